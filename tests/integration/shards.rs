//! A run in shards, as its processes run it: in any order, twice, at once, killed; and whether its end is told right.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;

use coact::pipeline::{self, Config, Finish, Interrupt, RunError, Shard};
use coact::tables::Faults;
use rayon::prelude::*;

use crate::durability::config;
use crate::support::recording_builder::RecordingBuilder;
use crate::support::rows::{check_all_open, rows, temporaries};

const N_SHARDS: usize = 6;

fn coact(arguments: &[&str], output: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_coact"));
    command.args(arguments).arg("--output").arg(output);
    command.args(["-q", "--threads", "1"]);
    command
}

fn shard(k: usize, output: &Path) -> Command {
    coact(&["extract", "--shard", &format!("{k}/{N_SHARDS}")], output)
}

fn finish(output: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_coact"));
    command.arg("finish").arg(output).output().unwrap()
}

fn code(output: &Output) -> i32 {
    output.status.code().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Recordings in two folders; those of one shard give several parts.
fn recordings(folder: &Path, n: usize, n_episodes: i64) {
    for i in 0..n {
        let mut b = RecordingBuilder::new();
        for episode in 0..n_episodes {
            b.episode(episode, 60 + 3 * (i % 7));
        }
        let folder = folder.join(["left", "right"][i % 2]);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join(format!("r{i:02}.mcap")), b.finish()).unwrap();
    }
}

/// Plans, with parts small enough that each shard has several.
fn plan(inputs: &Path, output: &Path) -> Output {
    let mut command = coact(&["plan", "--shards", &N_SHARDS.to_string()], output);
    command.args(["--max-part-rows", "100"]).arg(inputs);
    command.output().unwrap()
}

fn local(inputs: &Path, output: &Path) {
    let status = coact(&["extract"], output).arg(inputs).status().unwrap();
    assert!(status.success());
}

#[test]
fn shards_in_any_order_and_some_twice_give_the_rows_of_a_local_run() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 17, 3);
    local(&inputs, &dir.path().join("local"));
    assert_eq!(code(&plan(&inputs, &output)), 0);
    for k in [5, 2, 6, 2, 1, 3, 5] {
        assert_eq!(code(&shard(k, &output).output().unwrap()), 0, "shard {k}");
        let told = finish(&output);
        assert!(!output.join("_SUCCESS").exists());
        assert_eq!(code(&told), 1);
        let told = stderr(&told);
        assert!(
            told.contains("shard 4: 3 of 3 recordings missing: "),
            "{told}"
        );
    }
    let told = stderr(&finish(&output));
    assert!(told.ends_with("missing shards: 4\n"), "{told}");
    assert_eq!(code(&shard(4, &output).output().unwrap()), 0);
    let done = finish(&output);
    assert_eq!(code(&done), 0, "{}", stderr(&done));
    let told = String::from_utf8(done.stdout).unwrap();
    assert!(told.starts_with("17 recordings, 51 episodes, "), "{told}");
    assert_eq!(rows(&output), rows(&dir.path().join("local")));
    assert!(output.join("_SUCCESS").exists());
    // A shard that is run once more, as schedulers do, takes nothing back.
    assert_eq!(code(&shard(4, &output).output().unwrap()), 0);
    assert!(output.join("_SUCCESS").exists());
}

/// Runs a shard until its lock is held and `sign` is there, then stops the process where it stands.
fn stopped(k: usize, output: &Path, sign: &str) -> Child {
    let lock = output.join(format!("_coact/lock-{k:05}"));
    let sign = output.join("_coact").join(sign);
    let mut command = shard(k, output);
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    let process = command.spawn().unwrap();
    let id = process.id().to_string();
    let is_held = || fs::read_to_string(&lock).is_ok_and(|holder| holder.trim() == id);
    while !is_held() || !sign.exists() {
        std::thread::yield_now();
    }
    signal("-STOP", &process);
    process
}

fn signal(name: &str, process: &Child) {
    let id = process.id().to_string();
    assert!(
        Command::new("kill")
            .args([name, &id])
            .status()
            .unwrap()
            .success()
    );
}

#[test]
fn a_second_process_on_a_shard_is_refused_and_a_killed_one_is_made_good() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 12, 30);
    local(&inputs, &dir.path().join("local"));
    plan(&inputs, &output);
    let mut first = stopped(3, &output, "commits/00003-00000.json");
    let second = shard(3, &output).output().unwrap();
    assert_eq!(code(&second), 1);
    let told = stderr(&second);
    let id = first.id();
    let expected = format!(
        "shard 3 of {} is in use by another process (process {id})",
        output.display()
    );
    assert!(told.contains(&expected), "{told}");
    // Others are free; a finish is not.
    assert_eq!(code(&shard(4, &output).output().unwrap()), 0);
    let told = finish(&output);
    assert_eq!((code(&told), stderr(&told).contains("in use")), (1, true));
    let mut again = coact(&["plan", "--overwrite", "--shards", "2"], &output);
    let told = again.arg(&inputs).output().unwrap();
    assert_eq!((code(&told), stderr(&told).contains("in use")), (1, true));
    first.kill().unwrap();
    first.wait().unwrap();
    check_all_open(&output);
    for k in 1..=N_SHARDS {
        assert_eq!(code(&shard(k, &output).output().unwrap()), 0, "shard {k}");
    }
    assert_eq!(code(&finish(&output)), 0);
    assert_eq!(rows(&output), rows(&dir.path().join("local")));
    assert_eq!(temporaries(&output), [] as [PathBuf; 0]);
}

#[test]
fn without_locks_two_processes_on_a_shard_leave_one_copy_of_each_row() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 12, 8);
    local(&inputs, &dir.path().join("local"));
    let expected = rows(&dir.path().join("local"));
    let mut n_overtaken = 0;
    for round in 0..4 {
        let output = dir.path().join(format!("out-{round}"));
        plan(&inputs, &output);
        for k in 1..=N_SHARDS {
            let first = stopped(k, &output, "plan.json");
            // A lock on a file that is gone is as good as none.
            fs::remove_file(output.join(format!("_coact/lock-{k:05}"))).unwrap();
            let mut second = shard(k, &output);
            let second = second.stderr(Stdio::piped()).spawn().unwrap();
            if round % 2 == 0 {
                signal("-CONT", &first);
            }
            let second = second.wait_with_output().unwrap();
            if round % 2 == 1 {
                signal("-CONT", &first);
            }
            let both = [first.wait_with_output().unwrap(), second];
            for output in both.iter().filter(|o| code(o) != 0) {
                assert_eq!(code(output), 1, "{}", stderr(output));
                n_overtaken += usize::from(stderr(output).contains("which was faster"));
            }
        }
        // Whoever was refused or disturbed is run again.
        for k in 1..=N_SHARDS {
            assert_eq!(code(&shard(k, &output).output().unwrap()), 0, "shard {k}");
        }
        assert_eq!(code(&finish(&output)), 0);
        assert_eq!(rows(&output), expected, "round {round}");
        assert_eq!(temporaries(&output), [] as [PathBuf; 0]);
    }
    assert!(n_overtaken > 0, "no two processes met");
}

#[test]
fn any_call_to_the_file_system_may_fail_in_a_shard_and_nothing_is_lost_or_doubled() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    recordings(&inputs, 4, 3);
    let whole = dir.path().join("whole");
    pipeline::run(
        &config(&inputs, &whole, None),
        &|_| {},
        &Interrupt::default(),
    )
    .unwrap();
    let expected = rows(&whole);
    let begin = |name: &str| {
        let output = dir.path().join(name);
        let planned =
            pipeline::plan(&config(&inputs, &output, None), serde_json::Map::new(), 2).unwrap();
        (output, Arc::new(planned.plan))
    };
    let run = |output: &Path, plan: &Arc<pipeline::Plan>, number, faults| {
        let shard = Some(Shard {
            number,
            plan: Arc::clone(plan),
        });
        let config = Config {
            shard,
            ..config(&inputs, output, faults)
        };
        pipeline::run(&config, &|_| {}, &Interrupt::default())
    };
    let counter = Arc::new(Faults::none());
    let (output, plan) = begin("counted");
    run(&output, &plan, 1, Some(Arc::clone(&counter))).unwrap();
    let n_calls = counter.calls();
    assert!(n_calls > 50, "{n_calls} calls");
    (0..n_calls).into_par_iter().for_each(|call| {
        let (output, plan) = begin(&format!("out-{call}"));
        let result = run(&output, &plan, 1, Some(Arc::new(Faults::at(call, false))));
        assert!(
            matches!(result, Err(RunError::Failed(_))),
            "call {call}: {result:?}"
        );
        check_all_open(&output);
        for number in [2, 1] {
            run(&output, &plan, number, None).unwrap();
        }
        let finish = pipeline::finish(&output).unwrap();
        assert!(matches!(finish, Finish::Done(_)), "call {call}: {finish:?}");
        assert_eq!(rows(&output), expected, "call {call}");
        assert_eq!(temporaries(&output), [] as [PathBuf; 0], "call {call}");
    });
}

#[test]
fn a_plan_is_the_same_for_the_same_recordings_and_gives_way_only_while_nothing_is_done() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 9, 1);
    let text = || fs::read(output.join("_coact/plan.json")).unwrap();
    plan(&inputs, &output);
    let first = text();
    // Another plan gives way, and the first comes again byte by byte.
    let other = |more: &[&str]| {
        let mut command = coact(&["plan", "--shards", "2"], &output);
        command.arg(&inputs).args(more).output().unwrap()
    };
    assert_eq!(code(&other(&[])), 0);
    assert_ne!(text(), first);
    plan(&inputs, &output);
    assert_eq!(text(), first);
    assert_eq!(code(&shard(2, &output).output().unwrap()), 0);
    // The same plan is no other.
    assert_eq!(code(&plan(&inputs, &output)), 0);
    let refused = other(&[]);
    assert_eq!(code(&refused), 2);
    assert!(
        stderr(&refused).contains("--overwrite"),
        "{}",
        stderr(&refused)
    );
    let refused = other(&["--bins", "32"]);
    assert!(
        stderr(&refused).contains("bins was 64, is 32"),
        "{}",
        stderr(&refused)
    );
    let mut whole = coact(&["extract"], &output);
    let refused = whole.arg(&inputs).output().unwrap();
    assert_eq!(code(&refused), 2);
    assert!(
        stderr(&refused).contains("--shard K/N"),
        "{}",
        stderr(&refused)
    );
    assert_eq!(text(), first);
    assert_eq!(code(&other(&["--overwrite"])), 0);
    assert_eq!(rows(&output).values().flatten().count(), 0);
    let refused = shard(2, &output).output().unwrap();
    assert_eq!(code(&refused), 2);
    assert!(
        stderr(&refused).contains("has 2 shards"),
        "{}",
        stderr(&refused)
    );
}

#[test]
fn all_shards_have_the_options_of_the_plan() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 6, 1);
    let options = [
        "--bins",
        "32",
        "--measure",
        "tv",
        "--steps",
        "none",
        "--joints",
        "together",
    ];
    let n = N_SHARDS.to_string();
    let mut planned = coact(&["plan", "--shards", &n], &output);
    planned.arg(&inputs).args(options).status().unwrap();
    let mut command = coact(&["extract"], &dir.path().join("local"));
    command.arg(&inputs).args(options).status().unwrap();
    let refused = shard(1, &output).args(["--bins", "64"]).output().unwrap();
    assert_eq!(code(&refused), 2);
    assert!(
        stderr(&refused).contains("bins is 32, not 64"),
        "{}",
        stderr(&refused)
    );
    assert_eq!(
        code(&shard(1, &output).args(["--bins", "32"]).output().unwrap()),
        0
    );
    for k in 2..=N_SHARDS {
        assert_eq!(code(&shard(k, &output).output().unwrap()), 0);
    }
    assert_eq!(code(&finish(&output)), 0);
    assert_eq!(rows(&output), rows(&dir.path().join("local")));
    assert!(!output.join("steps").exists());
    assert_eq!(
        code(&shard(1, &dir.path().join("local")).output().unwrap()),
        2
    );
    assert_eq!(code(&finish(&dir.path().join("local"))), 2);
}

#[test]
fn recordings_that_fail_are_rows_and_those_that_changed_are_told_of() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 4, 1);
    fs::write(inputs.join("bad.mcap"), b"not a recording").unwrap();
    // Six shards of five recordings: one is empty.
    let planned = coact(&["plan", "--shards", "6", "--summary", "json"], &output)
        .arg(&inputs)
        .output()
        .unwrap();
    assert_eq!(code(&planned), 0);
    fs::remove_file(inputs.join("left/r00.mcap")).unwrap();
    fs::write(
        inputs.join("left/r02.mcap"),
        b"longer than a bit, and no recording",
    )
    .unwrap();
    let codes: Vec<i32> = (1..=6)
        .map(|k| code(&shard(k, &output).output().unwrap()))
        .collect();
    assert_eq!(codes, [3, 3, 3, 0, 0, 0]);
    assert_eq!(code(&finish(&output)), 3);
    let rows = rows(&output);
    let told = rows["recordings"].join("\n");
    for expected in [
        "was there when the run was planned, and is gone",
        "has changed since the run was planned",
    ] {
        assert!(told.contains(expected), "{told}");
    }
    assert_eq!(rows["recordings"].len(), 5);
    assert_eq!(rows["episodes"].len(), 2);
    // What failed is tried again; the run is open until it is finished again.
    recordings(&inputs, 4, 1);
    assert_eq!(code(&shard(2, &output).output().unwrap()), 0);
    assert!(!output.join("_SUCCESS").exists());
    assert_eq!(code(&finish(&output)), 3);
    // One shard begins again, and the others stay.
    assert_eq!(
        code(&shard(3, &output).arg("--overwrite").output().unwrap()),
        0
    );
    assert_eq!(code(&finish(&output)), 3);
    assert_eq!(crate::support::rows::rows(&output)["episodes"].len(), 4);
}

#[test]
fn a_shard_of_a_plan_that_was_replaced_is_refused_and_what_it_wrote_is_not_taken_for_the_new_one() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 2, 2);
    let begin =
        || pipeline::plan(&config(&inputs, &output, None), serde_json::Map::new(), 1).unwrap();
    let run = |plan: pipeline::Plan| {
        let shard = Some(Shard {
            number: 1,
            plan: Arc::new(plan),
        });
        let config = Config {
            shard,
            ..config(&inputs, &output, None)
        };
        pipeline::run(&config, &|_| {}, &Interrupt::default())
    };
    let old = begin().plan;
    let plan_file = output.join("_coact/plan.json");
    let old_text = fs::read(&plan_file).unwrap();
    let mut b = RecordingBuilder::new();
    b.episode(0, 200);
    fs::write(inputs.join("left/r00.mcap"), b.finish()).unwrap();
    let new = begin().plan;
    assert!(old != new);
    let refused = run(old);
    assert!(
        matches!(&refused, Err(RunError::Arguments(e)) if e.contains("planned anew")),
        "{refused:?}"
    );
    run(new).unwrap();
    // As if the shard had read the other plan, and no lock had kept it from it.
    let new_text = fs::read(&plan_file).unwrap();
    fs::write(&plan_file, old_text).unwrap();
    let Finish::Missing(missing) = pipeline::finish(&output).unwrap() else {
        panic!("rows of another recording were taken");
    };
    assert_eq!(missing[0].missing, [Arc::from("left/r00.mcap")]);
    fs::write(&plan_file, new_text).unwrap();
    assert!(matches!(
        pipeline::finish(&output).unwrap(),
        Finish::Done(_)
    ));
}

#[test]
fn a_plan_needs_no_locks() {
    let dir = tempfile::tempdir().unwrap();
    let (inputs, output) = (dir.path().join("in"), dir.path().join("out"));
    recordings(&inputs, 2, 1);
    let without = |output: &Path| config(&inputs, output, Some(Arc::new(Faults::no_locks())));
    pipeline::plan(&without(&output), serde_json::Map::new(), 2).unwrap();
    assert!(output.join("_coact/plan.json").is_file());
    // A whole run does: nothing else keeps two of them apart.
    let whole = pipeline::run(
        &without(&dir.path().join("whole")),
        &|_| {},
        &Interrupt::default(),
    );
    assert!(matches!(whole, Err(RunError::Failed(_))), "{whole:?}");
}
