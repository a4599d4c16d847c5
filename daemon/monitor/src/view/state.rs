//! The state of the view: what the operator has chosen to see, and messages to the operator.

use crate::view::status_words::Level;
use crate::view::theme::Theme;

/// What the operator has chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Colours or none.
    pub theme: Theme,
    /// While the picture is paused: the present verdict, which is still shown.
    pub paused: Option<(Level, String)>,
    /// Whether the help covers it.
    pub shows_help: bool,
    /// Whether a reset waits for its confirmation.
    pub asks_reset: bool,
    /// The answer to the last command, or that one is under way.
    pub message: Option<(Level, String)>,
    /// Which part is shown where there is no room for all.
    pub page: usize,
}

impl View {
    /// The view that a start shows.
    pub fn new(theme: Theme) -> Self {
        Self { theme, paused: None, shows_help: false, asks_reset: false, message: None, page: 0 }
    }
}
