//! Numbers of JSON text: eight digits at a time, always to the nearest f64.

use super::error::Malformed;
use super::float::{nearest, nearest_fraction};
use super::scan::Scanner;

/// A number as it is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
    /// Written as an integer, and within 64 bits.
    Integer(i64),
    Float(f64),
}

/// `mantissa * 10^exponent`.
struct Decimal {
    is_negative: bool,
    /// All digits as one number, if they are no more than [`MAX_DIGITS`].
    mantissa: u64,
    exponent: i64,
    n_digits: usize,
    /// Written without a point and without an exponent.
    is_integer: bool,
    start: usize,
}

/// So many digits always fit into 64 bits.
const MAX_DIGITS: usize = 19;

/// Farther exponents than this are not told apart. No message is so long that its digits could make up for it.
const MAX_EXPONENT: i64 = 1 << 40;

/// Longest text that is given to the standard library, whose parser stops reading an exponent at 65,536 and the digit
/// behind it: where a row of zeros makes up for a larger one it gives 0 instead of the number.
const MAX_STD_LEN: usize = 1024;

const POWERS_OF_TEN: [u64; 8] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000];

impl Scanner<'_> {
    /// The number that comes, if it is of a kind that is read fast. `all_natural`: so far an array had nothing but
    /// short natural numbers; they are read fastest, but the attempt costs a branch that signs make a gamble.
    #[inline]
    pub(super) fn fast_float(&mut self, all_natural: &mut bool) -> Option<f64> {
        let text = self.rest();
        if *all_natural {
            if let Some((value, len)) = short_natural(text) {
                self.advance(len);
                return Some(value);
            }
            *all_natural = false;
        }
        let (value, len) = short_number(text)?;
        self.advance(len);
        Some(value)
    }

    /// The number whose first byte was seen.
    pub(super) fn float(&mut self) -> Result<f64, Malformed> {
        let decimal = self.decimal()?;
        self.nearest(&decimal)
    }

    /// The number whose first byte was seen, told apart.
    pub(super) fn number(&mut self) -> Result<Number, Malformed> {
        let decimal = self.decimal()?;
        if decimal.is_integer && decimal.n_digits <= MAX_DIGITS {
            let magnitude = i128::from(decimal.mantissa);
            let is_minus_zero = decimal.is_negative && magnitude == 0;
            let value = if decimal.is_negative {
                -magnitude
            } else {
                magnitude
            };
            if let Ok(value) = i64::try_from(value)
                && !is_minus_zero
            {
                return Ok(Number::Integer(value));
            }
        }
        self.nearest(&decimal).map(Number::Float)
    }

    /// Passes a number, whatever its size.
    pub(super) fn skip_number(&mut self) -> Result<(), Malformed> {
        if self.peek() == b'-' {
            self.advance(1);
        }
        let starts_with_zero = self.peek() == b'0';
        let n_digits = self.skip_digits()?;
        if starts_with_zero && n_digits > 1 {
            return Err(Malformed::InvalidNumber);
        }
        if self.peek() == b'.' {
            self.advance(1);
            self.skip_digits()?;
        }
        if matches!(self.peek(), b'e' | b'E') {
            self.advance(1);
            if matches!(self.peek(), b'+' | b'-') {
                self.advance(1);
            }
            self.skip_digits()?;
        }
        Ok(())
    }

    /// Passes digits, at least one, and counts them.
    #[inline]
    fn skip_digits(&mut self) -> Result<usize, Malformed> {
        let mut n_digits = 0;
        let mut n = count_digits(self.word(0));
        // The next place is known before the digits are counted: the processor need not wait for them.
        while n == 8 {
            n_digits += 8;
            n = count_digits(self.word(n_digits));
        }
        n_digits += n;
        self.advance(n_digits);
        if n_digits == 0 {
            return Err(self.unexpected(Malformed::EndInValue, Malformed::InvalidNumber));
        }
        Ok(n_digits)
    }

    /// Reads digits, at least one, on to what `mantissa` has, and counts them. More than fit wrap around.
    #[inline]
    fn digits(&mut self, mantissa: &mut u64) -> Result<usize, Malformed> {
        let mut n_digits = 0;
        let mut word = self.word(0);
        let mut n = count_digits(word);
        // As in `skip_digits`.
        while n == 8 {
            *mantissa = mantissa
                .wrapping_mul(100_000_000)
                .wrapping_add(eight_digits(word ^ ZEROS).into());
            n_digits += 8;
            word = self.word(n_digits);
            n = count_digits(word);
        }
        *mantissa = mantissa
            .wrapping_mul(POWERS_OF_TEN[n])
            .wrapping_add(digits_before(word, n).into());
        n_digits += n;
        self.advance(n_digits);
        if n_digits == 0 {
            return Err(self.unexpected(Malformed::EndInValue, Malformed::InvalidNumber));
        }
        Ok(n_digits)
    }

    #[inline]
    fn decimal(&mut self) -> Result<Decimal, Malformed> {
        let start = self.offset();
        let is_negative = self.peek() == b'-';
        if is_negative {
            self.advance(1);
        }
        let starts_with_zero = self.peek() == b'0';
        let mut mantissa = 0;
        let mut n_digits = self.digits(&mut mantissa)?;
        if starts_with_zero {
            if n_digits > 1 {
                return Err(Malformed::InvalidNumber);
            }
            n_digits = 0;
        }
        let mut exponent = 0;
        let mut is_integer = true;
        if self.peek() == b'.' {
            self.advance(1);
            is_integer = false;
            let n_behind_point = self.digits(&mut mantissa)?;
            n_digits += n_behind_point;
            exponent = -i64::try_from(n_behind_point).unwrap_or(MAX_EXPONENT);
        }
        if matches!(self.peek(), b'e' | b'E') {
            self.advance(1);
            is_integer = false;
            exponent += self.exponent()?;
        }
        Ok(Decimal {
            is_negative,
            mantissa,
            exponent,
            n_digits,
            is_integer,
            start,
        })
    }

    /// What stands behind the `e`.
    fn exponent(&mut self) -> Result<i64, Malformed> {
        let is_negative = self.peek() == b'-';
        if is_negative || self.peek() == b'+' {
            self.advance(1);
        }
        if !self.peek().is_ascii_digit() {
            return Err(self.unexpected(Malformed::EndInValue, Malformed::InvalidNumber));
        }
        let mut exponent = 0i64;
        while let digit @ b'0'..=b'9' = self.peek() {
            exponent = (10 * exponent + i64::from(digit - b'0')).min(MAX_EXPONENT);
            self.advance(1);
        }
        Ok(if is_negative { -exponent } else { exponent })
    }

    /// The f64 nearest to the number that was just read.
    #[inline]
    fn nearest(&self, decimal: &Decimal) -> Result<f64, Malformed> {
        let magnitude = if decimal.n_digits <= MAX_DIGITS {
            nearest(decimal.mantissa, decimal.exponent, false)
        } else {
            nearest_of_many_digits(self.since(decimal.start), decimal.exponent)
        };
        match magnitude {
            Some(magnitude) if decimal.is_negative => Ok(-magnitude),
            Some(magnitude) => Ok(magnitude),
            None => slow(self.since(decimal.start)),
        }
    }
}

/// The number that the text starts with and its length, if it has up to 7 digits and neither sign, point nor exponent.
#[inline]
fn short_natural(text: &[u8]) -> Option<(f64, usize)> {
    let word = u64::from_le_bytes(*text.first_chunk()?);
    let n_digits = count_digits(word);
    let bytes = word.to_le_bytes();
    let is_whole = (1..8).contains(&n_digits)
        && !matches!(bytes[n_digits], b'.' | b'e' | b'E')
        && (bytes[0] != b'0' || n_digits == 1);
    is_whole.then(|| (digits_before(word, n_digits).into(), n_digits))
}

/// The number that the text starts with and its length, if it is one of the kinds that fill recordings: an integer of
/// up to 7 digits, or such a one with a point and up to 23 digits behind it, 19 in all, and no exponent.
///
/// Written so that the processor need not wait: places are known before digits are counted, where a branch that is
/// mostly the same can tell them, and the sign takes no branch.
#[inline]
fn short_number(text: &[u8]) -> Option<(f64, usize)> {
    let is_negative = text.first() == Some(&b'-');
    let n_sign = usize::from(is_negative);
    let digits = text.get(n_sign..)?;
    let word = u64::from_le_bytes(*digits.first_chunk()?);
    let n_integer = count_digits(word);
    let (has_digits, has_more) = (n_integer > 0, n_integer == 8);
    let starts_with_zero = digits[0] == b'0';
    if !has_digits || has_more || (starts_with_zero && n_integer > 1) {
        return None;
    }
    let (magnitude, len) = match word.to_le_bytes()[n_integer] {
        b'.' => {
            let integer = if starts_with_zero { 0 } else { n_integer };
            // One digit is by far the most common.
            let behind_point = if n_integer == 1 {
                digits.get(2..)?
            } else {
                digits.get(n_integer + 1..)?
            };
            let (mantissa, n_behind) =
                fraction(digits_before(word, n_integer).into(), behind_point)?;
            let n_significant = integer + n_behind;
            if n_significant > MAX_DIGITS {
                return None;
            }
            let value = nearest_fraction(mantissa, n_behind, n_significant)?;
            (value, n_integer + 1 + n_behind)
        }
        b'e' | b'E' => return None,
        _ => (f64::from(digits_before(word, n_integer)), n_integer),
    };
    let sign = u64::from(is_negative) << 63;
    Some((f64::from_bits(magnitude.to_bits() | sign), n_sign + len))
}

/// Reads the digits behind a point, fewer than 24, on to what `mantissa` has, and counts them.
#[inline]
fn fraction(mut mantissa: u64, text: &[u8]) -> Option<(u64, usize)> {
    let (words, _) = text.first_chunk::<24>()?.as_chunks::<8>();
    let mut n_digits = 0;
    for word in words {
        let word = u64::from_le_bytes(*word);
        let n = count_digits(word);
        if n == 8 {
            mantissa = mantissa
                .wrapping_mul(100_000_000)
                .wrapping_add(eight_digits(word ^ ZEROS).into());
            n_digits += 8;
            continue;
        }
        mantissa = mantissa
            .wrapping_mul(POWERS_OF_TEN[n])
            .wrapping_add(digits_before(word, n).into());
        n_digits += n;
        let is_complete = n_digits > 0 && !matches!(word.to_le_bytes()[n], b'e' | b'E');
        return is_complete.then_some((mantissa, n_digits));
    }
    None
}

/// The number by its first digits, where the others do not matter. `exponent` belongs to the last digit.
#[cold]
fn nearest_of_many_digits(text: &[u8], exponent: i64) -> Option<f64> {
    let digits = text
        .iter()
        .take_while(|b| !matches!(b, b'e' | b'E'))
        .filter(|b| b.is_ascii_digit())
        .map(|b| b - b'0')
        .skip_while(|&digit| digit == 0);
    let (mut mantissa, mut n_cut, mut is_cut) = (0u64, 0i64, false);
    for (i, digit) in digits.enumerate() {
        if i < MAX_DIGITS {
            mantissa = 10 * mantissa + u64::from(digit);
        } else {
            n_cut += 1;
            is_cut |= digit != 0;
        }
    }
    nearest(mantissa, exponent + n_cut, is_cut)
}

/// Any number, by a parser that knows every case.
#[cold]
fn slow(text: &[u8]) -> Result<f64, Malformed> {
    let parsed = if text.len() <= MAX_STD_LEN {
        std::str::from_utf8(text).ok().and_then(|t| t.parse().ok())
    } else {
        serde_json::from_slice(text).ok()
    };
    parsed
        .filter(|value: &f64| value.is_finite())
        .ok_or(Malformed::NumberOutOfRange)
}

/// Eight zeros.
const ZEROS: u64 = 0x3030_3030_3030_3030;

/// How many digits the word starts with.
#[inline]
fn count_digits(word: u64) -> usize {
    let digits = word ^ ZEROS;
    // Digits are 0 to 9 now; the high bit is set in every byte that is more. A carry only reaches bytes behind such.
    let others = (digits.wrapping_add(0x7676_7676_7676_7676) | digits) & 0x8080_8080_8080_8080;
    (others.trailing_zeros() / 8) as usize
}

/// The number that the first bytes of the word make, fewer than eight.
#[inline]
fn digits_before(word: u64, n_digits: usize) -> u32 {
    // In two steps, since there may be none. What is shifted in counts as leading zeros.
    eight_digits(((word ^ ZEROS) << 8) << (56 - 8 * n_digits))
}

/// The number that eight digits make, the first one in the lowest byte: pairs, then fours, then all.
#[inline]
fn eight_digits(digits: u64) -> u32 {
    const PAIRS: u64 = 0x0000_00ff_0000_00ff;
    let pairs = digits.wrapping_mul(10).wrapping_add(digits >> 8);
    let outer = (pairs & PAIRS).wrapping_mul(100 + (1_000_000 << 32));
    let inner = ((pairs >> 16) & PAIRS).wrapping_mul(1 + (10_000 << 32));
    (outer.wrapping_add(inner) >> 32) as u32
}
