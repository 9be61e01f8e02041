//! Progress on stderr: a line redrawn in place, or, where that is no terminal, a line now and then.

use std::io::{self, IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::{Deserialize, Serialize};

use crate::pipeline::Progress;

/// When to show progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum When {
    /// If stderr is a terminal
    #[default]
    Auto,
    /// Also into a file or a pipe: a line every few seconds
    Always,
    /// Not at all
    Never,
}

/// Between two lines into a file or a pipe.
const PAUSE: Duration = Duration::from_secs(5);

/// Recordings, episodes, steps per second and time left.
pub struct ProgressDisplay {
    started: Instant,
    form: Form,
}

enum Form {
    Hidden,
    Bar(ProgressBar),
    /// The last line was written then.
    Lines(Mutex<Option<Instant>>),
}

impl ProgressDisplay {
    /// Shows nothing unless `when` allows it.
    pub fn new(when: When) -> Self {
        let form = match (when, io::stderr().is_terminal()) {
            (When::Never, _) | (When::Auto, false) => Form::Hidden,
            (When::Auto | When::Always, true) => Form::Bar(bar()),
            (When::Always, false) => Form::Lines(Mutex::new(None)),
        };
        Self {
            started: Instant::now(),
            form,
        }
    }

    /// Shows how far the run is.
    pub fn update(&self, progress: Progress) {
        match &self.form {
            Form::Hidden => {}
            Form::Bar(bar) => {
                bar.set_length(progress.bytes_total);
                bar.set_position(progress.bytes);
                bar.set_message(self.message(progress));
            }
            Form::Lines(last) => {
                let is_last = progress.n_recordings == progress.n_recordings_total;
                let Ok(mut last) = last.lock() else {
                    return;
                };
                if is_last || last.is_none_or(|last| last.elapsed() >= PAUSE) {
                    *last = Some(Instant::now());
                    let percent = (100 * progress.bytes)
                        .checked_div(progress.bytes_total)
                        .unwrap_or(100);
                    let message = self.message(progress);
                    let _nobody_listens: io::Result<()> =
                        writeln!(io::stderr(), "{percent:>3}%  {message}");
                }
            }
        }
    }

    fn message(&self, progress: Progress) -> String {
        let seconds = self.started.elapsed().as_secs_f64().max(1e-3);
        format!(
            "{}/{} recordings  {} episodes  {:.0} steps/s",
            progress.n_recordings,
            progress.n_recordings_total,
            progress.n_episodes,
            progress.n_steps as f64 / seconds
        )
    }

    /// Clears the line.
    pub fn finish(&self) {
        if let Form::Bar(bar) = &self.form {
            bar.finish_and_clear();
        }
    }
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(8));
    if let Ok(style) = ProgressStyle::with_template("{bar:24} {percent:>3}%  {msg}  {eta} left") {
        bar.set_style(style);
    }
    bar
}
