//! Numbers, times and ages in few characters.

/// A number in at most nine characters, sign included, with `decimals` decimals or as many as fit.
pub fn number(value: f64, decimals: usize) -> String {
    const WIDTH: usize = 9;
    match value {
        _ if value.is_nan() => return "NaN".into(),
        f64::INFINITY => return "∞".into(),
        f64::NEG_INFINITY => return "-∞".into(),
        _ => {}
    }
    let mut with_decimals = (0..=decimals).rev().map(|decimals| format!("{value:.decimals$}"));
    let text = with_decimals.find(|text| text.len() <= WIDTH).unwrap_or_else(|| format!("{value:.1e}"));
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|digit| matches!(digit, b'0' | b'.')) => zero.into(),
        _ => text,
    }
}

/// A number that is never negative, in at most seven characters, with three digits that count.
pub fn magnitude(value: f64) -> String {
    match value {
        _ if value.is_nan() => "NaN".into(),
        _ if value.is_infinite() => "∞".into(),
        _ if value < 1e-99 => "0".into(),
        _ if value < 1e-4 => format!("{value:.1e}"),
        _ if value < 0.1 => format!("{value:.4}"),
        _ if value < 10.0 => format!("{value:.3}"),
        _ if value < 99_999.95 => format!("{value:.1}"),
        _ => format!("{value:.1e}"),
    }
}

/// A deviation, in at most five characters, with two digits that count.
pub fn deviation(value: f64) -> String {
    match value {
        _ if value < 1e-99 => "0".into(),
        _ if value < 9.5e-4 => format!("{value:.0e}"),
        _ if value < 0.095 => format!("{value:.3}"),
        _ if value < 0.95 => format!("{value:.2}"),
        _ if value < 9.5 => format!("{value:.1}"),
        _ if value < 99_999.5 => format!("{value:.0}"),
        _ => format!("{value:.0e}"),
    }
}

/// A length of time.
pub fn duration(seconds: f64) -> String {
    match seconds {
        _ if !seconds.is_finite() => "ever".into(),
        _ if seconds < 0.0995 => format!("{:.0} ms", seconds * 1e3),
        _ if seconds < 9.95 => format!("{seconds:.1} s"),
        _ if seconds < 120.0 => format!("{seconds:.0} s"),
        _ if seconds < 7200.0 => format!("{} min", (seconds / 60.0) as u64),
        _ if seconds < 172_800.0 => format!("{:.1} h", seconds / 3600.0),
        _ => format!("{:.1} days", seconds / 86_400.0),
    }
}

/// A length of time in ns.
pub fn duration_ns(ns: u64) -> String {
    duration(ns as f64 / 1e9)
}

/// How long something runs, to the second.
pub fn running(ns: u64) -> String {
    let s = ns / 1_000_000_000;
    let (days, h, min, s) = (s / 86_400, s / 3600 % 24, s / 60 % 60, s % 60);
    if days > 0 { format!("{days} d {h}:{min:02}:{s:02}") } else { format!("{h}:{min:02}:{s:02}") }
}

/// Time of the day.
pub fn utc(unix_s: u64) -> String {
    let s = unix_s % 86_400;
    format!("{:02}:{:02}:{:02} UTC", s / 3600, s / 60 % 60, s % 60)
}

/// A latency in µs, in at most seven characters.
pub fn micros(ns: u64) -> String {
    let us = ns as f64 / 1e3;
    match us {
        _ if us < 99_999.0 => format!("{us:.1}"),
        _ if us < 99_999e3 => format!("{:.0}ms", us / 1e3),
        _ => format!("{:.0}s", us / 1e6),
    }
}

/// Lines of at most `width` characters, broken between words.
pub fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last_mut().expect("never empty");
        let (length, more) = (line.chars().count(), word.chars().count());
        if length == 0 {
            line.push_str(word);
        } else if length + 1 + more <= width {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.into());
        }
    }
    lines
}

/// The text within `width` characters, with a mark where it was cut.
pub fn cut(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.into();
    }
    let mut short: String = text.chars().take(width.saturating_sub(1)).collect();
    short.push('…');
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fit_their_columns() {
        for exponent in -320..=308 {
            for mantissa in [1.0, 9.9999999] {
                let value = mantissa * 10_f64.powi(exponent);
                for decimals in [1, 3, 5] {
                    let text = number(-value, decimals);
                    assert!((2..=9).contains(&text.chars().count()), "{text}");
                }
                assert!(magnitude(value).chars().count() <= 7, "{}", magnitude(value));
                assert!(deviation(value).chars().count() <= 5, "{}", deviation(value));
            }
        }
        for (value, decimals, text) in [
            (-1.23449, 3, "-1.234"),
            (1000.0, 3, "1000.000"),
            (-12345.678, 3, "-12345.68"),
            (-123.456789, 5, "-123.4568"),
            (-1e-4, 3, "0.000"),
            (-12_345_678.0, 3, "-12345678"),
            (1e9, 3, "1.0e9"),
        ] {
            assert_eq!(number(value, decimals), text);
        }
        for (value, text) in [(0.01234, "0.0123"), (0.5, "0.500"), (0.0, "0"), (f64::INFINITY, "∞")] {
            assert_eq!(magnitude(value), text);
        }
        for ns in [0, 1, 999, 99_998_000, 100_000_000, 3_600_000_000_000] {
            assert!(micros(ns).chars().count() <= 7, "{}", micros(ns));
        }
    }

    #[test]
    fn times_are_said_as_people_say_them() {
        let said = [0.004, 0.8, 12.0, 119.0, 600.0, 9000.0, 1e6, f64::INFINITY].map(duration);
        assert_eq!(said, ["4 ms", "0.8 s", "12 s", "119 s", "10 min", "2.5 h", "11.6 days", "ever"]);
        assert_eq!(running(3_723_000_000_000), "1:02:03");
        assert_eq!(running(90_061_000_000_000), "1 d 1:01:01");
        assert_eq!(utc(1_700_000_000), "22:13:20 UTC");
    }

    #[test]
    fn long_lines_break_between_words() {
        assert_eq!(wrapped("to be or not", 5), ["to be", "or", "not"]);
        assert_eq!(wrapped("", 5), [""]);
        assert_eq!(cut("abcdef", 4), "abc…");
        assert_eq!(cut("abcd", 4), "abcd");
    }
}
