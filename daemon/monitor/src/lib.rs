//! What people look at: a live view of the estimation service in a terminal, recordings and a live stream for Foxglove and
//! PlotJuggler; outside of the real-time process.
//!
//! A monitor takes one node and one of the places for readers of estimates, statuses and truths (there are
//! [`shared_types::service::MAX_READERS`] of each), and for the time of a command one of the clients. It copies what it
//! takes and holds no sample; one that is slow or stopped misses the oldest, and the service never waits for it.
//!
//! | module | holds |
//! |---|---|
//! | [`cli`] | arguments; `--once` and `--json` |
//! | [`record`], [`serve`] | an MCAP file; a WebSocket server |
//! | [`topics`], [`messages`] | what both carry: channels, and their messages with schemas |
//! | [`link`] | one instance, followed across its restarts |
//! | [`model`], [`history`], [`truth`] | what is shown, from what was heard |
//! | [`words`] | what the status means and what to do |
//! | [`sections`], [`mod@format`] | the view as lines of text |
//! | [`draw`], [`pictures`], [`theme`] | where they stand, pictures of the past, colours |
//! | [`keys`] | what the keys do, said |
//! | [`screen`] | the terminal: when to draw, and obeying the keys |

pub mod cli;
pub mod draw;
pub mod format;
pub mod history;
pub mod keys;
pub mod link;
pub mod messages;
pub mod model;
pub mod motion;

pub mod pictures;
pub mod record;
pub mod screen;
pub mod sections;
pub mod serve;
pub mod theme;
pub mod topics;
pub mod truth;
pub mod words;

pub use cli::main_with_args;

/// Of this program.
const VERSION: &str = env!("CARGO_PKG_VERSION");
