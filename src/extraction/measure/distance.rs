//! The two distances of a pair of windows (Eq. 7), in plain f64; `earth_mover.rs` has the earth mover in integers.

/// Total variation distance `½ Σ |p − q|`, 0..=1 for windows of sum 1.
///
/// With `scaled` both windows are scaled to sum 1 first; the authors' program takes them raw.
pub(super) fn total_variation(p: &[f64], q: &[f64], scaled: bool) -> f64 {
    let total = |window: &[f64]| {
        if scaled {
            window.iter().fold(0.0, |sum, x| sum + x)
        } else {
            1.0
        }
    };
    let (sum_p, sum_q) = (total(p), total(q));
    p.iter()
        .zip(q)
        .fold(0.0, |sum, (p, q)| sum + (p / sum_p - q / sum_q).abs())
        / 2.0
}

/// The 1-Wasserstein distance of two windows as samples, in the authors' program's order of operations.
#[derive(Debug, Default)]
pub(super) struct AuthorsEarthMover {
    p: Vec<f64>,
    q: Vec<f64>,
    all: Vec<f64>,
    products: Vec<f64>,
}

impl AuthorsEarthMover {
    /// `Σ |F_p(v_i) − F_q(v_i)| · (v_{i+1} − v_i)` over the sorted values v of both windows, summed as NumPy does.
    pub(super) fn distance(&mut self, p: &[f64], q: &[f64]) -> f64 {
        let sort = |into: &mut Vec<f64>, parts: [&[f64]; 2]| {
            into.clear();
            for part in parts {
                into.extend_from_slice(part);
            }
            into.sort_unstable_by(f64::total_cmp);
        };
        sort(&mut self.p, [p, &[]]);
        sort(&mut self.q, [q, &[]]);
        sort(&mut self.all, [p, q]);
        let (mut below_p, mut below_q) = (0, 0);
        let width = p.len() as f64;
        self.products.clear();
        for pair in self.all.windows(2) {
            while below_p < p.len() && self.p[below_p] <= pair[0] {
                below_p += 1;
            }
            while below_q < q.len() && self.q[below_q] <= pair[0] {
                below_q += 1;
            }
            let difference = below_p as f64 / width - below_q as f64 / width;
            self.products.push(difference.abs() * (pair[1] - pair[0]));
        }
        numpy_sum(&self.products)
    }
}

/// Adds as NumPy does: few terms in order; else eight running sums, combined in pairs; halves beyond 128 terms.
pub(super) fn numpy_sum(values: &[f64]) -> f64 {
    const LANES: usize = 8;
    const BLOCK: usize = 128;
    let n = values.len();
    if n < LANES {
        return values.iter().fold(0.0, |sum, x| sum + x);
    }
    if n > BLOCK {
        let half = n / 2 - (n / 2) % LANES;
        return numpy_sum(&values[..half]) + numpy_sum(&values[half..]);
    }
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut r = chunks[0];
    for chunk in &chunks[1..] {
        for (sum, x) in r.iter_mut().zip(chunk) {
            *sum += x;
        }
    }
    let sum = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
    rest.iter().fold(sum, |sum, x| sum + x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_small_windows() {
        assert_eq!(total_variation(&[0.5, 0.5], &[1.0, 0.0], true), 0.5);
        assert_eq!(
            AuthorsEarthMover::default().distance(&[0.0, 1.0], &[1.0, 2.0]),
            1.0
        );
        // Windows are samples: their order does not matter.
        assert_eq!(
            AuthorsEarthMover::default().distance(&[0.25, 0.5], &[0.5, 0.25]),
            0.0
        );
    }

    #[test]
    fn sums_of_any_length() {
        for n in [0, 1, 7, 8, 9, 128, 129, 1000] {
            let values: Vec<f64> = (0..n).map(f64::from).collect();
            assert_eq!(
                numpy_sum(&values),
                f64::from(n) * (f64::from(n) - 1.0).max(0.0) / 2.0
            );
        }
    }
}
