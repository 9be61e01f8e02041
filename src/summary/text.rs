//! The closing summary as text for people: a table by environment, totals, and what was skipped and why.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::{EnvironmentSummary, JointSummary, Remark, RunSummary};
use crate::model::RecordingRow;
use crate::text::{Side, aligned, count, line, plural};

/// Causes that the text names for a recording.
const NAMED_CAUSES: usize = 4;

/// Recordings that the text names; JSON names all.
const NAMED_RECORDINGS: usize = 20;

/// Environments that the text has a row for: where recordings name none, each file may be one.
const NAMED_ENVIRONMENTS: usize = 40;

/// Joints of an environment that get a line of their own.
const NAMED_JOINTS: usize = 8;

/// A row of the table by environment.
type Row = [String; 8];

const HEADER: [&str; 8] = [
    "environment",
    "recordings",
    "episodes",
    "steps",
    "joint",
    "composite actions",
    "per episode",
    "mean steps",
];

/// Names to the left, numbers to the right.
const SIDES: [Side; 8] = {
    let mut sides = [Side::Right; 8];
    (sides[0], sides[4]) = (Side::Left, Side::Left);
    sides
};

impl RunSummary {
    /// As text for people.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        if !self.environments.is_empty() {
            let mut rows = vec![HEADER.map(String::from)];
            for (name, environment) in self.environments.iter().take(NAMED_ENVIRONMENTS) {
                rows.extend(environment_rows(name, environment));
            }
            aligned(&mut text, &SIDES, &rows);
            let unnamed = self.environments.len().saturating_sub(NAMED_ENVIRONMENTS);
            if unnamed > 0 {
                line(
                    &mut text,
                    &format!("… and {unnamed} more: see the episodes table"),
                );
            }
            text.push('\n');
        }
        self.totals(&mut text);
        text
    }

    /// What was skipped and why, as text for people; empty if nothing was.
    pub fn remarks_text(&self) -> String {
        let mut text = String::new();
        for remark in self.remarks.iter().take(NAMED_RECORDINGS) {
            remark.write(&mut text);
        }
        if self.remarks.len() > NAMED_RECORDINGS {
            line(
                &mut text,
                &format!(
                    "… and {} more recordings: see the recordings table",
                    self.remarks.len() - NAMED_RECORDINGS
                ),
            );
        }
        text
    }

    /// One line for every recording: what was read from it, and how.
    pub fn listing_text(&self) -> String {
        let mut text = String::new();
        for listed in &self.listing {
            line(&mut text, listed);
        }
        text
    }

    fn totals(&self, text: &mut String) {
        let n_recordings: u64 = self.recordings.values().sum();
        if n_recordings == 0 && self.n_recordings_before > 0 {
            line(
                text,
                &format!("nothing to do: {} before", self.written_before()),
            );
            return;
        }
        let n_episodes: u64 = self.episodes.values().sum();
        let rate = if self.seconds > 0.0 {
            self.n_steps as f64 / self.seconds
        } else {
            0.0
        };
        line(
            text,
            &format!(
                "{} {}{}, {} {}{}, {} steps: {} composite {} in {:.2} s ({} steps/s)",
                count(n_recordings),
                plural(n_recordings, "recording"),
                exceptions(
                    &self.recordings,
                    &[("recovered", "recovered"), ("failed", "failed")]
                ),
                count(n_episodes),
                plural(n_episodes, "episode"),
                exceptions(
                    &self.episodes,
                    &[("incomplete", "incomplete"), ("too_short", "too short")]
                ),
                count(self.n_steps),
                count(self.n_segments),
                plural(self.n_segments, "action"),
                self.seconds,
                compact(rate)
            ),
        );
        self.chosen_and_before(text);
        if self.n_messages_refused > 0 {
            line(
                text,
                &format!(
                    "{} of {} messages refused",
                    count(self.n_messages_refused),
                    count(self.n_messages)
                ),
            );
        }
    }

    /// Which layouts were found out, and what had been done before.
    fn chosen_and_before(&self, text: &mut String) {
        for (layout, &n) in self.layouts.iter().filter(|(layout, _)| !layout.is_native) {
            let of_how_many = if self.recordings.values().sum::<u64>() > 1 {
                format!(" in {} {}", count(n), plural(n, "recording"))
            } else {
                String::new()
            };
            line(
                text,
                &format!("auto: {}{of_how_many} ({})", layout.flags, layout.why),
            );
        }
        if self.n_episodes_before > 0 || self.n_recordings_before > 0 {
            line(text, &format!("{} before", self.written_before()));
        }
    }

    fn written_before(&self) -> String {
        let (n_recordings, n_episodes) = (self.n_recordings_before, self.n_episodes_before);
        let episodes = format!("{} {}", count(n_episodes), plural(n_episodes, "episode"));
        let of_whole = format!(
            "{} {} with ",
            count(n_recordings),
            plural(n_recordings, "recording")
        );
        let whole = if n_recordings > 0 { &*of_whole } else { "" };
        format!("{whole}{episodes} had been written")
    }
}

/// What was read from one recording, and how.
pub(super) fn listed(row: &RecordingRow) -> String {
    let mut text = format!(
        "{} {}: {} {} from {} {}",
        row.recording,
        row.status.as_str(),
        count(row.n_episodes),
        plural(row.n_episodes, "episode"),
        count(row.n_messages),
        plural(row.n_messages, "message")
    );
    for (label, value) in [
        ("action", &row.action_selector),
        ("state", &row.state_selector),
        ("encoding", &row.encoding),
        ("episodes", &row.episode_rule),
        ("clock", &row.clock),
        ("align", &row.align),
    ] {
        if let Some(value) = value {
            let _infallible = write!(text, ", {label} {value}");
        }
    }
    text
}

/// ` (1 recovered) (2 failed)`: how many have a status that is not the usual one.
fn exceptions(by_status: &BTreeMap<&'static str, u64>, labels: &[(&str, &str)]) -> String {
    let mut text = String::new();
    for (status, label) in labels {
        if let Some(&n) = by_status.get(status) {
            let _infallible = write!(text, " ({} {label})", count(n));
        }
    }
    text
}

/// One row a joint; the environment's own numbers stand in the first.
fn environment_rows(name: &str, environment: &EnvironmentSummary) -> Vec<Row> {
    let mut rows: Vec<Row> = environment
        .joints
        .iter()
        .take(NAMED_JOINTS)
        .map(|(number, joint)| joint_row(*number, joint, environment.n_episodes))
        .collect();
    if rows.is_empty() {
        let mut row = Row::default();
        for (cell, text) in row[4..].iter_mut().zip(["–", "0", "–", "–"]) {
            text.clone_into(cell);
        }
        rows.push(row);
    }
    rows[0][..4].clone_from_slice(&[
        name.to_owned(),
        count(environment.n_recordings),
        count(environment.n_episodes),
        count(environment.n_steps),
    ]);
    let unnamed = environment.joints.len().saturating_sub(NAMED_JOINTS);
    if unnamed > 0 {
        let mut row = Row::default();
        row[4] = format!("and {unnamed} more");
        rows.push(row);
    }
    rows
}

fn joint_row(number: i32, joint: &JointSummary, n_episodes: u64) -> Row {
    let mut row = Row::default();
    row[4] = match &joint.joint_name {
        Some(name) => name.to_string(),
        None if number < 0 => "together".to_owned(),
        None => number.to_string(),
    };
    row[5] = count(joint.n_segments);
    row[6] = format!("{:.1}", joint.n_segments as f64 / n_episodes as f64);
    row[7] = joint
        .mean_segment_steps()
        .map_or_else(|| "–".to_owned(), |mean| format!("{mean:.1}"));
    row
}

impl Remark {
    fn write(&self, text: &mut String) {
        let reason = self
            .reason
            .as_ref()
            .map_or_else(String::new, |r| format!(": {r}"));
        // A reason may have lines of its own, such as the readings to choose from.
        let mut lines = reason.lines();
        let first = lines.next().unwrap_or_default();
        line(text, &format!("{} {}{first}", self.recording, self.status));
        lines.for_each(|more| line(text, more));
        for (episode, reason) in &self.incomplete {
            line(text, &format!("  episode {episode} incomplete: {reason}"));
        }
        for cause in self.causes.iter().take(NAMED_CAUSES) {
            line(
                text,
                &format!(
                    "  {} × {} (first at offset {})",
                    count(cause.count),
                    cause.cause,
                    cause.first_offset
                ),
            );
        }
        if self.causes.len() > NAMED_CAUSES {
            line(
                text,
                &format!(
                    "  and {} more causes: see the recordings table",
                    self.causes.len() - NAMED_CAUSES
                ),
            );
        }
    }
}

/// A rate with three digits.
fn compact(rate: f64) -> String {
    match rate {
        r if r >= 1e6 => format!("{:.1} M", r / 1e6),
        r if r >= 1e3 => format!("{:.0} k", r / 1e3),
        r => format!("{r:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_of_environments_do_not_fill_the_screen() {
        let mut summary = RunSummary::default();
        for i in 0..1_000 {
            let environment = EnvironmentSummary::default();
            summary
                .environments
                .insert(format!("demo_{i}.mcap"), environment);
        }
        let text = summary.to_text();
        assert!(text.lines().count() < 50, "{text}");
        assert!(text.contains("… and 960 more"), "{text}");
    }

    #[test]
    fn a_reason_keeps_its_lines_and_nothing_steers_the_terminal() {
        let remark = Remark {
            recording: "a\u{1b}[2J.mcap".into(),
            status: "failed",
            reason: Some("which:\n  --action /a\n  --action /b\u{7}".to_owned()),
            causes: Vec::new(),
            incomplete: Vec::new(),
        };
        let mut text = String::new();
        remark.write(&mut text);
        assert_eq!(
            text,
            "a\u{fffd}[2J.mcap failed: which:\n  --action /a\n  --action /b\u{fffd}\n"
        );
    }

    #[test]
    fn rates_read_well() {
        assert_eq!(
            [compact(12.0), compact(45_000.0), compact(3.21e6)],
            ["12", "45 k", "3.2 M"]
        );
    }
}
