//! Definitions: what is read, what is refused and how.

use super::super::super::plan::{Field, Wanted};
use super::super::schema::{Dialect, Number, Shape, Type, Types};
use super::{channel, compile, schema, want};

fn parse(text: &str) -> Result<Types, String> {
    Types::parse("p/msg/T", text, Dialect::Ros2)
}

#[test]
fn comments_constants_defaults_and_bounds_are_understood() {
    let text = "
# A comment
int32 X=1
string S = \"a # b\"   # constant
float64 a 1.5
string<=10 b \"x=1\" # default
wstring[] c
  uint8[3] d  # fixed
string<=10[<=5] e
p/msg/U f
Other g
================================================================================
MSG: p/U
bool x
================================================================================
MSG: q/msg/Other
";
    let types = parse(text).unwrap();
    let members = &types.structs[types.root].members;
    let found: Vec<(&str, Shape)> = members.iter().map(|m| (m.name.as_str(), m.shape)).collect();
    let expected = [
        ("a", Shape::One),
        ("b", Shape::One),
        ("c", Shape::Sequence),
        ("d", Shape::Array(3)),
        ("e", Shape::Sequence),
        ("f", Shape::One),
        ("g", Shape::One),
    ];
    assert_eq!(found, expected);
    assert_eq!(members[3].ty, Type::Number(Number::U8));
    assert_eq!(types.describe(members[6].ty, Shape::One), "q/Other");
}

#[test]
fn definitions_that_cannot_be_used_are_refused_with_the_reason() {
    let doubling = (0..40).fold("L0 a\nL0 b\n".to_owned(), |text, i| {
        text + &format!("===\nMSG: p/L{i}\nL{j} a\nL{j} b\n", j = i + 1)
    }) + "===\nMSG: p/L40\nuint8 x\n";
    let deep = (0..200).fold("L0 a\n".to_owned(), |text, i| {
        text + &format!("===\nMSG: p/L{i}\nL{j} a\n", j = i + 1)
    }) + "===\nMSG: p/L200\nuint8 x\n";
    let cases = [
        ("Missing x", "\"p/Missing\" is not defined"),
        ("T x", "\"p/T\" holds itself"),
        ("U[] x\n===\nMSG: p/U\nT y", "\"p/T\" holds itself"),
        ("float64", "no field in the line \"float64\""),
        ("float64[x] a", "\"float64[x]\" is not a type"),
        ("float64<=3 a", "\"float64<=3\" is not a type"),
        ("uint8 a\n===\nIDL: p/U\n", "IDL"),
        (&doubling, "too many fields"),
        (&deep, "nested too deep"),
    ];
    for (text, reason) in cases {
        let of = schema("p/msg/T", "ros2msg", text);
        let error = compile("cdr", &of, &[want("", Field::Values(0))]).unwrap_err();
        assert!(error.to_string().contains(reason), "{error} lacks {reason}");
    }
}

#[test]
fn schemas_of_another_encoding_and_none_at_all_are_refused() {
    let wanted = [want("a", Field::Values(0))];
    let error = |encoding: &str, of: &str| {
        compile(encoding, &schema("p/msg/T", of, "uint8 a"), &wanted)
            .unwrap_err()
            .to_string()
    };
    for of in ["ros2idl", "omgidl", "ros1msg", ""] {
        assert!(error("cdr", of).contains("only ros2msg is read"));
    }
    assert!(error("ros1", "ros2msg").contains("only ros1msg is read"));
    let none = super::super::value(&channel("cdr"), None, &[0, 1, 0, 0]).unwrap_err();
    assert!(none.to_string().contains("the channel has none"), "{none}");
    let unknown = compile("cdr", &schema("p/msg/T", "", ""), &wanted).unwrap_err();
    assert!(
        unknown.to_string().contains("not one that is built in"),
        "{unknown}"
    );
}

#[test]
fn built_in_definitions_are_whole() {
    let names = [
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/TwistStamped",
        "geometry_msgs/msg/WrenchStamped",
        "sensor_msgs/msg/JointState",
        "std_msgs/msg/ByteMultiArray",
        "std_msgs/msg/Float64MultiArray",
        "std_msgs/msg/UInt16MultiArray",
        "std_msgs/Header",
        "trajectory_msgs/JointTrajectory",
    ];
    for name in names {
        for dialect in [Dialect::Ros1, Dialect::Ros2] {
            Types::parse(name, "", dialect).unwrap();
        }
    }
}

/// Paths into the type of the test below, and why they do not fit.
const UNFIT: [(&str, Field, &str); 10] = [
    (
        "positions",
        Field::Values(0),
        "p/T has no field \"positions\", its fields are name, position, p",
    ),
    (
        "p.x",
        Field::Values(0),
        "p/P has no field \"x\", its fields are s",
    ),
    (
        "name",
        Field::Values(0),
        "\"name\" of p/T is string[], which holds no numbers to take",
    ),
    (
        "p",
        Field::Values(0),
        "\"p\" of p/T is p/P, which holds no numbers to take",
    ),
    (
        "position.x",
        Field::Values(0),
        "\"position\" of p/T is float64[], which has no fields",
    ),
    (
        "position",
        Field::Reward,
        "\"position\" of p/T is float64[], where a number is expected",
    ),
    (
        "position[0:1]",
        Field::Step,
        "\"position\" of p/T is float64[], where an integer is expected",
    ),
    (
        "position",
        Field::Names(0),
        "\"position\" of p/T is float64[], where texts are expected",
    ),
    (
        "p[0:1].s",
        Field::Names(0),
        "\"p\" of p/T is p/P, of which no elements can be picked",
    ),
    (
        "p",
        Field::Step,
        "\"p\" of p/T is p/P, where one value is expected",
    ),
];

#[test]
fn paths_that_do_not_fit_are_refused_if_required_and_else_left_out() {
    let text = "string[] name\nfloat64[] position\nP p\n===\nMSG: p/P\nstring s";
    let of = schema("p/msg/T", "ros2msg", text);
    for (path, field, text) in UNFIT {
        let required = want(path, field);
        let optional = Wanted {
            required: false,
            ..required.clone()
        };
        let error = compile("cdr", &of, &[required]).unwrap_err();
        assert_eq!(error.to_string(), text);
        compile("cdr", &of, &[optional]).unwrap();
    }
}
