//! Columns of steps, and rows of characters with their colours.

use std::fmt::Write as _;
use std::ops::Range;

use anstyle::{AnsiColor, Style};

/// How the steps of an episode are put into columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Columns {
    n_steps: usize,
    n_columns: usize,
}

impl Columns {
    /// At most `width` columns, at least one step in each.
    pub(super) fn new(n_steps: usize, width: usize) -> Self {
        Self {
            n_steps,
            n_columns: width.min(n_steps),
        }
    }

    pub(super) fn n_columns(self) -> usize {
        self.n_columns
    }

    /// The steps of a column.
    pub(super) fn steps(self, column: usize) -> Range<usize> {
        let start = |column: usize| column * self.n_steps / self.n_columns.max(1);
        start(column)..start(column + 1)
    }

    /// The column of a step.
    pub(super) fn of(self, step: usize) -> usize {
        let last = self.n_columns.saturating_sub(1);
        (((step + 1) * self.n_columns).saturating_sub(1) / self.n_steps.max(1)).min(last)
    }
}

/// What a character is painted as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Paint {
    Plain,
    Name,
    Faint,
    Action,
    State,
    /// Composite actions in turn, so that neighbours differ.
    Segment(bool),
}

impl Paint {
    fn style(self) -> Style {
        match self {
            Self::Plain => Style::new(),
            Self::Name => Style::new().bold(),
            Self::Faint => Style::new().dimmed(),
            Self::Action => AnsiColor::Yellow.on_default(),
            Self::State => AnsiColor::Cyan.on_default(),
            Self::Segment(true) => AnsiColor::Green.on_default().bold(),
            Self::Segment(false) => AnsiColor::Magenta.on_default().bold(),
        }
    }
}

/// A line of painted characters.
#[derive(Debug, Clone, Default)]
pub(super) struct Row(Vec<(char, Paint)>);

impl Row {
    pub(super) fn push(&mut self, text: &str, paint: Paint) {
        self.0.extend(text.chars().map(|c| (c, paint)));
    }

    pub(super) fn push_char(&mut self, c: char, paint: Paint) {
        self.0.push((c, paint));
    }

    /// Fills up to `width` columns.
    pub(super) fn pad(&mut self, width: usize) {
        while self.0.len() < width {
            self.push_char(' ', Paint::Plain);
        }
    }

    /// Overwrites from `column` on; what is beyond the end is appended.
    pub(super) fn put(&mut self, column: usize, text: &str, paint: Paint) {
        self.pad(column);
        for (i, c) in text.chars().enumerate() {
            match self.0.get_mut(column + i) {
                Some(cell) => *cell = (c, paint),
                None => self.push_char(c, paint),
            }
        }
    }

    /// The line, without blanks at its end.
    pub(super) fn write(&self, text: &mut String, color: bool) {
        let end = self
            .0
            .iter()
            .rposition(|(c, _)| *c != ' ')
            .map_or(0, |last| last + 1);
        for run in self.0[..end].chunk_by(|a, b| a.1 == b.1) {
            let style = if color {
                run[0].1.style()
            } else {
                Style::new()
            };
            let content: String = run.iter().map(|(c, _)| *c).collect();
            let _infallible = write!(text, "{style}{content}{style:#}");
        }
        text.push('\n');
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn each_step_is_in_one_column_and_no_column_is_empty(n_steps in 1_usize..3_000, width in 1_usize..300) {
            let columns = Columns::new(n_steps, width);
            let mut step = 0;
            for column in 0..columns.n_columns() {
                let steps = columns.steps(column);
                prop_assert_eq!(steps.start, step);
                prop_assert!(!steps.is_empty());
                prop_assert!(steps.clone().all(|s| columns.of(s) == column));
                step = steps.end;
            }
            prop_assert_eq!(step, n_steps);
        }
    }

    #[test]
    fn an_episode_without_steps_has_no_columns() {
        let columns = Columns::new(0, 80);
        assert_eq!((columns.n_columns(), columns.of(0)), (0, 0));
    }

    #[test]
    fn colours_are_escapes_around_runs_and_nothing_without() {
        let mut row = Row::default();
        row.push("ab", Paint::Action);
        row.push("  ", Paint::Plain);
        let written = |color| {
            let mut text = String::new();
            row.write(&mut text, color);
            text
        };
        assert_eq!(written(false), "ab\n");
        assert_eq!(written(true), "\u{1b}[33mab\u{1b}[0m\n");
    }
}
