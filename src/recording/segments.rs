//! Values that are held back: pushed in the order of the file, read in any order, given up from the front.

use std::collections::VecDeque;

/// Values of a segment; a longer run has a segment of its own. Small enough to be used again while it is in the cache
/// of the last level.
const SEGMENT: usize = 64 << 10;

/// Where a run of values is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Run {
    /// Number of the segment, counted from the first there ever was.
    segment: u32,
    start: u32,
    len: u32,
}

impl Run {
    /// How many values it has.
    pub(crate) fn len(self) -> usize {
        self.len as usize
    }
}

/// Runs of values in a row of buffers: nothing that stays is moved when other values go.
#[derive(Debug, Default)]
pub(crate) struct Segments {
    buffers: VecDeque<Vec<f64>>,
    /// Number of the first segment that is still there.
    first: u32,
    spare: Vec<Vec<f64>>,
}

impl Segments {
    /// Keeps a run of values; at most `MAX_VECTOR_WIDTH`.
    pub(crate) fn push(&mut self, values: &[f64]) -> Run {
        let has_room = |last: &Vec<f64>| last.capacity() - last.len() >= values.len();
        if !self.buffers.back().is_some_and(has_room) {
            let mut segment = self.spare.pop().unwrap_or_default();
            segment.reserve_exact(values.len().max(SEGMENT));
            self.buffers.push_back(segment);
        }
        let nth = u32::try_from(self.buffers.len() - 1).unwrap_or(u32::MAX);
        let mut run = Run {
            segment: self.first.wrapping_add(nth),
            start: 0,
            len: u32::try_from(values.len()).unwrap_or(u32::MAX),
        };
        if let Some(last) = self.buffers.back_mut() {
            run.start = u32::try_from(last.len()).unwrap_or(u32::MAX);
            last.extend_from_slice(values);
        }
        run
    }

    /// The values of a run that was not given up.
    pub(crate) fn get(&self, run: Run) -> &[f64] {
        let nth = run.segment.wrapping_sub(self.first) as usize;
        let start = run.start as usize;
        &self.buffers[nth][start..start + run.len as usize]
    }

    /// Gives up all segments in front of the first that one of `kept` is in; all of them if there is none.
    pub(crate) fn keep(&mut self, kept: impl Iterator<Item = Run>) {
        let n_segments = self.buffers.len();
        let first = kept
            .map(|run| run.segment.wrapping_sub(self.first) as usize)
            .min();
        for _ in 0..first.unwrap_or(n_segments) {
            let Some(mut segment) = self.buffers.pop_front() else {
                break;
            };
            self.first = self.first.wrapping_add(1);
            // One that was made for a long run would never be filled.
            if segment.capacity() == SEGMENT {
                segment.clear();
                self.spare.push(segment);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_stay_where_they_are_while_others_go() {
        let mut segments = Segments::default();
        let values = |i: usize| vec![i as f64; 1 + (i * 7919) % 30_000];
        let mut runs = VecDeque::new();
        for i in 0..200 {
            runs.push_back((i, segments.push(&values(i))));
            if i % 3 == 2 {
                runs.pop_front();
                segments.keep(runs.iter().map(|(_, run)| *run));
            }
            for (i, run) in &runs {
                assert_eq!(segments.get(*run), values(*i));
            }
        }
        segments.keep(std::iter::empty());
        assert!(segments.buffers.is_empty());
        let run = segments.push(&[1.0]);
        assert_eq!(segments.get(run), [1.0]);
    }

    #[test]
    fn a_long_run_has_a_segment_of_its_own() {
        let mut segments = Segments::default();
        let long = vec![2.0; 3 * SEGMENT];
        let (short, run) = (segments.push(&[1.0]), segments.push(&long));
        assert_eq!(segments.get(run), long);
        segments.keep([run].into_iter());
        assert_eq!(segments.spare.len(), 1);
        let next = segments.push(&[3.0]);
        assert_eq!(
            (segments.get(run), segments.get(next)),
            (&*long, &[3.0][..])
        );
        assert_ne!(short, next);
        segments.keep([next].into_iter());
        assert_eq!(segments.spare.len(), 0, "the long one is not kept");
    }
}
