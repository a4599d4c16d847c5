//! Lays a figure out and writes it as an SVG file.

use super::axis::{Axis, Ticks};
use super::figure::{Figure, PageSize, Panel, Shade};
use super::look::{BAND, Look, Marker, layer, looks};
use super::svg::{Anchor, Point, Svg, text_width};
use anyhow::{Context, bail};
use std::cmp::Reverse;
use std::path::Path;

/// How large a figure is. Lengths are in units of its own, of which a tick's label is 13 high.
struct Page {
    width: f64,
    /// Height of a single panel; several are lower.
    panel_height: f64,
    /// About this many ticks along the x axis.
    x_ticks: usize,
    /// About this far from one tick of a y axis to the next.
    y_tick_distance: f64,
    /// Factor on the width of all strokes.
    pen: f64,
    /// CSS pixels of 1/96 inch to the unit.
    css_px: f64,
}

const SCREEN: Page =
    Page { width: 860.0, panel_height: 400.0, x_ticks: 8, y_tick_distance: 38.0, pen: 1.0, css_px: 1.0 };
const COLUMN: Page = Page {
    width: 448.0,
    panel_height: 250.0,
    x_ticks: 6,
    y_tick_distance: 26.0,
    pen: 0.7,
    css_px: 8.5 / 2.54 * 96.0 / 448.0,
};

const RIGHT_MARGIN: f64 = 20.0;
const TITLE_HEIGHT: f64 = 34.0;
const LEGEND_ROW: f64 = 18.0;
const LEGEND_SAMPLE: f64 = 30.0;
const PANEL_GAP: f64 = 14.0;
const TITLE_SIZE: f64 = 17.0;
const LABEL_SIZE: f64 = 14.5;
const TICK_SIZE: f64 = 13.0;
const MARKER_RADIUS: f64 = 3.2;

/// A line keeps about this many points: more than twice the pixels of a panel.
const POINTS_PER_LINE: usize = 2000;
/// All lines together keep about this many: some 0.2 MB.
const POINTS_PER_FIGURE: usize = 30_000;
/// A dashed line has about this many dashes at most. A noisy line would otherwise be drawn as dust.
const DASHES_PER_LINE: f64 = 500.0;
/// A line with at most this many points has a marker at each.
const MARKED_POINTS: usize = 30;

const WHITE: &str = "#fff";
const SHADE: &str = "#fae6cd";
const FRAME: &str = "#5a5a5a";
const GRID: &str = "#e0e0e0";
const MINOR_GRID: &str = "#f0f0f0";

/// Whether a figure can be written to this file: to be asked before a long measurement.
pub(crate) fn check_target(file: &Path) -> anyhow::Result<()> {
    if !file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("svg")) {
        bail!("cannot write the plot {}: plots are SVG; needed: FILE.svg", file.display());
    }
    let directory = file.parent().filter(|parent| !parent.as_os_str().is_empty());
    if let Some(directory) = directory.filter(|directory| !directory.is_dir()) {
        bail!("cannot write the plot {}: there is no directory {}", file.display(), directory.display());
    }
    Ok(())
}

impl Figure {
    /// The figure as an SVG document.
    pub(crate) fn svg(&self) -> String {
        Layout::of(self).svg()
    }

    /// Writes the figure as SVG.
    pub(crate) fn write(&self, file: &Path) -> anyhow::Result<()> {
        check_target(file)?;
        std::fs::write(file, self.svg()).with_context(|| format!("cannot write the plot {}", file.display()))
    }
}

/// The figure laid out.
struct Layout<'a> {
    figure: &'a Figure,
    page: &'static Page,
    x: Axis,
    left: f64,
    height: f64,
    plots: Vec<Plot<'a>>,
}

/// One panel laid out.
struct Plot<'a> {
    panel: &'a Panel,
    looks: Vec<Look>,
    /// The points of each line that are drawn, as runs without a gap.
    runs: Vec<Vec<Vec<Point>>>,
    y: Axis,
    ticks: Ticks,
    top: f64,
    bottom: f64,
    legend: Vec<LegendEntry<'a>>,
}

struct LegendEntry<'a> {
    label: &'a str,
    look: Look,
    is_marked: bool,
    /// From the frame's left.
    x: f64,
    baseline: f64,
}

/// Whether a point has a place on these axes. Beyond 1e300 a span would overflow.
fn has_place((x, y): Point, log_x: bool, log_y: bool) -> bool {
    let fits = |value: f64, log: bool| value.abs() < 1e300 && (!log || value > 0.0);
    fits(x, log_x) && fits(y, log_y)
}

/// Runs of points without a gap, thinned to about `budget` points in all. Each bucket keeps its lowest and its highest
/// point, so that no spike is lost.
fn runs(points: &[Point], has_place: impl Fn(Point) -> bool, budget: usize) -> Vec<Vec<Point>> {
    let per_bucket = (2 * points.len()).div_ceil(budget.max(2)).max(1);
    let thinned = |run: &[Point]| {
        if per_bucket <= 2 {
            return run.to_vec();
        }
        let mut kept = vec![run[0]];
        for bucket in run.chunks(per_bucket) {
            let by_height = |&a: &usize, &b: &usize| bucket[a].1.total_cmp(&bucket[b].1);
            let low = (0..bucket.len()).min_by(by_height).unwrap_or(0);
            let high = (0..bucket.len()).max_by(by_height).unwrap_or(0);
            kept.extend([bucket[low.min(high)], bucket[low.max(high)]]);
        }
        kept.push(run[run.len() - 1]);
        kept
    };
    points.split(|&point| !has_place(point)).filter(|run| !run.is_empty()).map(thinned).collect()
}

/// The dashes, longer where the line would have too many of them.
fn stretched(dashes: &[f64], points: &[Point]) -> Vec<f64> {
    let length: f64 = points.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).sum();
    let period: f64 = dashes.iter().sum();
    let stretch = (length / (period * DASHES_PER_LINE)).max(1.0);
    dashes.iter().map(|dash| dash * stretch).collect()
}

impl<'a> Layout<'a> {
    fn of(figure: &'a Figure) -> Self {
        let page = match figure.page {
            PageSize::Screen => &SCREEN,
            PageSize::Column => &COLUMN,
        };
        let (panels, log_x) = (&figure.panels, figure.log_x);
        let placed = |panel: &'a Panel| {
            let of_lines = panel.lines.iter().flat_map(|line| &line.points).copied();
            let of_band = panel.band.iter().flat_map(|band| &band.points);
            let of_band = of_band.flat_map(|&(x, low, high)| [(x, low), (x, high)]);
            of_lines.chain(of_band).filter(move |&point| has_place(point, log_x, panel.log_y))
        };
        // A time axis ends with its data; on a logarithmic one the outermost markers need room.
        let margin = if log_x { 0.05 } else { 0.0 };
        let x = Axis::around(panels.iter().flat_map(placed).map(|point| point.0), log_x, margin)
            .completed(page.x_ticks);

        let n_lines: usize = panels.iter().map(|panel| panel.lines.len()).sum();
        let budget = POINTS_PER_LINE.min(POINTS_PER_FIGURE / n_lines.max(1));
        let panel_height = (page.panel_height / (panels.len() as f64).powf(0.72)).max(110.0);
        let n_ticks = ((panel_height / page.y_tick_distance) as usize).clamp(3, 8);
        let plot = |panel: &'a Panel| {
            let y = Axis::around(placed(panel).map(|point| point.1), panel.log_y, 0.05);
            let has_place = |point| has_place(point, log_x, panel.log_y);
            Plot {
                panel,
                looks: looks(&panel.lines),
                runs: panel.lines.iter().map(|line| runs(&line.points, has_place, budget)).collect(),
                y,
                ticks: y.ticks(n_ticks),
                top: 0.0,
                bottom: 0.0,
                legend: Vec::new(),
            }
        };
        let mut plots: Vec<Plot> = panels.iter().map(plot).collect();
        let labels = plots.iter().flat_map(|plot| &plot.ticks.major);
        let widest_label = labels.map(|(_, label)| text_width(label, TICK_SIZE)).fold(0.0, f64::max);
        let left = 12.0 + LABEL_SIZE + 8.0 + widest_label + 7.0;

        let mut cursor = if figure.title.is_empty() { 12.0 } else { TITLE_HEIGHT };
        let mut shown: Vec<(&str, Look)> = Vec::new();
        for plot in &mut plots {
            let names = plot.panel.lines.iter().map(|line| line.label.as_str());
            let band = plot.panel.band.iter().map(|band| (band.label.as_str(), BAND));
            let entries: Vec<_> = names
                .zip(plot.looks.iter().copied())
                .chain(band)
                .filter(|(label, _)| !label.is_empty())
                .collect();
            // A legend is repeated only where it would differ.
            if !entries.is_empty() && shown != entries {
                cursor = plot.lay_out_legend(cursor, page.width - RIGHT_MARGIN - left);
                shown = entries;
            } else if plot.ticks.multiplier.is_some() {
                cursor += 10.0;
            }
            (plot.top, plot.bottom) = (cursor, cursor + panel_height);
            cursor = plot.bottom + PANEL_GAP;
        }
        let height = (cursor - PANEL_GAP + 50.0).ceil();
        Self { figure, page, x, left, height, plots }
    }

    fn right(&self) -> f64 {
        self.page.width - RIGHT_MARGIN
    }

    fn at_x(&self, value: f64) -> f64 {
        self.left + self.x.position(value) * (self.right() - self.left)
    }

    fn svg(&self) -> String {
        let mut svg = Svg::new((self.page.width, self.height), self.page.css_px, self.page.pen);
        let middle = 0.5 * (self.left + self.right());
        svg.text(&self.figure.title, (middle, 21.0), TITLE_SIZE, Anchor::Middle);
        let x_ticks = self.x.ticks(self.page.x_ticks);
        for plot in &self.plots {
            for (left, right) in self.figure.shades.iter().filter_map(|shade| self.ends(shade)) {
                let (top, bottom) = (plot.top, plot.bottom);
                svg.area(&[(left, top), (right, top), (right, bottom), (left, bottom)], SHADE);
            }
            self.draw_band(&mut svg, plot);
            self.draw_grid(&mut svg, plot, &x_ticks);
            self.draw_lines(&mut svg, plot);
            self.draw_frame(&mut svg, plot, &x_ticks);
            self.draw_legend(&mut svg, plot);
        }
        self.name_shades(&mut svg);
        let bottom = self.plots.last().map_or(0.0, |plot| plot.bottom);
        for (value, label) in &x_ticks.major {
            svg.text(label, (self.at_x(*value), bottom + 17.0), TICK_SIZE, Anchor::Middle);
        }
        if let Some(multiplier) = &x_ticks.multiplier {
            svg.text(multiplier, (self.right(), bottom + 37.0), TICK_SIZE, Anchor::End);
        }
        svg.text(&self.figure.x_label, (middle, bottom + 38.0), LABEL_SIZE, Anchor::Middle);
        svg.finish()
    }

    /// Left and right end of a shade within the frame; `None` outside of it.
    fn ends(&self, shade: &Shade) -> Option<(f64, f64)> {
        let (left, right) = (self.at_x(shade.from).max(self.left), self.at_x(shade.to).min(self.right()));
        // The shortest is still seen.
        (left <= right).then(|| (left, right.max(left + 1.5).min(self.right())))
    }

    /// In the gap below the first panel, or inside of it where it is the only one.
    fn name_shades(&self, svg: &mut Svg) {
        let Some(first) = self.plots.first() else { return };
        let baseline = if self.plots.len() > 1 { first.bottom + 12.0 } else { first.bottom - 8.0 };
        for shade in &self.figure.shades {
            let Some((left, right)) = self.ends(shade) else { continue };
            svg.text(&shade.label, (0.5 * (left + right), baseline), TICK_SIZE, Anchor::Middle);
        }
    }

    fn draw_grid(&self, svg: &mut Svg, plot: &Plot, x_ticks: &Ticks) {
        let major = |ticks: &Ticks| ticks.major.iter().map(|tick| tick.0).collect::<Vec<_>>();
        // All faint lines first, so that none of them crosses a stronger one.
        for (xs, ys, color, width) in [
            (&x_ticks.minor, &plot.ticks.minor, MINOR_GRID, 0.6),
            (&major(x_ticks), &major(&plot.ticks), GRID, 0.8),
        ] {
            for x in xs.iter().map(|&x| self.at_x(x)) {
                svg.line(&[(x, plot.top), (x, plot.bottom)], color, width, &[]);
            }
            for y in ys.iter().map(|&y| plot.at_y(y)) {
                svg.line(&[(self.left, y), (self.right(), y)], color, width, &[]);
            }
        }
    }

    fn draw_band(&self, svg: &mut Svg, plot: &Plot) {
        let Some(band) = &plot.panel.band else { return };
        let (log_x, log_y) = (self.figure.log_x, plot.panel.log_y);
        let fits = |&&(x, low, high): &&(f64, f64, f64)| {
            [low, high].into_iter().all(|y| has_place((x, y), log_x, log_y))
        };
        let every = band.points.len().div_ceil(POINTS_PER_LINE).max(1);
        let points: Vec<_> = band.points.iter().step_by(every).filter(fits).collect();
        let lower = points.iter().map(|(x, low, _)| (self.at_x(*x), plot.at_y(*low)));
        let upper = points.iter().rev().map(|(x, _, high)| (self.at_x(*x), plot.at_y(*high)));
        let corners: Vec<Point> = lower.chain(upper).collect();
        if corners.len() > 2 {
            svg.area(&corners, BAND.color);
        }
    }

    fn draw_lines(&self, svg: &mut Svg, plot: &Plot) {
        let mut order: Vec<usize> = (0..plot.panel.lines.len()).collect();
        // Stable; in each layer the first line comes last, on top: it is the one the figure is about.
        order.sort_by_key(|&i| (layer(plot.panel.lines[i].style), Reverse(i)));
        for i in order {
            let look = &plot.looks[i];
            for run in &plot.runs[i] {
                let places: Vec<Point> = run.iter().map(|&(x, y)| (self.at_x(x), plot.at_y(y))).collect();
                svg.line(&places, look.color, look.width, &stretched(look.dashes, &places));
                if places.len() == 1 && look.marker == Marker::None {
                    svg.disc(places[0], 0.6 * look.width, look.color);
                }
                if places.len() == 1 || plot.is_marked(i) {
                    places.iter().for_each(|&place| draw_marker(svg, place, look));
                }
            }
        }
        if plot.runs.iter().all(Vec::is_empty) {
            let place = (0.5 * (self.left + self.right()), 0.5 * (plot.top + plot.bottom) + 4.0);
            svg.text("no data", place, TICK_SIZE, Anchor::Middle);
        }
    }

    fn draw_frame(&self, svg: &mut Svg, plot: &Plot, x_ticks: &Ticks) {
        const TICK: f64 = 4.0;
        let (left, right, top, bottom) = (self.left, self.right(), plot.top, plot.bottom);
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
        svg.line(&corners, FRAME, 1.0, &[]);
        for (value, _) in &x_ticks.major {
            let x = self.at_x(*value);
            svg.line(&[(x, bottom), (x, bottom - TICK)], FRAME, 1.0, &[]);
        }
        for (value, label) in &plot.ticks.major {
            let y = plot.at_y(*value);
            svg.line(&[(left, y), (left + TICK, y)], FRAME, 1.0, &[]);
            svg.text(label, (left - 7.0, y + 4.2), TICK_SIZE, Anchor::End);
        }
        if let Some(multiplier) = &plot.ticks.multiplier {
            svg.text(multiplier, (left, top - 5.0), TICK_SIZE, Anchor::Start);
        }
        // A label longer than its panel is set smaller, so that neighbours do not run into each other.
        let room = (bottom - top + PANEL_GAP) / text_width(&plot.panel.y_label, LABEL_SIZE).max(1.0);
        let place = (12.0 + 0.75 * LABEL_SIZE, 0.5 * (top + bottom));
        svg.turned_text(&plot.panel.y_label, place, LABEL_SIZE * room.min(1.0), Anchor::Middle, true);
    }

    fn draw_legend(&self, svg: &mut Svg, plot: &Plot) {
        for entry in &plot.legend {
            let (start, end) = (self.left + entry.x, self.left + entry.x + LEGEND_SAMPLE);
            let height = entry.baseline - 4.2;
            svg.line(
                &[(start, height), (end, height)],
                entry.look.color,
                entry.look.width,
                entry.look.dashes,
            );
            if entry.is_marked {
                draw_marker(svg, (0.5 * (start + end), height), &entry.look);
            }
            svg.text(entry.label, (end + 6.0, entry.baseline), TICK_SIZE, Anchor::Start);
        }
    }
}

impl Plot<'_> {
    fn at_y(&self, value: f64) -> f64 {
        self.bottom - self.y.position(value) * (self.bottom - self.top)
    }

    /// Whether a line's points have markers.
    fn is_marked(&self, line: usize) -> bool {
        self.runs[line].iter().map(Vec::len).sum::<usize>() <= MARKED_POINTS
    }

    /// Places the legend from `cursor` on downwards in rows of this width, and returns where the frame begins.
    fn lay_out_legend(&mut self, mut cursor: f64, width: f64) -> f64 {
        // The power of ten that multiplies the ticks has the left end of the row.
        let multiplier = self.ticks.multiplier.as_ref();
        let start = multiplier.map_or(2.0, |multiplier| text_width(multiplier, TICK_SIZE) + 14.0);
        let mut x = start;
        let of_lines = self.panel.lines.iter().enumerate().filter(|(_, line)| !line.label.is_empty());
        let of_lines = of_lines.map(|(i, line)| (line.label.as_str(), self.looks[i], self.is_marked(i)));
        let of_band = self.panel.band.iter().map(|band| (band.label.as_str(), BAND, false));
        for (label, look, is_marked) in of_lines.chain(of_band).collect::<Vec<_>>() {
            let entry_width = LEGEND_SAMPLE + 6.0 + text_width(label, TICK_SIZE);
            if x > start && x + entry_width > width {
                x = start;
                cursor += LEGEND_ROW;
            }
            self.legend.push(LegendEntry { label, look, is_marked, x, baseline: cursor + 11.0 });
            x += entry_width + 20.0;
        }
        cursor + LEGEND_ROW
    }
}

fn draw_marker(svg: &mut Svg, (x, y): Point, look: &Look) {
    const SQUARE: [Point; 4] = [(-0.95, -0.95), (0.95, -0.95), (0.95, 0.95), (-0.95, 0.95)];
    const DIAMOND: [Point; 4] = [(0.0, -1.35), (1.35, 0.0), (0.0, 1.35), (-1.35, 0.0)];
    const TRIANGLE: [Point; 3] = [(0.0, -1.3), (1.15, 0.8), (-1.15, 0.8)];
    let at = |corners: &[Point], scale: f64| -> Vec<Point> {
        let radius = scale * MARKER_RADIUS;
        corners.iter().map(|(dx, dy)| (x + radius * dx, y + radius * dy)).collect()
    };
    match look.marker {
        Marker::None => {}
        Marker::Disc => svg.disc((x, y), MARKER_RADIUS, look.color),
        Marker::Square => svg.area(&at(&SQUARE, 1.0), look.color),
        Marker::Triangle => svg.area(&at(&TRIANGLE, 1.0), look.color),
        Marker::Diamond => svg.area(&at(&DIAMOND, 1.0), look.color),
        Marker::Ring => {
            svg.disc((x, y), 1.15 * MARKER_RADIUS, look.color);
            svg.disc((x, y), 0.6 * MARKER_RADIUS, WHITE);
        }
        Marker::Frame => {
            svg.area(&at(&SQUARE, 1.1), look.color);
            svg.area(&at(&SQUARE, 0.55), WHITE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::figure::{Band, Line, LineStyle};
    use super::super::look::ESTIMATES;
    use super::*;

    fn line(label: &str, style: LineStyle, point: impl Fn(f64) -> Point) -> Line {
        Line::new(label, style, (0..2000).map(|i| point(f64::from(i) * 0.01)).collect())
    }

    fn flight() -> Figure {
        let noise = |t: f64| (t * 7919.0).sin() * (t * 104_729.0).cos();
        let lines = |phase: f64| {
            vec![
                line("truth", LineStyle::Truth, |t| (t, (t + phase).sin())),
                line("observer", LineStyle::Estimate, |t| (t, (t + phase).sin() + 0.05 * noise(t))),
                line("without adaptation", LineStyle::Comparison, |t| (t, 0.7 * (t + phase).sin())),
            ]
        };
        let panel = |label: &str, phase| Panel::new(label, lines(phase));
        Figure::new(
            "A flight",
            "t (s)",
            vec![panel("v_x (m/s)", 0.0), panel("v_y (m/s)", 1.0), panel("v_z (m/s)", 2.0)],
        )
    }

    #[test]
    fn a_figure_holds_its_texts_once_and_every_line_in_its_colour() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("run-0.5.svg");
        flight().write(&file).unwrap();
        let svg = std::fs::read_to_string(file).unwrap();
        for text in ["A flight", "t (s)", "v_x (m/s)", "v_z (m/s)", "without adaptation"] {
            assert_eq!(svg.matches(&format!(">{text}<")).count(), 1, "{text}");
        }
        // Three panels and one legend.
        assert_eq!(svg.matches(ESTIMATES[0]).count(), 4);
        assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("\n\n"));
    }

    #[test]
    fn a_column_is_eight_and_a_half_centimeters_wide_with_room_for_its_labels() {
        let figure = Figure { page: PageSize::Column, ..flight() };
        let layout = Layout::of(&figure);
        let width_px: f64 =
            layout.svg().split("width=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
        assert!((width_px / 96.0 * 2.54 - 8.5).abs() < 1e-9, "{width_px}");
        // 7 points, at 72 to the inch.
        assert!((TICK_SIZE * COLUMN.css_px * 72.0 / 96.0 - 7.0).abs() < 0.05);
        assert!(layout.plots.iter().all(|plot| plot.ticks.major.len() >= 3));
    }

    #[test]
    fn a_shade_covers_its_stretch_and_no_more() {
        let shade = |from, to| Shade { from, to, label: "1".into() };
        let figure =
            Figure { shades: vec![shade(5.0, 10.0), shade(19.0, 30.0), shade(40.0, 50.0)], ..flight() };
        let layout = Layout::of(&figure);
        let ends: Vec<_> = figure.shades.iter().map(|shade| layout.ends(shade)).collect();
        let width = layout.right() - layout.left;
        let (from, to) = ends[0].unwrap();
        assert!((from - layout.left - 0.25 * width).abs() < 1e-9 && (to - from - 0.25 * width).abs() < 1e-9);
        assert_eq!(ends[1].unwrap().1, layout.right());
        assert_eq!(ends[2], None);
        assert_eq!(layout.svg().matches(SHADE).count(), 6, "two shades in three panels");
    }

    #[test]
    fn a_band_is_one_area_in_its_panel_and_an_entry_of_the_legend() {
        let mut figure = flight();
        let points = (0..5).map(|i| (f64::from(i), -3.0, if i == 2 { f64::INFINITY } else { 3.0 })).collect();
        figure.panels[1].band = Some(Band { label: "95 % band".into(), points });
        let layout = Layout::of(&figure);
        assert_eq!(layout.svg().matches(BAND.color).count(), 2);
        assert!(layout.plots[1].at_y(3.0) >= layout.plots[1].top, "it lies within the axis");
        assert!(layout.svg().contains("95 % band"));
    }

    #[test]
    fn another_extension_and_a_missing_directory_are_refused() {
        for name in ["figure.pdf", "figure.png", "figure"] {
            let error = flight().write(Path::new(name)).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("needed: FILE.svg"), "{error}");
        }
        let error = check_target(Path::new("nowhere/at/all.svg")).unwrap_err().to_string();
        assert!(error.contains("nowhere/at"), "{error}");
        assert!(check_target(Path::new("figure.SVG")).is_ok());
    }

    #[test]
    fn constant_empty_and_broken_data_still_make_a_figure() {
        let broken =
            |t: f64| (t, if (5.0..6.0).contains(&t) { f64::NAN } else { 1e308 * f64::from(t > 19.0) });
        let panels = [
            Panel::new("constant", vec![line("a", LineStyle::Estimate, |t| (t, 3.0))]),
            Panel::new("zero", vec![line("b", LineStyle::Truth, |t| (t, 0.0))]),
            Panel::new("none", vec![]),
            Panel::new("broken", vec![line("c", LineStyle::Comparison, broken)]),
        ];
        for panels in [&panels[..], &panels[1..2], &panels[2..3], &[]] {
            let svg = Layout::of(&Figure::new("", "", panels.to_vec())).svg();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
        let has_place = |point| has_place(point, false, false);
        let runs = runs(&panels[3].lines[0].points, has_place, POINTS_PER_LINE);
        assert_eq!(runs.len(), 2, "a gap from 5 to 6, and nothing beyond 19");
        assert!(runs.iter().flatten().all(|point| point.1 == 0.0));
    }

    #[test]
    fn thinning_keeps_spikes_and_both_ends() {
        let mut all: Vec<Point> =
            (0..1_000_000).map(|i| (f64::from(i), (f64::from(i) * 1e-4).sin())).collect();
        all[314_159].1 = 50.0;
        let kept = runs(&all, |_| true, POINTS_PER_LINE).remove(0);
        assert!(kept.len() <= POINTS_PER_LINE + 4, "{}", kept.len());
        assert!(kept.contains(&all[314_159]));
        assert_eq!((kept[0], kept[kept.len() - 1]), (all[0], all[all.len() - 1]));
        assert!(kept.windows(2).all(|pair| pair[0].0 <= pair[1].0), "order");
    }
}
