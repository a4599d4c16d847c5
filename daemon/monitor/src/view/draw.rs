//! The layout of the screen: a pure function of model, view and size.
//!
//! 80 columns and 24 lines show everything essential. More lines make the traces taller and show more notes and facts; more
//! columns make the traces longer. A smaller terminal shows lines of text, the most important first.

use crate::model::history::BUCKET_NS;
use crate::model::{Model, Part, Presence, Vector};
use crate::view::format::{cut, number};
use crate::view::keys::draw_bottom;
use crate::view::notes::Now;
use crate::view::pictures::{HISTOGRAM_COLUMNS, draw_histogram, draw_trace, range};
use crate::view::sections::{
    LABEL, TRUST_COLUMNS, deviation_text, has_deviations, heading, latency_lines, note_lines, sample_lines,
    service_lines, state_lines, trust_lines, truth_text, vectors_of, verdict_line,
};
use crate::view::state::View;
use crate::view::theme::Theme;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

/// Columns and lines that the whole view needs.
const WHOLE: (u16, u16) = (80, 24);
/// Columns from which on latency and channels get their wide form.
const WIDE: u16 = 110;
/// Columns from which on there is room for a histogram.
const WITH_HISTOGRAM: u16 = 180;
/// Columns of the narrow and the wide latencies, and the space behind.
const LATENCY_COLUMNS: [u16; 2] = [43, 72];
/// Columns of a number and the name of its axis.
const VALUE: u16 = 11;
/// Columns of a deviation, where one is known.
const DEVIATION: u16 = 7;
/// Columns that a trace has at least.
const LEAST_TRACE: u16 = 4;

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, model: &Model, view: &View, now: Now) {
    let area = frame.area();
    if area.width == 0 || area.height == 0 {
        return;
    }
    if area.width < WHOLE.0 || area.height < WHOLE.1 {
        return draw_small(frame, model, view, now);
    }
    let plan = Plan::of(model, view, area);
    let (theme, width) = (view.theme, usize::from(area.width));
    let mut rows = Rows { area: Rect { height: area.height - 1, ..area }, y: 0 };
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

    let pages = if plan.has_pages { "  tab next" } else { "" };
    draw_bottom(frame, model, view, pages);
}

/// As many lines of text as there is room for, those that are too long with a mark.
fn draw_small(frame: &mut Frame<'_>, model: &Model, view: &View, now: Now) {
    let area = frame.area();
    let (theme, width) = (view.theme, usize::from(area.width));
    let mut rows = Rows { area: Rect { height: area.height - 1, ..area }, y: 0 };
    let all = model.parts();
    let notes = note_lines(model, now, theme, width, usize::from(area.height / 3).max(1));
    let lines = [heading(model, theme, width), verdict_line(model, now, theme, width)]
        .into_iter()
        .chain(notes)
        .chain(state_lines(model, &all, width))
        .chain(trust_lines(model, &all, theme, width))
        .chain(sample_lines(model, theme, width, 3));
    for line in lines {
        match line.width() > width {
            true => rows.line(frame, Line::styled(cut(&line.to_string(), width), line.style)),
            false => rows.line(frame, line),
        }
    }
    draw_bottom(frame, model, view, &format!("  {}×{} shows all", WHOLE.0, WHOLE.1));
}

/// How the lines are distributed.
struct Plan {
    parts: Vec<Part>,
    /// There are parts on other pages.
    has_pages: bool,
    notes: usize,
    samples: usize,
    trace_height: u16,
    /// Columns of a number, with its deviation where one is known.
    value_columns: u16,
    has_gaps: bool,
}

impl Plan {
    /// Each part gets its least number of lines first. The remaining lines go to gaps, then to taller traces, then to notes.
    fn of(model: &Model, view: &View, area: Rect) -> Self {
        let all = model.parts();
        let samples = sample_lines(model, view.theme, usize::from(area.width), 3).len().max(2);
        // Heading, verdict, titles of state and trust, samples, latencies, keys.
        let least = |parts: &[Part]| 2 + 2 + samples + 5 + 1 + state_rows(model, parts) + parts.len();
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
        while trace_height < 4 && n_rows > 0 && take(n_rows) > 0 {
            trace_height += 1;
        }
        notes += (0..2).map(|_| take(1)).sum::<usize>();
        let value_columns = if has_deviations(model, &parts) { VALUE + DEVIATION } else { VALUE };
        Self { parts, has_pages, notes, samples, trace_height, value_columns, has_gaps }
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
    let trace_columns = usize::from(trace_columns(plan.value_columns, width as u16));
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

/// Columns of a trace; none where only a stub would fit.
fn trace_columns(value_columns: u16, width: u16) -> u16 {
    let columns = axis_columns(width).saturating_sub(value_columns + 2);
    if columns < LEAST_TRACE { 0 } else { columns }
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
    let value_columns = plan.value_columns;
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
                axis_columns(rect.width).max(value_columns),
            );
            let value = format!("{:>9}", number(vector.now[component], vector.decimals()));
            let mut lines = vec![Line::from(vec![
                Span::styled(format!("{axis:<2}"), theme.faint()),
                Span::styled(value, old.add_modifier(Modifier::BOLD)),
                Span::styled(deviation_text(vector, component), old),
            ])];
            let trace = columns(place, value_columns + 1, trace_columns(value_columns, rect.width));
            let values = vector.histories[component].last(usize::from(trace.width), now.monotonic_ns);
            if let Some((low, high)) = range(&values, vector.least_span) {
                if plan.trace_height >= 3 {
                    let faint = |sign: char, value: f64| {
                        let value = number(value, vector.decimals());
                        Line::styled(format!("{sign} {value:>9}"), theme.faint())
                    };
                    lines.resize(usize::from(plan.trace_height), Line::default());
                    lines[1] = faint('↑', high);
                    lines[usize::from(plan.trace_height) - 1] = faint('↓', low);
                }
                draw_trace(frame, trace, &values, (low, high), theme);
            }
            frame.render_widget(Paragraph::new(lines), columns(place, 0, value_columns));
        }
    }
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
    let width = usize::from(rows.area.width);
    for (k, line) in trust_lines(model, &plan.parts, theme, width).into_iter().enumerate() {
        let Some(rect) = rows.next(1) else { return };
        frame.render_widget(line.patch_style(old), rect);
        let rest = columns(rect, TRUST_COLUMNS as u16 + 2, u16::MAX);
        let pictures = [
            (&model.output_errors, "error until now"),
            (&model.activations, "σ until now"),
            (&model.native_norms, "norm until now"),
        ];
        let each = rest.width / pictures.len() as u16;
        if each < 17 {
            continue;
        }
        for (place, (histories, name)) in (0..).map(|n| columns(rest, n * each, each - 2)).zip(pictures) {
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
    let n_lines = latencies.len().max(service.len());
    let whole =
        Rect { y: rows.area.y + rows.y, height: rows.area.height.saturating_sub(rows.y), ..rows.area };
    let histogram = columns(whole, whole.width.saturating_sub(HISTOGRAM_COLUMNS), HISTOGRAM_COLUMNS);
    let has_histogram = whole.width >= WITH_HISTOGRAM;
    for k in 0..n_lines {
        let Some(rect) = rows.next(1) else { break };
        if let Some(line) = latencies.get(k) {
            frame.render_widget(line.clone().patch_style(old), columns(rect, 0, latency_columns));
        }
        if let Some(line) = service.get(k) {
            let end = if has_histogram { HISTOGRAM_COLUMNS + 2 } else { 0 };
            let place =
                columns(rect, latency_columns + 1, rect.width.saturating_sub(latency_columns + 1 + end));
            let text = cut(&line.to_string(), usize::from(place.width));
            frame.render_widget(Line::styled(text, line.style.patch(old)), place);
        }
    }
    if has_histogram {
        let place = Rect { height: histogram.height.min(n_lines as u16), ..histogram };
        draw_histogram(frame, place, "SAMPLE TO OUTPUT, how often", &model.sample_to_output, theme);
    }
}
