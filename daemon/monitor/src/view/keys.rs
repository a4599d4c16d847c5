//! The keys: the bottom line, which also shows questions and answers, and the help.

use crate::model::Model;
use crate::view::format::cut;
use crate::view::state::View;
use crate::view::status_words::Level;
use crate::view::theme::Theme;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::Line;
use ratatui::widgets::{Block, Clear, Paragraph};

/// Draws the last line, with `more` among its keys, and the help where it is wanted.
pub fn draw_bottom(frame: &mut Frame<'_>, model: &Model, view: &View, more: &str) {
    let area = frame.area();
    let bottom = Rect { y: area.bottom() - 1, height: 1, ..area };
    frame.render_widget(bottom_line(model, view, more, usize::from(area.width)), bottom);
    if view.shows_help {
        draw_help(frame, view.theme);
    }
}

fn bottom_line(model: &Model, view: &View, more: &str, width: usize) -> Line<'static> {
    let theme = view.theme;
    if view.asks_reset {
        let question = " Forget the state and all that was learned? y: yes, any other key: no";
        return Line::styled(format!("{question:<width$}"), theme.banner(Level::Alarm));
    }
    let freeze = if model.is_frozen() { "f learn again" } else { "f freeze" };
    if let Some((level, verdict)) = &view.paused {
        let answer = view.message.as_ref().map_or(String::new(), |(_, text)| format!("; {text}"));
        let text = cut(&format!(" PAUSED, p goes on; now: {verdict}{answer}"), width);
        return Line::styled(format!("{text:<width$}"), theme.banner(Level::Caution.max(*level)));
    }
    if let Some((level, text)) = &view.message {
        return Line::styled(format!(" {}", cut(text, width.saturating_sub(1))), theme.word(*level));
    }
    let keys = format!(" q quit  p pause  s save  {freeze}  r reset{more}  ? help");
    Line::styled(keys, theme.faint())
}

/// What keys do and columns mean.
const HELP: &str = "\
\x20q  quit (also Ctrl-C)            p  let the picture stand still, go on
 s  write what was learned        f  freeze learning, learn again
 r  forget state and learned      tab, 1, 2  the other part, where both
 ?  this help; any key closes it     do not fit (body; linear plant)

 error      size of the output error: measured minus estimated
 zone       width of the dead zone: nothing is learned from a smaller error
 bound      what it settles below, if daemon check says so; no covariance
 NIS        error² over its variance: 1 in the mean; or bound, below 96 columns
 σ          the dead zone's output; 0: within the noise, nothing learned
 uncovered  0 %: at a center; 100 %: no center knows this motion
 norm       of the learned function in its native space
 solver     its error in the learned force; below 96 columns instead of norm
 age        of the newest measurement of this channel

 learned    the unknown force, torque or input, as found so far
 learns: the error is beyond the zone     within: it is not
 predicts: no measurement         stale: for too long
 frozen: by an operator           grounded: the vehicle is on the ground
 Pictures: a second per column, newest at the right; a blank is a gap.
 ↑ ↓ their top and bottom    ± 1 σ    r p y  roll, pitch, yaw
 \"off the truth\": mean over 2 s, where a simulator tells the truth.";

fn draw_help(frame: &mut Frame<'_>, theme: Theme) {
    let area = frame.area();
    let height = (HELP.lines().count() as u16 + 2).min(area.height);
    let width = 78.min(area.width);
    let place =
        Rect { x: area.x + (area.width - width) / 2, y: area.y + (area.height - height) / 2, width, height };
    frame.render_widget(Clear, place);
    let block = Block::bordered().title(" help ").border_style(theme.title());
    frame.render_widget(Paragraph::new(HELP).block(block), place);
}
