//! The view of a [`Model`](crate::model::Model), in the terminal and for `--once`.
//!
//! A file may depend on those above it in this table, not on those below:
//!
//! | module | holds |
//! |---|---|
//! | [`mod@format`] | numbers and times in few characters |
//! | [`status_words`] | the meaning of each word of the status, and what to do about it |
//! | [`notes`] | notes on the present state, and the overall verdict |
//! | [`theme`] | colours |
//! | [`sections`] | the view as lines of text |
//! | [`state`] | what the operator has chosen to see |
//! | [`keys`] | the keys: the bottom line and the help |
//! | [`pictures`] | traces over time, the histogram |
//! | [`draw`] | the layout of the screen |
//! | [`screen`] | the terminal: when to draw, and what each key does |

pub mod draw;
pub mod format;
pub mod keys;
pub mod notes;
pub mod pictures;
pub mod screen;
pub mod sections;
pub mod state;
pub mod status_words;
pub mod theme;
