//! Eq. 3: how often each bin occurs, within a joint's column or over all columns of the state together.

/// Relative frequencies as integer counts: the probability of a bin is `counts[bin] / total`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Frequencies {
    pub(super) counts: Vec<u64>,
    pub(super) total: u64,
}

impl Frequencies {
    /// Counts the bins of all `columns` together.
    pub(super) fn of<'a>(columns: impl IntoIterator<Item = &'a [u16]>, bins: usize) -> Self {
        let mut counts = vec![0u64; bins];
        let mut total = 0;
        for column in columns {
            total += column.len() as u64;
            for &bin in column {
                counts[usize::from(bin)] += 1;
            }
        }
        Self { counts, total }
    }

    /// Probability of each bin.
    pub(super) fn probabilities(&self) -> Vec<f64> {
        let total = self.total as f64;
        self.counts.iter().map(|&c| c as f64 / total).collect()
    }

    /// `table[bin]` for each step of a column.
    pub(super) fn look_up<T: Copy>(table: &[T], column: &[u16]) -> Vec<T> {
        column.iter().map(|&bin| table[usize::from(bin)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_pooled() {
        let (a, b) = ([0u16, 1, 1], [1u16, 1, 2]);
        let frequencies = Frequencies::of([&a[..], &b[..]], 3);
        assert_eq!(
            frequencies,
            Frequencies {
                counts: vec![1, 4, 1],
                total: 6
            }
        );
        assert_eq!(
            Frequencies::look_up(&frequencies.probabilities(), &a),
            [1.0 / 6.0, 4.0 / 6.0, 4.0 / 6.0]
        );
    }
}
