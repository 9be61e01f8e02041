//! Decimal to binary: the f64 nearest to `mantissa * 10^exponent`, ties to even.
//!
//! A product of 128 bits decides almost every case. Where a bound on its error leaves two f64 possible the answer is
//! none, and the caller takes a slower way: what is returned is always the nearest.
//! The idea is that of Eisel and Lemire, "Number Parsing at a Gigabyte per Second", 2021; the error bound is simpler
//! and a little wider.

/// Bits of the significand of an f64, with the one that is not stored.
const SIGNIFICAND_BITS: u32 = 53;

/// Largest power of ten up to which all are exact in f64.
const MAX_EXACT_POWER: usize = 22;

const EXACT_POWERS: [f64; MAX_EXACT_POWER + 1] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// Powers of five that fit into 64 bits, so that their product with a mantissa fits into 128.
const POWERS: [u64; 28] = {
    let mut powers = [1; 28];
    let mut i = 1;
    while i < powers.len() {
        powers[i] = 5 * powers[i - 1];
        i += 1;
    }
    powers
};

/// `1 / 5^k` as `(bits, shift)`: `bits` is `2^shift / 5^k`, rounded down, with its highest bit set. The first entry
/// stands for nothing.
const RECIPROCALS: [(u128, u32); 55] = {
    let mut reciprocals = [(0, 0); 55];
    let mut power: u128 = 1;
    let mut k = 1;
    while k < reciprocals.len() {
        power *= 5;
        let power_bits = u128::BITS - power.leading_zeros();
        // Long division, bit by bit; the remainder stays below 5^54 < 2^126.
        let mut remainder: u128 = 1 << (power_bits - 1);
        let mut bits: u128 = 0;
        let mut i = 0;
        while i < u128::BITS {
            remainder *= 2;
            bits *= 2;
            if remainder >= power {
                remainder -= power;
                bits += 1;
            }
            i += 1;
        }
        reciprocals[k] = (bits, u128::BITS - 1 + power_bits);
        k += 1;
    }
    reciprocals
};

/// The f64 nearest to `mantissa * 10^exponent`, if it can be told. `is_cut`: more digits follow the mantissa, so that
/// the number lies between it and the next one.
#[inline]
pub(super) fn nearest(mantissa: u64, exponent: i64, is_cut: bool) -> Option<f64> {
    let power = usize::try_from(exponent.unsigned_abs()).ok()?;
    if mantissa < 1 << SIGNIFICAND_BITS && power <= MAX_EXACT_POWER && !is_cut {
        // Both operands are exact, so that the one operation rounds right.
        let (value, power) = (exact(mantissa), EXACT_POWERS[power]);
        return Some(if exponent < 0 {
            value / power
        } else {
            value * power
        });
    }
    if mantissa == 0 {
        return (!is_cut).then_some(0.0);
    }
    if exponent < 0 {
        divided(mantissa, power, is_cut)
    } else {
        multiplied(mantissa, power, is_cut)
    }
}

/// The f64 nearest to `mantissa / 10^n_digits`, if it can be told. `n_significant`: digits of the mantissa.
#[inline]
pub(super) fn nearest_fraction(
    mantissa: u64,
    n_digits: usize,
    n_significant: usize,
) -> Option<f64> {
    // Below 2^53, as more digits may be as well; but a branch on their number is mostly the same.
    if n_significant <= 15 && n_digits <= MAX_EXACT_POWER {
        return Some(exact(mantissa) / EXACT_POWERS[n_digits]);
    }
    if mantissa == 0 {
        return Some(0.0);
    }
    divided(mantissa, n_digits, false)
}

/// A mantissa below 2^53. As a signed integer it converts in one instruction.
#[inline]
fn exact(mantissa: u64) -> f64 {
    mantissa.cast_signed() as f64
}

/// `mantissa / 10^power`.
#[inline]
fn divided(mantissa: u64, power: usize, is_cut: bool) -> Option<f64> {
    let &(reciprocal, reciprocal_shift) = RECIPROCALS.get(power)?;
    let shift = mantissa.leading_zeros();
    let mantissa = u128::from(mantissa << shift);
    // Of the product's 192 bits the upper 128. The mantissa is below 2^64: neither product can overflow.
    let (high, low) = (reciprocal >> 64, reciprocal & u128::from(u64::MAX));
    let product = mantissa * high + ((mantissa * low) >> 64);
    let scale = 64 - i64::from(reciprocal_shift) - i64::from(shift) - i64::try_from(power).ok()?;
    // The bits that are dropped are worth less than one, and so is what the reciprocal lacks.
    if !is_cut && let Some(value) = rounded_by_high_bits(product, scale) {
        return Some(value);
    }
    let error = 2 + if is_cut { (high + 1) << shift } else { 0 };
    rounded(product, error, scale)
}

/// `mantissa * 10^power`.
fn multiplied(mantissa: u64, power: usize, is_cut: bool) -> Option<f64> {
    let five = u128::from(*POWERS.get(power)?);
    let product = u128::from(mantissa) * five;
    let shift = product.leading_zeros();
    let error = if is_cut { five << shift } else { 0 };
    let scale = i64::try_from(power).ok()? - i64::from(shift);
    rounded(product << shift, error, scale)
}

/// [`rounded`] for an error of 2, where the upper 64 bits decide: nearly always, and without a branch that depends on
/// the number.
#[inline]
fn rounded_by_high_bits(value: u128, scale: i64) -> Option<f64> {
    let high = u64::try_from(value >> 64).ok()?;
    let n_dropped = u64::BITS - SIGNIFICAND_BITS - high.leading_zeros();
    let half = 1 << (n_dropped - 1);
    let dropped = high & ((1 << n_dropped) - 1);
    if dropped == half || dropped == half - 1 {
        return None;
    }
    let goes_up = (high >> (n_dropped - 1)) & 1;
    Some(assembled(
        high >> n_dropped,
        goes_up,
        scale + 64 + i64::from(n_dropped),
    ))
}

/// The f64 nearest to `(value + e) * 2^scale`, where all that is known of e is `0 <= e < error`, or e = 0 if `error`
/// is 0. One of the two highest bits of `value` is set, and the result is far from the ends of the range of f64.
#[cold]
fn rounded(value: u128, error: u128, scale: i64) -> Option<f64> {
    let n_dropped = u128::BITS - SIGNIFICAND_BITS - value.leading_zeros();
    let half = 1 << (n_dropped - 1);
    let dropped = value & ((1 << n_dropped) - 1);
    let kept = u64::try_from(value >> n_dropped).ok()?;
    let goes_up = if dropped > half {
        // The error is far too small to carry it half a unit past the next f64.
        true
    } else if dropped + error < half || (dropped + error == half && error > 0) {
        false
    } else if error == 0 {
        kept & 1 == 1
    } else {
        return None;
    };
    Some(assembled(
        kept,
        goes_up.into(),
        scale + i64::from(n_dropped),
    ))
}

/// `(significand + goes_up) * 2^exponent`, of a significand of all 53 bits.
#[inline]
fn assembled(significand: u64, goes_up: u64, exponent: i64) -> f64 {
    let biased = exponent + i64::from(SIGNIFICAND_BITS - 1) + 1023;
    // The highest bit of the significand adds one to the exponent; a carry out of it adds another.
    let exponent_bits = (biased - 1).cast_unsigned() << (SIGNIFICAND_BITS - 1);
    f64::from_bits(exponent_bits + significand + goes_up)
}
