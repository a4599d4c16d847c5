//! Figures: stacked panels over one x axis, as SVG for papers and PNG for everything else.
//!
//! plotters draws; layout, ticks and legends are ours, because its own axes know neither powers of ten nor
//! panels whose frames line up. Text is set in an embedded DejaVu Sans: a flight computer has no fonts.

use anyhow::{Context, anyhow, bail};
use plotters::coord::Shift;
use plotters::element::{Circle, PathElement, Polygon, Text};
use plotters::prelude::{
    BitMapBackend, BitMapElement, DrawingArea, DrawingBackend, IntoDrawingArea, SVGBackend,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color, FontDesc, FontFamily, FontStyle, FontTransform, IntoTextStyle, RGBColor, ShapeStyle, TextStyle,
    WHITE, register_font,
};
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Its name in the legend; an empty one is not listed.
    pub label: String,
    /// (x, y) in drawing order. A point that is not finite, or not positive on a logarithmic axis, is
    /// skipped and leaves a gap.
    pub points: Vec<(f64, f64)>,
    /// How it looks.
    pub style: LineStyle,
}

/// What a curve stands for; each looks different in black and white too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineStyle {
    /// What is known to be so: solid, thick, gray, underneath the others.
    Truth,
    /// What is being judged: thin and coloured, on top; the first of a panel solid, then dashed, then
    /// dash-dotted.
    Estimate,
    /// What it is judged against: dotted and light, with hollow markers.
    Comparison,
    /// A bound or a slope to hold the curves against: a hair line, dashed.
    Guide,
}

/// One set of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// The quantity and its unit.
    pub y_label: String,
    /// Its curves, in the order of the legend.
    pub lines: Vec<Line>,
    /// Logarithmic x axis; the same in all panels of a figure.
    pub log_x: bool,
    /// Logarithmic y axis.
    pub log_y: bool,
}

/// A stretch of the x axis in which something was different.
#[derive(Debug, Clone, PartialEq)]
pub struct Shade {
    /// Where it begins.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// Its name, set below it in the first panel's margin.
    pub label: String,
}

/// Writes the figure as `path_without_extension` + `.svg` and + `.png`, and returns the two paths.
///
/// # Errors
/// As [`draw_to`].
pub fn draw(
    path_without_extension: &Path,
    title: &str,
    x_label: &str,
    panels: &[Panel],
) -> anyhow::Result<Vec<PathBuf>> {
    draw_shaded(path_without_extension, title, x_label, panels, &[])
}

/// As [`draw`], with these stretches shaded in all panels.
///
/// # Errors
/// As [`draw_to`].
pub fn draw_shaded(
    path_without_extension: &Path,
    title: &str,
    x_label: &str,
    panels: &[Panel],
    shades: &[Shade],
) -> anyhow::Result<Vec<PathBuf>> {
    let figure = Figure { shades, ..Figure::new(&SCREEN, title, x_label, panels)? };
    both(path_without_extension, &figure)
}

/// As [`draw`], but 8.5 cm wide, one column of a printed page, with text of 7 points and without a title: a paper
/// has that below the figure.
///
/// # Errors
/// As [`draw_to`].
pub fn draw_column(
    path_without_extension: &Path,
    x_label: &str,
    panels: &[Panel],
) -> anyhow::Result<Vec<PathBuf>> {
    both(path_without_extension, &Figure::new(&COLUMN, "", x_label, panels)?)
}

fn both(path_without_extension: &Path, figure: &Figure) -> anyhow::Result<Vec<PathBuf>> {
    [("svg", Format::Svg), ("png", Format::Png)]
        .into_iter()
        .map(|(extension, format)| {
            // Not `with_extension`, which would cut "run-0.5" to "run-0".
            let mut name = path_without_extension.as_os_str().to_owned();
            name.push(format!(".{extension}"));
            let file = PathBuf::from(name);
            figure.write(&file, format)?;
            Ok(file)
        })
        .collect()
}

/// Writes the figure to one file, `.svg` or `.png`.
///
/// # Errors
/// Another extension; no panels, or panels that disagree about `log_x`; a file that cannot be written.
pub fn draw_to(file: &Path, title: &str, x_label: &str, panels: &[Panel]) -> anyhow::Result<()> {
    let format = Format::of(file)?;
    Figure::new(&SCREEN, title, x_label, panels)?.write(file, format)
}

/// Whether [`draw_to`] will know what to write: to be asked before a long measurement, not after it.
///
/// # Errors
/// An extension other than `.svg` and `.png`, or a directory that does not exist.
pub fn check_target(file: &Path) -> anyhow::Result<()> {
    Format::of(file)?;
    let directory = file.parent().filter(|parent| !parent.as_os_str().is_empty());
    if let Some(directory) = directory.filter(|directory| !directory.is_dir()) {
        bail!("cannot write the plot {}: there is no directory {}", file.display(), directory.display());
    }
    Ok(())
}

#[derive(Clone, Copy)]
enum Format {
    Svg,
    Png,
}

impl Format {
    fn of(file: &Path) -> anyhow::Result<Self> {
        match file.extension().map(|extension| extension.to_ascii_lowercase()) {
            Some(extension) if extension == "svg" => Ok(Self::Svg),
            Some(extension) if extension == "png" => Ok(Self::Png),
            _ => bail!(
                "cannot tell the format of the plot {}: its name must end in .svg or .png",
                file.display()
            ),
        }
    }
}

/// How large a figure is. Lengths are in units of its own, of which a text is 13 high.
#[derive(Debug)]
struct Page {
    width: f64,
    /// Height of a single panel; several are lower.
    panel_height: f64,
    /// About this many ticks along the x axis.
    x_ticks: usize,
    /// About this far from one tick of a y axis to the next.
    y_tick_distance: f64,
    /// All strokes are so many times as wide as on a screen.
    pen: f64,
    /// One unit of an SVG, in CSS pixels of 1/96 inch.
    css_px: f64,
    /// Pixels of a PNG to the unit: it stays sharp in print and on dense screens.
    png_scale: u32,
}

/// For a screen, or across a whole page.
const SCREEN: Page = Page {
    width: 860.0,
    panel_height: 400.0,
    x_ticks: 8,
    y_tick_distance: 38.0,
    pen: 1.0,
    css_px: 1.0,
    png_scale: 2,
};
/// 8.5 cm, and 535 dots per inch.
const COLUMN: Page = Page {
    width: 448.0,
    panel_height: 250.0,
    x_ticks: 6,
    y_tick_distance: 26.0,
    pen: 0.7,
    css_px: 8.5 / 2.54 * 96.0 / 448.0,
    png_scale: 4,
};

const RIGHT_MARGIN: f64 = 20.0;
const TITLE_HEIGHT: f64 = 34.0;
const LEGEND_ROW: f64 = 18.0;
const LEGEND_SAMPLE: f64 = 30.0;
const PANEL_GAP: f64 = 14.0;
const TITLE_SIZE: f64 = 17.0;
const LABEL_SIZE: f64 = 14.5;
const TICK_SIZE: f64 = 13.0;

/// plotters works in whole pixels; ten to the unit make them invisible in a vector file.
const SVG_SCALE: f64 = 10.0;
/// Each pixel of a PNG is the mean of 2 × 2: plotters sets glyphs at whole pixels, which would show as uneven
/// spacing.
const SUPERSAMPLING: u32 = 2;

/// The number of points a line keeps: more than twice the pixels of a panel.
const POINTS_PER_LINE: usize = 4000;
/// All lines together: about 0.5 MB of SVG.
const POINTS_PER_FIGURE: usize = 40_000;
/// A dashed line has at most this many dashes: each is an element of its own in SVG.
const DASHES_PER_LINE: f64 = 500.0;
/// Lines of no more points than this show where they are.
const MARKED_POINTS: usize = 30;

const SHADE: RGBColor = RGBColor(250, 230, 205);
const INK: RGBColor = RGBColor(30, 30, 30);
const FRAME: RGBColor = RGBColor(90, 90, 90);
const GRID: RGBColor = RGBColor(224, 224, 224);
const MINOR_GRID: RGBColor = RGBColor(240, 240, 240);
const TRUTH: RGBColor = RGBColor(165, 165, 165);
const GUIDE: RGBColor = RGBColor(120, 120, 120);
/// Okabe and Ito's colours, which the colour-blind tell apart: the dark ones here, the light ones below.
const ESTIMATES: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(213, 94, 0), RGBColor(0, 138, 100), RGBColor(150, 70, 130)];
const COMPARISONS: [RGBColor; 3] = [RGBColor(230, 159, 0), RGBColor(86, 180, 233), RGBColor(204, 121, 167)];

/// The names under which the font is looked up: ours in a PNG, the first that the viewer has in an SVG.
const FONT: &str = "DejaVu Sans, Verdana, Arial, sans-serif";

fn font(size: f64) -> anyhow::Result<FontDesc<'static>> {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    let registered =
        REGISTERED.get_or_init(|| register_font(FONT, FontStyle::Normal, dejavu::sans::regular()).is_ok());
    if !registered {
        bail!("the embedded font DejaVu Sans is damaged: rebuild the program");
    }
    Ok(FontDesc::new(FontFamily::Name(FONT), size, FontStyle::Normal))
}

fn text_width(text: &str, size: f64) -> anyhow::Result<f64> {
    // Measured large, because plotters rounds to whole pixels.
    let (width, _) = font(100.0)?.box_size(text).map_err(|error| anyhow!("cannot measure text: {error}"))?;
    Ok(f64::from(width) * size / 100.0)
}

/// Colour, stroke and dashes of one line.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Look {
    color: RGBColor,
    width: f64,
    /// Lengths of ink and gap, in turn; empty for a solid line.
    dashes: &'static [f64],
    marker: Marker,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Marker {
    None,
    Disc,
    Square,
    Triangle,
    Ring,
    Frame,
}

impl LineStyle {
    /// The look of the `nth` line of this style in its panel.
    fn look(self, nth: usize) -> Look {
        const DASHES: [&[f64]; 4] = [&[], &[7.0, 3.5], &[9.0, 3.0, 1.8, 3.0], &[3.5, 2.5]];
        const DOTS: [&[f64]; 3] = [&[1.8, 2.6], &[1.8, 6.0], &[1.8, 2.0, 1.8, 6.0]];
        const MARKERS: [Marker; 3] = [Marker::Disc, Marker::Square, Marker::Triangle];
        match self {
            Self::Truth => Look { color: TRUTH, width: 3.6, dashes: &[], marker: Marker::None },
            Self::Estimate => Look {
                color: ESTIMATES[nth % ESTIMATES.len()],
                width: 1.5,
                dashes: DASHES[nth % DASHES.len()],
                marker: MARKERS[nth % MARKERS.len()],
            },
            Self::Comparison => Look {
                color: COMPARISONS[nth % COMPARISONS.len()],
                width: 1.8,
                dashes: DOTS[nth % DOTS.len()],
                marker: if nth.is_multiple_of(2) { Marker::Ring } else { Marker::Frame },
            },
            Self::Guide => {
                const GUIDES: [&[f64]; 2] = [&[5.0, 4.0], &[10.0, 3.0, 1.5, 3.0]];
                Look { color: GUIDE, width: 0.9, dashes: GUIDES[nth % GUIDES.len()], marker: Marker::None }
            }
        }
    }

    /// What is drawn later lies on top.
    fn layer(self) -> u8 {
        match self {
            Self::Guide => 0,
            Self::Truth => 1,
            Self::Comparison => 2,
            Self::Estimate => 3,
        }
    }
}

/// The looks of a panel's lines, in their order.
fn looks(lines: &[Line]) -> Vec<Look> {
    lines
        .iter()
        .enumerate()
        .map(|(i, line)| {
            line.style.look(lines[..i].iter().filter(|earlier| earlier.style == line.style).count())
        })
        .collect()
}

/// Values to a share of the axis' length, and the ticks along it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axis {
    log: bool,
    /// In log10 where the axis is logarithmic.
    start: f64,
    end: f64,
}

#[derive(Debug, Default, PartialEq)]
struct Ticks {
    /// Values and their labels.
    major: Vec<(f64, String)>,
    minor: Vec<f64>,
    /// What all labels are to be multiplied with, where that is not 1.
    multiplier: Option<String>,
}

impl Axis {
    /// Around the values, with `margin` of their span on both sides; they must be finite, and positive on
    /// a logarithmic axis.
    fn around(values: impl Iterator<Item = f64>, log: bool, margin: f64) -> Self {
        let (mut start, mut end) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values {
            let value = if log { value.log10() } else { value };
            (start, end) = (start.min(value), end.max(value));
        }
        if start > end {
            (start, end) = (0.0, 1.0);
        }
        let (span, size) = (end - start, start.abs().max(end.abs()));
        // Constant but for rounding: show it in the middle of a range of its own size.
        let widening = match span <= 1e-9 * size || span == 0.0 {
            true if log => 0.3,
            true if size == 0.0 => 1.0,
            true => 0.1 * size,
            false => margin * span,
        };
        Self { log, start: start - widening, end: end + widening }
    }

    /// Moves an end that all but reaches a tick onto it: 20 s sampled every 5 ms end at 19.995 s.
    fn completed(self, wanted: usize) -> Self {
        let step = round_step(self.start, self.end, wanted);
        let slack = 0.01 * (self.end - self.start);
        if self.log || !(step.is_finite() && step > 0.0) {
            return self;
        }
        let (below, above) = ((self.start / step).floor() * step, (self.end / step).ceil() * step);
        Self {
            log: self.log,
            start: if self.start - below < slack { below } else { self.start },
            end: if above - self.end < slack { above } else { self.end },
        }
    }

    /// 0 at the start, 1 at the end.
    fn position(&self, value: f64) -> f64 {
        let value = if self.log { value.log10() } else { value };
        (value - self.start) / (self.end - self.start)
    }

    /// About `wanted` labelled ticks.
    fn ticks(&self, wanted: usize) -> Ticks {
        if self.log { self.power_ticks(wanted) } else { linear_ticks(self.start, self.end, wanted) }
    }

    fn power_ticks(&self, wanted: usize) -> Ticks {
        let inside = |value: &f64| (self.start..=self.end).contains(&value.log10());
        let (first, last) = (self.start.floor() as i32, self.end.ceil() as i32);
        let multiples = |factors: &'static [f64]| {
            (first..=last)
                .flat_map(move |power| factors.iter().map(move |factor| factor * 10f64.powi(power)))
                .filter(inside)
                .collect::<Vec<_>>()
        };
        let decades = (self.end.floor() - self.start.ceil()) as i32 + 1;
        let minor = if decades <= 8 {
            multiples(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
        } else {
            multiples(&[1.0])
        };
        if self.end - self.start >= 2.0 {
            // Powers of ten are short: twice as many find room.
            let stride = (decades.max(1) as usize).div_ceil(2 * wanted.max(1)) as i32;
            let major = (self.start.ceil() as i32..=self.end.floor() as i32)
                .filter(|power| power % stride == 0)
                .map(|power| (10f64.powi(power), format!("10{}", superscript(power))))
                .collect();
            return Ticks { major, minor, multiplier: None };
        }
        let major = multiples(&[1.0, 2.0, 5.0]);
        if major.len() >= 3 {
            let major = major.into_iter().map(|value| (value, short_number(value))).collect();
            return Ticks { major, minor, multiplier: None };
        }
        // Less than a decade: round numbers of a linear axis, still at their logarithmic places.
        linear_ticks(10f64.powf(self.start), 10f64.powf(self.end), wanted)
    }
}

/// 1, 2 or 5 times a power of ten, so that about `wanted` steps fill the range.
fn round_step(start: f64, end: f64, wanted: usize) -> f64 {
    let rough = (end - start) / wanted.max(1) as f64;
    let magnitude = 10f64.powf(rough.log10().floor());
    // The thresholds are the geometric means of neighbouring factors.
    let factor = match rough / magnitude {
        share if share < 2f64.sqrt() => 1.0,
        share if share < 10f64.sqrt() => 2.0,
        share if share < 50f64.sqrt() => 5.0,
        _ => 10.0,
    };
    factor * magnitude
}

fn linear_ticks(start: f64, end: f64, wanted: usize) -> Ticks {
    let step = round_step(start, end, wanted);
    if !(step.is_finite() && step > 0.0) {
        return Ticks::default();
    }
    let (first, last) = ((start / step).ceil(), (end / step).floor());
    let largest = first.abs().max(last.abs()) * step;
    let exponent = match largest.log10().floor() as i32 {
        power if largest > 0.0 && !(-3..=4).contains(&power) => power,
        _ => 0,
    };
    let unit = 10f64.powi(exponent);
    // The step is 1, 2 or 5 times a power of ten; the small addend keeps a 0.999… from costing a digit.
    let digits = (-((step / unit).log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize;
    let major = (0..=(last - first) as usize)
        .map(|i| {
            let multiple = first + i as f64;
            // + 0.0 makes a positive zero of a negative one.
            (multiple * step, with_minus(format!("{:.digits$}", multiple * step / unit + 0.0)))
        })
        .collect();
    let multiplier = (exponent != 0).then(|| format!("×10{}", superscript(exponent)));
    Ticks { major, minor: Vec::new(), multiplier }
}

fn short_number(value: f64) -> String {
    let power = value.log10().floor() as i32;
    if (-3..=4).contains(&power) {
        return format!("{}", (value * 1e4).round() / 1e4);
    }
    let mantissa = (value / 10f64.powi(power)).round();
    format!("{mantissa}·10{}", superscript(power))
}

fn superscript(power: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    power.to_string().chars().map(|c| c.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize])).collect()
}

/// The minus sign proper, as wide as a digit, for the hyphen that formatting leaves.
fn with_minus(number: String) -> String {
    number.replace('-', "−")
}

/// Whether a point has a place on these axes. Beyond 1e300 a span would overflow.
fn has_place(panel: &Panel, &(x, y): &(f64, f64)) -> bool {
    let fits = |value: f64, log: bool| value.abs() < 1e300 && (!log || value > 0.0);
    fits(x, panel.log_x) && fits(y, panel.log_y)
}

/// Runs of points without a gap, thinned to about `budget` points in all: each bucket keeps its lowest and
/// its highest point, so that no spike is lost.
fn runs(panel: &Panel, line: &Line, budget: usize) -> Vec<Vec<(f64, f64)>> {
    let per_bucket = (2 * line.points.len()).div_ceil(budget.max(2)).max(1);
    line.points
        .split(|point| !has_place(panel, point))
        .filter(|run| !run.is_empty())
        .map(|run| {
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
        })
        .collect()
}

/// The inked pieces of a polyline.
fn dashed(points: &[(f64, f64)], dashes: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let length: f64 = points.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).sum();
    let period: f64 = dashes.iter().sum();
    // A line that fills the panel with noise would be nothing but dashes: there they are longer.
    let stretch = (length / (period * DASHES_PER_LINE)).max(1.0);
    let (mut pieces, mut piece) = (Vec::new(), vec![points[0]]);
    let (mut phase, mut rest) = (0, dashes[0] * stretch);
    for ends in points.windows(2) {
        let (from, to) = (ends[0], ends[1]);
        let segment = (to.0 - from.0).hypot(to.1 - from.1);
        let mut done = 0.0;
        while segment - done > rest {
            done += rest;
            let share = done / segment;
            let at = (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
            if phase % 2 == 0 {
                piece.push(at);
                pieces.push(std::mem::take(&mut piece));
            } else {
                piece = vec![at];
            }
            phase = (phase + 1) % dashes.len();
            rest = dashes[phase] * stretch;
        }
        rest -= segment - done;
        if phase % 2 == 0 {
            piece.push(to);
        }
    }
    if phase % 2 == 0 && piece.len() > 1 {
        pieces.push(piece);
    }
    pieces
}

/// The figure laid out, before any backend.
struct Figure<'a> {
    page: &'static Page,
    title: &'a str,
    x_label: &'a str,
    x: Axis,
    left: f64,
    height: f64,
    plots: Vec<Plot<'a>>,
    shades: &'a [Shade],
}

/// One panel laid out.
struct Plot<'a> {
    panel: &'a Panel,
    looks: Vec<Look>,
    runs: Vec<Vec<Vec<(f64, f64)>>>,
    y: Axis,
    ticks: Ticks,
    top: f64,
    bottom: f64,
    legend: Vec<LegendEntry<'a>>,
}

struct LegendEntry<'a> {
    label: &'a str,
    look: Look,
    /// From the frame's left.
    x: f64,
    baseline: f64,
}

impl<'a> Figure<'a> {
    fn new(
        page: &'static Page,
        title: &'a str,
        x_label: &'a str,
        panels: &'a [Panel],
    ) -> anyhow::Result<Self> {
        let Some(first) = panels.first() else { bail!("a figure needs at least one panel; found none") };
        if panels.iter().any(|panel| panel.log_x != first.log_x) {
            bail!("the panels of a figure share the x axis: log_x must be the same in all of them");
        }
        let placed = |panel: &'a Panel| {
            let points = panel.lines.iter().flat_map(|line| &line.points);
            points.filter(move |point| has_place(panel, point))
        };
        // A time axis ends with its data; on a logarithmic one the outermost markers need room.
        let margin = if first.log_x { 0.05 } else { 0.0 };
        let x = Axis::around(panels.iter().flat_map(placed).map(|point| point.0), first.log_x, margin)
            .completed(page.x_ticks);

        let n_lines: usize = panels.iter().map(|panel| panel.lines.len()).sum();
        let budget = POINTS_PER_LINE.min(POINTS_PER_FIGURE / n_lines.max(1));
        let panel_height = (page.panel_height / (panels.len() as f64).powf(0.72)).max(110.0);
        let mut plots = Vec::with_capacity(panels.len());
        let mut widest_tick: f64 = 0.0;
        for panel in panels {
            let y = Axis::around(placed(panel).map(|point| point.1), panel.log_y, 0.05);
            let ticks = y.ticks(((panel_height / page.y_tick_distance) as usize).clamp(2, 8));
            for (_, label) in &ticks.major {
                widest_tick = widest_tick.max(text_width(label, TICK_SIZE)?);
            }
            plots.push(Plot {
                panel,
                looks: looks(&panel.lines),
                runs: panel.lines.iter().map(|line| runs(panel, line, budget)).collect(),
                y,
                ticks,
                top: 0.0,
                bottom: 0.0,
                legend: Vec::new(),
            });
        }

        let left = 12.0 + LABEL_SIZE + 8.0 + widest_tick + 7.0;
        let mut cursor = if title.is_empty() { 12.0 } else { TITLE_HEIGHT };
        let mut shown: Option<Vec<(&str, Look)>> = None;
        for plot in &mut plots {
            let entries: Vec<_> = (plot.panel.lines.iter().zip(&plot.looks))
                .filter(|(line, _)| !line.label.is_empty())
                .map(|(line, look)| (line.label.as_str(), *look))
                .collect();
            // A legend is repeated only where it would say something else.
            let news = !entries.is_empty() && shown.as_ref() != Some(&entries);
            if plot.ticks.multiplier.is_some() && !news {
                cursor += 10.0;
            }
            if news {
                // The power of ten that multiplies the ticks has the left end of the line.
                let start = match &plot.ticks.multiplier {
                    Some(multiplier) => text_width(multiplier, TICK_SIZE)? + 14.0,
                    None => 2.0,
                };
                let mut along = start;
                for &(label, look) in &entries {
                    let width = LEGEND_SAMPLE + 6.0 + text_width(label, TICK_SIZE)?;
                    if along > start && along + width > page.width - RIGHT_MARGIN - left {
                        along = start;
                        cursor += LEGEND_ROW;
                    }
                    plot.legend.push(LegendEntry { label, look, x: along, baseline: cursor + 11.0 });
                    along += width + 20.0;
                }
                cursor += LEGEND_ROW;
                shown = Some(entries);
            }
            (plot.top, plot.bottom) = (cursor, cursor + panel_height);
            cursor = plot.bottom + PANEL_GAP;
        }
        let height = (cursor - PANEL_GAP + 50.0).ceil();
        Ok(Self { page, title, x_label, x, left, height, plots, shades: &[] })
    }

    fn right(&self) -> f64 {
        self.page.width - RIGHT_MARGIN
    }

    fn write(&self, file: &Path, format: Format) -> anyhow::Result<()> {
        match format {
            Format::Svg => fs::write(file, self.svg()?).map_err(anyhow::Error::from),
            Format::Png => self.png(file),
        }
        .with_context(|| format!("cannot write the plot {}", file.display()))
    }

    fn svg(&self) -> anyhow::Result<String> {
        let scaled = |length: f64| (length * SVG_SCALE).round() as u32;
        let size = (scaled(self.page.width), scaled(self.height));
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
            self.paint(&Canvas { area: &area, scale: SVG_SCALE, pen: self.page.pen, kind: Format::Svg })?;
        }
        // plotters would show the fine grid of pixels at full size, and miter every corner of a noisy line.
        let found = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
        let wanted = format!(
            "width=\"{}\" height=\"{}\" stroke-linejoin=\"round\" stroke-linecap=\"butt\"",
            self.page.css_px * self.page.width,
            self.page.css_px * self.height
        );
        // Its lowest anchor is half an x-height off the baseline; all of ours are baselines.
        Ok(text.replacen(&found, &wanted, 1).replace(" dy=\"-0.5ex\"", ""))
    }

    fn png(&self, file: &Path) -> anyhow::Result<()> {
        let (size, pixels) = self.raster()?;
        let area = BitMapBackend::new(file, size).into_drawing_area();
        let image = BitMapElement::with_owned_buffer((0, 0), size, pixels)
            .ok_or_else(|| anyhow!("the picture's pixels do not fill its size: a defect of this program"))?;
        area.draw(&image).map_err(|error| anyhow!("{error}"))?;
        area.present().map_err(|error| anyhow!("{error}"))
    }

    /// The picture as rows of RGB, and its size.
    fn raster(&self) -> anyhow::Result<((u32, u32), Vec<u8>)> {
        let png_scale = self.page.png_scale;
        let size = (self.page.width as u32 * png_scale, self.height as u32 * png_scale);
        let fine_size = (size.0 * SUPERSAMPLING, size.1 * SUPERSAMPLING);
        let mut fine = vec![0; 3 * (fine_size.0 * fine_size.1) as usize];
        {
            let area = BitMapBackend::with_buffer(&mut fine, fine_size).into_drawing_area();
            let scale = f64::from(png_scale * SUPERSAMPLING);
            self.paint(&Canvas { area: &area, scale, pen: self.page.pen, kind: Format::Png })?;
        }
        let (row, samples) = (3 * fine_size.0 as usize, SUPERSAMPLING as usize);
        let mut pixels = Vec::with_capacity(3 * (size.0 * size.1) as usize);
        for y in 0..size.1 as usize {
            for x in 0..size.0 as usize {
                pixels.extend((0..3).map(|channel| {
                    let corner = samples * (y * row + 3 * x) + channel;
                    let sum: usize = (0..samples * samples)
                        .map(|i| usize::from(fine[corner + i / samples * row + i % samples * 3]))
                        .sum();
                    (sum / (samples * samples)) as u8
                }));
            }
        }
        Ok((size, pixels))
    }

    fn paint<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> anyhow::Result<()> {
        canvas.area.fill(&WHITE).map_err(|error| anyhow!("{error}"))?;
        let middle = 0.5 * (self.left + self.right());
        canvas.text(self.title, (middle, 21.0), TITLE_SIZE, HPos::Center, Turn::Upright)?;
        let x_ticks = self.x.ticks(self.page.x_ticks);
        for plot in &self.plots {
            self.paint_shades(canvas, plot)?;
            self.paint_grid(canvas, plot, &x_ticks)?;
            self.paint_lines(canvas, plot)?;
            self.paint_frame(canvas, plot, &x_ticks)?;
            self.paint_legend(canvas, plot)?;
        }
        self.paint_names_of_shades(canvas)?;
        let bottom = self.plots.last().map_or(0.0, |plot| plot.bottom);
        for (value, label) in &x_ticks.major {
            canvas.text(label, (self.at_x(*value), bottom + 17.0), TICK_SIZE, HPos::Center, Turn::Upright)?;
        }
        if let Some(multiplier) = &x_ticks.multiplier {
            let at = (self.right(), bottom + 37.0);
            canvas.text(multiplier, at, TICK_SIZE, HPos::Right, Turn::Upright)?;
        }
        canvas.text(self.x_label, (middle, bottom + 38.0), LABEL_SIZE, HPos::Center, Turn::Upright)?;
        canvas.area.present().map_err(|error| anyhow!("{error}"))
    }

    fn at_x(&self, value: f64) -> f64 {
        self.left + self.x.position(value) * (self.right() - self.left)
    }

    /// Left and right end of a shade within the frame; `None` outside of it.
    fn ends(&self, shade: &Shade) -> Option<(f64, f64)> {
        let (left, right) = (self.at_x(shade.from).max(self.left), self.at_x(shade.to).min(self.right()));
        // The shortest is still seen.
        (left <= right).then(|| (left, right.max(left + 1.5).min(self.right())))
    }

    fn paint_shades<B: DrawingBackend>(&self, canvas: &Canvas<B>, plot: &Plot) -> anyhow::Result<()> {
        for (left, right) in self.shades.iter().filter_map(|shade| self.ends(shade)) {
            let corners = [(left, plot.top), (right, plot.top), (right, plot.bottom), (left, plot.bottom)];
            let area = Polygon::new(corners.map(|corner| canvas.pixel(corner)), SHADE.filled());
            canvas.area.draw(&area).map_err(|error| anyhow!("{error}"))?;
        }
        Ok(())
    }

    /// In the gap below the first panel; inside of it where there is no other panel, and so no gap.
    fn paint_names_of_shades<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> anyhow::Result<()> {
        let Some(first) = self.plots.first() else { return Ok(()) };
        let baseline = if self.plots.len() > 1 { first.bottom + 12.0 } else { first.bottom - 8.0 };
        for shade in self.shades {
            let Some((left, right)) = self.ends(shade) else { continue };
            let place = (0.5 * (left + right), baseline);
            canvas.text(&shade.label, place, TICK_SIZE, HPos::Center, Turn::Upright)?;
        }
        Ok(())
    }

    fn paint_grid<B: DrawingBackend>(
        &self,
        canvas: &Canvas<B>,
        plot: &Plot,
        x_ticks: &Ticks,
    ) -> anyhow::Result<()> {
        let vertical = |value: f64| [(self.at_x(value), plot.top), (self.at_x(value), plot.bottom)];
        let horizontal = |value: f64| [(self.left, plot.at_y(value)), (self.right(), plot.at_y(value))];
        let major = |ticks: &Ticks| ticks.major.iter().map(|tick| tick.0).collect::<Vec<_>>();
        // All faint lines first, so that none of them crosses a stronger one.
        for &value in &x_ticks.minor {
            canvas.polyline(&vertical(value), MINOR_GRID, 0.6)?;
        }
        for &value in &plot.ticks.minor {
            canvas.polyline(&horizontal(value), MINOR_GRID, 0.6)?;
        }
        for value in major(x_ticks) {
            canvas.polyline(&vertical(value), GRID, 0.8)?;
        }
        for value in major(&plot.ticks) {
            canvas.polyline(&horizontal(value), GRID, 0.8)?;
        }
        Ok(())
    }

    fn paint_lines<B: DrawingBackend>(&self, canvas: &Canvas<B>, plot: &Plot) -> anyhow::Result<()> {
        let mut order: Vec<usize> = (0..plot.panel.lines.len()).collect();
        // Stable, and in each layer the first line last: it is the one the figure is about.
        order.sort_by_key(|&i| (plot.panel.lines[i].style.layer(), std::cmp::Reverse(i)));
        for i in order {
            let look = &plot.looks[i];
            let n_points: usize = plot.runs[i].iter().map(Vec::len).sum();
            for run in &plot.runs[i] {
                let places: Vec<_> = run.iter().map(|&(x, y)| (self.at_x(x), plot.at_y(y))).collect();
                canvas.line(&places, look)?;
                if places.len() == 1 && look.marker == Marker::None {
                    canvas.marker(places[0], &Look { marker: Marker::Disc, ..*look }, 0.6 * look.width)?;
                }
                if places.len() == 1 || n_points <= MARKED_POINTS {
                    places.iter().try_for_each(|&place| canvas.marker(place, look, 3.2))?;
                }
            }
        }
        if plot.runs.iter().all(Vec::is_empty) {
            let place = (0.5 * (self.left + self.right()), 0.5 * (plot.top + plot.bottom) + 4.0);
            canvas.text("no data", place, TICK_SIZE, HPos::Center, Turn::Upright)?;
        }
        Ok(())
    }

    fn paint_frame<B: DrawingBackend>(
        &self,
        canvas: &Canvas<B>,
        plot: &Plot,
        x_ticks: &Ticks,
    ) -> anyhow::Result<()> {
        const TICK: f64 = 4.0;
        let (left, right, top, bottom) = (self.left, self.right(), plot.top, plot.bottom);
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        for i in 0..4 {
            canvas.polyline(&[corners[i], corners[(i + 1) % 4]], FRAME, 1.0)?;
        }
        for (value, _) in &x_ticks.major {
            let x = self.at_x(*value);
            canvas.polyline(&[(x, bottom), (x, bottom - TICK)], FRAME, 1.0)?;
        }
        for (value, label) in &plot.ticks.major {
            let y = plot.at_y(*value);
            canvas.polyline(&[(left, y), (left + TICK, y)], FRAME, 1.0)?;
            canvas.text(label, (left - 7.0, y + 4.2), TICK_SIZE, HPos::Right, Turn::Upright)?;
        }
        if let Some(multiplier) = &plot.ticks.multiplier {
            canvas.text(multiplier, (left, top - 5.0), TICK_SIZE, HPos::Left, Turn::Upright)?;
        }
        // A label longer than its panel is set smaller, so that neighbours do not run into each other.
        let room = (bottom - top + PANEL_GAP) / text_width(&plot.panel.y_label, LABEL_SIZE)?.max(1.0);
        let size = LABEL_SIZE * room.min(1.0);
        let place = (12.0 + 0.75 * LABEL_SIZE, 0.5 * (top + bottom));
        canvas.text(&plot.panel.y_label, place, size, HPos::Center, Turn::Upwards)
    }

    fn paint_legend<B: DrawingBackend>(&self, canvas: &Canvas<B>, plot: &Plot) -> anyhow::Result<()> {
        for entry in &plot.legend {
            let (start, end) = (self.left + entry.x, self.left + entry.x + LEGEND_SAMPLE);
            let height = entry.baseline - 4.2;
            canvas.line(&[(start, height), (end, height)], &entry.look)?;
            let marked = plot.panel.lines.iter().zip(&plot.runs).any(|(line, runs)| {
                line.label == entry.label && runs.iter().map(Vec::len).sum::<usize>() <= MARKED_POINTS
            });
            if marked {
                canvas.marker((0.5 * (start + end), height), &entry.look, 3.2)?;
            }
            canvas.text(entry.label, (end + 6.0, entry.baseline), TICK_SIZE, HPos::Left, Turn::Upright)?;
        }
        Ok(())
    }
}

impl Plot<'_> {
    fn at_y(&self, value: f64) -> f64 {
        self.bottom - self.y.position(value) * (self.bottom - self.top)
    }
}

#[derive(Clone, Copy)]
enum Turn {
    Upright,
    Upwards,
}

/// A backend, in the figure's units.
struct Canvas<'a, B: DrawingBackend> {
    area: &'a DrawingArea<B, Shift>,
    scale: f64,
    pen: f64,
    kind: Format,
}

impl<B: DrawingBackend> Canvas<'_, B> {
    fn pixel(&self, (x, y): (f64, f64)) -> (i32, i32) {
        ((x * self.scale).round() as i32, (y * self.scale).round() as i32)
    }

    fn stroke(&self, color: RGBColor, width: f64) -> ShapeStyle {
        color.stroke_width((width * self.pen * self.scale).round().max(1.0) as u32)
    }

    fn line(&self, points: &[(f64, f64)], look: &Look) -> anyhow::Result<()> {
        if points.len() < 2 {
            return Ok(());
        }
        if look.dashes.is_empty() {
            return self.polyline(points, look.color, look.width);
        }
        dashed(points, look.dashes).iter().try_for_each(|piece| self.polyline(piece, look.color, look.width))
    }

    fn polyline(&self, points: &[(f64, f64)], color: RGBColor, width: f64) -> anyhow::Result<()> {
        let mut pixels: Vec<_> = points.iter().map(|&point| self.pixel(point)).collect();
        pixels.dedup();
        let style = self.stroke(color, width);
        let failed = |error| anyhow!("cannot draw a line: {error}");
        match self.kind {
            Format::Svg => self.area.draw(&PathElement::new(pixels, style)).map_err(failed),
            // plotters fills a thick polyline as one polygon, which tears at the sharp corners of a noisy
            // signal: here segments, joined by discs.
            Format::Png => {
                for ends in pixels.windows(2) {
                    self.area.draw(&PathElement::new(ends, style)).map_err(failed)?;
                }
                let radius = (style.stroke_width / 2) as i32;
                let corners = pixels.get(1..pixels.len().max(2) - 1).unwrap_or_default();
                for &corner in corners.iter().filter(|_| radius > 0) {
                    self.area.draw(&Circle::new(corner, radius, color.filled())).map_err(failed)?;
                }
                Ok(())
            }
        }
    }

    fn marker(&self, place: (f64, f64), look: &Look, radius: f64) -> anyhow::Result<()> {
        let failed = |error| anyhow!("cannot draw a marker: {error}");
        let (x, y) = place;
        let disc = |radius: f64, color: RGBColor| {
            let size = (radius * self.scale).round().max(1.0) as i32;
            self.area.draw(&Circle::new(self.pixel(place), size, color.filled())).map_err(failed)
        };
        let polygon = |radius: f64, corners: &[(f64, f64)], color: RGBColor| {
            let corners: Vec<_> =
                corners.iter().map(|(dx, dy)| self.pixel((x + radius * dx, y + radius * dy))).collect();
            self.area.draw(&Polygon::new(corners, color.filled())).map_err(failed)
        };
        const SQUARE: [(f64, f64); 4] = [(-0.95, -0.95), (0.95, -0.95), (0.95, 0.95), (-0.95, 0.95)];
        const TRIANGLE: [(f64, f64); 3] = [(0.0, -1.3), (1.15, 0.8), (-1.15, 0.8)];
        match look.marker {
            Marker::None => Ok(()),
            Marker::Disc => disc(radius, look.color),
            Marker::Ring => disc(1.15 * radius, look.color).and_then(|()| disc(0.6 * radius, WHITE)),
            Marker::Square => polygon(radius, &SQUARE, look.color),
            Marker::Frame => polygon(1.1 * radius, &SQUARE, look.color)
                .and_then(|()| polygon(0.55 * radius, &SQUARE, WHITE)),
            Marker::Triangle => polygon(radius, &TRIANGLE, look.color),
        }
    }

    /// Sets `text` with its baseline through `place`.
    fn text(
        &self,
        text: &str,
        place: (f64, f64),
        size: f64,
        horizontal: HPos,
        turn: Turn,
    ) -> anyhow::Result<()> {
        if matches!(self.kind, Format::Svg) {
            return self.glyphs(text, place, size, horizontal, turn);
        }
        // plotters' bitmap text does not know where a hat belongs; whoever shows an SVG does.
        let (plain, accents) = without_accents(text);
        self.glyphs(&plain, place, size, horizontal, turn)?;
        let width = text_width(&plain, size)?;
        let start = match horizontal {
            HPos::Left => 0.0,
            HPos::Center => -0.5 * width,
            HPos::Right => -width,
        };
        for accent in accents {
            let before = text_width(&plain[..accent.letter.start], size)?;
            let letter = &plain[accent.letter];
            let along = start + before + 0.5 * text_width(letter, size)?;
            let tall = letter.starts_with(|c: char| c.is_uppercase() || "bdfhkltβδθλξ".contains(c));
            let up = if tall { 0.15 * size } else { 0.0 };
            let place = match turn {
                Turn::Upright => (place.0 + along, place.1 - up),
                Turn::Upwards => (place.0 - up, place.1 - along),
            };
            self.glyphs(accent.glyph, place, size, HPos::Center, turn)?;
        }
        Ok(())
    }

    fn glyphs(
        &self,
        text: &str,
        place: (f64, f64),
        size: f64,
        horizontal: HPos,
        turn: Turn,
    ) -> anyhow::Result<()> {
        if text.is_empty() {
            return Ok(());
        }
        let mut font = font(size * self.scale)?;
        if let Turn::Upwards = turn {
            font = font.transform(FontTransform::Rotate270);
        }
        // plotters puts the baseline of `Bottom` near the given point of an SVG (`Figure::svg` does the
        // rest), and that of `Top` half the size below the given point of a bitmap.
        let (vertical, above) = match self.kind {
            Format::Svg => (VPos::Bottom, 0.0),
            Format::Png => (VPos::Top, 0.5 * size),
        };
        let place = match turn {
            Turn::Upright => (place.0, place.1 - above),
            Turn::Upwards => (place.0 - above, place.1),
        };
        let style: TextStyle =
            font.into_text_style(self.area).color(&INK).pos(Pos::new(horizontal, vertical));
        self.area
            .draw(&Text::new(text, self.pixel(place), style))
            .map_err(|error| anyhow!("cannot set text: {error}"))
    }
}

/// A mark over a letter.
#[derive(Debug, PartialEq)]
struct Accent {
    /// Which bytes of the plain text the letter is.
    letter: Range<usize>,
    /// The mark as a character of its own.
    glyph: &'static str,
}

/// The text without combining accents (x̂, f̃, ȧ), and these.
fn without_accents(text: &str) -> (String, Vec<Accent>) {
    let (mut plain, mut accents) = (String::with_capacity(text.len()), Vec::new());
    let mut letter = 0;
    for c in text.chars() {
        let glyph = match c {
            '\u{302}' => "\u{2c6}",
            '\u{303}' => "\u{2dc}",
            '\u{304}' => "\u{af}",
            '\u{307}' => "\u{2d9}",
            '\u{308}' => "\u{a8}",
            _ => {
                letter = plain.len();
                plain.push(c);
                continue;
            }
        };
        accents.push(Accent { letter: letter..plain.len(), glyph });
    }
    (plain, accents)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(label: &str, style: LineStyle, point: impl Fn(f64) -> (f64, f64)) -> Line {
        Line { label: label.into(), points: (0..2000).map(|i| point(f64::from(i) * 0.01)).collect(), style }
    }

    fn panel(y_label: &str, lines: Vec<Line>) -> Panel {
        Panel { y_label: y_label.into(), lines, log_x: false, log_y: false }
    }

    fn flight() -> Vec<Panel> {
        let noise = |t: f64| (t * 7919.0).sin() * (t * 104_729.0).cos();
        let lines = |phase: f64| {
            vec![
                line("truth", LineStyle::Truth, |t| (t, (t + phase).sin())),
                line("observer", LineStyle::Estimate, |t| (t, (t + phase).sin() + 0.05 * noise(t))),
                line("without adaptation", LineStyle::Comparison, |t| (t, 0.7 * (t + phase).sin())),
            ]
        };
        vec![panel("v_x (m/s)", lines(0.0)), panel("v_y (m/s)", lines(1.0)), panel("v_z (m/s)", lines(2.0))]
    }

    #[test]
    fn both_files_are_written_beside_each_other() {
        let directory = tempfile::tempdir().unwrap();
        let files = draw(&directory.path().join("run-0.5"), "A flight", "t (s)", &flight()).unwrap();
        assert_eq!(files, ["run-0.5.svg", "run-0.5.png"].map(|name| directory.path().join(name)));

        let svg = fs::read_to_string(&files[0]).unwrap();
        for text in ["A flight", "t (s)", "v_x (m/s)", "v_z (m/s)", "without adaptation", "</svg>"] {
            assert!(svg.contains(text), "{text}");
        }
        assert_eq!(svg.matches("without adaptation").count(), 1, "one legend for equal panels");
        let png = fs::read(&files[1]).unwrap();
        assert!(png.starts_with(b"\x89PNG\r\n\x1a\n"));
        for file in files {
            let size = fs::metadata(&file).unwrap().len();
            assert!((10_000..1_000_000).contains(&size), "{}: {size} bytes", file.display());
        }
    }

    #[test]
    fn a_column_is_eight_and_a_half_centimeters_wide_with_room_for_its_labels() {
        let panels = flight();
        let figure = Figure::new(&COLUMN, "", "t (s)", &panels).unwrap();
        let svg = figure.svg().unwrap();
        let width_px: f64 = svg.split('"').nth(1).unwrap().parse().unwrap();
        assert!((width_px / 96.0 * 2.54 - 8.5).abs() < 1e-9, "{width_px}");
        // 7 points, at 72 to the inch.
        assert!((TICK_SIZE * COLUMN.css_px * 72.0 / 96.0 - 7.0).abs() < 0.05);
        assert!(figure.plots.iter().all(|plot| plot.ticks.major.len() >= 3));
        let (size, _) = figure.raster().unwrap();
        assert!(f64::from(size.0) / (8.5 / 2.54) > 500.0, "{} dots", size.0);
    }

    #[test]
    fn the_picture_shows_frame_text_and_every_line() {
        let panels = flight();
        let (size, pixels) = Figure::new(&SCREEN, "A flight", "t (s)", &panels).unwrap().raster().unwrap();
        assert_eq!(pixels.len(), 3 * (size.0 * size.1) as usize);
        let count = |color: RGBColor| {
            pixels.as_chunks::<3>().0.iter().filter(|p| **p == [color.0, color.1, color.2]).count()
        };
        let all = pixels.len() / 3;
        assert!((all / 2..all * 99 / 100).contains(&count(RGBColor(255, 255, 255))));
        for color in [INK, TRUTH, ESTIMATES[0], COMPARISONS[0]] {
            assert!(count(color) > 100, "{color:?}: {}", count(color));
        }
    }

    #[test]
    fn a_shade_covers_its_stretch_and_no_more() {
        let panels = flight();
        let shades = [Shade { from: 5.0, to: 10.0, label: "1".into() }];
        let figure = Figure { shades: &shades, ..Figure::new(&SCREEN, "", "time (s)", &panels).unwrap() };
        let ((width, _), pixels) = figure.raster().unwrap();
        let scale = f64::from(SCREEN.png_scale);
        for plot in &figure.plots {
            // Just above the frame's bottom, where no curve is: the axis has a margin.
            let row = ((plot.bottom - 3.0) * scale) as usize;
            for (x, shaded) in [(4.9, false), (5.1, true), (9.9, true), (10.1, false), (15.1, false)] {
                let column = (figure.at_x(x) * scale) as usize;
                let pixel = 3 * (row * width as usize + column);
                let color = RGBColor(pixels[pixel], pixels[pixel + 1], pixels[pixel + 2]);
                assert_eq!(color, if shaded { SHADE } else { RGBColor(255, 255, 255) }, "at {x}");
            }
        }
    }

    #[test]
    fn an_unknown_extension_is_refused_and_the_two_known_ones_are_named() {
        for name in ["figure.pdf", "figure"] {
            let error = draw_to(Path::new(name), "", "", &flight()).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(".svg") && error.contains(".png"), "{error}");
        }
        assert!(
            check_target(Path::new("nowhere/at/all.svg")).unwrap_err().to_string().contains("nowhere/at")
        );
        assert!(check_target(Path::new("figure.PNG")).is_ok());
        assert!(draw_to(Path::new("figure.svg"), "", "", &[]).is_err());
    }

    #[test]
    fn constant_empty_and_broken_data_still_make_a_figure() {
        let directory = tempfile::tempdir().unwrap();
        let broken =
            |t: f64| (t, if (5.0..6.0).contains(&t) { f64::NAN } else { 1e308 * f64::from(t > 19.0) });
        let panels = [
            panel("constant", vec![line("a", LineStyle::Estimate, |t| (t, 3.0))]),
            panel("zero", vec![line("b", LineStyle::Truth, |t| (t, 0.0))]),
            panel("none", vec![]),
            panel("broken", vec![line("c", LineStyle::Comparison, broken)]),
        ];
        for panels in [&panels[..], &panels[1..2], &panels[2..3]] {
            draw(&directory.path().join("odd"), "", "", panels).unwrap();
        }
        let runs = runs(&panels[3], &panels[3].lines[0], POINTS_PER_LINE);
        assert_eq!(runs.len(), 2, "a gap from 5 to 6, and nothing beyond 19");
        assert!(runs.iter().flatten().all(|point| point.1 == 0.0));
    }

    #[test]
    fn thinning_keeps_spikes_and_both_ends() {
        let mut long = Line { label: String::new(), points: Vec::new(), style: LineStyle::Estimate };
        long.points = (0..1_000_000).map(|i| (f64::from(i), (f64::from(i) * 1e-4).sin())).collect();
        long.points[314_159].1 = 50.0;
        let all = long.points.clone();
        let kept = runs(&panel("", vec![]), &long, POINTS_PER_LINE).remove(0);
        assert!(kept.len() <= POINTS_PER_LINE + 4, "{}", kept.len());
        assert!(kept.contains(&all[314_159]));
        assert_eq!((kept[0], kept[kept.len() - 1]), (all[0], all[all.len() - 1]));
        assert!(kept.windows(2).all(|pair| pair[0].0 <= pair[1].0), "order");
    }

    #[test]
    fn a_crowded_noisy_figure_stays_below_a_megabyte() {
        let noise = |t: f64| (t, (t * 7919.0).sin() * (t * 104_729.0).cos());
        let lines: Vec<_> = (0..6)
            .map(|i| {
                let style = if i < 3 { LineStyle::Estimate } else { LineStyle::Comparison };
                let points = (0..100_000).map(|j| noise(f64::from(j) * 1e-3)).collect();
                Line { label: format!("line {i}"), points, style }
            })
            .collect();
        let panels = [panel("a", lines.clone()), panel("b", lines)];
        let svg = Figure::new(&SCREEN, "", "", &panels).unwrap().svg().unwrap();
        assert!(svg.len() < 1_000_000, "{} bytes", svg.len());
    }

    #[test]
    fn a_logarithmic_axis_is_labelled_with_powers_of_ten() {
        let axis = Axis::around([1e-7, 1e-2].into_iter(), true, 0.0);
        let labels: Vec<_> = axis.ticks(8).major.into_iter().map(|tick| tick.1).collect();
        assert_eq!(labels, ["10⁻⁷", "10⁻⁶", "10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²"]);
        assert!((axis.position(1e-4) - 0.6).abs() < 1e-12);
        let short = Axis::around([27.0, 1000.0].into_iter(), true, 0.05).ticks(8);
        let labels: Vec<_> = short.major.iter().map(|tick| tick.1.as_str()).collect();
        assert_eq!(labels, ["50", "100", "200", "500", "1000"]);
        assert!(Axis::around([1.1, 1.2].into_iter(), true, 0.05).ticks(5).major.len() >= 3);
    }

    #[test]
    fn linear_ticks_are_round_numbers_without_useless_digits() {
        let labels =
            |start, end| linear_ticks(start, end, 5).major.into_iter().map(|tick| tick.1).collect::<Vec<_>>();
        assert_eq!(labels(-0.42, 0.42), ["−0.4", "−0.2", "0.0", "0.2", "0.4"]);
        assert_eq!(labels(0.0, 100.0), ["0", "20", "40", "60", "80", "100"]);
        let small = linear_ticks(0.0, 4e-6, 4);
        assert_eq!(small.multiplier.as_deref(), Some("×10⁻⁶"));
        assert_eq!(small.major[1].1, "1");
    }

    #[test]
    fn hats_are_set_over_their_letters() {
        let (plain, accents) = without_accents("v\u{302}₃, f\u{303}");
        assert_eq!(plain, "v₃, f");
        let expected = [(0..1, "ˆ"), (6..7, "˜")].map(|(letter, glyph)| Accent { letter, glyph });
        assert_eq!(accents, expected);
        assert_eq!(without_accents("\u{302}x").0, "x", "a mark without a letter is no reason to panic");
    }

    #[test]
    fn dashes_cover_their_share_of_the_line() {
        let corner = [(0.0, 0.0), (60.0, 0.0), (60.0, 40.0)];
        let inked: f64 = dashed(&corner, &[3.0, 2.0])
            .iter()
            .flat_map(|piece| piece.windows(2))
            .map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1))
            .sum();
        assert!((inked - 60.0).abs() < 1e-9, "{inked}");
    }
}
