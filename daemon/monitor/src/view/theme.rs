//! Colours, or bold and reversed text in their place. The view is complete without colours: each repeats a word beside it.

use crate::view::status_words::Level;
use ratatui::style::{Color, Modifier, Style};

/// The style of the view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Theme {
    /// Whether colours are used; without them, important text is bold or reversed.
    pub is_coloured: bool,
}

impl Theme {
    /// The verdict and questions.
    pub fn banner(self, level: Level) -> Style {
        let reversed = Style::new().add_modifier(Modifier::REVERSED | Modifier::BOLD);
        match self.is_coloured {
            false if level < Level::Caution => Style::new().add_modifier(Modifier::BOLD),
            false => reversed,
            true => Style::new().fg(Color::Black).bg(Self::colour(level)).add_modifier(Modifier::BOLD),
        }
    }

    /// A word.
    pub fn word(self, level: Level) -> Style {
        let bold = Style::new().add_modifier(Modifier::BOLD);
        match self.is_coloured {
            true if level != Level::Info => bold.fg(Self::colour(level)),
            _ => bold,
        }
    }

    /// The title of a section.
    pub fn title(self) -> Style {
        let bold = Style::new().add_modifier(Modifier::BOLD);
        if self.is_coloured { bold.fg(Color::Cyan) } else { bold.add_modifier(Modifier::UNDERLINED) }
    }

    /// Text for reference only.
    pub fn faint(self) -> Style {
        Style::new().add_modifier(Modifier::DIM)
    }

    /// A trace or a histogram.
    pub fn trace(self) -> Style {
        if self.is_coloured { Style::new().fg(Color::Blue) } else { Style::new() }
    }

    fn colour(level: Level) -> Color {
        match level {
            Level::Good => Color::Green,
            Level::Info => Color::Cyan,
            Level::Caution => Color::Yellow,
            Level::Alarm => Color::Red,
        }
    }
}
