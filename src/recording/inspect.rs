//! What a recording holds, for a person who wants to know what to type.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use serde::Serialize;

use super::decode::Value;
use super::layout::{Layout, Undecided};
use super::options::ReadOptions;
use super::selector::needs_quotes;
use super::survey::{Survey, Topic};

/// What a recording holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// Its name, as the tables would call it.
    pub recording: Arc<str>,
    /// Its files, in their order.
    pub files: Vec<PathBuf>,
    /// Size of its files.
    pub bytes: u64,
    /// Why it cannot be read at all.
    pub error: Option<String>,
    /// What is wrong with it, as sentences; the first few.
    pub damage: Vec<String>,
    /// How often something is wrong with it.
    pub n_damages: u64,
    /// The environment, if the recording says so.
    pub env_id: Option<Arc<str>>,
    /// Names of the action's columns, if the recording says so.
    pub action_names: Option<Arc<[Arc<str>]>>,
    /// Its topics, by name.
    pub topics: Vec<TopicInspection>,
    /// What `auto` reads.
    pub choice: Option<Choice>,
    /// Why `auto` reads nothing.
    pub undecided: Option<String>,
    /// Flags that read it: those of the choice, or of the likeliest reading.
    pub flags: Option<String>,
}

/// What `auto` reads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Choice {
    /// Selectors of the action.
    pub action: Vec<String>,
    /// Selectors of the state.
    pub state: Vec<String>,
    /// Why.
    pub why: String,
}

/// One topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicInspection {
    /// Its name.
    pub topic: String,
    /// Message encodings of its channels.
    pub encodings: Vec<String>,
    /// Schemas of its channels, each with its encoding.
    pub schemas: Vec<String>,
    /// Messages.
    pub n_messages: u64,
    /// Log time of the first message, nanoseconds.
    pub start_time: Option<u64>,
    /// Log time of the last message, nanoseconds.
    pub end_time: Option<u64>,
    /// Messages per second between the two.
    pub rate_hz: Option<f64>,
    /// What a message holds.
    pub fields: Vec<FieldInspection>,
    /// Why no message can be read, or the first could not.
    pub problem: Option<String>,
}

/// One field of a message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FieldInspection {
    /// As a selector takes it.
    pub path: String,
    /// `number`, `integer`, `boolean`, `text`, `bytes`, or `empty`.
    pub kind: &'static str,
    /// Lengths of the arrays around it, outermost first.
    pub shape: Vec<usize>,
    /// Its first value, or first few.
    pub example: String,
}

/// Fields of a topic that are listed.
const MAX_FIELDS: usize = 200;

/// Values of an example that are shown.
const SHOWN_VALUES: usize = 4;

/// Characters of a text that are shown.
const SHOWN_CHARS: usize = 40;

/// Deepest nesting that is looked into.
const MAX_DEPTH: usize = 8;

impl Inspection {
    fn new(recording: Arc<str>, files: &[PathBuf], error: Option<String>) -> Self {
        Self {
            recording,
            files: files.to_vec(),
            bytes: 0,
            error,
            damage: Vec::new(),
            n_damages: 0,
            env_id: None,
            action_names: None,
            topics: Vec::new(),
            choice: None,
            undecided: None,
            flags: None,
        }
    }

    /// Of a recording of which it is known that it cannot be read.
    pub fn unreadable(recording: Arc<str>, files: &[PathBuf], problem: &str) -> Self {
        Self::new(recording, files, Some(problem.to_owned()))
    }
}

/// Reads a recording to its end for what it holds.
pub fn inspect(recording: Arc<str>, files: &[PathBuf], options: &ReadOptions) -> Inspection {
    let survey = match Survey::of(files, &options.limits) {
        Ok(survey) => survey,
        Err(e) => return Inspection::unreadable(recording, files, &e.to_string()),
    };
    let mut inspection = Inspection::new(recording, files, None);
    inspection.bytes = survey.bytes;
    inspection.damage.clone_from(&survey.damage);
    inspection.n_damages = survey.n_damages;
    if let Some(names) = &survey.names {
        inspection.env_id.clone_from(&names.env_id);
        inspection.action_names.clone_from(&names.joint_names);
    }
    inspection.topics = survey.topics.iter().map(of_topic).collect();
    match Layout::choose(&survey, options) {
        Ok(layout) => {
            let texts =
                |selectors: &[super::Selector]| selectors.iter().map(ToString::to_string).collect();
            inspection.flags = Some(layout.flags());
            inspection.choice = Some(Choice {
                action: texts(&layout.actions),
                state: texts(&layout.states),
                why: layout.why.unwrap_or_default(),
            });
        }
        Err(Undecided { error, readings }) => {
            inspection.undecided = Some(error.to_string());
            inspection.flags = readings.first().map(Layout::flags);
        }
    }
    inspection
}

fn of_topic(topic: &Topic) -> TopicInspection {
    let mut encodings: Vec<String> = Vec::new();
    let mut schemas: Vec<String> = Vec::new();
    for (channel, schema) in &topic.channels {
        if !encodings.contains(&channel.encoding) {
            encodings.push(channel.encoding.clone());
        }
        let schema = schema
            .as_ref()
            .map(|s| format!("{} ({})", s.name, s.encoding));
        schemas.extend(schema.filter(|s| !schemas.contains(s)));
    }
    let seconds = topic
        .times
        .map(|(first, last)| last.saturating_sub(first) as f64 / 1e9);
    let mut fields = Vec::new();
    if let Some(example) = &topic.example {
        collect(example, &mut String::new(), &[], MAX_DEPTH, &mut fields);
    }
    TopicInspection {
        topic: topic.name.clone(),
        encodings,
        schemas,
        n_messages: topic.n_messages,
        start_time: topic.times.map(|(first, _)| first),
        end_time: topic.times.map(|(_, last)| last),
        rate_hz: seconds
            .filter(|s| *s > 0.0)
            .map(|s| (topic.n_messages - 1) as f64 / s),
        fields,
        problem: topic.problem.clone(),
    }
}

/// Lists the fields at and below `value`.
fn collect(
    value: &Value,
    path: &mut String,
    shape: &[usize],
    depth: usize,
    fields: &mut Vec<FieldInspection>,
) {
    if depth == 0 || fields.len() >= MAX_FIELDS {
        return;
    }
    match value {
        Value::Map(members) => {
            for (key, member) in members {
                let len = path.len();
                append_key(path, key);
                collect(member, path, shape, depth - 1, fields);
                path.truncate(len);
            }
        }
        // A name applies to each element of an array: its fields are arrays.
        Value::List(items) if matches!(items.first(), Some(Value::Map(_))) => {
            let mut shape = shape.to_vec();
            shape.push(items.len());
            collect(&items[0], path, &shape, depth - 1, fields);
        }
        _ => {
            let (inner, leaves) = flat(value);
            let mut shape = shape.to_vec();
            shape.extend(inner);
            fields.push(FieldInspection {
                path: path.clone(),
                kind: leaves.first().copied().map_or("empty", kind),
                shape,
                example: shown(&leaves, value),
            });
        }
    }
}

fn append_key(path: &mut String, key: &str) {
    if needs_quotes(key) {
        let _infallible = write!(path, "[\"{key}\"]");
        return;
    }
    if !path.is_empty() {
        path.push('.');
    }
    path.push_str(key);
}

/// Lengths of nested arrays, and the first few values in them.
fn flat(value: &Value) -> (Vec<usize>, Vec<&Value>) {
    let mut shape = Vec::new();
    let mut at = value;
    while let Value::List(items) = at {
        shape.push(items.len());
        match items.first() {
            Some(first) => at = first,
            None => return (shape, Vec::new()),
        }
    }
    if let Value::Bytes(bytes) = at {
        shape.push(bytes.len());
        return (shape, vec![at]);
    }
    let mut leaves = Vec::new();
    first_leaves(value, &mut leaves);
    (shape, leaves)
}

fn first_leaves<'a>(value: &'a Value, leaves: &mut Vec<&'a Value>) {
    match value {
        Value::List(items) => items
            .iter()
            .take(SHOWN_VALUES + 1)
            .for_each(|item| first_leaves(item, leaves)),
        leaf if leaves.len() <= SHOWN_VALUES => leaves.push(leaf),
        _ => {}
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Integer(_) => "integer",
        Value::Number(_) => "number",
        Value::Text(_) => "text",
        Value::Bytes(_) => "bytes",
        Value::List(_) | Value::Map(_) => "object",
    }
}

fn shown(leaves: &[&Value], whole: &Value) -> String {
    let mut texts: Vec<String> = leaves
        .iter()
        .take(SHOWN_VALUES)
        .map(|leaf| match leaf {
            Value::Null => "null".to_owned(),
            Value::Bool(b) => b.to_string(),
            Value::Integer(i) => i.to_string(),
            Value::Number(x) => x.to_string(),
            Value::Text(text) => {
                let cut: String = text.chars().take(SHOWN_CHARS).collect();
                format!("{cut:?}")
            }
            Value::Bytes(bytes) => {
                let shown: Vec<String> = bytes
                    .iter()
                    .take(SHOWN_VALUES)
                    .map(ToString::to_string)
                    .collect();
                let more = if bytes.len() > SHOWN_VALUES {
                    ", …"
                } else {
                    ""
                };
                format!("{}{more}", shown.join(", "))
            }
            Value::List(_) | Value::Map(_) => "…".to_owned(),
        })
        .collect();
    if leaves.len() > SHOWN_VALUES {
        texts.push("…".to_owned());
    }
    let text = texts.join(", ");
    if matches!(whole, Value::List(_) | Value::Bytes(_)) {
        format!("[{text}]")
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_listed_as_selectors_take_them() {
        let text = br#"{"a.b":1,"n":{"x":[[1,2],[3,4]]},"joints":[{"name":"j","p":0.5},{"name":"k","p":1}],"e":[]}"#;
        let channel = super::super::wire::Channel {
            id: 0,
            schema_id: 0,
            topic: String::new(),
            encoding: "json".to_owned(),
            metadata: std::collections::BTreeMap::new(),
        };
        let example = super::super::decode::example(&channel, None, text).unwrap();
        let mut fields = Vec::new();
        collect(&example, &mut String::new(), &[], MAX_DEPTH, &mut fields);
        let listed: Vec<String> = fields
            .iter()
            .map(|f| format!("{} {} {:?} {}", f.path, f.kind, f.shape, f.example))
            .collect();
        assert_eq!(
            listed,
            [
                "[\"a.b\"] integer [] 1",
                "n.x integer [2, 2] [1, 2, 3, 4]",
                "joints.name text [2] \"j\"",
                "joints.p number [2] 0.5",
                "e empty [0] []",
            ]
        );
    }
}
