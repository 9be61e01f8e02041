//! What strips are drawn with.

/// Characters of a strip.
pub(super) struct Glyphs {
    /// Of a value, from the least to the greatest.
    levels: &'static [char],
    pub(super) mask: char,
    pub(super) no_mask: char,
    pub(super) segment_start: char,
    pub(super) segment: char,
    pub(super) segment_end: char,
    /// A segment in one column.
    pub(super) segment_alone: char,
    pub(super) tick: char,
    pub(super) dots: &'static str,
}

impl Glyphs {
    pub(super) fn new(ascii: bool) -> Self {
        if ascii {
            Self {
                levels: &['_', '.', ':', '-', '=', '+', '*', '#'],
                mask: '#',
                no_mask: '.',
                segment_start: '[',
                segment: '-',
                segment_end: ']',
                segment_alone: '|',
                tick: '|',
                dots: "...",
            }
        } else {
            Self {
                levels: &['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'],
                mask: '■',
                no_mask: '·',
                segment_start: '├',
                segment: '─',
                segment_end: '┤',
                segment_alone: '┃',
                tick: '╵',
                dots: "…",
            }
        }
    }

    /// The character of a value in 0 to 1.
    pub(super) fn level(&self, value: f64) -> char {
        let n = self.levels.len();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to 0 and 1; what is no number counts as 0"
        )]
        let index = (value.clamp(0.0, 1.0) * n as f64) as usize;
        self.levels[index.min(n - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_a_character() {
        let glyphs = Glyphs::new(true);
        let of: String = [-1.0, 0.0, 0.124, 0.126, 0.5, 0.99, 1.0, 7.0, f64::NAN]
            .map(|v| glyphs.level(v))
            .iter()
            .collect();
        assert_eq!(of, "___.=###_");
    }
}
