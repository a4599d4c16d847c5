//! Graphics of the history: traces over time, and the histogram of a latency.

use crate::model::history::Histogram;
use crate::view::theme::Theme;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::Line;
use ratatui::widgets::Sparkline;

/// Least and greatest value that a picture spans; `None` where there is nothing to show.
pub fn range(values: &[Option<f64>], least_span: f64) -> Option<(f64, f64)> {
    let known = || values.iter().flatten().copied();
    let (low, high) = (known().fold(f64::INFINITY, f64::min), known().fold(f64::NEG_INFINITY, f64::max));
    if low > high {
        return None;
    }
    let widen = ((least_span.max(1e-9 * low.abs().max(high.abs())) - (high - low)) / 2.0).max(0.0);
    Some((low - widen, high + widen))
}

/// Bars from the least value up; at least one eighth, so that a low value does not look like a gap.
pub fn draw_trace(
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

/// Columns of the picture of a histogram.
pub const HISTOGRAM_COLUMNS: u16 = Histogram::BINS as u16 + 4;

/// A title, bars whose greatest fills the height, and the axis of time below; nothing where there is no room.
///
/// The height of a bar is the root of its count, so that rare latencies are visible.
pub fn draw_histogram(frame: &mut Frame<'_>, rect: Rect, title: &str, histogram: &Histogram, theme: Theme) {
    if rect.height < 3 || rect.width < HISTOGRAM_COLUMNS {
        return;
    }
    let line = |y: u16| Rect { y: rect.y + y, height: 1, ..rect };
    frame.render_widget(Line::styled(title, theme.title()), line(0));
    let bars = Rect { y: rect.y + 1, height: rect.height - 2, width: Histogram::BINS as u16, ..rect };
    let greatest = histogram.counts.iter().copied().max().unwrap_or(0) as f64;
    let roots = histogram.counts.map(|count| (count > 0).then(|| (count as f64 / greatest).sqrt()));
    draw_trace(frame, bars, &roots, (0.0, 1.0), theme);
    let axis: String = ["1µs", "10µs", "100µs", "1ms", "10ms", "100ms", "1s", "10s"]
        .map(|label| format!("{label:<w$}", w = Histogram::BINS_PER_DECADE))
        .concat();
    frame.render_widget(Line::styled(axis, theme.faint()), line(rect.height - 1));
}
