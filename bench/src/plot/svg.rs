//! The elements of an SVG picture, and an estimate of a text's width.
//!
//! All properties are attributes of their elements: the picture has no style sheet, no identifiers and no blank lines, so it
//! can be embedded in an HTML page. Text remains text, in the viewer's sans-serif font.

use std::fmt::Write;

/// A place in the picture's units, y downwards.
pub(super) type Point = (f64, f64);

/// The colour of text.
const INK: &str = "#1e1e1e";
const FONTS: &str = "DejaVu Sans, Verdana, Arial, sans-serif";

/// A picture that grows element by element. Coordinates are written in whole tenths of a unit.
pub(super) struct Svg {
    text: String,
    /// Factor on the width of all strokes.
    pen: f64,
}

/// The point of a text that is given.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

fn tenths(length: f64) -> i64 {
    (length * 10.0).round() as i64
}

impl Svg {
    /// A white picture of this size, shown with `css_px` pixels of 1/96 inch to the unit.
    pub(super) fn new((width, height): (f64, f64), css_px: f64, pen: f64) -> Self {
        let text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {} {}\" \
             font-family=\"{FONTS}\" fill=\"none\" stroke-linejoin=\"round\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
            css_px * width,
            css_px * height,
            tenths(width),
            tenths(height),
        );
        Self { text, pen }
    }

    /// A stroke through the points; `dashes` are lengths of ink and gap, in turn.
    pub(super) fn line(&mut self, points: &[Point], color: &str, width: f64, dashes: &[f64]) {
        if points.len() < 2 {
            return;
        }
        let path = path(points);
        let width = tenths(width * self.pen).max(1);
        let mut dashed = String::new();
        if !dashes.is_empty() {
            let lengths: Vec<String> = dashes.iter().map(|length| tenths(*length).to_string()).collect();
            dashed = format!(" stroke-dasharray=\"{}\"", lengths.join(" "));
        }
        self.push(format_args!("<path d=\"{path}\" stroke=\"{color}\" stroke-width=\"{width}\"{dashed}/>"));
    }

    /// A filled polygon.
    pub(super) fn area(&mut self, corners: &[Point], color: &str) {
        let path = path(corners);
        self.push(format_args!("<path d=\"{path}z\" fill=\"{color}\"/>"));
    }

    pub(super) fn disc(&mut self, (x, y): Point, radius: f64, color: &str) {
        let [x, y, radius] = [x, y, radius].map(tenths);
        self.push(format_args!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" fill=\"{color}\"/>"));
    }

    /// Text whose baseline passes through `place`.
    pub(super) fn text(&mut self, text: &str, place: Point, size: f64, anchor: Anchor) {
        self.turned_text(text, place, size, anchor, false);
    }

    /// As [`Svg::text`]; `upwards` turns it by 90° to read from bottom to top.
    pub(super) fn turned_text(
        &mut self,
        text: &str,
        (x, y): Point,
        size: f64,
        anchor: Anchor,
        upwards: bool,
    ) {
        if text.is_empty() {
            return;
        }
        let [x, y, size] = [x, y, size].map(tenths);
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let turn = if upwards { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
        let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        self.push(format_args!(
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" fill=\"{INK}\"{anchor}{turn}>{text}</text>"
        ));
    }

    fn push(&mut self, element: std::fmt::Arguments) {
        writeln!(self.text, "{element}").expect("a string takes everything");
    }

    pub(super) fn finish(mut self) -> String {
        self.text += "</svg>\n";
        self.text
    }
}

/// The points as path data: the first absolute, each other relative to the one before. Equal neighbours are left out.
fn path(points: &[Point]) -> String {
    let mut path = String::new();
    let mut last: Option<(i64, i64)> = None;
    for (x, y) in points.iter().map(|&(x, y)| (tenths(x), tenths(y))) {
        match last {
            None => path += &format!("M{x} {y}l0 0"),
            Some(last) if last == (x, y) => {}
            // A minus sign separates as well as a space does.
            Some((last_x, last_y)) => {
                for step in [x - last_x, y - last_y] {
                    path += &if step < 0 { step.to_string() } else { format!(" {step}") };
                }
            }
        }
        last = Some((x, y));
    }
    path
}

/// About how wide a text is in DejaVu Sans, the widest of the named fonts: to 5 % for a label.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    let em = |c: char| match c {
        '\u{300}'..='\u{36f}' => 0.0,
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | ';' | '|' | '\'' | '·' | '/' | ' ' => 0.31,
        'f' | 't' | 'r' | '(' | ')' | '-' => 0.39,
        '⁰'..='ₜ' | '²' | '³' | '¹' => 0.46,
        's' | 'c' | 'z' => 0.53,
        'm' | 'w' | 'M' | 'W' | '−' | '×' | '+' | '=' => 0.88,
        c if c.is_uppercase() => 0.7,
        _ => 0.62,
    };
    size * text.chars().map(em).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_brings_back_its_points() {
        let points = [(1.0, 2.0), (3.5, 1.26), (3.5, 1.26), (0.0, 4.0)];
        assert_eq!(path(&points), "M10 20l0 0 25-7-35 27");
    }

    #[test]
    fn text_is_escaped_and_turned() {
        let mut svg = Svg::new((10.0, 10.0), 1.0, 1.0);
        svg.turned_text("a < b & c", (1.0, 2.0), 13.0, Anchor::Middle, true);
        let svg = svg.finish();
        assert!(svg.contains("rotate(-90 10 20)\">a &lt; b &amp; c</text>"), "{svg}");
    }

    /// The widths are from the tables of DejaVu Sans, at a size of 100.
    #[test]
    fn widths_are_those_of_the_font_to_a_twentieth() {
        for (text, width) in [
            ("without adaptation", 949.3),
            ("−0.25", 306.4),
            ("angular velocity error (rad/s)", 1443.6),
            ("10⁻⁴", 220.1),
            ("latency of one step (µs)", 1187.0),
        ] {
            let found = text_width(text, 100.0);
            assert!((found / width - 1.0).abs() < 0.05, "{text}: {found}");
        }
    }
}
