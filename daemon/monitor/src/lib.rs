//! What people look at: a live view of the estimation service in a terminal, recordings and a live stream for Foxglove and
//! PlotJuggler; outside of the real-time process.
//!
//! A monitor takes one node and one of the places for readers of estimates, statuses and truths (there are
//! [`shared_types::service::MAX_READERS`] of each), and for the time of a command one of the clients. It copies what it
//! takes and holds no sample; one that is slow or stopped misses the oldest, and the service never waits for it.
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
