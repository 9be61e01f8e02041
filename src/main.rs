//! The `coact` command: parses, runs, prints. The only file that prints.

use std::io::{self, Write};
use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser;
use coact::cli::{
    self, Cli, Command, ProgressDisplay, Request, Signals, SummaryFormat, WatchRequest, exit,
};
use coact::diff;
use coact::pipeline::{self, Interrupt, RunError, Told};
use coact::results::{Results, ResultsError};
use coact::show;
use coact::summary::RunOutcome;

fn main() -> ExitCode {
    let code = match Cli::parse().command {
        Command::Extract(args) => extract(*args),
        Command::Plan(args) => plan(*args),
        Command::Finish(args) => finish(&args),
        Command::Watch(args) => watch(*args),
        Command::Inspect(args) => inspect(&args),
        Command::Compare(args) => compare(&args),
        Command::Show(args) => show(&args),
        Command::Diff(args) => diff(&args),
        Command::Report(args) => report(&args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            cli::completions(shell, &mut script);
            print(&script, exit::DONE)
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
            return print(text.as_bytes(), exit::DONE);
        }
        Err(message) => return fail(&message, exit::USAGE),
    };
    let display = ProgressDisplay::new(progress);
    let interrupt = Arc::new(Interrupt::default());
    let signals = Signals::watch(&interrupt, config.output.clone(), config.events.clone());
    let result = pipeline::run(&config, &|p| display.update(p), &interrupt);
    display.finish();
    let summary = match result {
        Ok(summary) => summary,
        Err(e @ RunError::Interrupted) => return fail(&e.to_string(), signals.exit_code()),
        Err(e) => return fail(&e.to_string(), code_of(&e)),
    };
    if verbose {
        tell(&summary.listing_text());
    }
    tell(&summary.remarks_text());
    let code = code_of_outcome(summary.outcome());
    let code = match format {
        _ if quiet => code,
        SummaryFormat::Text => print(summary.to_text().as_bytes(), code),
        SummaryFormat::Json => print((summary.to_json() + "\n").as_bytes(), code),
    };
    if summary.outcome() == RunOutcome::Failed {
        return fail("no episode came out", code);
    }
    code
}

fn plan(args: cli::PlanArgs) -> u8 {
    let request = match args.request() {
        Ok(request) => request,
        Err(message) => return fail(&message, exit::USAGE),
    };
    match pipeline::plan(&request.config, request.options.clone(), request.n_shards) {
        Ok(planned) => print(request.told(&planned).as_bytes(), exit::DONE),
        Err(e) => fail(&e.to_string(), code_of(&e)),
    }
}

fn finish(args: &cli::FinishArgs) -> u8 {
    match pipeline::finish(&args.directory) {
        Ok(finish) => {
            let (result, diagnostic, code) = args.told(&finish);
            tell(&diagnostic);
            print(result.as_bytes(), code)
        }
        Err(e) => fail(&e.to_string(), code_of(&e)),
    }
}

fn watch(args: cli::WatchArgs) -> u8 {
    let (config, format, quiet, verbose) = match args.request() {
        Ok(WatchRequest::Watch {
            config,
            summary,
            quiet,
            verbose,
        }) => (config, summary, quiet, verbose),
        Ok(WatchRequest::PrintConfig(text)) => return print(text.as_bytes(), exit::DONE),
        Err(message) => return fail(&message, exit::USAGE),
    };
    let interrupt = Arc::new(Interrupt::default());
    let _signals = Signals::of_watch(&interrupt, config.run.output.clone());
    let on_told = |told: &Told| match told {
        Told::Remark(remark) => tell(&format!("coact: {remark}\n")),
        Told::Committed(summary) => {
            if verbose {
                tell(&summary.committed_text());
                tell(&summary.listing_text());
            }
            tell(&summary.remarks_text());
        }
    };
    match pipeline::watch(&config, &on_told, &interrupt) {
        Err(e) => fail(&e.to_string(), code_of(&e)),
        Ok(_) if quiet => exit::DONE,
        Ok(summary) => match format {
            SummaryFormat::Text => print(summary.to_text().as_bytes(), exit::DONE),
            SummaryFormat::Json => print((summary.to_json() + "\n").as_bytes(), exit::DONE),
        },
    }
}

fn inspect(args: &cli::InspectArgs) -> u8 {
    let inspected = match pipeline::inspect(&args.inputs) {
        Ok(inspected) => inspected,
        Err(e) => return fail(&e.to_string(), code_of(&e)),
    };
    let text = if args.json {
        cli::inspect::to_json(&inspected) + "\n"
    } else {
        cli::inspect::to_text(&inspected)
    };
    print(text.as_bytes(), cli::inspect::exit_code(&inspected))
}

fn compare(args: &cli::CompareArgs) -> u8 {
    let config = match args.config() {
        Ok(config) => config,
        Err(message) => return fail(&message, exit::USAGE),
    };
    let display = ProgressDisplay::new(args.progress());
    let interrupt = Arc::new(Interrupt::default());
    let signals = Signals::watch(&interrupt, None, None);
    let result = pipeline::compare(&config, &|p| display.update(p), &interrupt);
    display.finish();
    let (comparison, summary) = match result {
        Ok(found) => found,
        Err(RunError::Interrupted) => return fail("interrupted", signals.exit_code()),
        Err(e) => return fail(&e.to_string(), code_of(&e)),
    };
    tell(&summary.remarks_text());
    let code = code_of_outcome(summary.outcome());
    if summary.outcome() == RunOutcome::Failed {
        return fail("no episode came out", code);
    }
    print(args.print(&comparison).as_bytes(), code)
}

fn show(args: &cli::ShowArgs) -> u8 {
    let options = match args.options() {
        Ok(options) => options,
        Err(message) => return fail(&message, exit::USAGE),
    };
    let results = match Results::open(&args.directory) {
        Ok(results) => results,
        Err(e) => return fail(&e.to_string(), exit::FAILED),
    };
    let query = args.query();
    let mut is_any = false;
    for piece in show::pieces(&results, query.as_ref(), options) {
        match piece.map(|text| write(text.as_bytes())) {
            Ok(Ok(())) => is_any = true,
            Ok(Err(e)) => return unwritten(&e, exit::DONE),
            Err(e) => return fail(&e.to_string(), exit::FAILED),
        }
    }
    match query {
        Some(query) if !is_any => fail(
            &format!("no episode is called {:?}", query.as_str()),
            exit::USAGE,
        ),
        _ => exit::DONE,
    }
}

fn diff(args: &cli::DiffArgs) -> u8 {
    let differ = || -> Result<_, ResultsError> {
        let (a, b) = (Results::open(&args.a)?, Results::open(&args.b)?);
        for results in [&a, &b].into_iter().filter(|r| !r.is_finished()) {
            let directory = results.directory().display();
            tell(&format!("coact: the run in {directory} is not finished\n"));
        }
        diff::diff(&a, &b, args.options())
    };
    match differ() {
        Ok(found) => {
            let text = if args.json {
                found.to_json() + "\n"
            } else {
                found.to_text()
            };
            let code = if found.is_different {
                exit::DIFFERENT
            } else {
                exit::DONE
            };
            print(text.as_bytes(), code)
        }
        Err(e) => fail(&e.to_string(), exit::USAGE),
    }
}

fn code_of_outcome(outcome: RunOutcome) -> u8 {
    match outcome {
        RunOutcome::Done => exit::DONE,
        RunOutcome::Partial => exit::PARTIAL,
        RunOutcome::Failed => exit::FAILED,
    }
}

fn report(args: &cli::ReportArgs) -> u8 {
    let results = match Results::open(&args.directory) {
        Ok(results) => results,
        Err(e) => return fail(&e.to_string(), exit::FAILED),
    };
    if !results.is_finished() {
        tell("coact: the run is not finished: the report shows what is committed so far\n");
    }
    match coact::report::write(&results, &args.options()) {
        Ok(report) => print(args.told(&report).as_bytes(), exit::DONE),
        Err(e) => fail(&e.to_string(), cli::report::exit_code(&e)),
    }
}

fn code_of(e: &RunError) -> u8 {
    match e {
        RunError::Arguments(_) => exit::USAGE,
        RunError::Failed(_) | RunError::Interrupted => exit::FAILED,
    }
}

/// Writes a result to stdout; `code` if that worked.
fn print(result: &[u8], code: u8) -> u8 {
    write(result).map_or_else(|e| unwritten(&e, code), |()| code)
}

fn write(result: &[u8]) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(result).and_then(|()| stdout.flush())
}

/// The exit code where stdout cannot be written. That nobody reads on is no failure.
fn unwritten(e: &io::Error, code: u8) -> u8 {
    if e.kind() == io::ErrorKind::BrokenPipe {
        return code;
    }
    fail(&format!("cannot write to stdout: {e}"), exit::FAILED)
}

/// Writes a diagnostic to stderr; where that is closed there is no one left to tell.
fn tell(diagnostic: &str) {
    let _nobody_listens: io::Result<()> = io::stderr().write_all(diagnostic.as_bytes());
}

fn fail(message: &str, code: u8) -> u8 {
    tell(&format!("coact: {message}\n"));
    code
}
