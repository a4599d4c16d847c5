//! Value parsers of options that several commands share.

/// A rate that a timer of microseconds can keep.
pub(crate) fn parse_rate_hz(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(rate_hz) if (1.0..=20_000.0).contains(&rate_hz) => Ok(rate_hz),
        _ => Err("needed: a rate from 1 to 20000 (in Hz)".into()),
    }
}

/// The length of a measurement.
pub(crate) fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(seconds) if (1e-3..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("needed: a number of seconds from 0.001 to 86400".into()),
    }
}
