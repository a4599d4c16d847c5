//! The style of each line: colour, width, dashes and marker.

use super::figure::{Line, LineStyle};

/// Colour, stroke and marker of one line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    pub(super) color: &'static str,
    pub(super) width: f64,
    /// Lengths of ink and gap, in turn; empty for a solid line.
    pub(super) dashes: &'static [f64],
    pub(super) marker: Marker,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Marker {
    None,
    Disc,
    Square,
    Triangle,
    Diamond,
    /// A hollow disc.
    Ring,
    /// A hollow square.
    Frame,
}

/// Okabe and Ito's colours, which colour-blind readers can distinguish: the dark ones here, the light ones below.
pub(super) const ESTIMATES: [&str; 6] = ["#0072b2", "#d55e00", "#008a64", "#964682", "#222222", "#8a7000"];
const COMPARISONS: [&str; 3] = ["#e69f00", "#56b4e9", "#cc79a7"];

/// A band, as its legend shows it.
pub(super) const BAND: Look = Look { color: "#cfe2f1", width: 9.0, dashes: &[], marker: Marker::None };

/// The look of the `nth` line of this style in its panel.
fn look(style: LineStyle, nth: usize) -> Look {
    const DASHES: [&[f64]; 4] = [&[], &[7.0, 3.5], &[9.0, 3.0, 1.8, 3.0], &[3.5, 2.5]];
    const DOTS: [&[f64]; 3] = [&[1.8, 2.6], &[1.8, 6.0], &[1.8, 2.0, 1.8, 6.0]];
    const GUIDES: [&[f64]; 2] = [&[5.0, 4.0], &[10.0, 3.0, 1.5, 3.0]];
    const MARKERS: [Marker; 4] = [Marker::Disc, Marker::Square, Marker::Triangle, Marker::Diamond];
    match style {
        LineStyle::Truth => Look { color: "#a5a5a5", width: 3.6, dashes: &[], marker: Marker::None },
        LineStyle::Estimate => Look {
            color: ESTIMATES[nth % ESTIMATES.len()],
            width: 1.5,
            dashes: DASHES[nth % DASHES.len()],
            marker: MARKERS[nth % MARKERS.len()],
        },
        LineStyle::Comparison => Look {
            color: COMPARISONS[nth % COMPARISONS.len()],
            width: 1.8,
            dashes: DOTS[nth % DOTS.len()],
            marker: if nth.is_multiple_of(2) { Marker::Ring } else { Marker::Frame },
        },
        LineStyle::Guide => {
            Look { color: "#787878", width: 0.9, dashes: GUIDES[nth % GUIDES.len()], marker: Marker::None }
        }
    }
}

/// The looks of a panel's lines, in their order.
pub(super) fn looks(lines: &[Line]) -> Vec<Look> {
    let of_same_style = |i: usize| lines[..i].iter().filter(|line| line.style == lines[i].style).count();
    lines.iter().enumerate().map(|(i, line)| look(line.style, of_same_style(i))).collect()
}

/// A line with a higher number is drawn later, on top of the others.
pub(super) fn layer(style: LineStyle) -> u8 {
    match style {
        LineStyle::Guide => 0,
        LineStyle::Truth => 1,
        LineStyle::Comparison => 2,
        LineStyle::Estimate => 3,
    }
}
