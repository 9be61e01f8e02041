//! `coact compare`: the measures side by side, as text for people or as JSON.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::extract::joints_parser;
use super::progress::When;
use super::reading::Reading;
use crate::extraction::{
    DEFAULT_BINS, DEFAULT_THRESHOLD, DEFAULT_WINDOW, ExtractionParams, Measure, Profile, RawParams,
};
use crate::model::{Comparison, JointMode, MeasureRow};
use crate::pipeline::CompareConfig;
use crate::text::{Side, aligned, count, line, plural};

const EXAMPLES: &str = "\
Examples:
  coact compare fixtures                            the eight measures on every recording below a folder
  coact compare logs --profiles both --json         both profiles, one JSON object
  coact compare logs --window 8 -o measures.parquet the rows as Parquet, too

Agreement is the F1 of boundaries: the steps of a joint at which a composite action starts or ends. Two boundaries are
the same if they are at most --tolerance steps apart, each with one partner; over all joints and episodes of an
environment F1 is 2 × the same ÷ (the boundaries of the one + of the other), and 1 where neither has any.

Exit codes:
  0  done
  1  no episode came out, or the output cannot be written
  2  bad arguments
  3  done, but a recording failed or was recovered, a message was refused, or an episode is incomplete";

/// Arguments of `coact compare`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct CompareArgs {
    /// Write the rows to a Parquet file
    #[arg(short, long, value_name = "FILE.parquet")]
    output: Option<PathBuf>,

    /// As one JSON object
    #[arg(long)]
    json: bool,

    /// Whose rules: each measure by `paper`, by `authors`, or by both
    #[arg(
        long,
        value_enum,
        value_name = "WHICH",
        default_value = "paper",
        help_heading = "Method"
    )]
    profiles: Profiles,

    /// Bins per column, b
    #[arg(long, value_name = "N", default_value_t = DEFAULT_BINS, help_heading = "Method")]
    bins: usize,

    /// Window in steps, w
    #[arg(long, value_name = "N", default_value_t = DEFAULT_WINDOW, help_heading = "Method")]
    window: usize,

    /// Threshold on the normalised change, λ
    #[arg(
        long,
        value_name = "X",
        default_value_t = DEFAULT_THRESHOLD,
        help_heading = "Method",
        allow_negative_numbers = true
    )]
    threshold: f64,

    /// Cut each joint on its own, or the whole action as one [default: each]
    #[arg(long, value_name = "MODE", value_parser = joints_parser(), help_heading = "Method")]
    joints: Option<JointMode>,

    /// Steps within which two boundaries are the same [default: the window]
    #[arg(long, value_name = "STEPS", help_heading = "Method")]
    tolerance: Option<usize>,

    #[command(flatten)]
    reading: Reading,

    /// Show progress on stderr
    #[arg(
        long,
        value_enum,
        value_name = "WHEN",
        default_value = "auto",
        help_heading = "Running"
    )]
    progress: When,
}

/// Which profiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Profiles {
    /// The equations
    Paper,
    /// What the authors' program does
    Authors,
    /// Both
    Both,
}

impl Profiles {
    fn all(self) -> &'static [Profile] {
        match self {
            Self::Paper => &[Profile::Paper],
            Self::Authors => &[Profile::Authors],
            Self::Both => &[Profile::Paper, Profile::Authors],
        }
    }
}

impl CompareArgs {
    /// What is to be done.
    ///
    /// # Errors
    /// One line that says which option is wrong and what it must be.
    pub fn config(&self) -> Result<CompareConfig, String> {
        self.reading.check()?;
        let params = self.profiles.all().iter().flat_map(|&profile| {
            Measure::ALL.map(|measure| {
                ExtractionParams::new(RawParams {
                    measure,
                    profile,
                    bins: self.bins,
                    window: self.window,
                    threshold: self.threshold,
                    joints: self.joints.unwrap_or_default(),
                    ..RawParams::default()
                })
            })
        });
        Ok(CompareConfig {
            inputs: self.reading.inputs.clone(),
            read: self.reading.read_options(),
            params: params
                .collect::<Result<_, _>>()
                .map_err(|e| e.to_string())?,
            tolerance_steps: self.tolerance.unwrap_or(self.window),
            output: self.output.clone(),
            threads: self.reading.threads(),
        })
    }

    /// When progress is shown.
    pub fn progress(&self) -> When {
        self.progress
    }

    /// The result as it is to be printed.
    pub fn print(&self, comparison: &Comparison) -> String {
        if self.json {
            serde_json::to_string_pretty(comparison).unwrap_or_default() + "\n"
        } else {
            to_text(comparison)
        }
    }
}

/// A measure by the name of a row or column, with its profile where there are two.
fn label(name: &str, profile: &str, is_one_profile: bool) -> String {
    if is_one_profile {
        name.to_owned()
    } else {
        format!("{name} ({profile})")
    }
}

/// As text for people.
fn to_text(comparison: &Comparison) -> String {
    let rows = &comparison.measures;
    let is_one_profile = rows.windows(2).all(|w| w[0].profile == w[1].profile);
    let header = [
        "environment",
        "measure",
        "episodes",
        "mean steps",
        "composite actions per episode",
        "mean length",
        "ms",
    ];
    let mut cells: Vec<[String; 7]> = vec![header.map(String::from)];
    let mut environment = None;
    for row in rows {
        let is_first = environment != Some(&row.environment);
        environment = Some(&row.environment);
        cells.push(cells_of(row, is_first, is_one_profile));
    }
    let mut sides = [Side::Right; 7];
    (sides[0], sides[1]) = (Side::Left, Side::Left);
    let mut text = String::new();
    aligned(&mut text, &sides, &cells);
    matrix(&mut text, comparison, is_one_profile);
    text
}

fn cells_of(row: &MeasureRow, is_first: bool, is_one_profile: bool) -> [String; 7] {
    let of_environment = |text: String| if is_first { text } else { String::new() };
    [
        of_environment(row.environment.to_string()),
        label(row.measure, row.profile, is_one_profile),
        of_environment(count(row.n_episodes)),
        of_environment(format!("{:.1}", row.mean_steps)),
        format!("{:.1}", row.mean_segments),
        row.mean_length
            .map_or_else(|| "–".to_owned(), |mean| format!("{mean:.1}")),
        format!("{:.2}", row.seconds * 1e3),
    ]
}

/// How far the measures agree: mean of the environments, each measure against each.
fn matrix(text: &mut String, comparison: &Comparison, is_one_profile: bool) {
    let rows = &comparison.measures;
    let Some(first) = rows.first() else {
        return;
    };
    let measures: Vec<(&str, &str)> = rows
        .iter()
        .take_while(|row| row.environment == first.environment)
        .map(|row| (row.measure, row.profile))
        .collect();
    let n_environments = rows.len() / measures.len();
    let steps = comparison.tolerance_steps;
    let mut title = format!(
        "agreement: F1 of boundaries within {steps} {}",
        plural(steps as u64, "step")
    );
    if n_environments > 1 {
        let _infallible = write!(title, ", mean of {n_environments} environments");
    }
    text.push('\n');
    line(text, &title);
    let short = |name: &str| name.parse().map_or("", Measure::short_name).to_owned();
    let mut header = vec![String::new()];
    header.extend(measures.iter().map(|(name, _)| short(name)));
    let mut cells = vec![header];
    for a in &measures {
        let mut row = vec![label(a.0, a.1, is_one_profile)];
        row.extend(measures.iter().map(|b| {
            let pairs = comparison.agreement.iter().filter(|pair| {
                let (x, y) = ((pair.a, pair.a_profile), (pair.b, pair.b_profile));
                (x, y) == (*a, *b) || (x, y) == (*b, *a)
            });
            let (n, sum) = pairs.fold((0, 0.0), |(n, sum), pair| (n + 1, sum + pair.f1));
            if n == 0 {
                "·".to_owned()
            } else {
                format!("{:.2}", sum / f64::from(n))
            }
        }));
        cells.push(row);
    }
    let mut sides = vec![Side::Right; measures.len() + 1];
    sides[0] = Side::Left;
    aligned(text, &sides, &cells);
}
