//! The parts of a figure: panels, lines, shades.

/// Panels over one x axis; `write` in `drawing` makes the file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Figure {
    /// Above the first panel; empty for none.
    pub(crate) title: String,
    /// The quantity of the x axis and its unit.
    pub(crate) x_label: String,
    /// Logarithmic x axis.
    pub(crate) log_x: bool,
    /// From top to bottom.
    pub(crate) panels: Vec<Panel>,
    /// Shaded in all panels.
    pub(crate) shades: Vec<Shade>,
    pub(crate) page: PageSize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PageSize {
    /// For a screen, or across a whole page.
    Screen,
    /// 8.5 cm wide, one column of a printed page, with text of 7 points.
    Column,
}

impl Figure {
    /// A figure for the screen with a linear x axis.
    pub(crate) fn new(title: &str, x_label: &str, panels: Vec<Panel>) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.into(),
            log_x: false,
            panels,
            shades: Vec::new(),
            page: PageSize::Screen,
        }
    }
}

/// One set of axes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Panel {
    /// The quantity and its unit.
    pub(crate) y_label: String,
    /// Logarithmic y axis.
    pub(crate) log_y: bool,
    /// Its curves, in the order of the legend.
    pub(crate) lines: Vec<Line>,
    /// Shaded between two curves, underneath the lines.
    pub(crate) band: Option<Band>,
}

impl Panel {
    /// A panel with a linear y axis.
    pub(crate) fn new(y_label: &str, lines: Vec<Line>) -> Self {
        Self { y_label: y_label.into(), log_y: false, lines, band: None }
    }
}

/// What lies between two curves, for example an interval of confidence.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Band {
    /// Its name in the legend.
    pub(crate) label: String,
    /// (x, lower y, upper y) in the order of x. A point that is not finite is left out.
    pub(crate) points: Vec<(f64, f64, f64)>,
}

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Line {
    /// Its name in the legend; an empty one is not listed.
    pub(crate) label: String,
    pub(crate) style: LineStyle,
    /// (x, y) in drawing order. A point that is not finite, or not positive on a logarithmic axis, leaves a gap.
    pub(crate) points: Vec<(f64, f64)>,
}

impl Line {
    pub(crate) fn new(label: &str, style: LineStyle, points: Vec<(f64, f64)>) -> Self {
        Self { label: label.into(), style, points }
    }
}

/// The meaning of a curve. The styles differ in black and white too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LineStyle {
    /// The true value: solid, thick, gray, underneath the others.
    Truth,
    /// The estimate that is evaluated: thin and coloured, on top; the first of a panel solid, then dashed, then dash-dotted.
    Estimate,
    /// The reference that it is compared with: dotted and light, with hollow markers.
    Comparison,
    /// A bound or a slope to compare the curves with: a thin dashed line.
    Guide,
}

/// A shaded part of the x axis, for example an outage.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shade {
    pub(crate) from: f64,
    pub(crate) to: f64,
    /// Its name, set below it in the first panel's margin.
    pub(crate) label: String,
}
