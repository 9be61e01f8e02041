//! The oracle is `serde_json`, walked by the seeds of `tree.rs`: same rows to the bit, and the same texts refused.

use std::fmt::Write as _;

use proptest::collection::vec;
use proptest::prelude::*;
use serde::de::DeserializeSeed;

use super::*;
use crate::recording::MAX_DEPTH;
use crate::recording::decode::plan::{Access, Field, Wanted};
use crate::recording::decode::test_support::*;
use crate::recording::decode::tree::NodeSeed;

fn slow_decode(node: &Node, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
    let mut json = serde_json::Deserializer::from_slice(data);
    NodeSeed {
        node,
        row,
        in_array: false,
    }
    .deserialize(&mut json)
    .and_then(|()| json.end())
    .map_err(|e| error(data, &e))
}

/// Holds our walk against the oracle, and gives what both gave.
#[track_caller]
fn check_same(trees: &[Node], data: &[u8]) -> Result<Row, DecodeError> {
    let (mut row, mut expected_row) = (new_row(), new_row());
    let mut json = Json::new(trees.to_vec());
    // Twice: a walk must not depend on what an earlier one left behind.
    drop(json.decode(data, &mut row));
    row.clear();
    let ours = json.decode(data, &mut row);
    let theirs = trees
        .iter()
        .try_for_each(|tree| slow_decode(tree, data, &mut expected_row));
    let text = String::from_utf8_lossy(data);
    match (&ours, &theirs) {
        // Errors may use other words for the same thing.
        (Ok(()), Ok(()))
        | (Err(DecodeError::WrongType(_)), Err(DecodeError::WrongType(_)))
        | (Err(DecodeError::Malformed { .. }), Err(DecodeError::Malformed { .. })) => {}
        _ => assert_eq!(ours, theirs, "{text}"),
    }
    // Also what was read before an error: its step number tells which step is lost.
    assert_eq!(format!("{row:?}"), format!("{expected_row:?}"), "{text}");
    ours.map(|()| row)
}

fn state_tree() -> Vec<Node> {
    Node::trees(&[wanted(&["state"], Field::Values(1))], None)
}

/// Holds a number against the oracle: as a value, as an integer, and where nobody wants it.
#[track_caller]
fn check_number(number: &str) -> Result<f64, DecodeError> {
    let reward_and_step = [
        wanted(&["state"], Field::Reward),
        wanted(&["step"], Field::Step),
    ];
    let trees = Node::trees(&reward_and_step, None);
    let message = format!(r#"{{"state":{number},"x":{number},"step":{number}}}"#);
    drop(check_same(&trees, message.as_bytes()));
    // In an array, at the end of a message, and far from it.
    let alone = Node::trees(
        &[Wanted {
            path: vec![],
            field: Field::Values(0),
            required: true,
        }],
        None,
    );
    drop(check_same(&alone, number.as_bytes()));
    drop(check_same(
        &alone,
        format!("[{number},{number}]").as_bytes(),
    ));
    let message = format!(
        r#"{{"state":[{number}, {number}],"unwanted":"{}"}}"#,
        " ".repeat(60)
    );
    let row = check_same(&state_tree(), message.as_bytes())?;
    assert_eq!(row.targets[1].values.len(), 2);
    Ok(row.targets[1].values[0])
}

/// Numbers of every shape, those where rounding is hard among them.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "-0.0",
    "0e5",
    "-0e999999999999",
    "0.0e-7",
    "1",
    "-1",
    "9",
    "10",
    "255",
    "1234567",
    "12345678",
    "123456789",
    "-7654321",
    "9007199254740991",
    "9007199254740992",
    "9007199254740993",
    "9007199254740995",
    "18014398509481989",
    "9223372036854775807",
    "9223372036854775808",
    "-9223372036854775808",
    "-9223372036854775809",
    "18446744073709551615",
    "18446744073709551616",
    "99999999999999999999",
    "100000000000000000000000",
    "0.1",
    "0.5",
    "1.5",
    "-2.25",
    "0.3",
    "2.675",
    "12.5",
    "123456.789",
    "0.30000000000000004",
    "0.1234567890123456789012345678901234567890",
    "3.141592653589793",
    "1.7976931348623157e308",
    "1.7976931348623158e308",
    "4.9e-324",
    "2.5e-324",
    "2.4e-324",
    "2.2250738585072014e-308",
    "2.2250738585072011e-308",
    "1e22",
    "1e23",
    "8.5e22",
    "1e-22",
    "1e-23",
    "1E5",
    "1e+5",
    "1e05",
    "1.0e-05",
    "7.2057594037927933e16",
    "9007199254740993.0",
    "9007199254740993.00000000001",
    "9007199254740992.99999999999999999999",
    "0.000000000000000000000000000000000000000000001",
    "0.0000000000000000000012345678901234567",
    "1.00000000000000011102230246251565404",
    "1.00000000000000011102230246251565405",
    "1.00000000000000011102230246251565403",
    // Halfway between two f64, exactly: 2^53 + 1, and over a power of ten.
    "9007199254740993e0",
    "900719925474099.3e1",
    "90071992547409930e-1",
    "4503599627370497.5",
    "4503599627370496.5",
    "1125899906842624.125",
    "45035996273704975e-1",
];

#[test]
fn numbers_are_the_nearest_f64() {
    for &number in NUMBERS {
        let value = check_number(number).unwrap();
        assert_eq!(
            value.to_bits(),
            number.parse::<f64>().unwrap().to_bits(),
            "{number}"
        );
    }
}

#[test]
fn what_is_no_number_is_refused() {
    for text in [
        "",
        "-",
        "+1",
        "01",
        "-01",
        "00",
        "1.",
        "-1.",
        ".5",
        "-.5",
        "1.e5",
        "1e",
        "1e+",
        "1e-",
        "1E",
        "0x10",
        "1_000",
        "1a",
        "--1",
        "1-",
        "1..2",
        "1.2.3",
        "1e5.5",
        "1e5e5",
        "0123456789",
        "012345678901234567890.5",
        "00.5",
        "NaN",
        "-NaN",
        "Infinity",
        "-Infinity",
        "1NaN",
        "nan",
        "inf",
        "١",
        "1,",
        "1 2",
    ] {
        assert!(check_number(text).is_err(), "{text}");
    }
    for text in [
        "1e999",
        "-1e999",
        "1e309",
        "1.8e308",
        "1e99999999999999999999",
        "123456789e301",
        "1e400",
    ] {
        let error = check_number(text).unwrap_err().to_string();
        assert_eq!(error, "not JSON: number out of range");
    }
    for text in ["NaN", "-Infinity", "Infinity"] {
        assert_eq!(check_number(text), Err(DecodeError::NanToken));
    }
}

#[test]
fn rows_of_zeros_do_not_mislead_the_exponent() {
    for n in [20, 400, 1_000, 70_000, 700_000] {
        let small = format!("0.{}1e{}", "0".repeat(n), n + 1);
        let large = format!("1{}e-{n}", "0".repeat(n));
        let small_but_cut = format!("0.{}1234567890123456789012345e{}", "0".repeat(n), n + 1);
        assert_eq!(check_number(&small), Ok(1.0));
        assert_eq!(check_number(&large), Ok(1.0));
        assert_eq!(check_number(&small_but_cut), Ok(1.234_567_890_123_456_8));
    }
}

/// JSON, and what nearly is.
const TEXTS: &[&str] = &[
    "",
    " ",
    "{",
    "}",
    "[",
    "{}",
    "[]",
    "{]",
    "null",
    "true",
    "5",
    "\"a\"",
    "{\"state\"}",
    "{\"state\":}",
    "{\"state\":[1,]}",
    "{\"state\":[,1]}",
    "{\"state\":[1 2]}",
    "{\"state\":[1}",
    "{\"state\":[1,2",
    "{\"state\":[1],}",
    "{,\"state\":[1]}",
    "{\"state\":[1]}x",
    "{\"state\":[1]} \t\r\n",
    "\u{feff}{\"state\":[1]}",
    "{\"state\":[1]}\0",
    "{'state':[1]}",
    "{state:[1]}",
    "{\"state\":[1];}",
    "{\"state\":[tru]}",
    "{\"state\":[true,false]}",
    "{\"state\":[truefalse]}",
    "{\"state\":[null]}",
    "{\"state\":null}",
    "{\"state\":{}}",
    "{\"state\":\"1\"}",
    "{\"state\" : [ 1 , [ 2 ] , [ ] ] }",
    "{\"st\\u0061te\":[1]}",
    "{\"\\u0073\\u0074ate\":[1],\"state\":[2]}",
    "{\"x\":\"\\ud83d\\ude00\",\"state\":[1]}",
    "{\"\\ud83d\":1,\"state\":[1]}",
    "{\"x\":\"\\ud83d\",\"state\":[1]}",
    "{\"\\ude00\":1,\"state\":[1]}",
    "{\"\\ud83dx\":1,\"state\":[1]}",
    "{\"\\ud83d\\n\":1,\"state\":[1]}",
    "{\"\\ud83d\\ud83d\":1,\"state\":[1]}",
    "{\"\\u12\":1}",
    "{\"\\u12g4\":1}",
    "{\"\\x\":1}",
    "{\"x\":\"\\x\"}",
    "{\"x\":\"\\u00e\"}",
    "{\"x\":\"a\tb\"}",
    "{\"a\tb\":1}",
    "{\"x\":\"\u{7f}\",\"state\":[1]}",
    "{\"x\":{\"a\":[1,{\"b\":[]},{}],\"c\":1e999},\"state\":[1]}",
    "{\"x\":[1,],\"state\":[1]}",
    "{\"x\":{\"a\":1,},\"state\":[1]}",
    "{\"x\":{\"a\" 1},\"state\":[1]}",
    "{\"x\":{a:1},\"state\":[1]}",
    "{\"x\":[1}],\"state\":[1]}",
    "{\"x\":{\"a\":1],\"state\":[1]}",
    "{\"x\":NaN,\"state\":[1]}",
    "{\"x\":[01],\"state\":[1]}",
    "{\"x\":-,\"state\":[1]}",
    "{\"x\":\"Na\" NaN}",
    "{\"x\":1,\"x\":2,\"state\":[1]}",
    "{\"state\":[1],\"state\":[1]}",
    "{\"step\":1,\"step\":1}",
    "{\"episode\":\"a\\\"\\\\\\/\\b\\f\\n\\r\\tb\\u00e9\\ud83d\\ude00\",\"state\":[1]}",
    "{\"episode\":\"\",\"state\":[1]}",
    "{\"episode\":null}",
    "{\"episode\":[1]}",
    "{\"episode\":{}}",
    "{\"episode\":1.5}",
    "{\"episode\":true}",
    "{\"step\":3.0,\"episode\":-0.0}",
    "{\"step\":\"3\"}",
    "{\"step\":9007199254740993}",
    "{\"step\":1e300}",
];

#[test]
fn texts_that_are_no_json_are_refused_where_serde_json_refuses_them() {
    let trees = Node::trees(
        &[
            wanted(&["state"], Field::Values(1)),
            wanted(&["episode"], Field::Episode { rank: 0 }),
            wanted(&["step"], Field::Step),
        ],
        None,
    );
    for &message in TEXTS {
        drop(check_same(&trees, message.as_bytes()));
        let in_array = format!("[{message}]");
        drop(check_same(&trees, in_array.as_bytes()));
        for end in 0..message.len() {
            drop(check_same(&trees, &message.as_bytes()[..end]));
        }
    }
    let not_utf8: [&[u8]; 5] = [
        b"{\"x\":\"\xff\",\"state\":[1]}",
        b"{\"\xff\":1,\"state\":[1]}",
        b"{\"x\":{\"\xff\":1},\"state\":[1]}",
        b"{\"episode\":\"\xc3\",\"state\":[1]}",
        b"{\"state\":[\"\xc3\"]}",
    ];
    for message in not_utf8 {
        drop(check_same(&trees, message));
    }
}

#[test]
fn a_quote_or_a_control_character_is_found_wherever_it_stands() {
    let trees = state_tree();
    for len in 0..300 {
        for end in [
            "\"",
            "\\\"\"",
            "\\u0041\"",
            "\n\"",
            "\u{1f}\"",
            "\u{e9}\"",
            "\\",
            "",
        ] {
            let text = format!("{}{end}", "a".repeat(len));
            for message in [
                format!(r#"{{"x":"{text},"state":[1]}}"#),
                format!(r#"{{"{text}:1,"state":[1]}}"#),
            ] {
                drop(check_same(&trees, message.as_bytes()));
            }
        }
    }
}

#[test]
fn depth_is_bounded_as_serde_json_bounds_it() {
    let wanted_everywhere = [
        wanted(&["state"], Field::Values(1)),
        wanted(&["joints", "position"], Field::Values(2)),
        wanted(&["joints", "name"], Field::Names(2)),
    ];
    let trees = Node::trees(&wanted_everywhere, None);
    for n in [
        1,
        63,
        64,
        65,
        MAX_DEPTH - 3,
        MAX_DEPTH - 2,
        MAX_DEPTH - 1,
        MAX_DEPTH,
        200,
        1_000,
    ] {
        let nested = |inner: &str| format!("{}{inner}{}", "[".repeat(n), "]".repeat(n));
        for message in [
            format!(r#"{{"state":{}}}"#, nested("1")),
            format!(
                r#"{{"joints":{},"state":[1]}}"#,
                nested(r#"{"position":1,"name":"a"}"#)
            ),
            format!(
                r#"{{"joints":{},"state":[1]}}"#,
                nested(r#"{"name":["a"]}"#)
            ),
            // What is not wanted may be nested to any depth.
            format!(r#"{{"x":{},"state":[1]}}"#, nested(r#"{"a":[{}]}"#)),
            format!(
                r#"{{"x":{}1{},"state":[1]}}"#,
                r#"{"a":["#.repeat(n),
                "]}".repeat(n)
            ),
            format!(
                r#"{{"x":{}1{},"state":[1]}}"#,
                r#"{"a":["#.repeat(n),
                "}]".repeat(n)
            ),
            nested("1"),
        ] {
            drop(check_same(&trees, message.as_bytes()));
        }
    }
    let error = check_number(&format!("{}1{}", "[".repeat(127), "]".repeat(127))).unwrap_err();
    assert_eq!(error.to_string(), "not JSON: recursion limit exceeded");
}

#[test]
fn errors_hold_nothing_of_the_message() {
    let trees = Node::trees(
        &[
            wanted(&["a", "b"], Field::Values(0)),
            wanted(&["step"], Field::Step),
        ],
        None,
    );
    for (message, expected) in [
        (r#"{"a":734}"#, "a number where an object is expected"),
        (r#"{"a":"734"}"#, "text where an object is expected"),
        (r#"{"a":false}"#, "a boolean where an object is expected"),
        (
            r#"{"step":734.5}"#,
            "a number that is not whole where step is expected",
        ),
        (r#"{"step":[734]}"#, "an array where step is expected"),
        (
            r#"{"a":{"b":"734"}}"#,
            "text where a number is expected in action",
        ),
        (
            r#"{"a":{"b":{"c":1}}}"#,
            "an object where a number is expected in action",
        ),
        (r#"{"step":1,"step":2}"#, "duplicate key \"step\""),
    ] {
        let error = check_same(&trees, message.as_bytes()).unwrap_err();
        assert_eq!(error.to_string(), expected, "{message}");
    }
}

#[test]
fn members_come_in_the_order_of_the_first_message() {
    let first =
        value(br#"{"action":{"a":1,"b":{"x":[1,2],"y":3},"t":"no","c":[{"p":1,"q":2}]}}"#).unwrap();
    let trees = Node::trees(&[wanted(&["action"], Field::Values(0))], Some(&first));
    let values = |message: &str| {
        check_same(&trees, message.as_bytes()).map(|row| row.targets[0].values.clone())
    };
    assert_eq!(
        values(
            r#"{"action":{"c":[{"q":9,"p":8},{"p":6,"q":7}],"z":0,"b":{"y":5,"x":[3,4]},"a":1,"t":1}}"#
        ),
        Ok(vec![1.0, 3.0, 4.0, 5.0, 8.0, 9.0, 6.0, 7.0])
    );
    for message in [
        r#"{"action":{"a":1,"b":{"x":[1,2]},"c":[]}}"#,
        r#"{"action":{"a":1,"b":{"x":[1,2],"y":1,"x":2},"c":[]}}"#,
        r#"{"action":{"a":1}}"#,
        r#"{"action":{"a":null,"b":5,"c":[]}}"#,
        r#"{"action":{"b":{"y":5,"x":[3,4"#,
    ] {
        assert!(values(message).is_err(), "{message}");
    }
}

/// Writes a value in one of the many ways in which it can be written.
struct Writer {
    out: String,
    choices: Choices,
}

impl Writer {
    fn space(&mut self) {
        let spaces = ["", "", "", "", "", " ", "\n\t", "  \r\n"];
        self.out.push_str(spaces[self.choices.below(spaces.len())]);
    }

    fn text(&mut self, text: &str) {
        self.out.push('"');
        for character in text.chars() {
            match (self.choices.below(12), character) {
                (0, _) => {
                    let mut units = [0; 2];
                    for unit in character.encode_utf16(&mut units) {
                        write!(self.out, "\\u{unit:04x}").unwrap();
                    }
                }
                (_, '"' | '\\') => self.out.extend(['\\', character]),
                (_, '\n') => self.out.push_str("\\n"),
                (_, control) if control < ' ' => {
                    write!(self.out, "\\u{:04X}", u32::from(control)).unwrap();
                }
                _ => self.out.push(character),
            }
        }
        self.out.push('"');
    }

    fn number(&mut self, number: f64) {
        let decimals = self.choices.below(30);
        let text = match self.choices.below(4) {
            0 => format!("{number:?}"),
            1 => format!("{number:e}"),
            2 if number.abs() < 1e30 => format!("{number:.decimals$}"),
            _ => format!("{number}"),
        };
        self.out.push_str(&text);
    }

    fn value(&mut self, value: &Value) {
        self.space();
        match value {
            Value::Null => self.out.push_str("null"),
            Value::Bool(b) => self.out.push_str(&b.to_string()),
            Value::Integer(n) => self.out.push_str(&n.to_string()),
            Value::Number(n) => self.number(*n),
            Value::Text(text) => self.text(text),
            // JSON has no bytes.
            Value::Bytes(bytes) => {
                let items = bytes.iter().map(|&b| Value::Integer(b.into())).collect();
                self.value(&Value::List(items));
            }
            Value::List(items) => {
                self.out.push('[');
                for (i, item) in items.iter().enumerate() {
                    self.out.push_str(if i == 0 { "" } else { "," });
                    self.value(item);
                }
                self.out.push(']');
            }
            Value::Map(members) => {
                self.out.push('{');
                for (i, (key, value)) in members.iter().enumerate() {
                    self.out.push_str(if i == 0 { "" } else { "," });
                    self.space();
                    self.text(key);
                    self.space();
                    self.out.push(':');
                    self.value(value);
                }
                self.out.push('}');
            }
        }
        self.space();
    }
}

fn write(value: &Value, seed: u64) -> Vec<u8> {
    let mut writer = Writer {
        out: String::new(),
        choices: Choices(seed),
    };
    writer.value(value);
    writer.out.into_bytes()
}

/// What is wanted, with ranges and an object of numbers besides.
fn plans(first: &Value) -> Vec<Vec<Node>> {
    let mut of_objects = wanted(&["joints"], Field::Values(2));
    of_objects.path.push(Access::Items(1..3));
    of_objects.path.push(Access::Key("position".to_owned()));
    vec![
        Node::trees(&all_wanted(), Some(first)),
        Node::trees(&all_wanted(), None),
        Node::trees(
            &[of_objects, wanted(&["noise"], Field::Values(0))],
            Some(first),
        ),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    #[test]
    fn any_message_gives_the_row_that_serde_json_gives(first in any_message(), seed in any::<u64>()) {
        let mut choices = Choices(seed);
        let message = write(&choices.shuffled(&first), seed);
        // Written without a fraction a number is an integer in JSON; the members' order is what matters here.
        for trees in plans(&first) {
            drop(check_same(&trees, &message));
        }
        prop_assert!(check_same(&Node::trees(&all_wanted(), Some(&first)), &message).is_ok());
    }

    #[test]
    fn any_f64_is_read_back(numbers in vec(any::<f64>().prop_filter("finite", |n| n.is_finite()), 1..40), seed in any::<u64>()) {
        let mut writer = Writer { out: String::new(), choices: Choices(seed) };
        for number in numbers {
            for exact in [format!("{number:?}"), format!("{number:e}"), format!("{number}")] {
                prop_assert_eq!(check_number(&exact).unwrap().to_bits(), number.to_bits());
            }
            writer.out.clear();
            writer.number(number);
            drop(check_number(&writer.out));
        }
    }

    #[test]
    fn any_digits_are_the_nearest_f64(number in "-?(0|[1-9][0-9]{0,24})(\\.[0-9]{1,30})?([eE][+-]?[0-9]{1,3})?") {
        let expected: f64 = number.parse().unwrap();
        match check_number(&number) {
            Ok(value) => prop_assert_eq!(value.to_bits(), expected.to_bits()),
            Err(_) => prop_assert!(expected.is_infinite()),
        }
    }

    #[test]
    fn halfway_cases_go_to_even(significand in 1u64 << 52..1 << 53, power in 0usize..12, tail in "[0-9]{0,12}") {
        // (significand + 1/2) / 2^power, written out, and a little more.
        let numerator = (2 * u128::from(significand) + 1) * 5u128.pow(u32::try_from(power).unwrap() + 1);
        let digits = numerator.to_string();
        let (integer, fraction) = digits.split_at(digits.len() - power - 1);
        for number in [format!("{integer}.{fraction}"), format!("{integer}.{fraction}{tail}"), format!("{digits}e-{}", power + 1)] {
            prop_assert_eq!(check_number(&number).unwrap().to_bits(), number.parse::<f64>().unwrap().to_bits());
        }
    }

    #[test]
    fn what_looks_like_a_number_is_one_for_both_or_for_none(text in "[-+0-9.eE]{1,12}") {
        drop(check_number(&text));
    }

    #[test]
    fn what_looks_like_json_is_json_for_both_or_for_none(tokens in vec(prop::sample::select(&[
        "{", "}", "[", "]", ",", ":", "\"state\"", "\"step\"", "\"a\\n\"", "\"", "\\", "1", "-2.5", "null", "true", " ", "NaN", "\u{e9}",
    ][..]), 0..16), start in prop::sample::select(&["", "{\"state\":", "{\"x\":", "{\"state\":[1,"][..])) {
        let trees = Node::trees(&[wanted(&["state"], Field::Values(1)), wanted(&["step"], Field::Step)], None);
        drop(check_same(&trees, format!("{start}{}", tokens.concat()).as_bytes()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(20) })]

    #[test]
    fn damage_is_an_error_for_both_or_for_none(first in any_message(), seed in any::<u64>()) {
        let plans = plans(&first);
        for message in damaged(&write(&first, seed)) {
            for trees in &plans {
                drop(check_same(trees, &message));
            }
        }
    }
}
