//! Eq. 4 and 6: which values a window holds, and with which other windows it is compared.

use super::params::{ExtractionParams, Profile};

/// The windows of an episode of `n_steps`, by the index of their first value.
#[derive(Debug, Clone, Copy)]
pub(super) struct Windows {
    pub(super) n_steps: usize,
    pub(super) width: usize,
    pub(super) neighbours: usize,
    left: usize,
    right: usize,
    /// Steps before this one look forward (Δ = +1), those from it on back.
    turn: usize,
}

impl Windows {
    /// `n_steps` is at least `2·W + 1`.
    pub(super) fn new(n_steps: usize, params: &ExtractionParams) -> Self {
        let width = params.window_width();
        let turn = match params.profile() {
            // t + w ≤ T − 1
            Profile::Paper => n_steps.saturating_sub(params.window()),
            // t < T − 1 − W
            Profile::Authors => n_steps.saturating_sub(width + 1),
        };
        Self {
            n_steps,
            width,
            neighbours: params.neighbours(),
            left: params.left(),
            right: params.right(),
            turn,
        }
    }

    /// Different windows: they start at `0..n_starts`.
    pub(super) fn n_starts(&self) -> usize {
        self.n_steps - self.width
    }

    /// First value of the window of step `t`; the borders repeat the first `w_l` and the last `w_r` windows.
    #[inline]
    pub(super) fn start(&self, t: usize) -> usize {
        if t < self.left {
            t
        } else if t >= self.n_steps - self.right {
            t - self.width
        } else {
            t - self.left
        }
    }

    /// The steps that step `t` is compared with (Eq. 7).
    pub(super) fn compared(&self, t: usize) -> impl Iterator<Item = usize> {
        let forward = t < self.turn;
        (1..=self.neighbours).map(move |j| if forward { t + j } else { t - j })
    }

    /// The steps whose own window and all compared windows follow each other without a border, looking forward.
    pub(super) fn interior(&self) -> std::ops::Range<usize> {
        let end = (self.n_steps - self.right)
            .saturating_sub(self.neighbours)
            .min(self.turn);
        self.left..end.max(self.left)
    }

    /// One value per step from one value per window start.
    pub(super) fn spread(&self, by_start: &[f64]) -> Vec<f64> {
        (0..self.n_steps).map(|t| by_start[self.start(t)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::params::RawParams;
    use super::*;

    #[test]
    fn borders_repeat_windows() {
        let params = ExtractionParams::new(RawParams::default()).unwrap();
        let windows = Windows::new(11, &params);
        let starts: Vec<_> = (0..11).map(|t| windows.start(t)).collect();
        // w_l = 3, w_r = 2, W = 5: six windows.
        assert_eq!(starts, [0, 1, 2, 0, 1, 2, 3, 4, 5, 4, 5]);
        assert_eq!(windows.compared(5).collect::<Vec<_>>(), [6, 7, 8, 9, 10]);
        assert_eq!(windows.compared(6).collect::<Vec<_>>(), [5, 4, 3, 2, 1]);
        assert_eq!(Windows::new(20, &params).interior(), 3..13);
    }
}
