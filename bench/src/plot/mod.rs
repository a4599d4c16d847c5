//! Figures: stacked panels over one x axis, written as SVG without a plotting library or a font.
//!
//! | file | what lives there | imports |
//! |---|---|---|
//! | `figure` | the parts of a figure: panels, lines, shades | nothing |
//! | `axis` | values to positions, ticks and their labels | nothing |
//! | `svg` | the SVG elements, and an estimate of a text's width | nothing |
//! | `look` | colours, dashes and markers of the lines | `figure` |
//! | `drawing` | the layout, and writing the file | all of these |

mod axis;
mod drawing;
mod figure;
mod look;
mod svg;

pub(crate) use drawing::check_target;
pub(crate) use figure::{Band, Figure, Line, LineStyle, PageSize, Panel, Shade};
