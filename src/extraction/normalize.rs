//! Eq. 8: a measure scaled to 0..=1 over the episode.

/// A span of a series at or below this share of its maximum is rounding: the series is constant.
const CONSTANT: f64 = 1e-12;

/// The extent that a series is normalised by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent {
    pub(super) min: f64,
    pub(super) max: f64,
}

impl Extent {
    /// Of all values of all `series`.
    pub(super) fn of<'a>(series: impl IntoIterator<Item = &'a [f64]>) -> Self {
        let start = Self {
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
        };
        series.into_iter().flatten().fold(start, |e, &x| Self {
            min: e.min.min(x),
            max: e.max.max(x),
        })
    }

    /// Is the series constant? Then its change is 0 everywhere and passes no threshold.
    pub(super) fn is_constant(&self) -> bool {
        // The extent of no values runs backwards.
        self.max - self.min <= CONSTANT * self.max.abs()
    }

    /// `E_n = (E_w − min) / (max − min)`.
    pub(super) fn normalize(&self, measure: &[f64]) -> Vec<f64> {
        if self.is_constant() {
            return vec![0.0; measure.len()];
        }
        let span = self.max - self.min;
        measure.iter().map(|x| (x - self.min) / span).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_series_is_scaled_and_a_constant_one_is_zero() {
        let normalized = |s: &[f64]| Extent::of([s]).normalize(s);
        assert_eq!(normalized(&[1.0, 3.0, 2.0]), [0.0, 1.0, 0.5]);
        assert_eq!(normalized(&[2.0, 2.0 + 4e-16]), [0.0, 0.0]);
    }
}
