//! What people look at: a live view of the estimation service in a terminal, outside of the real-time process.
//!
//! | module | holds |
//! |---|---|
//! | [`cli`] | arguments; `--once` and `--json` |
//! | [`link`] | one instance, followed across its restarts |
//! | [`model`], [`history`] | what is shown, from what was heard |
//! | [`words`] | what the status means and what to do |
//! | [`sections`], [`draw`], [`format`] | the view as lines, and where they stand |
//! | [`screen`] | the terminal: drawing and keys |

pub mod cli;
pub mod draw;
pub mod format;
pub mod history;
pub mod link;
pub mod model;
pub mod screen;
pub mod sections;
pub mod words;

pub use cli::main_with_args;
