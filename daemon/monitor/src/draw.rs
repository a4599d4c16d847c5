//! Where things stand on the screen: a pure function of model, view and size.
//!
//! With 80 columns and 24 lines everything that matters is there; more lines make the pictures of the past taller and
//! show more notes and facts, more columns make them longer.

use crate::format::{cut, number};
use crate::history::BUCKET_NS;
use crate::model::{Model, Part, Presence, Vector};
use crate::sections::{
    LABEL, Theme, heading, latency_lines, note_lines, sample_lines, service_lines, trust_lines, truth_text,
    vectors_of, verdict_line,
};
use crate::words::{Level, Now};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph, Sparkline};

/// What the operator has chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Colours or none.
    pub theme: Theme,
    /// While the picture stands still: the verdict of now, which must not be missed.
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

/// Columns from which on latency and channels get their wide form.
const WIDE: u16 = 110;
/// Columns of the narrow and the wide latencies, and the space behind.
const LATENCY_COLUMNS: [u16; 2] = [43, 72];
/// Columns of the table of trust.
const TRUST_COLUMNS: u16 = 81;
/// Columns of a number and the name of its axis.
const VALUE: u16 = 11;

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, model: &Model, view: &View, now: Now) {
    let area = frame.area();
    if area.width == 0 || area.height == 0 {
        return;
    }
    let plan = Plan::of(model, view, area);
    let (theme, width) = (view.theme, usize::from(area.width));
    let mut rows = Rows { area: Rect { height: area.height.saturating_sub(1), ..area }, y: 0 };
    rows.line(frame, heading(model, theme, width));
    rows.line(frame, verdict_line(model, now, theme, width));
    let notes = note_lines(model, now, theme, width, plan.notes);
    for k in 0..plan.notes {
        rows.line(frame, notes.get(k).cloned().unwrap_or_default());
    }
    rows.gap(plan.has_gaps);

    let old = if matches!(model.presence, Presence::Away { .. }) { theme.faint() } else { Style::new() };
    rows.line(frame, state_title(model, &plan, theme, width));
    for vector in vectors_of(model, &plan.parts) {
        draw_vector(frame, &mut rows, vector, &plan, theme, old, now);
    }
    rows.gap(plan.has_gaps);
    draw_trust(frame, &mut rows, model, &plan, theme, old, now);
    rows.gap(plan.has_gaps);
    let samples = sample_lines(model, theme, width, plan.samples);
    for k in 0..plan.samples {
        rows.line(frame, samples.get(k).cloned().unwrap_or_default().patch_style(old));
    }
    rows.gap(plan.has_gaps);
    draw_latency_and_service(frame, &mut rows, model, theme, old);

    let bottom = Rect { y: area.bottom() - 1, height: 1, ..area };
    frame.render_widget(bottom_line(model, view, &plan, width), bottom);
    if view.shows_help {
        draw_help(frame, theme);
    }
}

/// How the lines are shared out.
struct Plan {
    parts: Vec<Part>,
    /// There are parts on other pages.
    has_pages: bool,
    notes: usize,
    samples: usize,
    trace_height: u16,
    has_gaps: bool,
}

impl Plan {
    /// The least lines come first; what is left over goes to gaps, then to taller traces, then to notes.
    fn of(model: &Model, view: &View, area: Rect) -> Self {
        let all = model.parts();
        // Heading, verdict, titles of state and trust, samples, latencies, keys.
        let least = |parts: &[Part]| 2 + 2 + 2 + 5 + 1 + state_rows(model, parts) + parts.len();
        const LEAST_NOTES: usize = 3;
        let height = usize::from(area.height);
        let (body, linear): (Vec<_>, Vec<_>) = all.iter().copied().partition(|part| *part != Part::Linear);
        let has_pages = !body.is_empty() && !linear.is_empty() && least(&all) + LEAST_NOTES > height;
        let parts = match has_pages {
            false => all,
            true if view.page.is_multiple_of(2) => body,
            true => linear,
        };
        let mut spare = height.saturating_sub(least(&parts));
        let mut take = |lines: usize| {
            let taken = if spare >= lines { lines } else { 0 };
            spare -= taken;
            taken
        };
        let mut notes = take(LEAST_NOTES);
        let has_gaps = take(4) > 0;
        let n_rows = state_rows(model, &parts);
        let mut trace_height = 1;
        if n_rows > 0 && take(n_rows) > 0 {
            trace_height += 1;
        }
        // The rest of the service's facts, at the bottom.
        take(5);
        notes += take(2);
        let samples = 2 + take(1);
        while trace_height < 4 && n_rows > 0 && take(n_rows) > 0 {
            trace_height += 1;
        }
        notes += (0..5).map(|_| take(1)).sum::<usize>();
        Self { parts, has_pages, notes, samples, trace_height, has_gaps }
    }
}

fn state_rows(model: &Model, parts: &[Part]) -> usize {
    vectors_of(model, parts).iter().map(|vector| vector.n_shown().div_ceil(3)).sum()
}

/// Lines from top to bottom, until there is no room.
struct Rows {
    area: Rect,
    y: u16,
}

impl Rows {
    /// The next lines, or nothing where they do not fit.
    fn next(&mut self, height: u16) -> Option<Rect> {
        let fits = self.y + height <= self.area.height;
        let rect = Rect { y: self.area.y + self.y, height, ..self.area };
        self.y = self.y.saturating_add(height);
        fits.then_some(rect)
    }

    fn line(&mut self, frame: &mut Frame<'_>, line: Line<'_>) {
        if let Some(rect) = self.next(1) {
            frame.render_widget(line, rect);
        }
    }

    fn gap(&mut self, wanted: bool) {
        self.y += u16::from(wanted);
    }
}

/// Part of an area from a column on, cut to what is there.
fn columns(rect: Rect, from: u16, width: u16) -> Rect {
    let from = from.min(rect.width);
    Rect { x: rect.x + from, width: width.min(rect.width - from), ..rect }
}

fn state_title(model: &Model, plan: &Plan, theme: Theme, width: usize) -> Line<'static> {
    let trace_columns = usize::from(trace_columns(width as u16));
    let seconds = trace_columns as f64 * BUCKET_NS as f64 / 1e9;
    let right = match truth_text(model, width.saturating_sub(LABEL)) {
        Some(truth) => truth,
        None if trace_columns > 0 => format!("the last {seconds:.0} s"),
        None => String::new(),
    };
    let title = format!("{:<LABEL$}", if plan.has_pages { " STATE  (tab)" } else { " STATE" });
    Line::from(vec![Span::styled(title, theme.title()), Span::styled(right, theme.faint())])
}

/// Columns of each of three axes.
fn axis_columns(width: u16) -> u16 {
    width.saturating_sub(LABEL as u16) / 3
}

fn trace_columns(width: u16) -> u16 {
    axis_columns(width).saturating_sub(VALUE + 2)
}

fn draw_vector(
    frame: &mut Frame<'_>,
    rows: &mut Rows,
    vector: &Vector,
    plan: &Plan,
    theme: Theme,
    old: Style,
    now: Now,
) {
    for (row, axes) in vector.axes[..vector.n_shown()].chunks(3).enumerate() {
        let Some(rect) = rows.next(plan.trace_height) else { return };
        if row == 0 {
            frame.render_widget(Line::raw(format!(" {}", vector.name)), columns(rect, 0, LABEL as u16));
        }
        for (k, axis) in axes.iter().enumerate() {
            let component = 3 * row + k;
            let place = columns(
                rect,
                LABEL as u16 + k as u16 * axis_columns(rect.width),
                axis_columns(rect.width).max(VALUE),
            );
            let value = format!("{:>9}", number(vector.now[component]));
            let mut lines = vec![Line::from(vec![
                Span::styled(format!("{axis:<2}"), theme.faint()),
                Span::styled(value, old.add_modifier(Modifier::BOLD)),
            ])];
            let trace = columns(place, VALUE + 1, trace_columns(rect.width));
            let values = vector.histories[component].last(usize::from(trace.width), now.monotonic_ns);
            if let Some((low, high)) = range(&values, vector.least_span) {
                if plan.trace_height >= 3 {
                    let faint = |value: f64| Line::styled(format!("  {:>9}", number(value)), theme.faint());
                    lines.resize(usize::from(plan.trace_height), Line::default());
                    lines[1] = faint(high);
                    lines[usize::from(plan.trace_height) - 1] = faint(low);
                }
                draw_trace(frame, trace, &values, (low, high), theme);
            }
            frame.render_widget(Paragraph::new(lines), columns(place, 0, VALUE));
        }
    }
}

/// Least and greatest value that a picture spans; `None` where there is nothing to show.
fn range(values: &[Option<f64>], least_span: f64) -> Option<(f64, f64)> {
    let known = || values.iter().flatten().copied();
    let (low, high) = (known().fold(f64::INFINITY, f64::min), known().fold(f64::NEG_INFINITY, f64::max));
    if low > high {
        return None;
    }
    let widen = ((least_span.max(1e-9 * low.abs().max(high.abs())) - (high - low)) / 2.0).max(0.0);
    Some((low - widen, high + widen))
}

/// Bars from the least value up; at least one eighth, so that a gap is told from a low value.
fn draw_trace(
    frame: &mut Frame<'_>,
    rect: Rect,
    values: &[Option<f64>],
    (low, high): (f64, f64),
    theme: Theme,
) {
    if rect.is_empty() {
        return;
    }
    let levels = u64::from(rect.height) * 8;
    let bar = |value: f64| 1 + ((value - low) / (high - low) * (levels - 1) as f64).round() as u64;
    let bars: Vec<Option<u64>> = values.iter().map(|value| value.map(bar)).collect();
    frame.render_widget(
        Sparkline::default().data(bars).max(levels).absent_value_symbol(" ").style(theme.trace()),
        rect,
    );
}

fn draw_trust(
    frame: &mut Frame<'_>,
    rows: &mut Rows,
    model: &Model,
    plan: &Plan,
    theme: Theme,
    old: Style,
    now: Now,
) {
    for (k, line) in trust_lines(model, &plan.parts, theme).into_iter().enumerate() {
        let Some(rect) = rows.next(1) else { return };
        frame.render_widget(line.patch_style(old), rect);
        let rest = columns(rect, TRUST_COLUMNS + 2, u16::MAX);
        let half = rest.width / 2;
        if half < 10 {
            continue;
        }
        for (side, histories, name) in
            [(0, &model.output_errors, "error until now"), (1, &model.native_norms, "norm until now")]
        {
            let place = columns(rest, side * half, half - 2);
            if k == 0 {
                frame.render_widget(Line::styled(name, theme.title()), place);
                continue;
            }
            let values =
                histories[plan.parts[k - 1] as usize].last(usize::from(place.width), now.monotonic_ns);
            if let Some((_, high)) = range(&values, 0.0) {
                draw_trace(frame, place, &values, (0.0, high.max(1e-12)), theme);
            }
        }
    }
}

fn draw_latency_and_service(frame: &mut Frame<'_>, rows: &mut Rows, model: &Model, theme: Theme, old: Style) {
    let is_wide = rows.area.width >= WIDE;
    let latency_columns = LATENCY_COLUMNS[usize::from(is_wide)];
    let latencies = latency_lines(model, theme, is_wide);
    let service = service_lines(model, theme);
    for k in 0..latencies.len().max(service.len()) {
        let Some(rect) = rows.next(1) else { return };
        if let Some(line) = latencies.get(k) {
            frame.render_widget(line.clone().patch_style(old), columns(rect, 0, latency_columns));
        }
        if let Some(line) = service.get(k) {
            let place = columns(rect, latency_columns + 1, u16::MAX);
            let text = cut(&line.to_string(), usize::from(place.width));
            frame.render_widget(Line::styled(text, line.style.patch(old)), place);
        }
    }
}

fn bottom_line(model: &Model, view: &View, plan: &Plan, width: usize) -> Line<'static> {
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
    let pages = if plan.has_pages { "  tab next" } else { "" };
    if let Some((level, text)) = &view.message {
        return Line::styled(format!(" {}", cut(text, width.saturating_sub(1))), theme.word(*level));
    }
    let keys = format!(" q quit  p pause  s save  {freeze}  r reset{pages}  ? help");
    Line::styled(keys, theme.faint())
}

/// What keys do and columns mean.
const HELP: &str = "\
\x20q  quit (also Ctrl-C)            p  let the picture stand still, go on
 s  write what was learned        f  freeze learning, learn again
 r  forget state and learned      tab, 1, 2  the other part, where both
 ?  this help; any key closes it     do not fit (body; linear plant)

 error      size of the output error: measured minus estimated
 bound      what it settles below, if daemon check says so; no covariance
 σ          the dead zone's output; 0: within the noise, nothing learned
 uncovered  0 %: at a center; 100 %: no center knows this motion
 norm       of the learned function in its native space
 solver     error of the learned force by the local solver, estimated
 age        of the newest measurement of this channel

 learned    the unknown force, torque or input, as found so far
 learns: the dead zone is open    within: the error is within it
 predicts: no measurement         frozen: by an operator
 Pictures: half a second per column, newest at the right; a blank is a gap.
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
