//! The page: its frame, style and scripts, and the data they show.

use std::io::{self, Write};

use serde::Serialize;

use super::choice::{MAX_JOINTS, MAX_POINTS};
use super::comparison::Comparison;
use super::json::embedded;
use super::survey::{EnvironmentSurvey, Ranked, SkippedEpisodes, SkippedRecording, Survey};
use super::trace::{EpisodeTrace, rounded};
use crate::model::EpisodeStatus;
use crate::results::Results;

const FRAME: &str = include_str!("assets/page.html");

/// What stands for what in the frame. Scripts come in the order in which they use each other.
const PARTS: &[(&str, &[&str])] = &[
    (
        "/*STYLE*/",
        &[
            include_str!("assets/uplot/uPlot.min.css"),
            include_str!("assets/style.css"),
        ],
    ),
    (
        "/*SCRIPT*/",
        &[
            include_str!("assets/uplot/uPlot.iife.min.js"),
            "(() => {\n\"use strict\";\n",
            include_str!("assets/elements.js"),
            include_str!("assets/data.js"),
            include_str!("assets/theme.js"),
            include_str!("assets/overview.js"),
            include_str!("assets/kinds.js"),
            include_str!("assets/charts.js"),
            include_str!("assets/episode.js"),
            include_str!("assets/list.js"),
            include_str!("assets/ranking.js"),
            include_str!("assets/comparison.js"),
            include_str!("assets/main.js"),
            "})();\n",
        ],
    ),
];

/// Where the data stand in the frame.
const DATA: &str = "<!--DATA-->";

/// Rows of the lists that a page can hold and still be moved about in.
const MAX_ENVIRONMENTS: usize = 500;
const MAX_LISTED: usize = 20_000;

/// Points of a sparkline.
const SPARK_POINTS: usize = 48;

/// Lines of a sparkline.
const SPARK_LINES: usize = 6;

#[derive(Serialize)]
pub(super) struct PageData<'a> {
    version: &'static str,
    title: String,
    parameters: Vec<(&'a str, &'a str)>,
    threshold: Option<f64>,
    is_finished: bool,
    has_steps: bool,
    is_together: bool,
    recordings: &'a std::collections::BTreeMap<&'static str, u64>,
    n_messages: u64,
    n_messages_refused: u64,
    n_dropped_steps: u64,
    environments: &'a [EnvironmentSurvey],
    n_more_environments: usize,
    per_episode: &'a [u64],
    skipped_recordings: &'a [SkippedRecording],
    n_skipped_recordings: u64,
    skipped_episodes: &'a [SkippedEpisodes],
    n_more_skipped_episodes: usize,
    episodes: EpisodeList<'a>,
    n_episodes: usize,
    n_chosen: usize,
    rule: String,
    ranking: Vec<RankedRow<'a>>,
    comparison: Option<&'a Comparison>,
}

/// The list of episodes, column by column.
#[derive(Default, Serialize)]
struct EpisodeList<'a> {
    recordings: Vec<&'a str>,
    recording: Vec<usize>,
    id: Vec<String>,
    environment: Vec<usize>,
    status: Vec<u8>,
    n_steps: Vec<usize>,
    n_joints: Vec<usize>,
    n_state_dims: Vec<usize>,
    n_segments: Vec<usize>,
    episode_return: Vec<Option<f64>>,
    has_trace: Vec<u8>,
    /// Index in the table; a trace is found by it.
    index: Vec<usize>,
}

#[derive(Serialize)]
struct RankedRow<'a> {
    /// Index in the table.
    episode: usize,
    joint: i32,
    name: Option<&'a str>,
    segment: usize,
    start: usize,
    end: usize,
    sum: f64,
    peak: f64,
    rank: usize,
    reward: Option<f64>,
    /// Height of each line, 0 to 255 from its least to its largest value.
    spark: Vec<Vec<u8>>,
    range: Option<[f64; 2]>,
}

/// What the page is made of, but for the traces.
pub(super) struct Content<'a> {
    pub(super) results: &'a Results,
    pub(super) survey: &'a Survey,
    pub(super) chosen: &'a [usize],
    /// Values of the ranked composite actions, in their order.
    pub(super) ranked_actions: &'a [Vec<f64>],
    pub(super) comparison: Option<&'a Comparison>,
    pub(super) bounds: super::choice::Bounds,
    pub(super) is_asked_for: bool,
}

/// Writes the page; `traces` gives those of the chosen episodes, one after the other.
pub(super) fn write<E: From<io::Error>>(
    out: &mut impl Write,
    content: &Content<'_>,
    traces: impl Iterator<Item = Result<(usize, EpisodeTrace), E>>,
) -> Result<(), E> {
    let (before, after) = FRAME.split_once(DATA).unwrap_or((FRAME, ""));
    write_frame(out, before)?;
    let data = embedded(&content.data());
    writeln!(
        out,
        "<script type=\"application/json\" id=\"data\">{data}</script>"
    )?;
    for trace in traces {
        let (index, trace) = trace?;
        let trace = embedded(&trace);
        writeln!(
            out,
            "<script type=\"application/json\" id=\"trace-{index}\">{trace}</script>"
        )?;
    }
    write_frame(out, after)?;
    Ok(())
}

fn write_frame(out: &mut impl Write, mut frame: &str) -> io::Result<()> {
    while let Some((at, (mark, texts))) = PARTS
        .iter()
        .filter_map(|part| Some((frame.find(part.0)?, part)))
        .min_by_key(|(at, _)| *at)
    {
        out.write_all(&frame.as_bytes()[..at])?;
        for text in *texts {
            out.write_all(text.as_bytes())?;
        }
        frame = &frame[at + mark.len()..];
    }
    out.write_all(frame.as_bytes())
}

impl<'a> Content<'a> {
    fn data(&self) -> PageData<'a> {
        let (results, survey) = (self.results, self.survey);
        let n_environments = survey.environments.len().min(MAX_ENVIRONMENTS);
        let (skipped_episodes, n_more_skipped_episodes) = survey.named_skipped_episodes();
        let directory = results.directory();
        PageData {
            version: env!("CARGO_PKG_VERSION"),
            // The last name alone: a page that is sent round tells nothing of the machine.
            title: directory
                .canonicalize()
                .unwrap_or_else(|_unknown| directory.to_owned())
                .file_name()
                .map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            parameters: results.parameters().iter().collect(),
            threshold: results.parameters().threshold(),
            is_finished: results.is_finished(),
            has_steps: results.has_steps(),
            is_together: results.parameters().is_together(),
            recordings: &survey.recordings,
            n_messages: survey.n_messages,
            n_messages_refused: survey.n_messages_refused,
            n_dropped_steps: survey.episodes.iter().map(|e| e.n_dropped_steps).sum(),
            environments: &survey.environments[..n_environments],
            n_more_environments: survey.environments.len() - n_environments,
            per_episode: &survey.per_episode,
            skipped_recordings: &survey.skipped_recordings,
            n_skipped_recordings: survey.n_skipped_recordings,
            skipped_episodes,
            n_more_skipped_episodes,
            episodes: self.listed(),
            n_episodes: survey.episodes.len(),
            n_chosen: self.chosen.len(),
            rule: self.rule(),
            ranking: self.ranking(),
            comparison: self.comparison,
        }
    }

    /// Which episodes have their traces in the page, and what of them.
    fn rule(&self) -> String {
        let which = if self.is_asked_for {
            "the episodes that were asked for, in the order of the table"
        } else {
            "from one environment after another in turn, the episodes with the strongest composite action"
        };
        let count = if self.bounds.max_episodes == usize::MAX {
            String::new()
        } else {
            format!(" and at most {} episodes", self.bounds.max_episodes)
        };
        format!(
            "{which}, up to {:.1} MB{count}; of each at most {MAX_JOINTS} joints and {MAX_POINTS} points a joint \
             (in longer episodes a point stands for several steps: the largest change, the first action, any mask)",
            self.bounds.max_bytes as f64 / 1e6
        )
    }

    /// The episodes that the list names: those with traces first, if not all can be named.
    fn listed(&self) -> EpisodeList<'a> {
        let survey = self.survey;
        let mut list = EpisodeList::default();
        let n_without = MAX_LISTED.saturating_sub(self.chosen.len());
        let mut named_without = 0;
        for (index, episode) in survey.episodes.iter().enumerate() {
            let has_trace = self.chosen.binary_search(&index).is_ok();
            if !has_trace {
                if named_without == n_without {
                    continue;
                }
                named_without += 1;
            }
            let recording = &*episode.key.recording;
            if list.recordings.last() != Some(&recording) {
                list.recordings.push(recording);
            }
            list.recording.push(list.recordings.len() - 1);
            list.id.push(
                episode
                    .key
                    .episode_id
                    .as_deref()
                    .map_or_else(|| episode.key.episode.to_string(), ToOwned::to_owned),
            );
            list.environment.push(survey.environment[index]);
            list.status.push(match episode.status {
                EpisodeStatus::Ok => 0,
                EpisodeStatus::Incomplete => 1,
                EpisodeStatus::TooShort => 2,
            });
            list.n_steps.push(episode.n_steps);
            list.n_joints.push(episode.n_joints);
            list.n_state_dims.push(episode.n_state_dims);
            list.n_segments.push(episode.n_segments);
            list.episode_return
                .push(episode.episode_return.map(rounded));
            list.has_trace.push(u8::from(has_trace));
            list.index.push(index);
        }
        list
    }

    fn ranking(&self) -> Vec<RankedRow<'a>> {
        let ranked = self.survey.ranked.iter().zip(self.ranked_actions);
        ranked
            .map(|(Ranked { episode, row }, actions)| {
                let (spark, range) = spark(actions, row.n_steps());
                RankedRow {
                    episode: *episode,
                    joint: row.joint,
                    name: row.joint_name.as_deref(),
                    segment: row.segment,
                    start: row.start_step,
                    end: row.end_step,
                    sum: rounded(row.state_change_sum),
                    peak: rounded(row.state_change_peak),
                    rank: row.state_change_rank,
                    reward: row.reward_sum.map(rounded),
                    spark,
                    range,
                }
            })
            .collect()
    }
}

/// A few heights for each line of `actions`, row-major of `n_steps` rows, and the least and largest value.
fn spark(actions: &[f64], n_steps: usize) -> (Vec<Vec<u8>>, Option<[f64; 2]>) {
    let width = actions.len().checked_div(n_steps).unwrap_or(0);
    let low = actions.iter().copied().fold(f64::INFINITY, f64::min);
    let high = actions.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if width == 0 {
        return (Vec::new(), None);
    }
    let n_points = n_steps.min(SPARK_POINTS);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a float to an integer saturates"
    )]
    let height = |value: f64| match (value - low) / (high - low) {
        share if share.is_finite() => (share * 255.0).round() as u8,
        _ => 128,
    };
    let lines = (0..width.min(SPARK_LINES))
        .map(|column| {
            (0..n_points)
                .map(|p| height(actions[p * n_steps / n_points * width + column]))
                .collect()
        })
        .collect();
    (lines, Some([low, high]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_takes_all_its_parts() {
        let mut page = Vec::new();
        write_frame(&mut page, FRAME).unwrap();
        let page = String::from_utf8(page).unwrap();
        for (mark, _) in PARTS {
            assert!(FRAME.contains(mark) && !page.contains(mark), "{mark}");
        }
        assert_eq!(FRAME.matches(DATA).count(), 1);
        let scripts = page.matches("<script").count();
        assert_eq!(
            scripts,
            page.matches("</script").count(),
            "no script ends early"
        );
        assert!(!page.contains("innerHTML"), "markup is never made of data");
    }

    #[test]
    fn a_sparkline_goes_from_its_least_to_its_largest_value() {
        assert_eq!(
            spark(&[1.0, 3.0, 2.0], 3),
            (vec![vec![0, 255, 128]], Some([1.0, 3.0]))
        );
        assert_eq!(spark(&[5.0; 4], 2), (vec![vec![128; 2]; 2], Some([5.0; 2])));
        assert_eq!(spark(&[], 3).0.len(), 0);
    }
}
