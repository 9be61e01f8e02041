//! `coact show`: what it takes, and what the terminal can do.

use std::io::{self, IsTerminal};
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::results::EpisodeQuery;
use crate::show::{MIN_WIDTH, ShowOptions};

const EXAMPLES: &str = "\
Examples:
  coact show out                               the episodes, and the first one as a strip
  coact show out --episode cartpole.mcap:2     one episode
  coact show out --episode cartpole.mcap       all of a recording
  coact show out --episode 2 --width 200 | less -RS

A column is some steps: actions are its mean, changes its greatest, a mask is set where one of its steps is. Composite
actions carry their rank by change of state where there is room.

Exit codes:
  0  shown
  1  the tables cannot be read
  2  bad arguments; no such episode";

/// Arguments of `coact show`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ShowArgs {
    /// Directory that coact extract has written, finished or not
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,

    /// Episodes to show: RECORDING:EPISODE, RECORDING or EPISODE [default: a list, and the first]
    #[arg(long, value_name = "EPISODE")]
    episode: Option<String>,

    /// Columns [default: those of the terminal, else 100]
    #[arg(long, value_name = "N")]
    width: Option<usize>,

    /// Nothing but ASCII [default: where the locale is not UTF-8]
    #[arg(long)]
    ascii: bool,

    /// With colours: `auto` if stdout is a terminal and `NO_COLOR` is not set
    #[arg(long, value_enum, value_name = "WHEN", default_value = "auto")]
    color: ColorWhen,
}

/// When colours are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ColorWhen {
    /// If stdout is a terminal and `NO_COLOR` is not set
    Auto,
    /// Also into a file or a pipe
    Always,
    /// Not at all
    Never,
}

/// Columns where there is no terminal.
const DEFAULT_WIDTH: usize = 100;

/// More columns than any terminal has.
const MAX_WIDTH: usize = 10_000;

impl ShowArgs {
    /// Which episodes; none if none is named.
    pub fn query(&self) -> Option<EpisodeQuery> {
        self.episode.as_deref().map(EpisodeQuery::new)
    }

    /// How they are drawn, by what the process is connected to.
    ///
    /// # Errors
    /// If the width cannot be.
    pub fn options(&self) -> Result<ShowOptions, String> {
        let width = match self.width {
            Some(width) if !(MIN_WIDTH..=MAX_WIDTH).contains(&width) => {
                return Err(format!(
                    "width is {width}: expected {MIN_WIDTH} to {MAX_WIDTH}"
                ));
            }
            Some(width) => width,
            None => terminal_width()
                .unwrap_or(DEFAULT_WIDTH)
                .clamp(MIN_WIDTH, MAX_WIDTH),
        };
        let no_color = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
        Ok(ShowOptions {
            width,
            ascii: self.ascii || is_other_charset(|name| std::env::var(name).ok()),
            color: match self.color {
                ColorWhen::Auto => io::stdout().is_terminal() && !no_color,
                ColorWhen::Always => true,
                ColorWhen::Never => false,
            },
        })
    }
}

fn terminal_width() -> Option<usize> {
    let (width, _) = terminal_size::terminal_size_of(io::stdout())?;
    Some(usize::from(width.0))
}

/// Does the locale name a character set that is not UTF-8? The first that is set counts, as POSIX has it; where none is,
/// nothing is known against UTF-8.
fn is_other_charset(variable: impl Fn(&str) -> Option<String>) -> bool {
    let mut given = ["LC_ALL", "LC_CTYPE", "LANG"]
        .into_iter()
        .filter_map(variable);
    given.find(|value| !value.is_empty()).is_some_and(|value| {
        let value = value.to_ascii_lowercase();
        !value.contains("utf-8") && !value.contains("utf8")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_variable_of_the_locale_decides() {
        let check = |set: &[(&str, &str)]| {
            is_other_charset(|name| {
                let found = set.iter().find(|(n, _)| *n == name);
                found.map(|(_, value)| (*value).to_owned())
            })
        };
        assert!(!check(&[]));
        assert!(check(&[("LC_ALL", "C")]));
        assert!(check(&[("LC_ALL", "POSIX"), ("LANG", "de_DE.UTF-8")]));
        assert!(!check(&[("LC_ALL", ""), ("LANG", "de_DE.utf8")]));
        assert!(!check(&[("LC_CTYPE", "C.UTF-8"), ("LANG", "C")]));
    }
}
