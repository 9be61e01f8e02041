//! The last windows of an episode, laid out so that the kernel for regular ones can take them too.
//!
//! Behind the regular steps come some that have fewer windows ahead, and some that look back. The latter look ahead in a
//! column that is read backwards, and no measure depends on the direction in which a window is read. So both kinds are
//! windows of a short column of its own: the end of the column, then the end of the column backwards.

use super::super::window::{Neighbourhood, Windows};

/// Which windows of the short column are steps of the episode.
#[derive(Debug)]
pub(super) struct Tail {
    /// By window of the short column: how many windows ahead it is compared with; 0 if it is no step.
    pub(super) limits: Vec<u32>,
    /// Window of the short column, step of the episode.
    pub(super) steps: Vec<(usize, usize)>,
    width: usize,
    backwards: usize,
}

impl Tail {
    /// Of an episode in profile `paper`.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "no window is wider than 1024"
    )]
    pub(super) fn new(windows: &Windows) -> Self {
        let (n, width) = (windows.n_steps, windows.width);
        let mut limits = vec![0; 2 * width + windows.tail().len() + 1];
        let mut steps = Vec::new();
        for t in windows.tail() {
            let start = windows.start(t);
            let (at, limit) = match windows.neighbourhood(t) {
                Neighbourhood::OwnWindow => continue,
                Neighbourhood::Ahead(limit) => (start + 2 * width - n, limit),
                Neighbourhood::Behind(limit) => (2 * width + (n - width - start), limit),
            };
            limits[at] = limit as u32;
            steps.push((at, t));
        }
        Self {
            limits,
            steps,
            width,
            backwards: n.min(3 * width),
        }
    }

    /// Writes the short column of column `x` to the front of `out`.
    pub(super) fn column<T: Copy>(&self, x: &[T], out: &mut [T]) {
        let (forwards, backwards) = out.split_at_mut(2 * self.width);
        forwards.copy_from_slice(&x[x.len() - 2 * self.width..]);
        let reversed = x.iter().rev().take(self.backwards);
        for (value, x) in backwards.iter_mut().zip(reversed) {
            *value = *x;
        }
    }
}
