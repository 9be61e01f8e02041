//! Series as few characters: numbers in as many bits as their use asks for, bytes as base64.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// Values over time.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum PackedValues {
    /// Few distinct values: an index of one byte into them. 255 stands for no value.
    Indexed {
        /// The distinct values, rising.
        values: Vec<f64>,
        /// One byte a step.
        bytes: String,
    },
    /// Little-endian f32; NaN stands for no value.
    Floats {
        /// Four bytes a step.
        bytes: String,
    },
}

/// Distinct values for which an index is worth its table.
const MAX_INDEXED: usize = 64;

impl PackedValues {
    /// Packs values; NaN stands for none.
    pub(super) fn new(values: &[f64]) -> Self {
        let mut distinct: Vec<f64> = Vec::new();
        let mut indices = Vec::with_capacity(values.len());
        for &value in values {
            if value.is_nan() {
                indices.push(u8::MAX);
                continue;
            }
            let index = distinct
                .iter()
                .position(|&d| d.to_bits() == value.to_bits());
            let index = index.unwrap_or_else(|| {
                distinct.push(value);
                distinct.len() - 1
            });
            if distinct.len() > MAX_INDEXED {
                return Self::floats(values);
            }
            indices.push(u8::try_from(index).unwrap_or(u8::MAX));
        }
        Self::Indexed {
            values: distinct,
            bytes: STANDARD.encode(indices),
        }
    }

    fn floats(values: &[f64]) -> Self {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "seven digits are enough to be seen"
        )]
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|&v| (v as f32).to_le_bytes())
            .collect();
        Self::Floats {
            bytes: STANDARD.encode(bytes),
        }
    }
}

/// Seconds since the first of `times` (nanoseconds), as little-endian f32.
pub(super) fn seconds(times: &[i64]) -> String {
    let first = times.first().copied().unwrap_or_default();
    let seconds = |&t: &i64| (i128::from(t) - i128::from(first)) as f64 / 1e9;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "seven digits are enough to be seen"
    )]
    let bytes: Vec<u8> = times
        .iter()
        .flat_map(|t| (seconds(t) as f32).to_le_bytes())
        .collect();
    STANDARD.encode(bytes)
}

/// A change (`E_n`) and the measure (`E_w`) that it is the scaled form of: one number of 16 bits a step is both.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct PackedChange {
    /// Change that 0 and 65535 stand for.
    change: [f64; 2],
    /// Measure that 0 and 65535 stand for.
    measure: [f64; 2],
    /// Little-endian u16, two bytes a step.
    bytes: String,
}

impl PackedChange {
    /// Of a series of one length; nothing where there is none.
    pub(super) fn new(change: &[f64], measure: &[f64]) -> Option<Self> {
        let order = |a: &usize, b: &usize| change[*a].total_cmp(&change[*b]);
        let low = (0..change.len()).min_by(order)?;
        let high = (0..change.len()).max_by(order)?;
        let range = change[high] - change[low];
        let bytes: Vec<u8> = change
            .iter()
            .flat_map(|&c| quantised(c - change[low], range).to_le_bytes())
            .collect();
        Some(Self {
            change: [change[low], change[high]],
            measure: [measure[low], measure[high]],
            bytes: STANDARD.encode(bytes),
        })
    }
}

fn quantised(value: f64, range: f64) -> u16 {
    if range <= 0.0 {
        return 0;
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the range"
    )]
    let quantised = (value / range * f64::from(u16::MAX))
        .round()
        .clamp(0.0, f64::from(u16::MAX)) as u16;
    quantised
}

/// Flags of a step, one bit each, one byte a step.
pub(super) fn flags(of_step: impl Iterator<Item = u8>) -> String {
    STANDARD.encode(of_step.collect::<Vec<u8>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(text: &str) -> Vec<u8> {
        STANDARD.decode(text).unwrap()
    }

    #[test]
    fn few_values_are_indexed_and_many_are_floats() {
        let PackedValues::Indexed { values, bytes: b } =
            PackedValues::new(&[2.0, -1.0, f64::NAN, 2.0])
        else {
            panic!("few values")
        };
        assert_eq!((values, bytes(&b)), (vec![2.0, -1.0], vec![0, 1, 255, 0]));
        let many: Vec<f64> = (0..100).map(|i| f64::from(i) / 7.0).collect();
        let PackedValues::Floats { bytes: b } = PackedValues::new(&many) else {
            panic!("many values")
        };
        assert_eq!(bytes(&b)[4..8], (1.0_f32 / 7.0).to_le_bytes());
    }

    #[test]
    fn a_change_tells_its_measure() {
        let measure = [3.0, 1.0, 2.0, 1.5];
        let change = measure.map(|m| (m - 1.0) / 2.0);
        let packed = PackedChange::new(&change, &measure).unwrap();
        assert_eq!((packed.change, packed.measure), ([0.0, 1.0], [1.0, 3.0]));
        let numbers: Vec<u16> = bytes(&packed.bytes)
            .chunks(2)
            .map(|b| u16::from_le_bytes([b[0], b[1]]))
            .collect();
        assert_eq!(numbers, [65535, 0, 32768, 16384]);
    }

    #[test]
    fn what_never_changes_is_packed_too() {
        let packed = PackedChange::new(&[0.0; 3], &[0.7; 3]).unwrap();
        assert_eq!(
            (packed.measure, bytes(&packed.bytes)),
            ([0.7; 2], vec![0; 6])
        );
        assert_eq!(PackedChange::new(&[], &[]), None);
    }
}
