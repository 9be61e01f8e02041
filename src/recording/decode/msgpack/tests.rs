//! Layouts are those of the specification; `rmp-serde` is the oracle.

use proptest::prelude::*;

use super::*;
use crate::recording::decode::plan::{Access, Field};
use crate::recording::decode::test_support::*;

/// `{"action": item}`.
fn action(item: &[u8]) -> Vec<u8> {
    [b"\x81\xa6action", item].concat()
}

fn values(item: &[u8]) -> Result<Vec<f64>, String> {
    values_at(&["action"], &action(item), value, decode).map_err(|e| e.to_string())
}

#[track_caller]
fn check(item: &[u8], expected: &[f64]) {
    assert_eq!(values(item).as_deref(), Ok(expected), "{item:x?}");
}

#[track_caller]
fn refused(item: &[u8], expected: &str) {
    assert_eq!(values(item), Err(expected.to_owned()), "{item:x?}");
}

#[test]
fn numbers_of_every_size() {
    check(b"\x7f", &[127.0]);
    check(b"\xe0", &[-32.0]);
    check(b"\xcc\xff", &[255.0]);
    check(b"\xcd\x01\x02", &[258.0]);
    check(b"\xce\x00\x01\x00\x00", &[65_536.0]);
    check(
        b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff",
        &[18_446_744_073_709_551_615.0],
    );
    check(b"\xd0\x80", &[-128.0]);
    check(b"\xd1\x80\x00", &[-32_768.0]);
    check(b"\xd2\xff\xff\xff\x00", &[-256.0]);
    check(b"\xd3\xff\xff\xff\xff\xff\xff\xff\xfe", &[-2.0]);
    check(b"\xca\x47\xc3\x50\x00", &[100_000.0]);
    check(b"\xcb\xc0\x10\x66\x66\x66\x66\x66\x66", &[-4.1]);
    check(b"\x92\xc2\xc3", &[0.0, 1.0]);
}

#[test]
fn arrays_maps_and_bytes_of_every_length_field() {
    check(b"\xdc\x00\x02\x01\x02", &[1.0, 2.0]);
    check(b"\xdd\x00\x00\x00\x02\x01\x02", &[1.0, 2.0]);
    check(b"\xc4\x02\x01\x02", &[1.0, 2.0]);
    check(b"\xc5\x00\x02\x01\x02", &[1.0, 2.0]);
    check(b"\xc6\x00\x00\x00\x02\x01\x02", &[1.0, 2.0]);
    check(b"\xde\x00\x01\xd9\x01x\x05", &[5.0]);
    check(b"\xdf\x00\x00\x00\x01\xda\x00\x01x\x05", &[5.0]);
    check(b"\x81\xdb\x00\x00\x00\x01x\x05", &[5.0]);
}

#[test]
fn what_is_no_number_is_refused() {
    refused(b"\xc0", "null where a number is expected in action");
    refused(b"\xa1a", "text where a number is expected in action");
    // rmp-serde would make two numbers of it.
    refused(b"\xa2\xff\xfe", "not MessagePack: a text is not UTF-8");
    refused(b"\xc1", "not MessagePack: a byte that starts no value");
    refused(b"\x01\x02", "not MessagePack: bytes follow the message");
    for extension in [
        &b"\xd4\x01\x00"[..],
        b"\xd6\xff\x00\x00\x00\x00",
        b"\xd8\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00",
        b"\xc7\x01\x4e\x00",
        b"\xc8\x00\x01\x4e\x00",
        b"\xc9\x00\x00\x00\x00\x4e",
    ] {
        refused(extension, "an extension type is not supported");
        let message = [b"\x82\xa1x", extension, b"\xa6action\x05"].concat();
        assert_eq!(
            values_at(&["action"], &message, value, decode),
            Ok(vec![5.0])
        );
    }
}

#[test]
fn keys_that_are_not_text_are_skipped() {
    // An integer, nil, bytes, an array, text that is not UTF-8.
    let message =
        b"\x86\x01\x01\xc0\x02\xc4\x01a\x03\x91\x01\x04\xa1\xff\x05\xa6action\x82\x07\x01\xa1x\x02";
    assert_eq!(
        values_at(&["action"], message, value, decode),
        Ok(vec![2.0])
    );
}

#[test]
fn a_wanted_key_that_comes_twice_is_an_error() {
    let message = b"\x82\xa6action\x01\xa6action\x02";
    assert_eq!(
        values_at(&["action"], message, value, decode)
            .unwrap_err()
            .to_string(),
        "duplicate key \"action\""
    );
}

#[test]
fn ranges_pick_from_arrays_and_bytes() {
    for item in [&b"\xc4\x04\x01\x02\x03\x04"[..], b"\x94\x01\x02\x03\x04"] {
        let mut want = wanted(&["action"], Field::Values(0));
        want.path.push(Access::Items(1..3));
        let trees = Node::trees(&[want], None);
        let mut row = new_row();
        decode(&trees[0], &action(item), &mut row).unwrap();
        assert_eq!(row.targets[0].values, [2.0, 3.0]);
    }
}

#[test]
fn depth_and_lengths_are_bounded() {
    let deep = |n: usize| [&b"\x91".repeat(n)[..], b"\x01"].concat();
    check(&deep(MAX_DEPTH - 1), &[1.0]);
    refused(&deep(MAX_DEPTH), "not MessagePack: it is nested too deeply");
    refused(&deep(1_000_000), "not MessagePack: it is nested too deeply");
    let unwanted = [b"\x81\xa1x", &deep(100_000)[..]].concat();
    let trees = Node::trees(&[wanted(&["action"], Field::Values(0))], None);
    assert!(decode(&trees[0], &unwanted, &mut new_row()).is_err());
    for marker in [0xdd, 0xdf, 0xdb, 0xc6, 0xc9] {
        refused(
            &[marker, 0xff, 0xff, 0xff, 0xff],
            "not MessagePack: it ends in the middle of a value",
        );
    }
}

/// Writes a value in one of the many ways in which it can be written.
struct Writer {
    out: Vec<u8>,
    choices: Choices,
}

impl Writer {
    fn len(&mut self, len: usize, fixed: Option<(u8, usize)>, markers: &[(u8, u32)]) {
        if let Some((marker, below)) = fixed
            && len < below
            && self.choices.below(3) > 0
        {
            self.out.push(marker | u8::try_from(len).unwrap());
            return;
        }
        let fitting: Vec<_> = markers
            .iter()
            .filter(|(_, n_bytes)| len < 1 << (8 * n_bytes))
            .collect();
        let (marker, n_bytes) = *fitting[self.choices.below(fitting.len())];
        self.out.push(marker);
        let bytes = u32::try_from(len).unwrap().to_be_bytes();
        self.out.extend(&bytes[4 - n_bytes as usize..]);
    }

    fn integer(&mut self, n: i128) {
        let signed = [(0xd0, 1), (0xd1, 2), (0xd2, 4), (0xd3, 8)]
            .iter()
            .filter(|(_, size)| (-(1i128 << (8 * size - 1))..1 << (8 * size - 1)).contains(&n));
        let unsigned = [(0xcc, 1), (0xcd, 2), (0xce, 4), (0xcf, 8)]
            .iter()
            .filter(|(_, size)| (0..1i128 << (8 * size)).contains(&n));
        let fitting: Vec<_> = signed.chain(unsigned).collect();
        if (-32..128).contains(&n) && self.choices.below(2) == 0 {
            self.out.push(n.to_be_bytes()[15]);
            return;
        }
        let &(marker, size) = fitting[self.choices.below(fitting.len())];
        self.out.push(marker);
        self.out.extend(&n.to_be_bytes()[16 - size..]);
    }

    fn text(&mut self, text: &str) {
        self.len(
            text.len(),
            Some((0xa0, 32)),
            &[(0xd9, 1), (0xda, 2), (0xdb, 4)],
        );
        self.out.extend(text.as_bytes());
    }

    fn value(&mut self, value: &Value) {
        match value {
            Value::Null => self.out.push(0xc0),
            Value::Bool(b) => self.out.push(0xc2 + u8::from(*b)),
            Value::Integer(n) => self.integer(*n),
            Value::Number(n) => {
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "only used if nothing is lost"
                )]
                let single = *n as f32;
                if f64::from(single) == *n && self.choices.below(2) == 0 {
                    self.out.push(0xca);
                    self.out.extend(single.to_be_bytes());
                } else {
                    self.out.push(0xcb);
                    self.out.extend(n.to_be_bytes());
                }
            }
            Value::Text(text) => self.text(text),
            Value::Bytes(bytes) => {
                self.len(bytes.len(), None, &[(0xc4, 1), (0xc5, 2), (0xc6, 4)]);
                self.out.extend(bytes);
            }
            Value::List(items) => {
                self.len(items.len(), Some((0x90, 16)), &[(0xdc, 2), (0xdd, 4)]);
                for item in items {
                    self.value(item);
                }
            }
            Value::Map(members) => {
                self.len(members.len(), Some((0x80, 16)), &[(0xde, 2), (0xdf, 4)]);
                for (key, value) in members {
                    self.text(key);
                    self.value(value);
                }
            }
        }
    }
}

fn write(value: &Value, seed: u64) -> Vec<u8> {
    let mut writer = Writer {
        out: Vec::new(),
        choices: Choices(seed),
    };
    writer.value(value);
    writer.out
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn any_value_is_read_back_as_rmp_serde_reads_it(written in any_value(), seed in any::<u64>()) {
        let data = write(&written, seed);
        let theirs = ValueSeed.deserialize(&mut rmp_serde::Deserializer::from_read_ref(&data)).unwrap();
        let ours = value(&data).unwrap();
        prop_assert_eq!(&ours, &theirs);
        prop_assert_eq!(ours, written);
    }

    #[test]
    fn a_plan_takes_what_a_slow_walk_takes(first in any_message(), seed in any::<u64>()) {
        let mut choices = Choices(seed);
        let message = choices.shuffled(&first);
        let trees = Node::trees(&all_wanted(), Some(&first));
        let row = walk_all(&trees, &write(&message, seed), decode).unwrap();
        prop_assert_eq!(format!("{row:?}"), format!("{:?}", slow_row(&message, &first)));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(12) })]

    #[test]
    fn damage_is_an_error_or_another_value(first in any_message(), seed in any::<u64>()) {
        let trees = Node::trees(&all_wanted(), Some(&first));
        for message in damaged(&write(&first, seed)) {
            let row = walk_all(&trees, &message, decode);
            // What is a message for the plan is one for people as well.
            prop_assert!(row.is_err() || value(&message).is_ok());
        }
    }

    #[test]
    fn random_bytes_do_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let trees = Node::trees(&all_wanted(), None);
        for start in 0..bytes.len() {
            drop(walk_all(&trees, &bytes[start..], decode));
            drop(value(&bytes[start..]));
        }
    }
}
