//! Examples are those of RFC 8949, appendix A, and RFC 8746 where it is said so.

use half::f16;
use proptest::prelude::*;

use super::*;
use crate::recording::decode::plan::{Access, Field};
use crate::recording::decode::test_support::*;

/// Bytes of hexadecimal digits, blanks between them.
fn hex(digits: &str) -> Vec<u8> {
    let digits: String = digits.split_whitespace().collect();
    (0..digits.len())
        .step_by(2)
        .map(|i| u8::from_str_radix(&digits[i..i + 2], 16).unwrap())
        .collect()
}

/// `{"action": item}`.
fn action(item: &str) -> Vec<u8> {
    hex(&format!("a1 66 616374696f6e {item}"))
}

fn values(item: &str) -> Result<Vec<f64>, String> {
    values_at(&["action"], &action(item), value, decode).map_err(|e| e.to_string())
}

#[track_caller]
fn check(item: &str, expected: &[f64]) {
    assert_eq!(values(item).as_deref(), Ok(expected), "{item}");
}

#[track_caller]
fn refused(item: &str, expected: &str) {
    assert_eq!(values(item), Err(expected.to_owned()), "{item}");
}

#[test]
fn numbers_of_every_size() {
    check("00", &[0.0]);
    check("1903e8", &[1000.0]);
    check("1bffffffffffffffff", &[18_446_744_073_709_551_615.0]);
    check("3bffffffffffffffff", &[-18_446_744_073_709_551_616.0]);
    check("29", &[-10.0]);
    check("3903e7", &[-1000.0]);
    check("f90001", &[5.960_464_477_539_063e-8]);
    check("f9c400", &[-4.0]);
    check("fa47c35000", &[100_000.0]);
    check("fbc010666666666666", &[-4.1]);
    check("83 f4 f5 f93c00", &[0.0, 1.0, 1.0]);
    refused("f97e00 00", "not CBOR: bytes follow the message");
    assert!(values("f97e00").unwrap()[0].is_nan());
}

#[test]
fn big_numbers_become_the_nearest_float() {
    check("c249010000000000000000", &[18_446_744_073_709_551_616.0]);
    check("c349010000000000000000", &[-18_446_744_073_709_551_617.0]);
    check("c25f 42 0100 41 00 ff", &[65_536.0]);
    check("c240", &[0.0]);
    check(
        "c250 ffffffffffffffffffffffffffffffff",
        &[340_282_366_920_938_463_463_374_607_431_768_211_456.0],
    );
    check(
        "c350 ffffffffffffffffffffffffffffffff",
        &[-340_282_366_920_938_463_463_374_607_431_768_211_456.0],
    );
    refused(
        "c251 01ffffffffffffffffffffffffffffffff",
        "an integer beyond 128 bits is not supported",
    );
    refused(
        "c2 05",
        "not CBOR: a tag of byte strings before another value",
    );
}

#[test]
fn arrays_strings_and_maps_of_indefinite_length() {
    check("9f 01 82 02 03 9f 04 05 ff ff", &[1.0, 2.0, 3.0, 4.0, 5.0]);
    check("5f 42 0102 43 030405 ff", &[1.0, 2.0, 3.0, 4.0, 5.0]);
    check("bf 61 61 01 61 62 9f 02 03 ff ff", &[1.0, 2.0, 3.0]);
    // {_ "act" "ion": 7}
    let message = hex("bf 7f 63 616374 63 696f6e ff 07 ff");
    assert_eq!(
        values_at(&["action"], &message, value, decode),
        Ok(vec![7.0])
    );
    refused("ff", "not CBOR: a byte that starts no value");
    refused("82 01 ff", "not CBOR: a byte that starts no value");
    refused("9f 01", "not CBOR: it ends in the middle of a value");
    // A piece of a string must have a length and be of its kind.
    refused("5f 61 61 ff", "not CBOR: a byte that starts no value");
}

#[test]
fn typed_arrays_in_both_byte_orders() {
    check("d840 43 0102ff", &[1.0, 2.0, 255.0]);
    check("d844 43 0102ff", &[1.0, 2.0, 255.0]);
    check("d841 44 0102 0304", &[258.0, 772.0]);
    check("d845 44 0201 0403", &[258.0, 772.0]);
    check("d842 44 00010000", &[65_536.0]);
    check("d846 44 00000100", &[65_536.0]);
    check("d843 48 8000000000000000", &[9_223_372_036_854_775_808.0]);
    check("d847 48 0000000000000080", &[9_223_372_036_854_775_808.0]);
    check("d848 42 80ff", &[-128.0, -1.0]);
    check("d849 42 8000", &[-32_768.0]);
    check("d84d 42 feff", &[-2.0]);
    check("d84a 44 ffffff00", &[-256.0]);
    check("d84e 44 00ffffff", &[-256.0]);
    check("d84b 48 fffffffffffffffe", &[-2.0]);
    check("d84f 48 feffffffffffffff", &[-2.0]);
    check("d850 44 3c00 c400", &[1.0, -4.0]);
    check("d854 44 003c 00c4", &[1.0, -4.0]);
    check("d851 44 47c35000", &[100_000.0]);
    check("d855 44 0050c347", &[100_000.0]);
    check("d852 48 c010666666666666", &[-4.1]);
    check("d856 48 66666666666610c0", &[-4.1]);
    check("d855 5f 42 0050 42 c347 ff", &[100_000.0]);
    check("d829 82 01 02", &[1.0, 2.0]);
    refused(
        "d855 43 0050c3",
        "not CBOR: a typed array that ends inside a number",
    );
    refused(
        "d855 01",
        "not CBOR: a tag of byte strings before another value",
    );
    refused(
        "d857 50 00000000000000000000000000000000",
        "an array of floats of 128 bits is not supported",
    );
    refused(
        "d84c 41 00",
        "a typed array of an unknown kind is not supported",
    );
}

#[test]
fn arrays_with_dimensions_are_row_major() {
    // RFC 8746, figures 1 and 2.
    let expected = [2.0, 4.0, 8.0, 4.0, 16.0, 256.0];
    check(
        "d828 82 82 02 03 d841 4c 000200040008 000400100100",
        &expected,
    );
    check("d828 82 82 02 03 86 02 04 08 04 10 190100", &expected);
    check("d828 9f 9f 02 03 ff 86 02 04 08 04 10 190100 ff", &expected);
    refused(
        "d90410 82 82 02 03 86 02 04 08 04 10 190100",
        "an array in column-major order is not supported",
    );
    let wrong = "not CBOR: the dimensions of an array are not those of its elements";
    refused("d828 82 82 02 04 86 02 04 08 04 10 190100", wrong);
    refused("d828 82 82 02 04 d841 4c 000200040008 000400100100", wrong);
    refused("d828 82 82 1bffffffffffffffff 02 80", wrong);
    refused("d828 82 81 01 05", wrong);
    let no_dimensions = "not CBOR: a tag of arrays with dimensions before another value";
    refused("d828 81 81 01", no_dimensions);
    refused("d828 83 81 01 81 05 05", no_dimensions);
    refused("d828 9f 81 01 81 05 05 ff", no_dimensions);
    refused("d828 05", no_dimensions);
}

#[test]
fn what_only_looks_like_a_number_is_refused() {
    for (item, what) in [
        ("c4 82 21 196ab3", "a decimal fraction"),
        ("c5 82 20 03", "a big float"),
        ("d81e 82 01 03", "a rational number"),
        ("d818 41 05", "CBOR inside a byte string"),
        ("d819 00", "a reference to an earlier text"),
        ("d81d 00", "a reference to an earlier value"),
        ("f0", "a simple value"),
        ("f8 ff", "a simple value"),
    ] {
        refused(item, &format!("{what} is not supported"));
        // In a field that is not wanted it does not matter.
        let message = hex(&format!("a2 61 78 {item} 66 616374696f6e 05"));
        assert_eq!(
            values_at(&["action"], &message, value, decode),
            Ok(vec![5.0])
        );
    }
    refused("f6", "null where a number is expected in action");
    refused("f7", "null where a number is expected in action");
    refused("61 61", "text where a number is expected in action");
}

#[test]
fn tags_that_change_nothing_are_skipped() {
    let message = hex("d9d9f7 a1 c0 66 616374696f6e c1 d83d 82 c6 01 02");
    assert_eq!(
        values_at(&["action"], &message, value, decode),
        Ok(vec![1.0, 2.0])
    );
}

#[test]
fn keys_that_are_not_text_are_skipped() {
    // {1: 1, h'61': 2, [1]: 3, null: 4, 1(2): 5, "action": {7: 1, "x": 2}}
    let message =
        hex("a6 01 01 41 61 02 81 01 03 f6 04 c1 02 05 66 616374696f6e a2 07 01 61 78 02");
    assert_eq!(
        values_at(&["action"], &message, value, decode),
        Ok(vec![2.0])
    );
    // A reference may be any key.
    let trees = Node::trees(&[wanted(&["action"], Field::Values(0))], None);
    assert_eq!(
        decode(&trees[0], &hex("a1 d819 00 01"), &mut new_row()),
        Err(DecodeError::WrongType(
            "a reference to an earlier text is not supported".to_owned()
        ))
    );
}

#[test]
fn a_wanted_key_that_comes_twice_is_an_error() {
    let message = hex("a2 66 616374696f6e 01 66 616374696f6e 02");
    assert_eq!(
        values_at(&["action"], &message, value, decode)
            .unwrap_err()
            .to_string(),
        "duplicate key \"action\""
    );
    refused("a2 61 61 01 61 61 02", "duplicate key \"a\"");
}

#[test]
fn ranges_pick_from_typed_arrays_and_byte_strings() {
    for item in [
        "45 0102030405",
        "d840 45 0102030405",
        "d845 4a 01000200030004000500",
    ] {
        let data = action(item);
        let mut want = wanted(&["action"], Field::Values(0));
        want.path.push(Access::Items(1..3));
        let trees = Node::trees(&[want], Some(&value(&data).unwrap()));
        let mut row = new_row();
        decode(&trees[0], &data, &mut row).unwrap();
        assert_eq!(row.targets[0].values, [2.0, 3.0], "{item}");
    }
}

#[test]
fn errors_hold_no_value() {
    let trees = Node::trees(&[wanted(&["action", "x"], Field::Values(0))], None);
    for (item, expected) in [
        ("18ff", "a number where an object is expected"),
        ("63 616263", "text where an object is expected"),
        ("42 0102", "bytes where an object is expected"),
        ("f4", "a boolean where an object is expected"),
        ("f6", "null where an object is expected"),
        (
            "3bffffffffffffffff",
            "a number beyond 64 bits where an object is expected",
        ),
    ] {
        let error = decode(&trees[0], &action(item), &mut new_row()).unwrap_err();
        assert_eq!(error.to_string(), expected);
    }
    let trees = Node::trees(&[wanted(&["action"], Field::Names(0))], None);
    let error = decode(&trees[0], &action("82 61 61 05"), &mut new_row()).unwrap_err();
    assert_eq!(error.to_string(), "no text where action is expected");
}

#[test]
fn a_nan_in_a_message_does_not_stand_for_an_absent_value() {
    let bits = crate::recording::decode::ABSENT.to_bits();
    let taken = values(&format!("fb {bits:016x}")).unwrap();
    assert!(!crate::recording::decode::is_absent(taken[0]));
    assert!(taken[0].is_nan());
}

#[test]
fn depth_and_lengths_are_bounded() {
    let deep = |n: usize| format!("{} 01", "81".repeat(n));
    check(&deep(MAX_DEPTH - 1), &[1.0]);
    refused(&deep(MAX_DEPTH), "not CBOR: it is nested too deeply");
    refused(&deep(1_000_000), "not CBOR: it is nested too deeply");
    check(&format!("{} 01", "c1".repeat(1_000_000)), &[1.0]);
    for nested in [
        &b"\x81"[..],
        b"\x9f",
        b"\xbf\x61\x61",
        b"\xa1\x61\x61",
        b"\xd8\x28\x82\x81\x01",
    ] {
        let unwanted = [&b"\xa1\x61\x78"[..], &nested.repeat(100_000)].concat();
        let trees = Node::trees(&[wanted(&["action"], Field::Values(0))], None);
        for message in [nested.repeat(100_000), unwanted] {
            decode(&trees[0], &message, &mut new_row()).unwrap_err();
            value(&message).unwrap_err();
        }
    }
    for length in [
        "9bffffffffffffffff",
        "bbffffffffffffffff",
        "5bffffffffffffffff",
        "7bffffffffffffffff",
    ] {
        refused(length, "not CBOR: it ends in the middle of a value");
    }
}

/// Writes a value in one of the many ways in which it can be written.
struct Writer {
    out: Vec<u8>,
    choices: Choices,
}

impl Writer {
    fn head(&mut self, major: u8, n: u64) {
        let sizes = [24, 1 << 8, 1 << 16, 1 << 32, u128::MAX];
        let fewest = sizes.iter().position(|&s| u128::from(n) < s).unwrap();
        // Longer than need be one time in four.
        let size = match self.choices.below(4) {
            0 => fewest + self.choices.below(5 - fewest),
            _ => fewest,
        };
        let bytes = n.to_be_bytes();
        let major = major << 5;
        match size {
            0 => self.out.push(major | bytes[7]),
            1 => self.out.extend([major | 0x18, bytes[7]]),
            2 => self.out.extend([&[major | 0x19], &bytes[6..]].concat()),
            3 => self.out.extend([&[major | 0x1a], &bytes[4..]].concat()),
            _ => self.out.extend([&[major | 0x1b], &bytes[..]].concat()),
        }
    }

    /// Begins a string, an array or a map; true if a break must end it.
    fn open(&mut self, major: u8, n: usize) -> bool {
        let is_indefinite = self.choices.below(3) == 0;
        if is_indefinite {
            self.out.push((major << 5) | 0x1f);
        } else {
            self.head(major, n as u64);
        }
        is_indefinite
    }

    fn string(&mut self, major: u8, bytes: &[u8]) {
        if self.open(major, bytes.len()) {
            let at = match major {
                2 => self.choices.below(bytes.len() + 1),
                _ => 0,
            };
            for piece in [&bytes[..at], &bytes[at..]] {
                self.head(major, piece.len() as u64);
                self.out.extend(piece);
            }
            self.out.push(0xff);
        } else {
            self.out.extend(bytes);
        }
    }

    fn float(&mut self, n: f64) {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "only used if nothing is lost"
        )]
        let single = n as f32;
        let half = f16::from_f64(n);
        match self.choices.below(3) {
            0 if half.to_f64() == n => self
                .out
                .extend([&[0xf9][..], &half.to_bits().to_be_bytes()].concat()),
            1 if f64::from(single) == n => self
                .out
                .extend([&[0xfa][..], &single.to_be_bytes()].concat()),
            _ => self.out.extend([&[0xfb][..], &n.to_be_bytes()].concat()),
        }
    }

    fn list(&mut self, items: &[Value]) {
        let floats: Option<Vec<f64>> = items
            .iter()
            .map(|item| match item {
                Value::Number(n) => Some(*n),
                _ => None,
            })
            .collect();
        match floats {
            Some(floats) if self.choices.below(2) == 0 => {
                let is_little_endian = self.choices.below(2) == 0;
                self.head(6, if is_little_endian { 86 } else { 82 });
                let bytes: Vec<u8> = floats
                    .iter()
                    .flat_map(|n| {
                        if is_little_endian {
                            n.to_le_bytes()
                        } else {
                            n.to_be_bytes()
                        }
                    })
                    .collect();
                self.string(2, &bytes);
            }
            _ => {
                let has_break = self.open(4, items.len());
                for item in items {
                    self.value(item);
                }
                self.out.extend(has_break.then_some(0xff));
            }
        }
    }

    fn value(&mut self, value: &Value) {
        if self.choices.below(10) == 0 {
            self.head(6, 55_799);
        }
        match value {
            Value::Null => self.out.push(if self.choices.below(2) == 0 {
                0xf6
            } else {
                0xf7
            }),
            Value::Bool(b) => self.out.push(0xf4 + u8::from(*b)),
            Value::Integer(n) if *n < 0 => self.head(1, (-1 - n).try_into().unwrap()),
            Value::Integer(n) => self.head(0, (*n).try_into().unwrap()),
            Value::Number(n) => self.float(*n),
            Value::Text(text) => self.string(3, text.as_bytes()),
            Value::Bytes(bytes) => self.string(2, bytes),
            Value::List(items) => self.list(items),
            Value::Map(members) => {
                let has_break = self.open(5, members.len());
                for (key, value) in members {
                    self.string(3, key.as_bytes());
                    self.value(value);
                }
                self.out.extend(has_break.then_some(0xff));
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
    fn any_value_is_read_back(written in any_value(), seed in any::<u64>()) {
        prop_assert_eq!(value(&write(&written, seed)).unwrap(), written);
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
            // What is a message for the plan is one for people as well, but for tags in fields that the plan skips.
            if let (Ok(_), Err(error)) = (row, value(&message)) {
                let text = error.to_string();
                prop_assert!(
                    ["tag", "typed array", "dimensions"].iter().any(|w| text.contains(w)),
                    "{}", text
                );
            }
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
