//! What the tags before an item say about it.

use minicbor::data::Type;
use minicbor::decode::Decoder;

use super::arrays::Element;
use super::malformed;
use crate::recording::decode::walk_error::WalkError;

/// How an item is to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// As what it is.
    Plain,
    /// A byte string that is an integer of any size.
    BigNumber { is_negative: bool },
    /// A byte string that is an array of numbers.
    TypedArray(Element),
    /// Dimensions and an array, the last dimension running fastest.
    RowMajor,
    /// The item would be mistaken for another value if its tag were skipped.
    Unreadable(&'static str),
}

/// Takes the tags before an item, up to one that changes what the item is.
pub(super) fn peel(input: &mut Decoder) -> Result<Meaning, WalkError> {
    while input.datatype().map_err(malformed)? == Type::Tag {
        let meaning = meaning(input.tag().map_err(malformed)?.as_u64());
        if meaning != Meaning::Plain {
            return Ok(meaning);
        }
    }
    Ok(Meaning::Plain)
}

/// Numbers of tags: <https://www.iana.org/assignments/cbor-tags>.
fn meaning(tag: u64) -> Meaning {
    match tag {
        2 | 3 => Meaning::BigNumber {
            is_negative: tag == 3,
        },
        4 | 264 => Meaning::Unreadable("a decimal fraction"),
        5 | 265 | 268..=270 => Meaning::Unreadable("a big float"),
        24 => Meaning::Unreadable("CBOR inside a byte string"),
        25 => Meaning::Unreadable("a reference to an earlier text"),
        29 => Meaning::Unreadable("a reference to an earlier value"),
        30 => Meaning::Unreadable("a rational number"),
        40 => Meaning::RowMajor,
        76 => Meaning::Unreadable("a typed array of an unknown kind"),
        83 | 87 => Meaning::Unreadable("an array of floats of 128 bits"),
        64..=87 => Meaning::TypedArray(Element::of_tag(tag)),
        43000 => Meaning::Unreadable("a complex number"),
        1040 => Meaning::Unreadable("an array in column-major order"),
        _ => Meaning::Plain,
    }
}
