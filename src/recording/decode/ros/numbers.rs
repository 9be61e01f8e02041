//! Numbers from their bytes.

use super::super::DecodeError;
use super::super::plan::Field;
use super::super::row::{Row, is_absent};
use super::super::value::Value;
use super::input::Input;
use super::schema::Number;
use crate::recording::limits::MAX_VECTOR_WIDTH;

/// Takes all numbers of `bytes` for a field; a whole number of them must be there.
#[inline]
pub(super) fn take<const BIG: bool>(
    number: Number,
    bytes: &[u8],
    field: Field,
    row: &mut Row,
) -> Result<(), DecodeError> {
    if let Field::Values(target) = field {
        let label = row.label(field);
        let values = row.values(target);
        if values.len() + bytes.len() / number.size() > MAX_VECTOR_WIDTH {
            return Err(DecodeError::TooWide(label));
        }
        append::<BIG>(number, bytes, values);
        return Ok(());
    }
    for one in bytes.chunks_exact(number.size()) {
        match value::<BIG>(number, one) {
            Some(Value::Bool(value)) => row.boolean(field, value)?,
            Some(Value::Number(value)) => row.float(field, value)?,
            Some(Value::Integer(value)) => match i64::try_from(value) {
                Ok(value) => row.integer(field, value)?,
                Err(_) => row.float(field, value as f64)?,
            },
            _ => {}
        }
    }
    Ok(())
}

/// Appends numbers as f64: integers beyond 2^53 become the nearest one.
fn append<const BIG: bool>(number: Number, bytes: &[u8], values: &mut Vec<f64>) {
    match number {
        Number::Bool => values.extend(bytes.iter().map(|&b| f64::from(u8::from(b != 0)))),
        Number::U8 => values.extend(bytes.iter().map(|&b| f64::from(b))),
        Number::I8 => extend::<1, BIG>(values, bytes, |b| f64::from(i8::from_le_bytes(b))),
        Number::I16 => extend::<2, BIG>(values, bytes, |b| f64::from(i16::from_le_bytes(b))),
        Number::U16 => extend::<2, BIG>(values, bytes, |b| f64::from(u16::from_le_bytes(b))),
        Number::I32 => extend::<4, BIG>(values, bytes, |b| f64::from(i32::from_le_bytes(b))),
        Number::U32 => extend::<4, BIG>(values, bytes, |b| f64::from(u32::from_le_bytes(b))),
        Number::F32 => extend::<4, BIG>(values, bytes, |b| f64::from(f32::from_le_bytes(b))),
        Number::I64 => extend::<8, BIG>(values, bytes, |b| i64::from_le_bytes(b) as f64),
        Number::U64 => extend::<8, BIG>(values, bytes, |b| u64::from_le_bytes(b) as f64),
        Number::F64 => extend::<8, BIG>(values, bytes, |b| {
            let value = f64::from_le_bytes(b);
            // A NaN with just these bits must be refused as any other, not pass for a value that is absent.
            if is_absent(value) { f64::NAN } else { value }
        }),
    }
}

#[inline]
fn extend<const N: usize, const BIG: bool>(
    values: &mut Vec<f64>,
    bytes: &[u8],
    of: impl Fn([u8; N]) -> f64,
) {
    let (numbers, _) = bytes.as_chunks::<N>();
    values.extend(numbers.iter().map(|&b| Input::<BIG>::order(b, &of)));
}

/// One number as a value; none if the bytes are too few.
pub(super) fn value<const BIG: bool>(number: Number, bytes: &[u8]) -> Option<Value> {
    Some(match number {
        Number::Bool => Value::Bool(*bytes.first()? != 0),
        Number::U8 => Value::Integer((*bytes.first()?).into()),
        Number::I8 => Value::Integer(one::<1, _, BIG>(bytes, i8::from_le_bytes)?.into()),
        Number::I16 => Value::Integer(one::<2, _, BIG>(bytes, i16::from_le_bytes)?.into()),
        Number::U16 => Value::Integer(one::<2, _, BIG>(bytes, u16::from_le_bytes)?.into()),
        Number::I32 => Value::Integer(one::<4, _, BIG>(bytes, i32::from_le_bytes)?.into()),
        Number::U32 => Value::Integer(one::<4, _, BIG>(bytes, u32::from_le_bytes)?.into()),
        Number::I64 => Value::Integer(one::<8, _, BIG>(bytes, i64::from_le_bytes)?.into()),
        Number::U64 => Value::Integer(one::<8, _, BIG>(bytes, u64::from_le_bytes)?.into()),
        Number::F32 => Value::Number(one::<4, _, BIG>(bytes, f32::from_le_bytes)?.into()),
        Number::F64 => Value::Number(one::<8, _, BIG>(bytes, f64::from_le_bytes)?),
    })
}

fn one<const N: usize, T, const BIG: bool>(bytes: &[u8], of: impl Fn([u8; N]) -> T) -> Option<T> {
    bytes
        .first_chunk::<N>()
        .map(|&b| Input::<BIG>::order(b, of))
}
