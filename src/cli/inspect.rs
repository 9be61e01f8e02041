//! `coact inspect`: what recordings hold, as text for people or as JSON.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;

use super::exit;
use crate::pipeline::Inspected;
use crate::recording::{Inspection, TopicInspection};

const EXAMPLES: &str = "\
Examples:
  coact inspect run1.mcap              topics, fields, and a command line that reads it
  coact inspect logs --json            the same for every recording below a folder, one JSON array

Exit codes:
  0  every recording could be read
  1  no recording could be read
  3  some could not, or are damaged";

/// Arguments of `coact inspect`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct InspectArgs {
    /// Recordings: files, folders (every *.mcap and *.mcap.zst below, rosbag2 directories), globs
    #[arg(value_name = "INPUT", required = true)]
    pub inputs: Vec<PathBuf>,

    /// As one JSON array
    #[arg(long)]
    pub json: bool,
}

/// Fields of a topic that the text names; JSON has more.
const NAMED_FIELDS: usize = 24;

/// Topics of a recording that the text names.
const NAMED_TOPICS: usize = 100;

/// The exit code for what was found.
pub fn exit_code(inspected: &[Inspected]) -> u8 {
    let n_unread = inspected
        .iter()
        .filter(|i| i.inspection.error.is_some())
        .count();
    let is_damaged = inspected.iter().any(|i| i.inspection.n_damages > 0);
    if n_unread == inspected.len() {
        exit::FAILED
    } else if n_unread > 0 || is_damaged {
        exit::PARTIAL
    } else {
        exit::DONE
    }
}

/// As one JSON array.
pub fn to_json(inspected: &[Inspected]) -> String {
    serde_json::to_string_pretty(inspected).unwrap_or_default()
}

/// As text for people.
pub fn to_text(inspected: &[Inspected]) -> String {
    let mut text = String::new();
    for (i, one) in inspected.iter().enumerate() {
        if i > 0 {
            text.push('\n');
        }
        recording(&mut text, one);
    }
    text
}

fn line(text: &mut String, line: &str) {
    text.push_str(line.trim_end());
    text.push('\n');
}

fn recording(
    text: &mut String,
    Inspected {
        inspection,
        command,
    }: &Inspected,
) {
    let Inspection {
        recording,
        files,
        bytes,
        ..
    } = inspection;
    let mut title = format!("{recording}  {bytes} bytes");
    if files.len() > 1 {
        let _infallible = write!(title, " in {} files", files.len());
    }
    if let Some(env_id) = &inspection.env_id {
        let _infallible = write!(title, "  {env_id}");
    }
    line(text, &title);
    if let Some(error) = &inspection.error {
        line(text, &format!("  cannot be read: {error}"));
        return;
    }
    for damage in &inspection.damage {
        line(text, &format!("  damaged: {damage}"));
    }
    let unnamed = inspection
        .n_damages
        .saturating_sub(inspection.damage.len() as u64);
    if unnamed > 0 {
        line(text, &format!("  damaged: and {unnamed} more"));
    }
    for topic in inspection.topics.iter().take(NAMED_TOPICS) {
        self::topic(text, topic);
    }
    if inspection.topics.len() > NAMED_TOPICS {
        let more = inspection.topics.len() - NAMED_TOPICS;
        line(text, &format!("  … and {more} more topics"));
    }
    if let Some(choice) = &inspection.choice {
        line(text, &format!("  auto: {}", choice.why));
    }
    if let Some(undecided) = &inspection.undecided {
        line(text, &format!("  auto: {undecided}"));
    }
    if let Some(command) = command {
        line(text, &format!("  {command}"));
    }
}

fn topic(text: &mut String, topic: &TopicInspection) {
    let schemas = if topic.schemas.is_empty() {
        "no schema".to_owned()
    } else {
        topic.schemas.join(", ")
    };
    let rate = topic
        .rate_hz
        .map_or(String::new(), |hz| format!(", {hz:.1} Hz"));
    let plural = if topic.n_messages == 1 { "" } else { "s" };
    line(
        text,
        &format!(
            "  {}  {}  {schemas}  {} message{plural}{rate}",
            topic.topic,
            topic.encodings.join(", "),
            topic.n_messages
        ),
    );
    if let Some(problem) = &topic.problem {
        line(text, &format!("    {problem}"));
    }
    let widest = |f: &dyn Fn(usize) -> usize| {
        (0..topic.fields.len().min(NAMED_FIELDS))
            .map(f)
            .max()
            .unwrap_or(0)
    };
    let shapes: Vec<String> = topic
        .fields
        .iter()
        .map(|field| match field.shape.as_slice() {
            [] => field.kind.to_owned(),
            shape => {
                let lengths: Vec<String> = shape.iter().map(ToString::to_string).collect();
                format!("{} × {}", lengths.join(" × "), field.kind)
            }
        })
        .collect();
    let path_width = widest(&|i| topic.fields[i].path.chars().count());
    let shape_width = widest(&|i| shapes[i].chars().count());
    for (field, shape) in topic.fields.iter().zip(&shapes).take(NAMED_FIELDS) {
        line(
            text,
            &format!(
                "    {:path_width$}  {shape:shape_width$}  {}",
                field.path, field.example
            ),
        );
    }
    if topic.fields.len() > NAMED_FIELDS {
        let more = topic.fields.len() - NAMED_FIELDS;
        line(text, &format!("    … and {more} more fields"));
    }
}
