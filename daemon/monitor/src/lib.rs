//! The monitor: a live view of the estimation service in a terminal, recordings, and a live stream for Foxglove and
//! PlotJuggler. It runs outside of the real-time process.
//!
//! A monitor needs one iceoryx2 node, one of the [`shared_types::service::MAX_READERS`] subscribers of each topic, and one
//! client while a command is under way. It copies every message and holds no sample. The service never waits for it: a
//! monitor that is slow or stopped misses the oldest messages.
//!
//! | module | holds |
//! |---|---|
//! | [`link`] | one instance, followed across its restarts |
//! | [`model`] | what is known of it: the newest estimate and status, the past, the error against the truth |
//! | [`view`] | what the terminal shows of the model; what each word of the status means |
//! | [`lines`] | `--once` and `--json` |
//! | [`topics`], [`messages`] | what a recording and a live stream carry: channels, and their messages with schemas |
//! | [`motion`] | Foxglove's own messages, where they say the same as ours |
//! | [`record`], [`serve`] | an MCAP file; a WebSocket server |
//! | [`cli`] | arguments |
//!
//! Depends on `shared_types` and `command_line`, never on the service or the simulator.

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
