//! The messages, and their schemas as protobuf has them: `FileDescriptorSet`s.

use prost::Message;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type};
use prost_reflect::prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
};

/// `google.protobuf.Timestamp`.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct Timestamp {
    /// Seconds since the Unix epoch.
    #[prost(int64, tag = "1")]
    pub seconds: i64,
    /// 0 to 999,999,999.
    #[prost(int32, tag = "2")]
    pub nanos: i32,
}

impl Timestamp {
    /// Of nanoseconds since the Unix epoch.
    pub fn from_nanos(nanos: i64) -> Self {
        let second = 1_000_000_000;
        Self {
            seconds: nanos.div_euclid(second),
            nanos: i32::try_from(nanos.rem_euclid(second)).unwrap_or(0),
        }
    }
}

/// `foxglove.KeyValuePair`.
#[derive(Clone, PartialEq, Message)]
pub struct KeyValuePair {
    /// Unique among the pairs of an event.
    #[prost(string, tag = "1")]
    pub key: String,
    /// As text.
    #[prost(string, tag = "2")]
    pub value: String,
}

/// `foxglove.Event`: one composite action.
#[derive(Clone, PartialEq, Message)]
pub struct Event {
    /// Time of its first step.
    #[prost(message, optional, tag = "1")]
    pub start_time: Option<Timestamp>,
    /// Time of its last step.
    #[prost(message, optional, tag = "2")]
    pub end_time: Option<Timestamp>,
    /// The columns of its row in the `segments` table; those that are null there are not here.
    #[prost(message, repeated, tag = "3")]
    pub metadata: Vec<KeyValuePair>,
}

/// `coact.StateChange`: the state at one step.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct StateChange {
    /// As in the tables.
    #[prost(int64, tag = "1")]
    pub episode: i64,
    /// 0-based in the episode.
    #[prost(uint32, tag = "2")]
    pub step: u32,
    /// `E_w`, in the unit of the measure.
    #[prost(double, tag = "3")]
    pub measure: f64,
    /// `E_n`, 0 to 1.
    #[prost(double, tag = "4")]
    pub change: f64,
    /// The change passes the threshold.
    #[prost(bool, tag = "5")]
    pub mask: bool,
}

/// `coact.ActionChange`: one joint, or all together, at one step.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct ActionChange {
    /// As in the tables.
    #[prost(int64, tag = "1")]
    pub episode: i64,
    /// 0-based in the episode.
    #[prost(uint32, tag = "2")]
    pub step: u32,
    /// The raw action; none for all joints together.
    #[prost(double, optional, tag = "3")]
    pub action: Option<f64>,
    /// `E_w`, in the unit of the measure.
    #[prost(double, tag = "4")]
    pub measure: f64,
    /// `E_n`, 0 to 1.
    #[prost(double, tag = "5")]
    pub change: f64,
    /// The change passes the threshold.
    #[prost(bool, tag = "6")]
    pub mask: bool,
    /// Action and state both change nearby.
    #[prost(bool, tag = "7")]
    pub correlated: bool,
    /// The last step of a run of correlated ones.
    #[prost(bool, tag = "8")]
    pub boundary: bool,
    /// Number of the composite action that the step is in; −1 outside.
    #[prost(sint32, tag = "9")]
    pub segment: i32,
}

/// A message that has a schema.
pub(super) trait Schema: Message {
    /// Its full name.
    const NAME: &'static str;

    /// The `FileDescriptorSet` of its file and those that it needs.
    fn descriptor_set() -> Vec<u8>;
}

impl Schema for Event {
    const NAME: &'static str = "foxglove.Event";

    fn descriptor_set() -> Vec<u8> {
        let time = ".google.protobuf.Timestamp";
        set(vec![
            file(
                "google/protobuf/timestamp.proto",
                "google.protobuf",
                &[],
                message(
                    "Timestamp",
                    [
                        field("seconds", 1, Type::Int64),
                        field("nanos", 2, Type::Int32),
                    ],
                ),
            ),
            file(
                "foxglove/KeyValuePair.proto",
                "foxglove",
                &[],
                message(
                    "KeyValuePair",
                    [
                        field("key", 1, Type::String),
                        field("value", 2, Type::String),
                    ],
                ),
            ),
            file(
                "foxglove/Event.proto",
                "foxglove",
                &[
                    "foxglove/KeyValuePair.proto",
                    "google/protobuf/timestamp.proto",
                ],
                message(
                    "Event",
                    [
                        of_type(field("start_time", 1, Type::Message), time),
                        of_type(field("end_time", 2, Type::Message), time),
                        FieldDescriptorProto {
                            label: Some(Label::Repeated.into()),
                            ..of_type(
                                field("metadata", 3, Type::Message),
                                ".foxglove.KeyValuePair",
                            )
                        },
                    ],
                ),
            ),
        ])
    }
}

impl Schema for StateChange {
    const NAME: &'static str = "coact.StateChange";

    fn descriptor_set() -> Vec<u8> {
        let fields = [
            field("episode", 1, Type::Int64),
            field("step", 2, Type::Uint32),
            field("measure", 3, Type::Double),
            field("change", 4, Type::Double),
            field("mask", 5, Type::Bool),
        ];
        set(vec![file(
            "coact/StateChange.proto",
            "coact",
            &[],
            message("StateChange", fields),
        )])
    }
}

impl Schema for ActionChange {
    const NAME: &'static str = "coact.ActionChange";

    fn descriptor_set() -> Vec<u8> {
        // Presence in proto3 is a `oneof` of one field.
        let action = FieldDescriptorProto {
            oneof_index: Some(0),
            proto3_optional: Some(true),
            ..field("action", 3, Type::Double)
        };
        let fields = [
            field("episode", 1, Type::Int64),
            field("step", 2, Type::Uint32),
            action,
            field("measure", 4, Type::Double),
            field("change", 5, Type::Double),
            field("mask", 6, Type::Bool),
            field("correlated", 7, Type::Bool),
            field("boundary", 8, Type::Bool),
            field("segment", 9, Type::Sint32),
        ];
        let mut message = message("ActionChange", fields);
        message
            .oneof_decl
            .push(prost_reflect::prost_types::OneofDescriptorProto {
                name: Some("_action".to_owned()),
                options: None,
            });
        set(vec![file(
            "coact/ActionChange.proto",
            "coact",
            &[],
            message,
        )])
    }
}

fn set(file: Vec<FileDescriptorProto>) -> Vec<u8> {
    FileDescriptorSet { file }.encode_to_vec()
}

fn file(
    name: &str,
    package: &str,
    dependencies: &[&str],
    message: DescriptorProto,
) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        dependency: dependencies.iter().map(ToString::to_string).collect(),
        message_type: vec![message],
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    }
}

fn message<const N: usize>(name: &str, fields: [FieldDescriptorProto; N]) -> DescriptorProto {
    DescriptorProto {
        name: Some(name.to_owned()),
        field: fields.into(),
        ..DescriptorProto::default()
    }
}

fn field(name: &str, number: i32, kind: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        json_name: Some(json_name(name)),
        number: Some(number),
        label: Some(Label::Optional.into()),
        r#type: Some(kind.into()),
        ..FieldDescriptorProto::default()
    }
}

fn of_type(field: FieldDescriptorProto, name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto {
        type_name: Some(name.to_owned()),
        ..field
    }
}

/// `start_time` as JSON has it, `startTime`.
fn json_name(name: &str) -> String {
    let mut words = name.split('_');
    let first = words.next().unwrap_or_default().to_owned();
    words.fold(first, |mut text, word| {
        let mut letters = word.chars();
        text.extend(letters.next().map(|c| c.to_ascii_uppercase()));
        text.push_str(letters.as_str());
        text
    })
}

#[cfg(test)]
mod tests {
    use prost_reflect::{DescriptorPool, DynamicMessage, Value};

    use super::*;

    /// Decodes a message by its schema alone, as a viewer does.
    fn decoded<M: Schema>(message: &M) -> DynamicMessage {
        let pool = DescriptorPool::decode(&*M::descriptor_set()).unwrap();
        let descriptor = pool.get_message_by_name(M::NAME).unwrap();
        let decoded = DynamicMessage::decode(descriptor, &*message.encode_to_vec()).unwrap();
        assert_eq!(decoded.unknown_fields().count(), 0, "{decoded:?}");
        decoded
    }

    #[test]
    fn schemas_describe_the_messages() {
        let state = StateChange {
            episode: -3,
            step: 7,
            measure: 0.25,
            change: 0.5,
            mask: true,
        };
        let read = decoded(&state);
        let by_name = |name: &str| read.get_field_by_name(name).unwrap().into_owned();
        assert_eq!(by_name("episode"), Value::I64(-3));
        assert_eq!(by_name("step"), Value::U32(7));
        assert_eq!(by_name("measure"), Value::F64(0.25));
        assert_eq!(by_name("change"), Value::F64(0.5));
        assert_eq!(by_name("mask"), Value::Bool(true));

        let action = ActionChange {
            episode: 1,
            step: 2,
            action: Some(0.0),
            measure: 1.5,
            change: 0.75,
            mask: false,
            correlated: true,
            boundary: true,
            segment: -1,
        };
        let read = decoded(&action);
        let by_name = |name: &str| read.get_field_by_name(name).unwrap().into_owned();
        assert!(read.has_field_by_name("action"), "zero is a value");
        assert_eq!(by_name("action"), Value::F64(0.0));
        assert_eq!(by_name("correlated"), Value::Bool(true));
        assert_eq!(by_name("boundary"), Value::Bool(true));
        assert_eq!(by_name("segment"), Value::I32(-1));
        let together = ActionChange {
            action: None,
            ..action
        };
        assert!(!decoded(&together).has_field_by_name("action"));

        let event = Event {
            start_time: Some(Timestamp::from_nanos(1_500_000_000)),
            end_time: Some(Timestamp::from_nanos(-1)),
            metadata: vec![KeyValuePair {
                key: "joint".to_owned(),
                value: "0".to_owned(),
            }],
        };
        let read = decoded(&event);
        let Value::List(metadata) = read.get_field_by_name("metadata").unwrap().into_owned() else {
            panic!("metadata is a list");
        };
        let pair = metadata[0].as_message().unwrap();
        assert_eq!(pair.get_field_by_name("value").unwrap().as_str(), Some("0"));
        let start = read.get_field_by_name("start_time").unwrap().into_owned();
        let start = start.as_message().unwrap();
        assert_eq!(
            start.get_field_by_name("nanos").unwrap().as_i32(),
            Some(500_000_000)
        );
    }

    #[test]
    fn times_before_1970_are_times() {
        let before = Timestamp::from_nanos(-1);
        assert_eq!((before.seconds, before.nanos), (-1, 999_999_999));
        assert_eq!(json_name("start_time"), "startTime");
    }
}
