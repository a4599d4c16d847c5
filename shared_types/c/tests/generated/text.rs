//! Breaks text into lines, for the files of both languages.

/// Breaks a text after spaces where a line would be longer than 110 characters, with `indent` in front of each line.
pub(crate) fn wrapped(text: &str, indent: &str) -> Vec<String> {
    let mut lines = vec![String::from(indent)];
    for word in text.split_whitespace() {
        let last = lines.len() - 1;
        if lines[last].chars().count() + word.chars().count() < 110 {
            let gap = if lines[last] == indent { "" } else { " " };
            lines[last] += &format!("{gap}{word}");
        } else {
            lines.push(format!("{indent}{word}"));
        }
    }
    lines
}
