//! Episodes as strips of text: a column some steps, a row an action, a mask or the composite actions of a joint.

mod canvas;
mod glyphs;
mod strip;

use std::fmt::Write as _;

use crate::results::{EpisodeQuery, EpisodeRow, EpisodeSteps, Results, ResultsError, SegmentRow};
use crate::text::{Side, aligned, count, counted, line, plural, printable};

/// How strips are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShowOptions {
    /// Columns of the terminal.
    pub width: usize,
    /// Nothing but ASCII.
    pub ascii: bool,
    /// With the escapes of terminals.
    pub color: bool,
}

/// The least width: labels, and some columns of steps.
pub const MIN_WIDTH: usize = 40;

/// Episodes that a list names.
const LISTED: usize = 20;

/// What is shown, piece by piece: the episodes that a query means, or a list of all and the first.
pub fn pieces<'a>(
    results: &'a Results,
    query: Option<&'a EpisodeQuery>,
    options: ShowOptions,
) -> impl Iterator<Item = Result<String, ResultsError>> + 'a {
    let list = query.is_none().then(|| list(results, options));
    let pieces = list.into_iter().chain(strips(results, query, options));
    let apart = |(i, piece): (usize, Result<String, ResultsError>)| {
        piece.map(|text| if i > 0 { format!("\n{text}") } else { text })
    };
    pieces.enumerate().map(apart)
}

/// The episodes of a run.
fn list(results: &Results, options: ShowOptions) -> Result<String, ResultsError> {
    let header = [
        "episode",
        "environment",
        "status",
        "steps",
        "composite actions",
    ];
    let mut rows = vec![header.map(String::from)];
    let mut n_episodes = 0;
    for row in results.episodes() {
        let row = row?;
        n_episodes += 1;
        if n_episodes <= LISTED {
            rows.push([
                name(&row),
                row.environment().to_owned(),
                row.status.as_str().to_owned(),
                count(row.n_steps as u64),
                count(row.n_segments as u64),
            ]);
        }
    }
    let mut text = String::new();
    let (left, right) = (Side::Left, Side::Right);
    aligned(&mut text, &[left, left, left, right, right], &rows);
    if n_episodes > LISTED {
        let n_more = (n_episodes - LISTED) as u64;
        let more = format!("{} more {}", count(n_more), plural(n_more, "episode"));
        let dots = glyphs::Glyphs::new(options.ascii).dots;
        line(
            &mut text,
            &format!("{dots} and {more}: --episode RECORDING shows those of a recording"),
        );
    }
    Ok(plain(text, options))
}

/// Strips of episodes, one after the other: of those that a query means, or of the first.
fn strips<'a>(
    results: &'a Results,
    query: Option<&'a EpisodeQuery>,
    options: ShowOptions,
) -> impl Iterator<Item = Result<String, ResultsError>> + 'a {
    let mut steps = results.steps();
    let mut segments = results.segments();
    let is_meant = move |row: &EpisodeRow| query.is_none_or(|query| query.matches(&row.key));
    let most = if query.is_some() { usize::MAX } else { 1 };
    let of_interest = results
        .episodes()
        .filter(move |row| row.as_ref().map_or(true, is_meant));
    of_interest.take(most).map(move |row| {
        let row = row?;
        let steps = if results.has_steps() {
            steps.read(&row)?
        } else {
            None
        };
        let mut of_episode: Vec<SegmentRow> = Vec::new();
        // Segments come in the order of the episodes.
        while of_episode.len() < row.n_segments {
            let Some(segment) = segments.next().transpose()? else {
                break;
            };
            if segment.key == row.key {
                of_episode.push(segment);
            }
        }
        Ok(episode(&row, steps.as_ref(), &of_episode, options))
    })
}

/// `recording:id`, as `--episode` takes it.
fn name(row: &EpisodeRow) -> String {
    let number = row.key.episode.to_string();
    let id = row.key.episode_id.as_deref().unwrap_or(&number);
    format!("{}:{id}", row.key.recording)
}

/// A title, what is to be said, and the strip.
fn episode(
    row: &EpisodeRow,
    steps: Option<&EpisodeSteps>,
    segments: &[SegmentRow],
    options: ShowOptions,
) -> String {
    let mut title = format!(
        "{}  {}  {}, {}, {}",
        name(row),
        row.environment(),
        row.status.as_str(),
        counted(row.n_steps as u64, "step"),
        counted(row.n_segments as u64, "composite action")
    );
    if let (Some(start), Some(end)) = (row.start_time, row.end_time) {
        let _infallible = write!(title, ", {:.3} s", end.saturating_sub(start) as f64 / 1e9);
    }
    let mut text = String::new();
    line(&mut text, &title);
    if let Some(reason) = &row.reason {
        line(&mut text, reason);
    }
    if steps.is_none() {
        line(
            &mut text,
            "no per-step table (--steps none): composite actions alone",
        );
    }
    plain(text, options) + &strip::strip(row, steps, segments, options)
}

/// What others have named, without letters that the terminal may not have.
fn plain(text: String, options: ShowOptions) -> String {
    if options.ascii {
        let ascii = |c: char| if c.is_ascii() { c } else { '?' };
        text.chars().map(ascii).collect()
    } else {
        text
    }
}
