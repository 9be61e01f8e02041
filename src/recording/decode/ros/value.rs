//! One message as a tree of values, read along its types.

use super::super::DecodeError;
use super::super::value::Value;
use super::input::{Fault, Input};
use super::layout::Layout;
use super::numbers;
use super::schema::{Number, Shape, Type, Types};

/// Most values of a message that is made a tree; arrays of bytes count as one.
const MAX_VALUES: usize = 1 << 20;

/// The whole message.
pub(super) fn value<const BIG: bool>(
    types: &Types,
    layout: &Layout,
    bytes: &[u8],
) -> Result<Value, DecodeError> {
    let mut reader = Reader::<BIG> {
        types,
        layout,
        input: Input::new(bytes),
        values_left: MAX_VALUES,
    };
    let value = reader.one(Type::Struct(types.root))?;
    if reader.input.left() > layout.max_left {
        return Err(layout.malformed("bytes are left behind its last field, its schema is another"));
    }
    Ok(value)
}

struct Reader<'a, 'd, const BIG: bool> {
    types: &'a Types,
    layout: &'a Layout,
    input: Input<'d, BIG>,
    values_left: usize,
}

impl<'d, const BIG: bool> Reader<'_, 'd, BIG> {
    fn one(&mut self, ty: Type) -> Result<Value, DecodeError> {
        let Some(left) = self.values_left.checked_sub(1) else {
            return Err(DecodeError::WrongType(
                "a message of too many values to show".to_owned(),
            ));
        };
        self.values_left = left;
        match ty {
            Type::Number(number) => {
                self.align(number.size());
                let bytes = self.take(number.size())?;
                Ok(numbers::value::<BIG>(number, bytes).unwrap_or(Value::Null))
            }
            Type::Text => {
                self.align(4);
                let text = self.input.text(self.layout.is_terminated);
                let bytes = text.map_err(|fault| fault.error(self.layout))?;
                Ok(Value::Text(String::from_utf8_lossy(bytes).into_owned()))
            }
            Type::WideText => {
                self.align(4);
                let text = self.input.wide_text(self.layout);
                let bytes = text.map_err(|fault| fault.error(self.layout))?;
                Ok(Value::Text(wide::<BIG>(bytes, self.layout)))
            }
            Type::Struct(index) => {
                self.sized(self.layout.has_struct_sizes, |this| this.members(index))
            }
        }
    }

    fn members(&mut self, index: usize) -> Result<Value, DecodeError> {
        let of = &self.types.structs[index];
        let mut members = Vec::with_capacity(of.members.len());
        for member in &of.members {
            let value = match member.shape {
                Shape::One => self.one(member.ty)?,
                Shape::Array(n) => self.list(member.ty, Some(n))?,
                Shape::Sequence => self.list(member.ty, None)?,
            };
            members.push((member.name.clone(), value));
        }
        self.take(of.padding)?;
        Ok(Value::Map(members))
    }

    /// An array of `n` or, without `n`, a sequence.
    fn list(&mut self, ty: Type, n: Option<usize>) -> Result<Value, DecodeError> {
        let is_sized = self.layout.is_xcdr2 && !matches!(ty, Type::Number(_));
        self.sized(is_sized, |this| {
            let n = if let Some(n) = n {
                n
            } else {
                this.align(4);
                let n = this.input.len();
                n.map_err(|fault| fault.error(this.layout))?
            };
            if ty == Type::Number(Number::U8) {
                return Ok(Value::Bytes(this.take(n)?.to_vec()));
            }
            let min_size = this.types.min_size(ty);
            if min_size == 0 {
                // Elements without a byte: their number may be anything.
                return Ok(Value::List(Vec::new()));
            }
            if n > this.input.left() / min_size {
                return Err(Fault::Short.error(this.layout));
            }
            let items = (0..n).map(|_| this.one(ty)).collect::<Result<_, _>>()?;
            Ok(Value::List(items))
        })
    }

    fn sized(
        &mut self,
        is_sized: bool,
        read: impl FnOnce(&mut Self) -> Result<Value, DecodeError>,
    ) -> Result<Value, DecodeError> {
        if !is_sized {
            return read(self);
        }
        self.align(4);
        let inner = self.input.len().and_then(|n| self.input.split(n));
        let inner = inner.map_err(|fault| fault.error(self.layout))?;
        let outer = std::mem::replace(&mut self.input, inner);
        let value = read(self);
        self.input = outer;
        value
    }

    fn align(&mut self, size: usize) {
        self.input.align(size.min(self.layout.max_align) - 1);
    }

    fn take(&mut self, n: usize) -> Result<&'d [u8], DecodeError> {
        let taken = self.input.take(n);
        taken.map_err(|fault| fault.error(self.layout))
    }
}

/// Text of two-byte or four-byte characters, see [`Input::wide_text`].
fn wide<const BIG: bool>(bytes: &[u8], layout: &Layout) -> String {
    if layout.is_xcdr2 {
        let units = bytes.as_chunks::<2>().0.iter();
        let units = units.map(|&unit| Input::<BIG>::order(unit, u16::from_le_bytes));
        return char::decode_utf16(units)
            .map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER))
            .collect();
    }
    let units = bytes.as_chunks::<4>().0.iter();
    units
        .filter_map(|&unit| char::from_u32(Input::<BIG>::order(unit, u32::from_le_bytes)))
        .collect()
}
