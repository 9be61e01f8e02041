//! Messages of robots made by hand, byte by byte: CDR as ROS 2 writes it, and Foxglove's joint states in protobuf.

use prost_reflect::prost::Message as _;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type as Kind};
use prost_reflect::prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
};

/// A CDR message, little endian, that grows field by field.
pub(crate) struct Cdr(Vec<u8>);

impl Cdr {
    pub(crate) fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn align(mut self, size: usize) -> Self {
        while !(self.0.len() - 4).is_multiple_of(size) {
            self.0.push(0);
        }
        self
    }

    pub(crate) fn u32(self, value: u32) -> Self {
        let mut cdr = self.align(4);
        cdr.0.extend(value.to_le_bytes());
        cdr
    }

    pub(crate) fn f64(self, value: f64) -> Self {
        let mut cdr = self.align(8);
        cdr.0.extend(value.to_le_bytes());
        cdr
    }

    pub(crate) fn text(self, text: &str) -> Self {
        let mut cdr = self.u32(text.len() as u32 + 1);
        cdr.0.extend(text.as_bytes());
        cdr.0.push(0);
        cdr
    }

    pub(crate) fn f64s(self, values: &[f64]) -> Self {
        let cdr = self.u32(values.len() as u32);
        values.iter().fold(cdr, |cdr, v| cdr.f64(*v))
    }

    pub(crate) fn texts(self, texts: &[&str]) -> Self {
        let cdr = self.u32(texts.len() as u32);
        texts.iter().fold(cdr, |cdr, t| cdr.text(t))
    }

    pub(crate) fn header(self, stamp_nanos: u64) -> Self {
        self.u32((stamp_nanos / 1_000_000_000) as u32)
            .u32((stamp_nanos % 1_000_000_000) as u32)
            .text("base")
    }

    pub(crate) fn bytes(self) -> Vec<u8> {
        self.0
    }
}

/// The definition may be empty: the type is built in.
pub(crate) const JOINT_STATE: (&str, &str, &[u8]) = ("sensor_msgs/msg/JointState", "ros2msg", b"");
pub(crate) const TWIST: (&str, &str, &[u8]) = ("geometry_msgs/msg/Twist", "ros2msg", b"");
pub(crate) const TWIST_STAMPED: (&str, &str, &[u8]) =
    ("geometry_msgs/msg/TwistStamped", "ros2msg", b"");
pub(crate) const MULTI_ARRAY: (&str, &str, &[u8]) =
    ("std_msgs/msg/Float64MultiArray", "ros2msg", b"");
pub(crate) const TRAJECTORY: (&str, &str, &[u8]) =
    ("trajectory_msgs/msg/JointTrajectory", "ros2msg", b"");

pub(crate) fn joint_state(stamp_nanos: u64, names: &[&str], position: &[f64]) -> Vec<u8> {
    Cdr::new()
        .header(stamp_nanos)
        .texts(names)
        .f64s(position)
        .f64s(&[])
        .f64s(&[])
        .bytes()
}

pub(crate) fn multi_array(data: &[f64]) -> Vec<u8> {
    let dimension = Cdr::new().u32(1).text("joints").u32(data.len() as u32);
    dimension.u32(data.len() as u32).u32(0).f64s(data).bytes()
}

pub(crate) fn twist(values: [f64; 6]) -> Vec<u8> {
    values.iter().fold(Cdr::new(), |cdr, v| cdr.f64(*v)).bytes()
}

pub(crate) fn twist_stamped(stamp_nanos: u64, values: [f64; 6]) -> Vec<u8> {
    let cdr = Cdr::new().header(stamp_nanos);
    values.iter().fold(cdr, |cdr, v| cdr.f64(*v)).bytes()
}

/// A trajectory of two points; only the first is the action.
pub(crate) fn trajectory(names: &[&str], positions: &[f64]) -> Vec<u8> {
    let mut cdr = Cdr::new().header(0).texts(names).u32(2);
    for offset in [0.0, 100.0] {
        let moved: Vec<f64> = positions.iter().map(|p| p + offset).collect();
        cdr = cdr.f64s(&moved).f64s(&[]).f64s(&[]).f64s(&[]).u32(0).u32(0);
    }
    cdr.bytes()
}

/// A schema of `foxglove.JointStates` with what is needed of it.
pub(crate) fn joint_states_schema() -> Vec<u8> {
    let field = |name: &str, number, kind: Kind, label: Label| FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        r#type: Some(kind.into()),
        label: Some(label.into()),
        ..FieldDescriptorProto::default()
    };
    let joint = DescriptorProto {
        name: Some("JointState".to_owned()),
        field: vec![
            field("name", 1, Kind::String, Label::Optional),
            FieldDescriptorProto {
                proto3_optional: Some(true),
                oneof_index: Some(0),
                ..field("position", 2, Kind::Double, Label::Optional)
            },
        ],
        oneof_decl: vec![prost_reflect::prost_types::OneofDescriptorProto {
            name: Some("_position".to_owned()),
            ..Default::default()
        }],
        ..DescriptorProto::default()
    };
    let joints = DescriptorProto {
        name: Some("JointStates".to_owned()),
        field: vec![FieldDescriptorProto {
            type_name: Some(".foxglove.JointState".to_owned()),
            ..field("joints", 2, Kind::Message, Label::Repeated)
        }],
        ..DescriptorProto::default()
    };
    FileDescriptorSet {
        file: vec![FileDescriptorProto {
            name: Some("foxglove/JointStates.proto".to_owned()),
            package: Some("foxglove".to_owned()),
            syntax: Some("proto3".to_owned()),
            message_type: vec![joint, joints],
            ..FileDescriptorProto::default()
        }],
    }
    .encode_to_vec()
}

/// A message of that schema; a joint may come without its position.
pub(crate) fn joint_states(joints: &[(&str, Option<f64>)]) -> Vec<u8> {
    let mut message = Vec::new();
    for (name, position) in joints {
        let mut joint = vec![0x0a, name.len() as u8];
        joint.extend(name.as_bytes());
        if let Some(position) = position {
            joint.push(0x11);
            joint.extend(position.to_le_bytes());
        }
        message.extend([0x12, joint.len() as u8]);
        message.extend(joint);
    }
    message
}
