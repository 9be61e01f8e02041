//! The `coact` command: parses, runs, prints. The only file that prints.
#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "results go to stdout, diagnostics to stderr"
)]

use std::io;
use std::process::ExitCode;

use clap::Parser;
use coact::cli::{self, Cli, Command, ProgressDisplay, Request, SummaryFormat, exit};
use coact::pipeline::{self, RunError};
use coact::report::RunOutcome;

fn main() -> ExitCode {
    let code = match Cli::parse().command {
        Command::Extract(args) => extract(*args),
        Command::Completions { shell } => {
            cli::completions(shell, &mut io::stdout());
            exit::DONE
        }
    };
    ExitCode::from(code)
}

fn extract(args: cli::ExtractArgs) -> u8 {
    let (config, progress, format, quiet, verbose) = match args.request() {
        Ok(Request::Run {
            config,
            progress,
            summary,
            quiet,
            verbose,
        }) => (config, progress, summary, quiet, verbose),
        Ok(Request::PrintConfig(text)) => {
            print!("{text}");
            return exit::DONE;
        }
        Err(message) => return fail(&message, exit::USAGE),
    };
    let display = ProgressDisplay::new(progress);
    let result = pipeline::run(&config, &|p| display.update(p));
    display.finish();
    let summary = match result {
        Ok(summary) => summary,
        Err(e @ RunError::Arguments(_)) => return fail(&e.to_string(), exit::USAGE),
        Err(e @ RunError::Failed(_)) => return fail(&e.to_string(), exit::FAILED),
    };
    if verbose {
        eprint!("{}", summary.listing_text());
    }
    eprint!("{}", summary.remarks_text());
    if !quiet {
        match format {
            SummaryFormat::Text => print!("{}", summary.to_text()),
            SummaryFormat::Json => println!("{}", summary.to_json()),
        }
    }
    match summary.outcome() {
        RunOutcome::Done => exit::DONE,
        RunOutcome::Partial => exit::PARTIAL,
        RunOutcome::Failed => fail("no episode came out", exit::FAILED),
    }
}

fn fail(message: &str, code: u8) -> u8 {
    eprintln!("coact: {message}");
    code
}
