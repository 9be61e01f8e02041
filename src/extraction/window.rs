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

/// The windows that one is compared with, by the distance of their starts from its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Neighbourhood {
    /// Among others its own, repeated at a border: no difference.
    OwnWindow,
    /// Those that start `1..=n` steps later.
    Ahead(usize),
    /// Those that start `1..=n` steps earlier.
    Behind(usize),
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

    /// Which windows that of step `t` is compared with, by their starts; profile `paper` only.
    ///
    /// A border window equals the one it repeats. So a step that is compared with a step whose window is its own has
    /// the distance 0, and the other border windows are ones that the step is compared with anyway: what is left is one
    /// number. A test holds this against [`Self::compared`].
    pub(super) fn neighbourhood(&self, t: usize) -> Neighbourhood {
        if t < self.left || t >= self.n_steps - self.right {
            return Neighbourhood::OwnWindow;
        }
        let start = t - self.left;
        if t < self.turn {
            let to_border = self.n_steps - self.right - t;
            Neighbourhood::Ahead(self.width.min(to_border - 1))
        } else if start < self.left {
            Neighbourhood::OwnWindow
        } else {
            Neighbourhood::Behind(self.width.min(start))
        }
    }

    /// The steps that are compared with the next W windows, all of them; profile `paper` only.
    pub(super) fn regular(&self) -> std::ops::Range<usize> {
        self.left..self.left + self.n_steps - 2 * self.width
    }

    /// The steps behind the regular ones whose window is not a repeated one; profile `paper` only.
    pub(super) fn tail(&self) -> std::ops::Range<usize> {
        self.regular().end..self.n_steps - self.right
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
        assert_eq!(Windows::new(20, &params).regular(), 3..13);
    }

    #[test]
    fn neighbourhoods_hold_the_windows_that_are_compared() {
        for window in 2..=13 {
            let params = ExtractionParams::new(RawParams {
                window,
                ..RawParams::default()
            })
            .unwrap();
            for n in params.min_steps()..6 * window + 3 {
                let windows = Windows::new(n, &params);
                for t in 0..n {
                    let own = windows.start(t);
                    let mut starts: Vec<_> =
                        windows.compared(t).map(|o| windows.start(o)).collect();
                    starts.sort_unstable();
                    starts.dedup();
                    let found = windows.neighbourhood(t);
                    match found {
                        Neighbourhood::OwnWindow => assert!(starts.contains(&own)),
                        Neighbourhood::Ahead(m) => {
                            assert_eq!(starts, (own + 1..=own + m).collect::<Vec<_>>());
                        }
                        Neighbourhood::Behind(m) => {
                            assert_eq!(starts, (own - m..own).collect::<Vec<_>>());
                        }
                    }
                    if windows.regular().contains(&t) {
                        assert_eq!(found, Neighbourhood::Ahead(window));
                    } else if !windows.tail().contains(&t) {
                        assert_eq!(found, Neighbourhood::OwnWindow);
                    }
                }
            }
        }
    }
}
