//! The monitor: a live view of the estimation service in a terminal, recordings, and a live stream for Foxglove and
//! PlotJuggler. It is a process beside the service. Depends on `shared_types` and `command_line`, never on the service or
//! the simulator.
//!
//! A monitor uses one iceoryx2 node, one of the [`shared_types::service::MAX_READERS`] subscribers of each topic, and one
//! client while a command is under way. It copies every message and holds no loan. The service never waits for it: a
//! monitor that is slow or stopped loses the oldest messages.
//!
//! | module | holds |
//! |---|---|
//! | [`link`] | one instance, followed across its restarts |
//! | [`model`] | the newest estimate and status, their history, the error against the truth |
//! | [`view`] | the terminal's view of the model; the meaning of each word of the status |
//! | [`lines`] | `--once` and `--json` |
//! | [`topics`], [`messages`] | contents of a recording and a live stream: channels, and their messages with schemas |
//! | [`motion`] | Foxglove's own messages for pose, velocities and log |
//! | [`record`], [`serve`] | an MCAP file; a WebSocket server |
//! | [`cli`] | the command line |

pub mod cli;
pub mod lines;
pub mod link;
pub mod messages;
pub mod model;
pub mod motion;
pub mod record;
pub mod serve;
pub mod topics;
pub mod view;

pub use cli::main_with_args;
