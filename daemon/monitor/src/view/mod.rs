//! The view: what the terminal and `--once` show of a [`Model`](crate::model::Model).
//!
//! Every file depends on the ones above it in this table, and on nothing below:
//!
//! | module | holds |
//! |---|---|
//! | [`mod@format`] | numbers and times in few characters |
//! | [`status_words`] | what each word of the status means, and what to do about it |
//! | [`notes`] | all there is to know now, counts included; the verdict |
//! | [`theme`] | colours |
//! | [`sections`] | the view as lines of text |
//! | [`state`] | what the operator has chosen to see |
//! | [`keys`] | what the keys do: the bottom line and the help |
//! | [`pictures`] | traces over time, the histogram |
//! | [`draw`] | where everything stands on the screen |
//! | [`screen`] | the terminal: when to draw, and obeying the keys |

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
