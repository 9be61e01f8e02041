//! Which topics of a recording are read for what: as asked for, or found out from what is there.

use std::fmt::Write as _;

use super::decode::Value;
use super::error::RecordingError;
use super::options::{EpisodeOption, ReadOptions};
use super::selector::{PathPart, Selector};
use super::survey::{Survey, Topic};

/// Topic of the native convention.
pub(crate) const NATIVE_TOPIC: &str = "/step";

/// Where actions and states come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Layout {
    pub(crate) actions: Vec<Selector>,
    pub(crate) states: Vec<Selector>,
    /// Why so, if it was not asked for.
    pub(crate) why: Option<String>,
}

/// Nothing was chosen: why, and what might be meant, the likeliest first.
#[derive(Debug)]
pub(crate) struct Undecided {
    pub(crate) error: RecordingError,
    pub(crate) readings: Vec<Layout>,
}

/// A topic that could be the action, or the state.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Candidate {
    topic: String,
    type_name: String,
    selectors: Vec<Selector>,
}

/// Words in the topic of joint states that are commands.
const COMMAND_WORDS: [&str; 4] = ["leader", "command", "target", "action"];

/// More such words: they order what is proposed, and decide nothing.
const COMMAND_HINTS: [&str; 5] = ["cmd", "lead", "goal", "desired", "setpoint"];

/// Words of what was measured; for proposals too.
const STATE_HINTS: [&str; 4] = ["follow", "obs", "measured", "actual"];

/// Readings that an error lists.
const LISTED: usize = 8;

impl Layout {
    /// What was asked for, if that is all that is needed.
    pub(crate) fn asked_for(options: &ReadOptions) -> Option<Self> {
        (!options.actions.is_empty() && !options.states.is_empty()).then(|| Self {
            actions: options.actions.clone(),
            states: options.states.clone(),
            why: None,
        })
    }

    /// The native convention, but for what was asked for.
    pub(crate) fn native(options: &ReadOptions) -> Self {
        let or = |asked: &[Selector], key| {
            if asked.is_empty() {
                vec![Selector::of_key(NATIVE_TOPIC, key)]
            } else {
                asked.to_vec()
            }
        };
        Self {
            actions: or(&options.actions, "action"),
            states: or(&options.states, "state"),
            why: Some(format!("topic {NATIVE_TOPIC} of the native convention")),
        }
    }

    /// Finds out what is not asked for from what the recording holds.
    pub(crate) fn choose(survey: &Survey, options: &ReadOptions) -> Result<Self, Undecided> {
        if let Some(layout) = Self::asked_for(options) {
            return Ok(layout);
        }
        if survey
            .topics
            .iter()
            .any(|t| t.name == NATIVE_TOPIC && t.n_messages > 0)
        {
            return Ok(Self::native(options));
        }
        let (actions, states) = candidates(survey, options);
        match (actions.as_slice(), states.as_slice()) {
            ([action], [state]) if action.topic != state.topic => Ok(Self {
                why: Some(why(action, state, options)),
                actions: action.selectors.clone(),
                states: state.selectors.clone(),
            }),
            _ => Err(undecided(survey, options, &actions, &states)),
        }
    }

    /// Is everything taken from the topic of the native convention?
    pub(crate) fn is_native(&self) -> bool {
        let mut selectors = self.actions.iter().chain(&self.states);
        selectors.all(|s| s.topic() == NATIVE_TOPIC)
    }

    /// As flags of the command line.
    pub(crate) fn flags(&self) -> String {
        flags(&self.actions, &self.states)
    }
}

fn why(action: &Candidate, state: &Candidate, options: &ReadOptions) -> String {
    let part = |role: &str, candidate: &Candidate, asked: bool| {
        if asked {
            return format!("{role} as asked for");
        }
        let name = &candidate.type_name;
        let short = name.rsplit(['/', '.']).next().unwrap_or(name);
        format!("{role}: the only {short}")
    };
    format!(
        "{}; {}",
        part("action", action, !options.actions.is_empty()),
        part("state", state, !options.states.is_empty())
    )
}

/// The topics that could be the action, and those that could be the state.
fn candidates(survey: &Survey, options: &ReadOptions) -> (Vec<Candidate>, Vec<Candidate>) {
    let asked = |selectors: &[Selector]| {
        vec![Candidate {
            topic: selectors
                .first()
                .map_or(String::new(), |s| s.topic().to_owned()),
            type_name: "topic".to_owned(),
            selectors: selectors.to_vec(),
        }]
    };
    let is_free = |topic: &Topic| {
        topic.n_messages > 0
            && options
                .actions
                .iter()
                .chain(&options.states)
                .all(|s| s.topic() != topic.name)
            && Some(topic.name.as_str()) != marker(options)
    };
    let of = |kind: Kind| {
        survey
            .topics
            .iter()
            .filter(|t| is_free(t))
            .filter_map(|t| candidate(t, kind))
            .collect::<Vec<_>>()
    };
    let mut actions = of(Kind::Command);
    let (commanded, mut states): (Vec<_>, Vec<_>) = of(Kind::Joints)
        .into_iter()
        .partition(|c| is_commanded(&c.topic));
    let n_joint_topics = commanded.len() + states.len();
    if n_joint_topics + usize::from(!options.states.is_empty()) >= 2 {
        actions.extend(commanded);
    } else {
        states.extend(commanded);
    }
    if !options.actions.is_empty() {
        actions = asked(&options.actions);
    }
    if !options.states.is_empty() {
        states = asked(&options.states);
    }
    (actions, states)
}

fn marker(options: &ReadOptions) -> Option<&str> {
    match &options.episodes {
        EpisodeOption::Marker(topic) => Some(topic),
        _ => None,
    }
}

fn is_commanded(topic: &str) -> bool {
    let topic = topic.to_ascii_lowercase();
    COMMAND_WORDS.iter().any(|word| topic.contains(word))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Positions of joints: a state, or an action if its name says so.
    Joints,
    /// A command by its type.
    Command,
}

/// The table of the layouts of real robots.
fn candidate(topic: &Topic, kind: Kind) -> Option<Candidate> {
    let type_name = topic.type_name();
    // `sensor_msgs/msg/JointState`, `sensor_msgs/JointState`, `sensor_msgs.JointState`
    let short = type_name.replace("/msg/", "/").replace('.', "/");
    let key = |k: &str| PathPart::Key(k.to_owned());
    let (found, paths): (Kind, Vec<Vec<PathPart>>) = match short.as_str() {
        "sensor_msgs/JointState" => (Kind::Joints, vec![vec![key("position")]]),
        "foxglove/JointStates" | "foxglove_msgs/JointStates" => {
            (Kind::Joints, vec![vec![key("joints"), key("position")]])
        }
        "trajectory_msgs/JointTrajectory" => (
            Kind::Command,
            vec![vec![key("points"), PathPart::Index(0), key("positions")]],
        ),
        "geometry_msgs/Twist" => (
            Kind::Command,
            vec![vec![key("linear")], vec![key("angular")]],
        ),
        "geometry_msgs/TwistStamped" => (
            Kind::Command,
            vec![
                vec![key("twist"), key("linear")],
                vec![key("twist"), key("angular")],
            ],
        ),
        name if name.starts_with("std_msgs/") && name.ends_with("MultiArray") => {
            (Kind::Command, vec![vec![key("data")]])
        }
        _ => return None,
    };
    (found == kind).then(|| Candidate {
        topic: topic.name.clone(),
        selectors: paths
            .into_iter()
            .map(|path| Selector::new(&topic.name, path))
            .collect(),
        type_name: type_name.to_owned(),
    })
}

/// Selectors one after the other, for the `recordings` table.
pub(crate) fn listing(selectors: &[Selector]) -> String {
    let texts: Vec<String> = selectors.iter().map(Selector::to_string).collect();
    texts.join(" ")
}

/// Selectors as flags that can be typed into a shell.
pub(crate) fn flags(actions: &[Selector], states: &[Selector]) -> String {
    let mut text = String::new();
    for (flag, selectors) in [("--action", actions), ("--state", states)] {
        for selector in selectors {
            let separator = if text.is_empty() { "" } else { " " };
            let _infallible = write!(text, "{separator}{flag} {}", quoted(&selector.to_string()));
        }
    }
    text
}

/// A word for a shell: in single quotes where it would be taken for something else.
pub fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/_-.:,=+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// The error where there is not just one reading: it prints the flags that would settle it.
fn undecided(
    survey: &Survey,
    options: &ReadOptions,
    actions: &[Candidate],
    states: &[Candidate],
) -> Undecided {
    let candidates = pairs(actions, states);
    if !candidates.is_empty() {
        return Undecided {
            error: RecordingError::Ambiguous(listed(&candidates)),
            readings: candidates,
        };
    }
    let missing = match (actions.is_empty(), states.is_empty()) {
        (true, true) => "neither actions nor states",
        (true, false) => "states but no actions",
        (false, true) => "actions but no states",
        (false, false) => "only one topic for both actions and states",
    };
    let wanted = if actions.is_empty() && states.is_empty() {
        format!("no topic {NATIVE_TOPIC:?} with steps of an agent, and {missing} found")
    } else {
        format!("{missing} found")
    };
    let mut found = survey.describe();
    if survey.n_damages > 0 {
        let _infallible = write!(found, "; {}", survey.damage.join("; "));
    }
    let readings = suggestions(survey, options, actions, states);
    if !readings.is_empty() {
        let _infallible = write!(found, "; say which, such as\n{}", listed(&readings));
    }
    Undecided {
        error: RecordingError::NothingToRead { wanted, found },
        readings,
    }
}

/// Every action with every state of other selectors, those first that sound like what they are taken for.
fn pairs(actions: &[Candidate], states: &[Candidate]) -> Vec<Layout> {
    let mut pairs: Vec<Layout> = actions
        .iter()
        .flat_map(|a| states.iter().map(move |s| (a, s)))
        .filter(|(a, s)| a.selectors != s.selectors)
        .map(|(a, s)| Layout {
            actions: a.selectors.clone(),
            states: s.selectors.clone(),
            why: None,
        })
        .collect();
    let has = |selectors: &[Selector], words: &[&str]| {
        let text = listing(selectors).to_ascii_lowercase();
        words.iter().any(|word| text.contains(word))
    };
    let commands = [&COMMAND_WORDS[..], &COMMAND_HINTS].concat();
    pairs.sort_by_key(|l| {
        (
            !has(&l.actions, &commands),
            has(&l.states, &commands),
            has(&l.actions, &STATE_HINTS),
            !has(&l.states, &STATE_HINTS),
        )
    });
    pairs
}

fn listed(readings: &[Layout]) -> String {
    let mut text = String::new();
    for reading in readings.iter().take(LISTED) {
        let separator = if text.is_empty() { "" } else { "\n" };
        let _infallible = write!(text, "{separator}  {}", reading.flags());
    }
    if readings.len() > LISTED {
        let _infallible = write!(text, "\n  … and {} more", readings.len() - LISTED);
    }
    text
}

/// Flags that might be meant, from the numeric fields of the messages.
fn suggestions(
    survey: &Survey,
    options: &ReadOptions,
    actions: &[Candidate],
    states: &[Candidate],
) -> Vec<Layout> {
    let fields: Vec<Candidate> = survey
        .topics
        .iter()
        .filter(|t| t.n_messages > 0 && Some(t.name.as_str()) != marker(options))
        .flat_map(|topic| {
            let paths = topic.example.as_ref().map(numeric_arrays);
            let candidate = |path| Candidate {
                topic: topic.name.clone(),
                type_name: topic.type_name().to_owned(),
                selectors: vec![Selector::new(&topic.name, path)],
            };
            paths.unwrap_or_default().into_iter().map(candidate)
        })
        .collect();
    let or_fields = |candidates: &[Candidate]| {
        if candidates.is_empty() {
            fields.clone()
        } else {
            candidates.to_vec()
        }
    };
    pairs(&or_fields(actions), &or_fields(states))
}

/// Paths of the members that are numbers or arrays of numbers, as far as two objects deep.
fn numeric_arrays(example: &Value) -> Vec<Vec<PathPart>> {
    let Value::Map(members) = example else {
        return Vec::new();
    };
    let mut paths = Vec::new();
    for (key, value) in members {
        let part = PathPart::Key(key.clone());
        match value {
            Value::List(items)
                if matches!(
                    items.first(),
                    Some(Value::Number(_) | Value::Integer(_) | Value::Bool(_))
                ) =>
            {
                paths.push(vec![part]);
            }
            Value::Bytes(bytes) if !bytes.is_empty() => paths.push(vec![part]),
            Value::Map(inner) if key != "header" && key != "layout" => {
                for path in numeric_arrays(&Value::Map(inner.clone())) {
                    let mut whole = vec![part.clone()];
                    whole.extend(path);
                    paths.push(whole);
                }
            }
            _ => {}
        }
    }
    paths
}
