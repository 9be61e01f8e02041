//! Skips an item that nobody wants. Not `minicbor`'s own `skip`: that one takes a break also where none may stand.

use minicbor::data::Type;
use minicbor::decode::Decoder;

use super::{NO_VALUE, has_more, malformed};
use crate::recording::decode::walk_error::WalkError;

/// Skips an item with its tags, held to the same rules as one that is read.
pub(super) fn skip(input: &mut Decoder, depth: usize) -> Result<(), WalkError> {
    while input.datatype().map_err(malformed)? == Type::Tag {
        input.tag().map_err(malformed)?;
    }
    match input.datatype().map_err(malformed)? {
        Type::Array | Type::ArrayIndef => {
            let left = input.array().map_err(malformed)?;
            skip_members(input, left, 1, depth)
        }
        Type::Map | Type::MapIndef => {
            let left = input.map().map_err(malformed)?;
            skip_members(input, left, 2, depth)
        }
        Type::Bytes | Type::BytesIndef => input
            .bytes_iter()
            .and_then(|mut pieces| pieces.try_for_each(|piece| piece.map(drop)))
            .map_err(malformed),
        Type::String | Type::StringIndef => input
            .str_iter()
            .and_then(|mut pieces| pieces.try_for_each(|piece| piece.map(drop)))
            .map_err(malformed),
        scalar => skip_scalar(input, scalar),
    }
}

/// Each member is so many items: one in an array, two in a map.
fn skip_members(
    input: &mut Decoder,
    mut left: Option<u64>,
    n_items: usize,
    depth: usize,
) -> Result<(), WalkError> {
    let depth = depth.checked_sub(1).ok_or(WalkError::TOO_DEEP)?;
    while has_more(input, &mut left)? {
        for _ in 0..n_items {
            skip(input, depth)?;
        }
    }
    Ok(())
}

fn skip_scalar(input: &mut Decoder, kind: Type) -> Result<(), WalkError> {
    match kind {
        Type::Bool => input.bool().map(drop),
        Type::Null => input.null(),
        Type::Undefined => input.undefined(),
        Type::U8 | Type::U16 | Type::U32 | Type::U64 => input.u64().map(drop),
        Type::I8 | Type::I16 | Type::I32 | Type::I64 | Type::Int => input.int().map(drop),
        Type::F16 => input.f16().map(drop),
        Type::F32 => input.f32().map(drop),
        Type::F64 => input.f64().map(drop),
        Type::Simple => input.simple().map(drop),
        _ => return Err(NO_VALUE),
    }
    .map_err(malformed)
}
