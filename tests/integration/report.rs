//! `coact report`: its exit codes, its files, and that it never leaves half of one. What a page shows is held against
//! the tables in a browser (`tests/browser`).

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::project;
use crate::support::recording_builder::{RecordingBuilder, step_message};

fn coact(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_coact"))
        .args(arguments)
        .current_dir(dir)
        .output()
        .unwrap()
}

/// Runs a report that must end with a code, and gives what it says.
#[track_caller]
fn report(dir: &Path, arguments: &[&str], code: i32) -> String {
    let output = coact(dir, &[&["report", "out"], arguments].concat());
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}");
    said.into_owned()
}

/// A folder with `out`, extracted from a recording.
fn extracted(recording: &Path) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let arguments = ["extract", recording.to_str().unwrap(), "-o", "out", "-q"];
    assert_eq!(coact(dir.path(), &arguments).status.code(), Some(0));
    dir
}

fn cartpole() -> tempfile::TempDir {
    extracted(&project("fixtures/recordings/cartpole.mcap"))
}

fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn the_same_tables_give_the_same_page_and_it_tells_nothing_of_the_machine() {
    let dir = cartpole();
    let said = report(dir.path(), &[], 0);
    assert!(said.ends_with("traces of 3 of 3 episodes\n"), "{said}");
    report(dir.path(), &["-o", "again.html"], 0);
    let page = fs::read_to_string(dir.path().join("report.html")).unwrap();
    assert!(page == fs::read_to_string(dir.path().join("again.html")).unwrap());
    let place = dir.path().to_str().unwrap();
    assert!(!page.contains(place), "{place} is in the page");
    assert_eq!(names(dir.path()), ["again.html", "out", "report.html"]);
}

#[test]
fn what_cannot_be_made_is_said_and_leaves_no_file() {
    let dir = cartpole();
    fs::write(dir.path().join("not.json"), "{\"measures\": 1}").unwrap();
    fs::create_dir(dir.path().join("folder")).unwrap();
    let asked = [
        (
            &["--episode", "cartpole.mcap:9"][..],
            2,
            "\"cartpole.mcap:9\" is no episode of out",
        ),
        (
            &["--compare", "not.json"][..],
            2,
            "not.json: is not what coact compare --json prints",
        ),
        (
            &["--compare", "none.json"][..],
            2,
            "none.json: cannot be read",
        ),
        (&["-o", "none/report.html"][..], 1, "cannot write none/"),
        (&["-o", "folder"][..], 1, "cannot write folder"),
    ];
    for (arguments, code, expected) in asked {
        let said = report(dir.path(), arguments, code);
        assert!(said.contains(expected), "{said}");
    }
    assert_eq!(names(dir.path()), ["folder", "not.json", "out"]);
    let output = coact(dir.path(), &["report", "folder"]);
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn a_page_that_cannot_be_written_leaves_the_old_one() {
    let dir = cartpole();
    report(dir.path(), &[], 0);
    let before = fs::read(dir.path().join("report.html")).unwrap();
    // The steps of the first part are gone, the rest is there.
    let steps = dir.path().join("out/steps");
    let part = steps.join(&names(&steps)[0]);
    fs::write(&part, &fs::read(&part).unwrap()[..100]).unwrap();
    let said = report(dir.path(), &[], 1);
    assert!(said.contains("part-00000-00000.parquet"), "{said}");
    assert!(before == fs::read(dir.path().join("report.html")).unwrap());
    assert_eq!(names(dir.path()), ["out", "report.html"]);
}

#[test]
fn a_run_that_is_not_finished_has_a_page_that_says_so() {
    let dir = cartpole();
    report(dir.path(), &["-o", "finished.html"], 0);
    fs::remove_file(dir.path().join("out/_SUCCESS")).unwrap();
    report(dir.path(), &["-o", "unfinished.html"], 0);
    let has = |page: &str, text: &str| {
        fs::read_to_string(dir.path().join(page))
            .unwrap()
            .contains(text)
    };
    assert!(has("finished.html", "\"is_finished\":true"));
    assert!(has("unfinished.html", "\"is_finished\":false"));
}

#[test]
fn figures_of_episodes_whose_names_look_alike_are_all_there() {
    let dir = tempfile::tempdir().unwrap();
    let mut recording = RecordingBuilder::new();
    for name in ["a/b", "a b", "</text>\u{1}"] {
        for step in 0..60 {
            let mut message = step_message(0, step, step == 59);
            message["episode"] = name.into();
            recording.step(&message);
        }
    }
    let path: PathBuf = dir.path().join("names.mcap");
    fs::write(&path, recording.finish()).unwrap();
    let dir = extracted(&path);
    let arguments = ["--no-page", "--svg", "svg", "--png", "png"];
    let said = report(dir.path(), &arguments, 0);
    assert_eq!(said.lines().count(), 6, "{said}");
    let stems = ["names___text__", "names_a_b-2", "names_a_b"];
    for (folder, head) in [("svg", &b"<?xml"[..]), ("png", b"\x89PNG\r\n")] {
        assert_eq!(
            names(&dir.path().join(folder)),
            stems.map(|s| format!("{s}.{folder}"))
        );
        for stem in stems {
            let file = dir.path().join(folder).join(format!("{stem}.{folder}"));
            assert!(fs::read(file).unwrap().starts_with(head), "{stem}.{folder}");
        }
    }
    let hostile = fs::read_to_string(dir.path().join("svg/names___text__.svg")).unwrap();
    assert!(
        hostile.contains("&lt;/text&gt;\u{fffd}"),
        "its name is text"
    );
    assert_eq!(names(dir.path()), ["out", "png", "svg"]);
}
