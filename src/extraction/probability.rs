//! Eq. 3: how often each bin occurs, within a joint's column or over all columns of the state together.

/// Relative frequencies as integer counts: the probability of a bin is `counts[bin] / total`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Frequencies {
    pub(super) counts: Vec<u64>,
    pub(super) total: u64,
}

impl Frequencies {
    /// Of no values.
    pub(super) fn none(bins: usize) -> Self {
        Self {
            counts: vec![0; bins],
            total: 0,
        }
    }

    /// Counts the bins of all `columns` together.
    pub(super) fn of<'a>(columns: impl IntoIterator<Item = &'a [u16]>, bins: usize) -> Self {
        // Several tallies in turn: a run of equal bins would wait for its own counter at every step. Few bins only, as
        // more of them would not stay in the cache, and have short runs.
        const TALLIES: usize = 8;
        const MAX_BINS: usize = 256;
        let mut all = Self::none(bins);
        let mut tallies = [[0u32; MAX_BINS]; TALLIES];
        for column in columns {
            all.total += column.len() as u64;
            let rest = if bins <= MAX_BINS && u32::try_from(column.len()).is_ok() {
                let (chunks, rest) = column.as_chunks::<TALLIES>();
                for chunk in chunks {
                    for (tally, &bin) in tallies.iter_mut().zip(chunk) {
                        tally[usize::from(bin) % MAX_BINS] += 1;
                    }
                }
                for tally in &mut tallies {
                    for (count, seen) in all.counts.iter_mut().zip(tally) {
                        *count += u64::from(std::mem::take(seen));
                    }
                }
                rest
            } else {
                column
            };
            for &bin in rest {
                all.counts[usize::from(bin)] += 1;
            }
        }
        all
    }

    /// Adds what another part of the columns holds.
    pub(super) fn merge(&mut self, other: &Self) {
        self.total += other.total;
        for (count, more) in self.counts.iter_mut().zip(&other.counts) {
            *count += more;
        }
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

    /// The same into the front of a buffer.
    pub(super) fn look_up_into<T: Copy>(table: &[T], column: &[u16], out: &mut [T]) {
        for (value, &bin) in out.iter_mut().zip(column) {
            *value = table[usize::from(bin)];
        }
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

    #[test]
    fn every_value_is_counted_once_whatever_the_number_of_bins() {
        for bins in [2usize, 256, 257, 60_000] {
            let column: Vec<u16> = (0..5003)
                .map(|i| u16::try_from(i * i % bins).unwrap())
                .collect();
            let mut expected = vec![0; bins];
            for &bin in &column {
                expected[usize::from(bin)] += 1;
            }
            let mut found = Frequencies::of([&column[..1000]], bins);
            found.merge(&Frequencies::of([&column[1000..]], bins));
            assert_eq!((found.counts, found.total), (expected, 5003));
        }
    }
}
