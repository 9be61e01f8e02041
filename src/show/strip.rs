//! The strip of one episode.

use std::collections::BTreeMap;

use super::canvas::{Columns, Paint, Row};
use super::glyphs::Glyphs;
use super::{ShowOptions, printable};
use crate::model::Series;
use crate::results::{EpisodeRow, EpisodeSteps, JointSteps, SegmentRow};

/// Letters of a joint's name.
const MAX_NAME: usize = 16;

/// Letters of what a row shows.
const KIND_WIDTH: usize = 9;

/// Columns between two ticks, at least: a number and a gap.
const TICK_COLUMNS: usize = 8;

/// Draws an episode: state, then each joint, then the steps and their times.
pub(super) fn strip(
    row: &EpisodeRow,
    steps: Option<&EpisodeSteps>,
    segments: &[SegmentRow],
    options: ShowOptions,
) -> String {
    let mut by_joint: BTreeMap<i32, Vec<&SegmentRow>> = BTreeMap::new();
    for segment in segments {
        by_joint.entry(segment.joint).or_default().push(segment);
    }
    let names = names(steps, &by_joint);
    let name_width = names
        .values()
        .map(|name| name.chars().count())
        .max()
        .unwrap_or(0)
        .clamp("state".len(), MAX_NAME);
    let label_width = name_width + 1 + KIND_WIDTH;
    let painter = Painter {
        glyphs: Glyphs::new(options.ascii),
        columns: Columns::new(row.n_steps, options.width.saturating_sub(label_width)),
        options,
        name_width,
        label_width,
    };
    let mut text = String::new();
    if painter.columns.n_columns() == 0 {
        return text;
    }
    if let Some(steps) = steps {
        painter.state(&mut text, &steps.state);
    }
    for (number, name) in &names {
        let of_joint = by_joint.get(number).map_or(&[][..], Vec::as_slice);
        let joint = steps.and_then(|s| s.joints.iter().find(|j| j.joint == *number));
        painter.joint(&mut text, name, joint, of_joint);
    }
    painter.axis(&mut text, steps.and_then(|s| s.times.as_deref()));
    text
}

/// Joints by number; without the per-step table only those that have composite actions are known.
fn names(
    steps: Option<&EpisodeSteps>,
    by_joint: &BTreeMap<i32, Vec<&SegmentRow>>,
) -> BTreeMap<i32, String> {
    let name = |number: i32, name: Option<&str>| match (name, number) {
        (Some(name), _) => printable(name),
        (None, -1) => "together".to_owned(),
        (None, number) => number.to_string(),
    };
    let of_steps = steps.into_iter().flat_map(|steps| &steps.joints);
    let of_segments = by_joint.values().filter_map(|segments| segments.first());
    of_steps
        .map(|joint| (joint.joint, joint.joint_name.as_deref()))
        .chain(of_segments.map(|segment| (segment.joint, segment.joint_name.as_deref())))
        .map(|(number, given)| (number, name(number, given)))
        .collect()
}

struct Painter {
    glyphs: Glyphs,
    columns: Columns,
    options: ShowOptions,
    name_width: usize,
    label_width: usize,
}

impl Painter {
    fn row(&self, name: &str, kind: &str) -> Row {
        let mut row = Row::default();
        let is_plain = |c: char| c.is_ascii() || !self.options.ascii;
        let letters = name.chars().take(self.name_width);
        for c in letters.map(|c| if is_plain(c) { c } else { '?' }) {
            row.push_char(c, Paint::Name);
        }
        row.pad(self.name_width + 1);
        row.push(kind, Paint::Faint);
        row.pad(self.label_width);
        row
    }

    fn finish(&self, text: &mut String, row: &Row) {
        row.write(text, self.options.color);
    }

    fn state(&self, text: &mut String, state: &Series) {
        let mut row = self.row("state", "change");
        self.greatest(&mut row, &state.change, Paint::State);
        self.finish(text, &row);
        let mut row = self.row("", "mask");
        self.mask(&mut row, &state.mask, Paint::State);
        self.finish(text, &row);
    }

    fn joint(
        &self,
        text: &mut String,
        name: &str,
        joint: Option<&JointSteps>,
        segments: &[&SegmentRow],
    ) {
        let mut name = name;
        if let Some(joint) = joint {
            // The actions of joints that are cut together are not in the table.
            if !joint.actions.is_empty() {
                let mut row = self.row(std::mem::take(&mut name), "action");
                self.mean(&mut row, &joint.actions, Paint::Plain);
                self.finish(text, &row);
            }
            let mut row = self.row(std::mem::take(&mut name), "change");
            self.greatest(&mut row, &joint.action.change, Paint::Action);
            self.finish(text, &row);
            let mut row = self.row("", "mask");
            self.mask(&mut row, &joint.action.mask, Paint::Action);
            self.finish(text, &row);
        }
        let mut row = self.row(name, "segments");
        self.segments(&mut row, segments);
        self.finish(text, &row);
    }

    /// The mean of each column, between the least and the greatest value of all.
    fn mean(&self, row: &mut Row, values: &[f64], paint: Paint) {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // Halves, so that the widest range of all does not overflow.
        let range = greatest / 2.0 - least / 2.0;
        self.each(row, paint, |steps| {
            let of_column = values.get(steps).unwrap_or(&[]);
            let n = of_column.len() as f64;
            let mean: f64 = of_column.iter().map(|v| v / n).sum();
            let share = if range > 0.0 {
                (mean / 2.0 - least / 2.0) / range
            } else {
                0.0
            };
            self.glyphs.level(share)
        });
    }

    /// The greatest change of each column.
    fn greatest(&self, row: &mut Row, changes: &[f64], paint: Paint) {
        if changes.is_empty() {
            row.push("too short", Paint::Faint);
            return;
        }
        self.each(row, paint, |steps| {
            let of_column = changes.get(steps).unwrap_or(&[]);
            self.glyphs
                .level(of_column.iter().copied().fold(0.0, f64::max))
        });
    }

    /// Where any step of a column is masked.
    fn mask(&self, row: &mut Row, mask: &[bool], paint: Paint) {
        for column in 0..self.columns.n_columns() {
            let steps = self.columns.steps(column);
            if mask.get(steps).is_some_and(|m| m.contains(&true)) {
                row.push_char(self.glyphs.mask, paint);
            } else {
                row.push_char(self.glyphs.no_mask, Paint::Faint);
            }
        }
    }

    fn each(&self, row: &mut Row, paint: Paint, draw: impl Fn(std::ops::Range<usize>) -> char) {
        for column in 0..self.columns.n_columns() {
            row.push_char(draw(self.columns.steps(column)), paint);
        }
    }

    /// Composite actions from their first to their last step, with their ranks where there is room.
    fn segments(&self, row: &mut Row, segments: &[&SegmentRow]) {
        for (i, segment) in segments.iter().enumerate() {
            let paint = Paint::Segment(i % 2 == 0);
            let first = self.columns.of(segment.start_step);
            let last = self.columns.of(segment.end_step.saturating_sub(1));
            let width = last + 1 - first;
            let glyphs = &self.glyphs;
            let mut bar: Vec<char> = vec![glyphs.segment; width];
            bar[0] = glyphs.segment_start;
            bar[width - 1] = glyphs.segment_end;
            if width == 1 {
                bar[0] = glyphs.segment_alone;
            }
            let rank: Vec<char> = segment.state_change_rank.to_string().chars().collect();
            if rank.len() + 2 <= width {
                let at = (width - rank.len()) / 2;
                bar[at..at + rank.len()].copy_from_slice(&rank);
            }
            let bar: String = bar.into_iter().collect();
            row.put(self.label_width + first, &bar, paint);
        }
    }

    /// Ticks with the numbers of steps, and the seconds since the first.
    fn axis(&self, text: &mut String, times: Option<&[i64]>) {
        let n_columns = self.columns.n_columns();
        let n_steps = self.columns.steps(n_columns - 1).end;
        let distance = tick_distance(n_steps, n_columns);
        let mut steps = self.row("", "step");
        let mut seconds = self.row("", "seconds");
        for step in (0..n_steps).step_by(distance) {
            let column = self.label_width + self.columns.of(step);
            let is_room = |label: &str| column + 1 + label.len() <= self.label_width + n_columns;
            let label = step.to_string();
            if is_room(&label) {
                steps.put(column, &self.glyphs.tick.to_string(), Paint::Faint);
                steps.put(column + 1, &label, Paint::Faint);
            }
            let Some(times) = times else { continue };
            let elapsed = times[step].saturating_sub(times[0]) as f64 / 1e9;
            let label = format!("{elapsed:.1}");
            if is_room(&label) && label.len() < TICK_COLUMNS {
                seconds.put(column + 1, &label, Paint::Faint);
            }
        }
        self.finish(text, &steps);
        if times.is_some() {
            self.finish(text, &seconds);
        }
    }
}

/// Steps between two ticks: 1, 2 or 5 and zeros, so many that the numbers have room.
fn tick_distance(n_steps: usize, n_columns: usize) -> usize {
    let least = (n_steps * TICK_COLUMNS).div_ceil(n_columns.max(1));
    let mut power = 1_usize;
    loop {
        for distance in [1, 2, 5].map(|digit| power.saturating_mul(digit)) {
            if distance >= least {
                return distance;
            }
        }
        power = power.saturating_mul(10);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_apart() {
        assert_eq!(tick_distance(80, 80), 10);
        assert_eq!(tick_distance(1_000, 80), 100);
        assert_eq!(tick_distance(999, 10), 1_000);
        assert_eq!(tick_distance(5, 5), 10);
        assert!(tick_distance(usize::MAX / 16, 1) >= usize::MAX / 2 - 8);
    }
}
