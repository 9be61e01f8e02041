//! Messages of random content, as any writer may put them on the wire: fields in any order, packed or not, singular
//! ones more than once, unknown ones between.

use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor};

/// Random bytes, used up one by one; then zeros.
pub(super) struct Entropy<'a>(pub(super) std::slice::Iter<'a, u8>);

impl Entropy<'_> {
    fn byte(&mut self) -> u8 {
        self.0.next().copied().unwrap_or(0)
    }

    fn below(&mut self, n: usize) -> usize {
        usize::from(self.byte()) % n
    }

    fn bits(&mut self) -> u64 {
        let bits = u64::from_le_bytes([(); 8].map(|()| self.byte()));
        // Small numbers as well as large ones.
        bits >> (8 * self.below(8))
    }
}

pub(super) fn varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value.to_le_bytes()[0] | 0x80);
        value >>= 7;
    }
    out.push(value.to_le_bytes()[0]);
}

pub(super) fn tag(number: u32, wire_type: u8, out: &mut Vec<u8>) {
    varint(u64::from(number) << 3 | u64::from(wire_type), out);
}

pub(super) fn bytes(number: u32, data: &[u8], out: &mut Vec<u8>) {
    tag(number, 2, out);
    varint(data.len() as u64, out);
    out.extend(data);
}

/// A message, its fields in order and singular ones once if it is `tidy`.
pub(super) fn message(
    kind: &MessageDescriptor,
    tidy: bool,
    depth: usize,
    entropy: &mut Entropy<'_>,
) -> Vec<u8> {
    let fields: Vec<FieldDescriptor> = kind.fields().collect();
    let mut parts: Vec<(i32, Vec<u8>)> = Vec::new();
    for _ in 0..entropy.below(2 * fields.len()) {
        let field = &fields[entropy.below(fields.len())];
        let at = super::super::fields::declared(field);
        let oneof = field.containing_oneof();
        let is_taken = parts.iter().any(|(other, _)| {
            *other == at
                || oneof.as_ref().is_some_and(|o| {
                    o.fields()
                        .any(|f| super::super::fields::declared(&f) == *other)
                })
        });
        if tidy && is_taken && !field.is_list() {
            continue;
        }
        let mut out = Vec::new();
        occurrence(field, tidy, depth, entropy, &mut out);
        parts.push((at, out));
    }
    if tidy {
        parts.sort_by_key(|&(at, _)| at);
    }
    let mut out = Vec::new();
    for (_, part) in parts {
        out.extend(part);
        if entropy.below(8) == 0 {
            unknown(entropy, &mut out);
        }
    }
    out
}

fn unknown(entropy: &mut Entropy<'_>, out: &mut Vec<u8>) {
    let number = 5000;
    match entropy.below(5) {
        0 => {
            tag(number, 0, out);
            varint(entropy.bits(), out);
        }
        1 => {
            tag(number, 1, out);
            out.extend([7; 8]);
        }
        2 => bytes(number, b"unknown", out),
        3 => {
            tag(number, 3, out);
            tag(1, 0, out);
            varint(entropy.bits(), out);
            tag(2, 3, out);
            tag(2, 4, out);
            tag(number, 4, out);
        }
        _ => {
            tag(number, 5, out);
            out.extend([7; 4]);
        }
    }
}

fn occurrence(
    field: &FieldDescriptor,
    tidy: bool,
    depth: usize,
    entropy: &mut Entropy<'_>,
    out: &mut Vec<u8>,
) {
    let number = field.number();
    let wire_type = match field.kind() {
        Kind::Message(kind) => {
            let data = match depth.checked_sub(1) {
                Some(depth) => message(&kind, tidy, depth, entropy),
                None => Vec::new(),
            };
            return bytes(number, &data, out);
        }
        Kind::String => {
            return bytes(
                number,
                &b"a\xc3\xa9z"[..[0, 1, 3, 4][entropy.below(4)]],
                out,
            );
        }
        Kind::Bytes => return bytes(number, &[0, 255, 3, 9][..entropy.below(5)], out),
        Kind::Double | Kind::Fixed64 | Kind::Sfixed64 => 1,
        Kind::Float | Kind::Fixed32 | Kind::Sfixed32 => 5,
        _ => 0,
    };
    let mut scalar = |out: &mut Vec<u8>| {
        let bits = entropy.bits();
        match wire_type {
            1 => out.extend(bits.to_le_bytes()),
            5 => out.extend(&bits.to_le_bytes()[..4]),
            _ => varint(bits, out),
        }
        bits
    };
    let mut run = Vec::new();
    let is_packed = field.is_list() && scalar(&mut run) % 2 == 0;
    if is_packed {
        let n = scalar(&mut run) % 5;
        for _ in 0..n {
            scalar(&mut run);
        }
        bytes(number, &run, out);
    } else {
        tag(number, wire_type, out);
        scalar(out);
    }
}
