//! An episode as a figure for print: each joint's action, its composite actions in their colours, and below it the
//! changes of action and state with the threshold and the masks.

mod axis;
#[cfg(feature = "png")]
mod raster;
mod svg;

use std::fmt::Write as _;
use std::path::Path;

use axis::{Axis, Panel};
use svg::Svg;

use super::error::ReportError;
use crate::model::{EpisodeKey, Series};
use crate::results::{EpisodeRow, EpisodeSteps, JointSteps, Parameters};

/// Joints that are drawn; more would not be seen.
const MAX_JOINTS: usize = 12;

/// Points of a curve; of a longer episode, the first of each run of steps.
const MAX_POINTS: usize = 4000;

/// Colours that people with any colour vision tell apart (Okabe and Ito, 2008), without yellow, which paper swallows.
const SEGMENT_COLOURS: [&str; 6] = [
    "#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00",
];

const ACTION_COLOUR: &str = "#0072b2";
const STATE_COLOUR: &str = "#d55e00";
const BOTH_COLOUR: &str = "#4d4d4d";
const OUTSIDE_COLOUR: &str = "#9a9a9a";

// Sizes in units of 1/100 inch at the usual width of two columns (7.2 inch).
const WIDTH: f64 = 720.0;
const LEFT: f64 = 74.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 58.0;
const TRACE_HEIGHT: f64 = 84.0;
const CHANGE_HEIGHT: f64 = 84.0;
const BAND_HEIGHT: f64 = 6.0;
const BAND_GAP: f64 = 2.0;
const GAP: f64 = 14.0;
const BOTTOM: f64 = 42.0;

/// The figure of an episode.
pub(super) fn svg(episode: &EpisodeRow, steps: &EpisodeSteps, parameters: &Parameters) -> String {
    let joints = &steps.joints[..steps.joints.len().min(MAX_JOINTS)];
    let bands = 3.0 * (BAND_HEIGHT + BAND_GAP);
    let joint_height = TRACE_HEIGHT + GAP + CHANGE_HEIGHT + bands + GAP + 8.0;
    let height = TOP + joints.len() as f64 * joint_height + BOTTOM;
    let mut svg = Svg::new(WIDTH, height);
    heading(&mut svg, episode, steps, joints.len());
    let x = Axis::new(0.0, steps.n_steps.max(2) as f64 - 1.0, LEFT, WIDTH - RIGHT);
    let mut top = TOP;
    for joint in joints {
        let trace = Panel::new(x, top, TRACE_HEIGHT);
        draw_trace(&mut svg, trace, joint);
        let change = Panel::new(x, top + TRACE_HEIGHT + GAP, CHANGE_HEIGHT);
        draw_change(
            &mut svg,
            change,
            joint,
            &steps.state,
            parameters.threshold(),
        );
        top += joint_height;
    }
    let last = top - GAP - 8.0;
    x.draw_steps(&mut svg, last);
    svg.finish()
}

/// `RECORDING_EPISODE`, of characters that every file system takes.
pub(super) fn file_stem(key: &EpisodeKey) -> String {
    let id = key
        .episode_id
        .as_deref()
        .map_or_else(|| key.episode.to_string(), ToOwned::to_owned);
    let stem = key
        .recording
        .strip_suffix(".mcap")
        .unwrap_or(&key.recording);
    let safe = |text: &str| -> String {
        text.chars()
            .map(|c| {
                if c.is_alphanumeric() || "._-".contains(c) {
                    c
                } else {
                    '_'
                }
            })
            .take(100)
            .collect()
    };
    let mut name = safe(stem);
    let _infallible = write!(name, "_{}", safe(&id));
    // A name that begins with a dot would be hidden.
    name.trim_start_matches('.').to_owned()
}

/// The figure as a PNG of 300 dots an inch.
#[cfg(feature = "png")]
pub(super) fn png(svg: &str, path: &Path) -> Result<Vec<u8>, ReportError> {
    raster::png(svg).map_err(|what| ReportError::Figure {
        path: path.to_owned(),
        what,
    })
}

/// The figure as a PNG, which this build cannot make.
#[cfg(not(feature = "png"))]
pub(super) fn png(_svg: &str, path: &Path) -> Result<Vec<u8>, ReportError> {
    Err(ReportError::Figure {
        path: path.to_owned(),
        what: "this coact was built without the feature png".to_owned(),
    })
}

fn heading(svg: &mut Svg, episode: &EpisodeRow, steps: &EpisodeSteps, n_drawn: usize) {
    let id = episode
        .key
        .episode_id
        .as_deref()
        .map_or_else(|| episode.key.episode.to_string(), ToOwned::to_owned);
    let mut title = format!("{}, episode {id}", episode.key.recording);
    if let Some(env_id) = &episode.env_id {
        title = format!("{env_id}: {title}");
    }
    if n_drawn < steps.joints.len() {
        let _infallible = write!(
            title,
            " (the first {n_drawn} of {} joints)",
            steps.joints.len()
        );
    }
    svg.text(LEFT, 16.0, "title", "start", &title);
    let mut left = LEFT;
    for (colour, text, width) in [
        (ACTION_COLOUR, "action", 62.0),
        (STATE_COLOUR, "state", 56.0),
        (BOTH_COLOUR, "near both", 84.0),
        (OUTSIDE_COLOUR, "outside composite actions", 176.0),
    ] {
        svg.rect(left, 27.0, 14.0, 5.0, colour);
        svg.text(left + 18.0, 33.0, "label", "start", text);
        left += width;
    }
    svg.text(
        left,
        33.0,
        "label",
        "start",
        "other colours: one composite action each",
    );
}

/// The action over time, each composite action in its colour.
fn draw_trace(svg: &mut Svg, panel: Panel, joint: &JointSteps) {
    let name = joint.joint_name.as_deref().map_or_else(
        || match joint.joint {
            -1 => "all joints".to_owned(),
            joint => format!("joint {joint}"),
        },
        ToOwned::to_owned,
    );
    // Joints that are cut together have no action of their own: its change stands for it.
    let (values, what) = if joint.actions.is_empty() {
        (&joint.action.change, "change")
    } else {
        (&joint.actions, "action")
    };
    let Some(y) = panel.values(values) else {
        panel.frame(svg);
        panel.label(svg, &name, "");
        return;
    };
    let stride = values.len().div_ceil(MAX_POINTS);
    let pieces = pieces(&joint.segment);
    for &(start, end, segment) in &pieces {
        if let Some(colour) = segment_colour(segment) {
            let (left, right) = (
                panel.x.at(start as f64),
                panel.x.at(end_of(end, values.len())),
            );
            svg.tint(left, panel.top, right - left, panel.height, colour);
        }
    }
    panel.frame(svg);
    y.draw_values(svg);
    panel.label(svg, &name, what);
    for &(start, end, segment) in &pieces {
        let points = (start..=end.min(values.len() - 1))
            .filter(|t| stride == 1 || t % stride == 0 || *t == start)
            .map(|t| (panel.x.at(t as f64), y.at(values[t])));
        svg.line(
            points,
            segment_colour(segment).unwrap_or(OUTSIDE_COLOUR),
            1.1,
        );
    }
}

/// The changes with the threshold, the boundaries, and the masks as bands below.
fn draw_change(
    svg: &mut Svg,
    panel: Panel,
    joint: &JointSteps,
    state: &Series,
    threshold: Option<f64>,
) {
    let y = panel.unit();
    panel.frame(svg);
    y.draw_unit(svg);
    panel.label(svg, "change", "0 to 1");
    for (t, _) in joint.boundary.iter().enumerate().filter(|(_, b)| **b) {
        let x = panel.x.at(t as f64);
        svg.rule(
            (x, panel.top),
            (x, panel.top + panel.height),
            "#bdbdbd",
            false,
        );
    }
    for (series, colour) in [(state, STATE_COLOUR), (&joint.action, ACTION_COLOUR)] {
        let stride = series.change.len().div_ceil(MAX_POINTS).max(1);
        let points = series.change.chunks(stride).enumerate().map(|(i, chunk)| {
            let largest = chunk.iter().copied().fold(0.0, f64::max);
            (panel.x.at((i * stride) as f64), y.at(largest))
        });
        svg.line(points, colour, 0.9);
    }
    if let Some(threshold) = threshold {
        let height = y.at(threshold);
        svg.rule(
            (panel.x.start, height),
            (panel.x.end, height),
            "#000000",
            true,
        );
        svg.text(panel.x.end - 3.0, height - 3.0, "tick", "end", "λ");
    }
    let masks = [
        (&joint.action.mask, ACTION_COLOUR, "action mask"),
        (&state.mask, STATE_COLOUR, "state mask"),
        (&joint.correlated, BOTH_COLOUR, "near both"),
    ];
    let mut top = panel.top + panel.height + BAND_GAP + 1.0;
    for (mask, colour, name) in masks {
        svg.text(LEFT - 5.0, top + BAND_HEIGHT, "band", "end", name);
        svg.rect(
            panel.x.start,
            top,
            panel.x.end - panel.x.start,
            BAND_HEIGHT,
            "#f2f2f2",
        );
        for (start, end) in runs(mask) {
            let (left, right) = (
                panel.x.at(start as f64),
                panel.x.at(end_of(end, mask.len())),
            );
            svg.rect(left, top, (right - left).max(0.5), BAND_HEIGHT, colour);
        }
        top += BAND_HEIGHT + BAND_GAP;
    }
}

/// The last place of a piece that ends before step `end`.
fn end_of(end: usize, n_steps: usize) -> f64 {
    end.min(n_steps.saturating_sub(1)) as f64
}

fn segment_colour(segment: i32) -> Option<&'static str> {
    let index = usize::try_from(segment).ok()?;
    Some(SEGMENT_COLOURS[index % SEGMENT_COLOURS.len()])
}

/// Runs of one segment: first step, one past the last, which.
fn pieces(segment: &[i32]) -> Vec<(usize, usize, i32)> {
    let mut start = 0;
    segment
        .chunk_by(|a, b| a == b)
        .map(|chunk| {
            let piece = (start, start + chunk.len(), chunk[0]);
            start += chunk.len();
            piece
        })
        .collect()
}

/// Runs of truths: first step, one past the last.
fn runs(mask: &[bool]) -> Vec<(usize, usize)> {
    let mut start = 0;
    mask.chunk_by(|a, b| a == b)
        .filter_map(|chunk| {
            let run = (start, start + chunk.len());
            start += chunk.len();
            chunk[0].then_some(run)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_pieces_are_half_open() {
        assert_eq!(runs(&[false, true, true, false, true]), [(1, 3), (4, 5)]);
        assert_eq!(pieces(&[-1, 0, 0, 1]), [(0, 1, -1), (1, 3, 0), (3, 4, 1)]);
    }

    #[test]
    fn a_name_from_a_recording_stays_in_its_folder() {
        let key = EpisodeKey {
            recording: "../a b/ü.mcap".into(),
            episode: 2,
            episode_id: Some("x/../y".into()),
        };
        assert_eq!(file_stem(&key), "_a_b_ü_x_.._y");
    }
}
