//! Plain text for people: tables with columns under each other, numbers that read well. Pure.

use std::fmt::Write as _;

/// On which side of its column a cell stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    /// Names.
    Left,
    /// Numbers.
    Right,
}

/// Rows under each other, each on a line; trailing blanks are cut.
pub(crate) fn aligned<R: AsRef<[String]>>(text: &mut String, sides: &[Side], rows: &[R]) {
    let width = |c: usize| {
        let cells = rows.iter().filter_map(|row| row.as_ref().get(c));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..sides.len()).map(width).collect();
    for row in rows {
        let mut content = String::new();
        for (c, cell) in row.as_ref().iter().enumerate() {
            let width = widths.get(c).copied().unwrap_or(0);
            let gap = if c == 0 { "" } else { "  " };
            let _infallible = match sides.get(c) {
                Some(Side::Right) => write!(content, "{gap}{cell:>width$}"),
                _ => write!(content, "{gap}{cell:<width$}"),
            };
        }
        line(text, content.trim_end());
    }
}

/// A line and its end. Names come from recordings: what would steer a terminal does not get there.
pub(crate) fn line(text: &mut String, content: &str) {
    text.push_str(&printable(content));
    text.push('\n');
}

/// Text without control characters.
pub(crate) fn printable(text: &str) -> String {
    let visible = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    text.chars().map(visible).collect()
}

/// `1 step`, `1,234 steps`.
pub(crate) fn counted(n: u64, word: &str) -> String {
    format!("{} {}", count(n), plural(n, word))
}

pub(crate) fn plural(n: u64, word: &str) -> String {
    if n == 1 {
        word.to_owned()
    } else {
        format!("{word}s")
    }
}

/// An integer with its thousands apart.
pub(crate) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(
            [count(0), count(999), count(1000), count(1_234_567)],
            ["0", "999", "1,000", "1,234,567"]
        );
        assert_eq!(
            [counted(1, "step"), counted(2, "step")],
            ["1 step", "2 steps"]
        );
    }

    #[test]
    fn columns_stand_under_each_other() {
        let rows = [["a", "1"], ["käse", "100"]].map(|row| row.map(String::from));
        let mut text = String::new();
        aligned(&mut text, &[Side::Left, Side::Right], &rows);
        assert_eq!(text, "a       1\nkäse  100\n");
    }
}
