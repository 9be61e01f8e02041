//! A difference as text for people, and as JSON.

use std::fmt::Write as _;

use super::{Difference, EpisodeEntry, SegmentChange, Span};
use crate::text::{Side, aligned, count, counted, line};

/// Episodes and segments that the text names; JSON names all.
const NAMED: usize = 50;

impl Difference {
    /// As one JSON object.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default()
    }

    /// As text for people.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        self.parameters_text(&mut text);
        self.episodes_text(&mut text);
        self.segments_text(&mut text);
        self.totals(&mut text);
        text
    }

    fn parameters_text(&self, text: &mut String) {
        for parameter in &self.parameters {
            let value = |value: &Option<String>| value.clone().unwrap_or_else(|| "–".to_owned());
            let (a, b) = (value(&parameter.a), value(&parameter.b));
            line(text, &format!("parameter {}: {a} → {b}", parameter.name));
        }
    }

    fn episodes_text(&self, text: &mut String) {
        let episodes = &self.episodes;
        let mut lines: Vec<String> = Vec::new();
        for (what, entries) in [("gone", &episodes.gone), ("added", &episodes.added)] {
            lines.extend(entries.iter().map(|entry| {
                let n_steps = counted(entry.n_steps as u64, "step");
                let n_segments = counted(entry.n_segments as u64, "composite action");
                format!("episode {} {what}: {n_steps}, {n_segments}", name(entry))
            }));
        }
        lines.extend(episodes.changed.iter().map(|change| {
            let state = |entry: &EpisodeEntry| {
                let n_steps = counted(entry.n_steps as u64, "step");
                format!("{}, {n_steps}", entry.status)
            };
            let (a, b) = (state(&change.a), state(&change.b));
            format!("episode {} changed: {a} → {b}", name(&change.a))
        }));
        for content in lines.iter().take(NAMED) {
            line(text, content);
        }
        more(text, lines.len(), "episode");
    }

    fn segments_text(&self, text: &mut String) {
        if self.segments.is_empty() {
            return;
        }
        let header = [
            "recording",
            "episode",
            "joint",
            "segment",
            "before",
            "after",
        ];
        let mut rows = vec![header.map(String::from)];
        rows.extend(self.segments.iter().take(NAMED).map(row));
        let left = Side::Left;
        aligned(
            text,
            &[left, left, left, left, Side::Right, Side::Right],
            &rows,
        );
        more(text, self.segments.len(), "segment");
    }

    fn totals(&self, text: &mut String) {
        let n = &self.n_segments;
        let mut total = format!("{} the same", counted(n.same, "segment"));
        let of_kind = [
            (n.moved, "moved"),
            (n.appeared, "appeared"),
            (n.vanished, "vanished"),
        ];
        for (n, kind) in of_kind.into_iter().filter(|(n, _)| *n > 0) {
            let _infallible = write!(total, ", {} {kind}", count(n));
        }
        let changes = &self.episodes;
        for (entries, kind) in [
            (changes.gone.len(), "gone"),
            (changes.added.len(), "added"),
            (changes.changed.len(), "changed"),
        ] {
            if entries > 0 {
                let entries = counted(entries as u64, "episode");
                let _infallible = write!(total, "; {entries} {kind}");
            }
        }
        line(text, &total);
    }
}

fn more(text: &mut String, n: usize, word: &str) {
    if n > NAMED {
        let unnamed = counted((n - NAMED) as u64, word);
        line(text, &format!("… and {unnamed} more: --json has all"));
    }
}

fn name(entry: &EpisodeEntry) -> String {
    let number = entry.episode.to_string();
    let id = entry.episode_id.as_deref().unwrap_or(&number);
    format!("{}:{id}", entry.recording)
}

fn row(change: &SegmentChange) -> [String; 6] {
    let span = |span: Option<Span>| {
        span.map_or_else(String::new, |s| format!("{}..{}", s.start_step, s.end_step))
    };
    let number = |joint: i32| match joint {
        -1 => "together".to_owned(),
        joint => joint.to_string(),
    };
    [
        change.recording.to_string(),
        change
            .episode_id
            .as_ref()
            .map_or_else(|| change.episode.to_string(), ToString::to_string),
        change
            .joint_name
            .as_ref()
            .map_or_else(|| number(change.joint), ToString::to_string),
        change.change.as_str().to_owned(),
        span(change.a),
        span(change.b),
    ]
}
