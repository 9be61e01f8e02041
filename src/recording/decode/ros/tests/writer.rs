//! Random types with random messages, and a serializer of its own: the oracle of the decoder.

use std::fmt::Write;

use super::super::super::value::Value;

/// Splitmix64: the same numbers for a seed on every machine.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() % u64::try_from(n).unwrap()).unwrap()
    }

    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        // Often zeros, so that small numbers occur.
        let keep = self.below(N) + 1;
        let mut bytes = [0; N];
        bytes[..keep].copy_from_slice(&self.next().to_le_bytes()[..keep]);
        bytes
    }
}

const NUMBERS: [(&str, usize); 11] = [
    ("bool", 1),
    ("int8", 1),
    ("uint8", 1),
    ("int16", 2),
    ("uint16", 2),
    ("int32", 4),
    ("uint32", 4),
    ("float32", 4),
    ("int64", 8),
    ("uint64", 8),
    ("float64", 8),
];

#[derive(Clone, Copy)]
pub(super) enum Kind {
    /// Index into [`NUMBERS`].
    Number(usize),
    Text,
    WideText,
    Struct(usize),
}

#[derive(Clone, Copy)]
pub(super) enum Many {
    One,
    Fixed(usize),
    Any,
}

/// Definitions; a struct holds only those before it, the last is the message.
pub(super) struct Schema {
    pub(super) structs: Vec<Vec<(Kind, Many)>>,
    is_ros1: bool,
}

impl Schema {
    pub(super) fn random(random: &mut Random, is_ros1: bool) -> Self {
        let n_structs = random.below(5) + 1;
        let mut structs: Vec<Vec<(Kind, Many)>> = Vec::new();
        for s in 0..n_structs {
            let n_members = if s + 1 == n_structs {
                random.below(8) + 1
            } else {
                random.below(5)
            };
            let mut members = Vec::new();
            for _ in 0..n_members {
                let kind = match random.below(8) {
                    0 => Kind::Text,
                    1 if !is_ros1 => Kind::WideText,
                    2 | 3 if s > 0 => Kind::Struct(random.below(s)),
                    _ => Kind::Number(random.below(NUMBERS.len())),
                };
                let many = match random.below(6) {
                    0 => Many::Fixed(random.below(4)),
                    1 | 2 => Many::Any,
                    _ => Many::One,
                };
                members.push((kind, many));
            }
            structs.push(members);
        }
        Self { structs, is_ros1 }
    }

    /// As a `.msg` definition.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        for (s, members) in self.structs.iter().enumerate().rev() {
            if s + 1 < self.structs.len() {
                write!(text, "{}\nMSG: p/S{s}\n", "=".repeat(80)).unwrap();
            } else {
                text.push_str("# The message.\nint32 ANSWER = 42\n");
            }
            for (m, (kind, many)) in members.iter().enumerate() {
                let base = match kind {
                    Kind::Number(n) => NUMBERS[*n].0.to_owned(),
                    Kind::Text => "string".to_owned(),
                    Kind::WideText => "wstring<=99".to_owned(),
                    Kind::Struct(s) if s % 2 == 0 => format!("S{s}"),
                    Kind::Struct(s) => format!("p/msg/S{s}"),
                };
                match many {
                    Many::One => writeln!(text, "{base} m{m} # comment"),
                    Many::Fixed(n) => writeln!(text, "{base}[{n}] m{m}"),
                    Many::Any if m % 2 == 0 => writeln!(text, "{base}[] m{m}"),
                    Many::Any => writeln!(text, "{base}[<=999]  m{m}"),
                }
                .unwrap();
            }
        }
        text
    }
}

/// The rules of an encoding, in the writer's own terms.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    pub(super) is_ros1: bool,
    /// XCDR1 or 2.
    pub(super) version: u8,
    pub(super) is_delimited: bool,
    pub(super) is_big_endian: bool,
}

pub(super) struct Writer<'a> {
    schema: &'a Schema,
    rules: Rules,
    random: &'a mut Random,
    out: Vec<u8>,
}

/// Writes a random message; what it says, and its bytes.
pub(super) fn message(schema: &Schema, rules: Rules, random: &mut Random) -> (Value, Vec<u8>) {
    let mut writer = Writer {
        schema,
        rules,
        random,
        out: Vec::new(),
    };
    let value = writer.value(Kind::Struct(schema.structs.len() - 1));
    let mut bytes = Vec::new();
    if !rules.is_ros1 {
        let id = match (rules.version, rules.is_delimited) {
            (1, _) => 0,
            (_, false) => 6,
            (_, true) => 8,
        };
        bytes.extend([0, id + u8::from(!rules.is_big_endian), 0, 0]);
    }
    bytes.extend(writer.out);
    (value, bytes)
}

impl Writer<'_> {
    fn put(&mut self, mut bytes: Vec<u8>) {
        let align = match self.rules {
            Rules { is_ros1: true, .. } => 1,
            Rules { version: 1, .. } => bytes.len(),
            _ => bytes.len().min(4),
        };
        while !self.out.len().is_multiple_of(align) {
            self.out.push(0xee);
        }
        if self.rules.is_big_endian {
            bytes.reverse();
        }
        self.out.extend(bytes);
    }

    fn put_len(&mut self, n: usize) {
        self.put(u32::try_from(n).unwrap().to_le_bytes().to_vec());
    }

    fn sized(&mut self, is_sized: bool, write: impl FnOnce(&mut Self) -> Value) -> Value {
        if !is_sized {
            return write(self);
        }
        self.put_len(0);
        let start = self.out.len();
        let value = write(self);
        let n = u32::try_from(self.out.len() - start).unwrap();
        let size = if self.rules.is_big_endian {
            n.to_be_bytes()
        } else {
            n.to_le_bytes()
        };
        self.out[start - 4..start].copy_from_slice(&size);
        value
    }

    fn value(&mut self, kind: Kind) -> Value {
        match kind {
            Kind::Number(n) => self.number(n),
            Kind::Text => {
                let text = ["", "a", "joint_1", "wrist é", "elbow"][self.random.below(5)];
                let nul = usize::from(!self.rules.is_ros1);
                self.put_len(text.len() + nul);
                self.out.extend(text.as_bytes());
                self.out.extend(std::iter::repeat_n(0, nul));
                Value::Text(text.to_owned())
            }
            Kind::WideText => self.wide_text(),
            Kind::Struct(s) => self.sized(self.rules.is_delimited, |this| this.members(s)),
        }
    }

    fn wide_text(&mut self) -> Value {
        let text = ["", "b", "größe"][self.random.below(3)];
        if self.rules.version == 2 {
            self.put_len(text.encode_utf16().count() * 2);
            for unit in text.encode_utf16() {
                self.put(unit.to_le_bytes().to_vec());
            }
        } else {
            self.put_len(text.chars().count());
            for c in text.chars() {
                self.put(u32::from(c).to_le_bytes().to_vec());
            }
        }
        Value::Text(text.to_owned())
    }

    fn members(&mut self, s: usize) -> Value {
        let schema = self.schema;
        let members = &schema.structs[s];
        if members.is_empty() && !schema.is_ros1 {
            self.put(vec![0]);
        }
        let mut values = Vec::new();
        for (m, (kind, many)) in members.iter().enumerate() {
            let value = match many {
                Many::One => self.value(*kind),
                Many::Fixed(n) => self.list(*kind, Some(*n)),
                Many::Any => self.list(*kind, None),
            };
            values.push((format!("m{m}"), value));
        }
        Value::Map(values)
    }

    fn list(&mut self, kind: Kind, fixed: Option<usize>) -> Value {
        let is_sized = self.rules.version == 2 && !matches!(kind, Kind::Number(_));
        self.sized(is_sized, |this| {
            let n = fixed.unwrap_or_else(|| this.random.below(4));
            if fixed.is_none() {
                this.put_len(n);
            }
            let start = this.out.len();
            let items: Vec<Value> = (0..n).map(|_| this.value(kind)).collect();
            if this.out.len() == start && matches!(kind, Kind::Struct(_)) {
                // In ROS 1 an element may have no byte; how many there are is not kept then.
                return Value::List(Vec::new());
            }
            if !matches!(kind, Kind::Number(n) if NUMBERS[n].0 == "uint8") {
                return Value::List(items);
            }
            let byte = |item: &Value| match item {
                Value::Integer(i) => u8::try_from(*i).unwrap(),
                _ => unreachable!(),
            };
            Value::Bytes(items.iter().map(byte).collect())
        })
    }

    fn number(&mut self, n: usize) -> Value {
        let (name, size) = NUMBERS[n];
        let raw = self.random.bytes::<8>();
        self.put(raw[..size].to_vec());
        let two = [raw[0], raw[1]];
        let four = [raw[0], raw[1], raw[2], raw[3]];
        match name {
            "bool" => Value::Bool(raw[0] != 0),
            "int8" => Value::Integer(i8::from_le_bytes([raw[0]]).into()),
            "uint8" => Value::Integer(raw[0].into()),
            "int16" => Value::Integer(i16::from_le_bytes(two).into()),
            "uint16" => Value::Integer(u16::from_le_bytes(two).into()),
            "int32" => Value::Integer(i32::from_le_bytes(four).into()),
            "uint32" => Value::Integer(u32::from_le_bytes(four).into()),
            "float32" => Value::Number(f32::from_le_bytes(four).into()),
            "int64" => Value::Integer(i64::from_le_bytes(raw).into()),
            "uint64" => Value::Integer(u64::from_le_bytes(raw).into()),
            _ => Value::Number(f64::from_le_bytes(raw)),
        }
    }
}
