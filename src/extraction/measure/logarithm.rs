//! The natural logarithm, in operations that the compiler turns into vectors.
//!
//! `f64::ln` is a call into the machine's libm: one value at a time, and its last bit differs from one system to the
//! next. This one is plain arithmetic, the same to the last bit everywhere.

/// √½ as bits: mantissas are taken from √½ to √2, so that their logarithm is near 0.
const SQRT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;

/// 2^52, to whose last bits an integer is added to make it a float.
const TWO_52: f64 = (1u64 << 52) as f64;

/// ln 2 in two parts; the upper one has so few digits that its product with an exponent is exact.
const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// `(2·atanh(s)/s − 2)/s²` as a polynomial in s², fitted at Chebyshev's nodes for |s| ≤ (√2−1)/(√2+1); its Taylor series
/// is 2/3 + 2/5 s² + 2/7 s⁴ + …. The error of s²·polynomial is 6e-20.
const ATANH: [f64; 8] = [
    0.666_666_666_666_666_6,
    0.400_000_000_000_008_8,
    0.285_714_285_708_032_3,
    0.222_222_223_918_004_7,
    0.181_817_956_308_847_53,
    0.153_862_402_058_137_54,
    0.132_687_596_685_606_12,
    0.130_867_670_099_481_75,
];

/// ln x for a normal x > 0, to about one unit in the last place.
///
/// `x = m·2^k` with m in √½..√2, and `ln m = 2·atanh((m − 1)/(m + 1))`.
#[expect(clippy::many_single_char_names, reason = "the names are the formula's")]
// It must be compiled with the features of its caller.
#[inline(always)]
pub(super) fn ln(x: f64) -> f64 {
    const EXPONENT_BIAS: u64 = 1024;
    const MANTISSA: u64 = (1 << 52) - 1;
    let shifted = x
        .to_bits()
        .wrapping_sub(SQRT_HALF)
        .wrapping_add(EXPONENT_BIAS << 52);
    let k = f64::from_bits(TWO_52.to_bits() | (shifted >> 52)) - (TWO_52 + EXPONENT_BIAS as f64);
    let m = f64::from_bits((shifted & MANTISSA).wrapping_add(SQRT_HALF));
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let [a, b, c, d, e, f, g, h] = ATANH;
    // In pairs (Estrin's scheme): half as many steps that wait for each other as Horner's.
    let (z2, z4) = (z * z, (z * z) * (z * z));
    let polynomial = ((a + b * z) + (c + d * z) * z2) + ((e + f * z) + (g + h * z) * z2) * z4;
    k * LN_2_HIGH + (2.0 * s + (s * z * polynomial + k * LN_2_LOW))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_logarithm() {
        assert_eq!(ln(1.0), 0.0);
        let mut x = 1e-300f64;
        while x < 1e300 {
            for x in [x, x.sqrt(), x.powf(0.01), 1.0 + x.fract()] {
                let exact = x.ln();
                assert!(
                    (ln(x) - exact).abs() <= 2.5 * f64::EPSILON * exact.abs().max(1e-3),
                    "{x:e}: {} {exact}",
                    ln(x)
                );
            }
            x *= 1.0123;
        }
    }
}
