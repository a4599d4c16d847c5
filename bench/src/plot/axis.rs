//! One axis: maps values to fractions of its length, and computes ticks with labels.

/// Values to a share of the axis' length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    pub(super) log: bool,
    /// In log10 where the axis is logarithmic.
    start: f64,
    end: f64,
}

#[derive(Debug, Default, PartialEq)]
pub(super) struct Ticks {
    /// Values and their labels.
    pub(super) major: Vec<(f64, String)>,
    pub(super) minor: Vec<f64>,
    /// The factor on all labels, where it is not 1.
    pub(super) multiplier: Option<String>,
}

impl Axis {
    /// Around the values, with `margin` of their span on both sides. They must be finite, and positive on
    /// a logarithmic axis.
    pub(super) fn around(values: impl Iterator<Item = f64>, log: bool, margin: f64) -> Self {
        let (mut start, mut end) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values {
            let value = if log { value.log10() } else { value };
            (start, end) = (start.min(value), end.max(value));
        }
        if start > end {
            (start, end) = (0.0, 1.0);
        }
        let (span, size) = (end - start, start.abs().max(end.abs()));
        // A value that is constant but for rounding gets a range of its own size around it.
        let widening = match span <= 1e-9 * size || span == 0.0 {
            true if log => 0.3,
            true if size == 0.0 => 1.0,
            true => 0.1 * size,
            false => margin * span,
        };
        Self { log, start: start - widening, end: end + widening }
    }

    /// Moves an end that is within a hundredth of a tick onto it: 20 s sampled every 5 ms end at 19.995 s.
    pub(super) fn completed(self, wanted: usize) -> Self {
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
    pub(super) fn position(&self, value: f64) -> f64 {
        let value = if self.log { value.log10() } else { value };
        (value - self.start) / (self.end - self.start)
    }

    /// About `wanted` labelled ticks.
    pub(super) fn ticks(&self, wanted: usize) -> Ticks {
        if self.log { self.power_ticks(wanted) } else { linear_ticks(self.start, self.end, wanted) }
    }

    fn power_ticks(&self, wanted: usize) -> Ticks {
        let (first, last) = (self.start.floor() as i32, self.end.ceil() as i32);
        let multiples = |factors: &[u32]| -> Vec<f64> {
            let of_power =
                |power: i32| factors.iter().map(move |&factor| f64::from(factor) * 10f64.powi(power));
            let inside = |value: &f64| (self.start..=self.end).contains(&value.log10());
            (first..=last).flat_map(of_power).filter(inside).collect()
        };
        let decades = (self.end.floor() - self.start.ceil()) as i32 + 1;
        let minor = multiples(if decades <= 8 { &[1, 2, 3, 4, 5, 6, 7, 8, 9] } else { &[1] });
        if self.end - self.start >= 2.0 {
            // Powers of ten are short: twice as many have room.
            let stride = (decades.max(1) as usize).div_ceil(2 * wanted.max(1)) as i32;
            let powers = (self.start.ceil() as i32..=self.end.floor() as i32).filter(|p| p % stride == 0);
            let major = powers.map(|power| (10f64.powi(power), format!("10{}", superscript(power))));
            return Ticks { major: major.collect(), minor, multiplier: None };
        }
        let major = multiples(&[1, 2, 5]);
        if major.len() >= 3 {
            let major = major.into_iter().map(|value| (value, short_number(value))).collect();
            return Ticks { major, minor, multiplier: None };
        }
        // Less than a decade: round numbers of a linear axis, at their logarithmic places.
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
    let tick = |i: usize| {
        let value = (first + i as f64) * step;
        // + 0.0 makes a positive zero of a negative one.
        let label = format!("{:.digits$}", value / unit + 0.0);
        // The minus sign proper, as wide as a digit.
        (value, label.replace('-', "−"))
    };
    let major = (0..=(last - first) as usize).map(tick).collect();
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
