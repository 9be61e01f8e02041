//! Makes the report: surveys, chooses, and writes the page and the figures.

use std::collections::{BTreeMap, HashSet};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::choice::{Bounds, choose};
use super::comparison::Comparison;
use super::error::ReportError;
use super::figure;
use super::page::{self, Content};
use super::survey::Survey;
use super::trace::EpisodeTrace;
use crate::results::{EpisodeQuery, EpisodeRow, Results, ResultsError, SegmentRow};

/// Bytes of traces in a page.
pub const DEFAULT_MAX_BYTES: u64 = 8_000_000;

/// Figures that are drawn if no episode is asked for.
const DEFAULT_FIGURES: usize = 3;

/// What is to be written.
#[derive(Debug, Clone)]
pub struct ReportOptions {
    /// The page; `None` for figures alone.
    pub page: Option<PathBuf>,
    /// The episodes to show; all, as far as the bounds go, if none is given.
    pub episodes: Vec<EpisodeQuery>,
    /// Episodes whose traces are embedded at most.
    pub max_episodes: Option<usize>,
    /// Bytes that their traces take at most.
    pub max_bytes: u64,
    /// Measures side by side, as JSON.
    pub comparison: Option<PathBuf>,
    /// Where figures go as SVG.
    pub svg: Option<PathBuf>,
    /// Where figures go as PNG.
    pub png: Option<PathBuf>,
}

/// What was written.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// Size of the page.
    pub n_bytes: u64,
    /// Episodes of the run.
    pub n_episodes: usize,
    /// Those whose traces are in the page.
    pub n_embedded: usize,
    /// The figures.
    pub figures: Vec<PathBuf>,
}

/// Writes a report of `results`.
///
/// # Errors
/// If the tables cannot be read, an episode that is asked for is not there, or the file system refuses.
pub fn write(results: &Results, options: &ReportOptions) -> Result<Report, ReportError> {
    let comparison = options
        .comparison
        .as_deref()
        .map(Comparison::read)
        .transpose()?;
    let survey = Survey::of(results)?;
    for query in &options.episodes {
        if !survey.episodes.iter().any(|e| query.matches(&e.key)) {
            return Err(ReportError::NoEpisode {
                query: query.as_str().to_owned(),
                directory: results.directory().to_owned(),
            });
        }
    }
    let mut report = Report {
        n_episodes: survey.episodes.len(),
        ..Report::default()
    };
    if let Some(path) = &options.page {
        let bounds = Bounds {
            max_episodes: options.max_episodes.unwrap_or(usize::MAX),
            max_bytes: usize::try_from(options.max_bytes).unwrap_or(usize::MAX),
        };
        let chosen = choose(&survey, &options.episodes, bounds);
        report.n_embedded = chosen.len();
        let job = PageJob {
            results,
            survey: &survey,
            chosen: &chosen,
            comparison: comparison.as_ref(),
            bounds,
            is_asked_for: !options.episodes.is_empty(),
        };
        report.n_bytes = job.write(path)?;
    }
    if options.svg.is_some() || options.png.is_some() {
        report.figures = figures(results, &survey, options)?;
    }
    Ok(report)
}

struct PageJob<'a> {
    results: &'a Results,
    survey: &'a Survey,
    chosen: &'a [usize],
    comparison: Option<&'a Comparison>,
    bounds: Bounds,
    is_asked_for: bool,
}

impl PageJob<'_> {
    fn write(&self, path: &Path) -> Result<u64, ReportError> {
        let segments = SegmentsOf::read(self.results, self.survey, self.chosen)?;
        whole(path, |temporary| self.write_to(temporary, &segments))
    }

    fn write_to(&self, path: &Path, segments: &SegmentsOf) -> Result<u64, ReportError> {
        let mut steps = self.results.steps();
        let is_together = self.results.parameters().is_together();
        let traces = self.chosen.iter().map(|&index| {
            let episode = &self.survey.episodes[index];
            let of_episode = segments
                .by_episode
                .get(&index)
                .map_or(&[][..], Vec::as_slice);
            let trace = match steps.read(episode)? {
                Some(steps) => EpisodeTrace::of_steps(episode, &steps, of_episode),
                None => EpisodeTrace::of_segments(episode, of_episode, is_together),
            };
            Ok((index, trace))
        });
        let content = Content {
            results: self.results,
            survey: self.survey,
            chosen: self.chosen,
            ranked_actions: &segments.ranked_actions,
            comparison: self.comparison,
            bounds: self.bounds,
            is_asked_for: self.is_asked_for,
        };
        let file = File::create(path).map_err(io_error(path))?;
        let mut out = BufWriter::new(file);
        page::write(
            &mut out,
            &content,
            traces.map(|t: Result<_, ResultsError>| t.map_err(PageError::Results)),
        )
        .map_err(|e| e.at(path))?;
        out.flush().map_err(io_error(path))?;
        let size = out.get_ref().metadata().map_err(io_error(path))?.len();
        Ok(size)
    }
}

/// Why a page ends early.
enum PageError {
    Results(ResultsError),
    Io(io::Error),
}

impl From<io::Error> for PageError {
    fn from(e: io::Error) -> Self {
        Self::Io(e)
    }
}

impl PageError {
    fn at(self, path: &Path) -> ReportError {
        match self {
            Self::Results(e) => e.into(),
            Self::Io(e) => io_error(path)(e),
        }
    }
}

/// The composite actions that the page needs: those of the chosen episodes, and the values of the ranked.
struct SegmentsOf {
    by_episode: BTreeMap<usize, Vec<SegmentRow>>,
    ranked_actions: Vec<Vec<f64>>,
}

impl SegmentsOf {
    fn read(results: &Results, survey: &Survey, chosen: &[usize]) -> Result<Self, ResultsError> {
        let chosen: std::collections::HashMap<_, usize> = chosen
            .iter()
            .map(|&index| (&survey.episodes[index].key, index))
            .collect();
        let ranked: std::collections::HashMap<_, usize> = survey
            .ranked
            .iter()
            .enumerate()
            .map(|(place, r)| ((&r.row.key, r.row.joint, r.row.segment), place))
            .collect();
        let mut by_episode: BTreeMap<usize, Vec<SegmentRow>> = BTreeMap::new();
        let mut ranked_actions = vec![Vec::new(); survey.ranked.len()];
        for row in results.segments_with_actions() {
            let mut row = row?;
            if let Some(&place) = ranked.get(&(&row.key, row.joint, row.segment)) {
                ranked_actions[place].clone_from(&row.actions);
            }
            if let Some(&index) = chosen.get(&row.key) {
                if results.has_steps() {
                    row.actions = Vec::new();
                }
                by_episode.entry(index).or_default().push(row);
            }
        }
        Ok(Self {
            by_episode,
            ranked_actions,
        })
    }
}

/// Draws the episodes that are asked for, else the first few with most composite actions.
fn figures(
    results: &Results,
    survey: &Survey,
    options: &ReportOptions,
) -> Result<Vec<PathBuf>, ReportError> {
    let mut order: Vec<&EpisodeRow> = survey.episodes.iter().filter(|e| e.n_steps > 0).collect();
    if options.episodes.is_empty() {
        order.sort_by_key(|e| std::cmp::Reverse(e.n_segments));
        order.truncate(DEFAULT_FIGURES);
    } else {
        order.retain(|e| options.episodes.iter().any(|q| q.matches(&e.key)));
    }
    let mut reader = results.steps();
    let mut taken = HashSet::new();
    let mut written = Vec::new();
    for episode in order {
        let Some(steps) = reader.read(episode)? else {
            return Err(ReportError::Figure {
                path: results.directory().to_owned(),
                what: "figures need the per-step table, and this run has none (--steps none)"
                    .to_owned(),
            });
        };
        let svg = figure::svg(episode, &steps, results.parameters());
        let stem = not_taken(&mut taken, &figure::file_stem(&episode.key));
        for (folder, is_png) in [(&options.svg, false), (&options.png, true)] {
            let Some(folder) = folder else { continue };
            fs::create_dir_all(folder).map_err(io_error(folder))?;
            let extension = if is_png { "png" } else { "svg" };
            let path = folder.join(format!("{stem}.{extension}"));
            let content = if is_png {
                figure::png(&svg, &path)?
            } else {
                svg.clone().into_bytes()
            };
            whole(&path, |temporary| {
                fs::write(temporary, content).map_err(io_error(temporary))
            })?;
            written.push(path);
        }
    }
    Ok(written)
}

/// A name that no figure has yet: names of episodes may differ in what a file's name cannot have.
fn not_taken(taken: &mut HashSet<String>, stem: &str) -> String {
    let mut name = stem.to_owned();
    let mut n = 1;
    while !taken.insert(name.clone()) {
        n += 1;
        name = format!("{stem}-{n}");
    }
    name
}

/// Writes a file under a name of its own, then gives it its name: there is a whole file or none.
fn whole<T>(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<T, ReportError>,
) -> Result<T, ReportError> {
    let temporary = temporary(path);
    let written = write(&temporary).and_then(|told| {
        fs::rename(&temporary, path)
            .map(|()| told)
            .map_err(io_error(path))
    });
    if written.is_err() {
        let _best_effort: io::Result<()> = fs::remove_file(&temporary);
    }
    written
}

fn temporary(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(".tmp");
    path.with_file_name(name)
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> ReportError {
    let path = path.to_owned();
    move |source| ReportError::Io { path, source }
}
