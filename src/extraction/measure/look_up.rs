//! `table[bin]` of each step, for tables of counts.
//!
//! A table of up to 64 counts fits into the registers of AVX-512, where one instruction looks up 32 bins. The compiler
//! finds that instruction in no loop, so it is called by name: safe, since only code compiled for such a processor can.

use multiversion::multiversion;
use multiversion::target::match_target;

/// Writes `table[bin]` of each bin of `column` to the front of `out`.
#[multiversion(targets("x86_64+avx512f+avx512bw"))]
pub(super) fn look_up_16(table: &[u16], column: &[u16], out: &mut [u16]) {
    let n_done = match_target! {
        "x86_64+avx512f+avx512bw" => avx512::look_up_16(table, column, out),
        _ => 0,
    };
    one_by_one(table, &column[n_done..], &mut out[n_done..]);
}

/// The same for counts of 32 bits.
#[multiversion(targets("x86_64+avx512f+avx512bw"))]
pub(super) fn look_up_32(table: &[u32], column: &[u16], out: &mut [u32]) {
    let n_done = match_target! {
        "x86_64+avx512f+avx512bw" => avx512::look_up_32(table, column, out),
        _ => 0,
    };
    one_by_one(table, &column[n_done..], &mut out[n_done..]);
}

fn one_by_one<T: Copy>(table: &[T], column: &[u16], out: &mut [T]) {
    for (out, &bin) in out.iter_mut().zip(column) {
        *out = table[usize::from(bin)];
    }
}

/// Each function tells how many steps it did: whole vectors, or none if the table is too large.
#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::{__m512i, _mm512_permutex2var_epi16};

    use bytemuck::must_cast;

    /// Bins in a vector.
    const LANES: usize = 32;

    #[target_feature(enable = "avx512f,avx512bw")]
    pub(super) fn look_up_16(table: &[u16], column: &[u16], out: &mut [u16]) -> usize {
        let Some(table) = Table::new(table.iter().copied()) else {
            return 0;
        };
        let bins = column.as_chunks::<LANES>().0;
        for (out, bins) in out.as_chunks_mut::<LANES>().0.iter_mut().zip(bins) {
            *out = table.look_up(bins);
        }
        bins.len() * LANES
    }

    /// In two halves.
    #[target_feature(enable = "avx512f,avx512bw")]
    #[expect(clippy::cast_possible_truncation, reason = "halves")]
    pub(super) fn look_up_32(table: &[u32], column: &[u16], out: &mut [u32]) -> usize {
        let low = Table::new(table.iter().map(|&count| count as u16));
        let high = Table::new(table.iter().map(|&count| (count >> 16) as u16));
        let (Some(low), Some(high)) = (low, high) else {
            return 0;
        };
        let bins = column.as_chunks::<LANES>().0;
        for (out, bins) in out.as_chunks_mut::<LANES>().0.iter_mut().zip(bins) {
            let halves = low.look_up(bins).into_iter().zip(high.look_up(bins));
            for (out, (low, high)) in out.iter_mut().zip(halves) {
                *out = u32::from(low) | u32::from(high) << 16;
            }
        }
        bins.len() * LANES
    }

    /// In two vectors.
    struct Table([u16; 2 * LANES]);

    impl Table {
        fn new(values: impl ExactSizeIterator<Item = u16>) -> Option<Self> {
            let mut table = [0; 2 * LANES];
            let places = table.get_mut(..values.len())?;
            for (place, value) in places.iter_mut().zip(values) {
                *place = value;
            }
            Some(Self(table))
        }

        #[target_feature(enable = "avx512f,avx512bw")]
        #[inline]
        fn look_up(&self, bins: &[u16; LANES]) -> [u16; LANES] {
            let [low, high]: [__m512i; 2] = must_cast(self.0);
            must_cast(_mm512_permutex2var_epi16(low, must_cast(*bins), high))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_all_sizes_are_looked_up() {
        for n_bins in [2u16, 31, 64, 65, 1000] {
            let table: Vec<u32> = (0..u32::from(n_bins)).map(|i| i * 2_654_435).collect();
            let short: Vec<u16> = (0..n_bins).map(|i| i.wrapping_mul(40_503)).collect();
            for n in [0u16, 1, 31, 32, 33, 500] {
                let column: Vec<u16> = (0..n).map(|i| i.wrapping_mul(7919) % n_bins).collect();
                let (mut found, mut found_short) = (vec![0; 501], vec![0; 501]);
                look_up_32(&table, &column, &mut found);
                look_up_16(&short, &column, &mut found_short);
                for (i, bin) in column.iter().map(|&bin| usize::from(bin)).enumerate() {
                    assert_eq!((found[i], found_short[i]), (table[bin], short[bin]));
                }
                assert_eq!(found[column.len()..], vec![0; 501 - column.len()]);
                assert_eq!(found_short[column.len()..], vec![0; 501 - column.len()]);
            }
        }
    }
}
