//! Eq. 1: each column cut into b bins of equal width between its own minimum and maximum.

/// A column after binning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Binned {
    /// All values are equal: Eq. 1 is undefined.
    Constant,
    /// The bin of each step, `0..b`.
    Bins(Vec<u16>),
}

/// Bins one column of finite values: the bin of x is the number of inner edges `e_1..e_{b−1}` that are ≤ x.
pub(super) fn bin(values: &[f64], bins: usize) -> Binned {
    let (min, max) = extent(values);
    if min == max || values.is_empty() {
        return Binned::Constant;
    }
    let edges = Edges::new(min, max, bins);
    Binned::Bins(match edges.reciprocal_width() {
        Some(reciprocal) => approximate(values, &edges, reciprocal, bins),
        None => search(values, &edges, bins),
    })
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
fn extent(values: &[f64]) -> (f64, f64) {
    // Independent lanes: a single running minimum would wait for itself at every value.
    const LANES: usize = 32;
    let mut low = [f64::INFINITY; LANES];
    let mut high = [f64::NEG_INFINITY; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            let x = chunk[i];
            low[i] = if x < low[i] { x } else { low[i] };
            high[i] = if x > high[i] { x } else { high[i] };
        }
    }
    let low = low.iter().chain(rest).fold(f64::INFINITY, |a, &b| a.min(b));
    let high = high
        .iter()
        .chain(rest)
        .fold(f64::NEG_INFINITY, |a, &b| a.max(b));
    (low, high)
}

/// The inner edges of a column, computed as NumPy's `linspace` does.
struct Edges {
    min: f64,
    max: f64,
    width: f64,
    bins: f64,
}

impl Edges {
    fn new(min: f64, max: f64, bins: usize) -> Self {
        Self {
            min,
            max,
            width: (max - min) / bins as f64,
            bins: bins as f64,
        }
    }

    /// `e_k`; not less than `e_{k−1}`, since each rounded operation is monotone.
    #[expect(
        clippy::inline_always,
        reason = "must be compiled with the features of its caller"
    )]
    #[inline(always)]
    fn at(&self, k: f64) -> f64 {
        self.min + k * self.width
    }

    /// `e_k` also where the range overflows or its b-th part is zero.
    fn at_any(&self, k: usize) -> f64 {
        let share = k as f64 / self.bins;
        if self.width.is_infinite() || (self.max - self.min).is_infinite() {
            self.min * (1.0 - share) + self.max * share
        } else if self.width == 0.0 {
            self.min + share * (self.max - self.min)
        } else {
            self.at(k as f64)
        }
    }

    /// 1 / width, where a position found with it is off by far less than half a bin: the width must be normal and far
    /// above the rounding of the edges.
    fn reciprocal_width(&self) -> Option<f64> {
        const MARGIN: f64 = 1.0 / (1u64 << 30) as f64;
        let magnitude = self.min.abs().max(self.max.abs());
        let reciprocal = 1.0 / self.width;
        (self.width.is_finite()
            && self.width > f64::MIN_POSITIVE
            && reciprocal.is_finite()
            && self.width > MARGIN * magnitude)
            .then_some(reciprocal)
    }
}

/// A guess by one multiplication, held against the edge below it.
///
/// The guess is rounded to the nearest integer, not down: it is the bin or, in the upper half of the bin, the one
/// above. So one comparison with an exact edge decides, where a guess rounded down would need both edges.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
    "x86_64+avx2",
    "aarch64+neon"
))]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "bins are 0..=65535"
)]
fn approximate(values: &[f64], edges: &Edges, reciprocal: f64, bins: usize) -> Vec<u16> {
    // Added to a number of up to 2^51, this leaves its nearest integer in the lowest bits: such a conversion is fast on
    // every instruction set, a cast from f64 is not.
    const TO_INTEGER: f64 = 1.5 * (1u64 << 52) as f64;
    let last = bins as i32 - 1;
    let mut found = vec![0; values.len()];
    for (bin, &x) in found.iter_mut().zip(values) {
        let shifted = (x - edges.min) * reciprocal + TO_INTEGER;
        let too_high = x < edges.at(shifted - TO_INTEGER);
        *bin = (shifted.to_bits() as i32 - i32::from(too_high)).min(last) as u16;
    }
    found
}

/// The exact search, for columns whose edges are blurred by rounding.
#[expect(clippy::cast_possible_truncation, reason = "bins are 0..=65535")]
fn search(values: &[f64], edges: &Edges, bins: usize) -> Vec<u16> {
    let inner: Vec<f64> = (1..bins).map(|k| edges.at_any(k)).collect();
    values
        .iter()
        .map(|x| inner.partition_point(|e| e <= x) as u16)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bins_of(values: &[f64], bins: usize) -> Vec<u16> {
        match bin(values, bins) {
            Binned::Bins(found) => found,
            Binned::Constant => panic!("constant"),
        }
    }

    #[test]
    fn a_value_on_an_edge_belongs_to_the_bin_above_and_the_maximum_to_the_last() {
        assert_eq!(bins_of(&[0.0, 0.5, 1.0, 1.5, 2.0], 4), [0, 1, 2, 3, 3]);
    }

    #[test]
    fn ranges_that_overflow_or_vanish_are_binned() {
        assert_eq!(bins_of(&[f64::MIN, -1.0, 0.0, f64::MAX], 2), [0, 0, 1, 1]);
        // (max − min) / b is 0, and two of the three inner edges round to 0.
        assert_eq!(bins_of(&[0.0, 5e-324], 4), [2, 3]);
        assert_eq!(bins_of(&[1e16, 1e16 + 2.0], 64)[1], 63);
    }

    #[test]
    fn the_guess_equals_the_search() {
        let mut x = 1u64;
        let values: Vec<f64> = (0..5000)
            .map(|i| {
                x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                if i % 3 == 0 {
                    f64::from((x >> 40) as u32 % 129) / 128.0
                } else {
                    (x >> 11) as f64 / (1u64 << 53) as f64
                }
            })
            .collect();
        for bins in [2, 3, 64, 100, 65_536] {
            let (min, max) = extent(&values);
            let edges = Edges::new(min, max, bins);
            assert_eq!(
                approximate(&values, &edges, edges.reciprocal_width().unwrap(), bins),
                search(&values, &edges, bins)
            );
        }
    }

    #[test]
    fn equal_values_are_constant() {
        assert_eq!(bin(&[0.0, -0.0, 0.0], 64), Binned::Constant);
    }
}
