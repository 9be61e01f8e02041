//! `coact show`: what it draws, held against the tables; and what it is connected to.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use coact::results::Results;

use crate::support::project;
use crate::support::recording_builder::{RecordingBuilder, step_message};

/// The command in a UTF-8 locale, without what the tests' own terminal says of colours.
fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_coact"));
    command
        .args(arguments)
        .env("LC_ALL", "C.UTF-8")
        .env_remove("NO_COLOR");
    command
}

#[track_caller]
fn shown(arguments: &[&str]) -> String {
    said(&command(arguments).output().unwrap())
}

#[track_caller]
fn said(output: &Output) -> String {
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{told}");
    assert_eq!(told, "");
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[track_caller]
fn extracted(dir: &Path, input: &Path, flags: &[&str]) -> PathBuf {
    let out = dir.join("out");
    let arguments = [
        "extract",
        text(input),
        "-o",
        text(&out),
        "-q",
        "--overwrite",
    ];
    assert_eq!(
        command(&[&arguments[..], flags].concat())
            .status()
            .unwrap()
            .code(),
        Some(0)
    );
    out
}

/// The rows of a strip: the name that stands in front, what is shown, and its columns, all of them.
fn rows(strip: &str, name_width: usize, n_columns: usize) -> Vec<(String, String, Vec<char>)> {
    let letters = |line: &str| line.chars().collect::<Vec<char>>();
    let part = |letters: &[char]| letters.iter().collect::<String>().trim().to_owned();
    strip
        .lines()
        .skip(1)
        .map(|line| {
            let mut letters = letters(line);
            letters.resize(name_width + 10 + n_columns, ' ');
            let columns = letters.split_off(name_width + 10);
            (
                part(&letters[..name_width]),
                part(&letters[name_width..]),
                columns,
            )
        })
        .collect()
}

#[test]
fn with_a_column_a_step_it_shows_the_masks_and_segments_of_the_tables() {
    let dir = tempfile::tempdir().unwrap();
    for (fixture, mode) in [
        ("cartpole", "each"),
        ("halfcheetah", "each"),
        ("halfcheetah", "together"),
    ] {
        let input = project(&format!("fixtures/recordings/{fixture}.mcap"));
        let out = extracted(dir.path(), &input, &["--joints", mode]);
        let results = Results::open(&out).unwrap();
        let mut steps = results.steps();
        let segments: Vec<_> = results.segments().map(Result::unwrap).collect();
        for episode in results.episodes().map(Result::unwrap) {
            let steps = steps.read(&episode).unwrap().unwrap();
            let query = format!("{}:{}", episode.key.recording, episode.key.episode);
            let strip = shown(&["show", text(&out), "--episode", &query, "--width", "1000"]);
            let names: Vec<&str> = steps
                .joints
                .iter()
                .map(|joint| joint.joint_name.as_deref().unwrap_or("together"))
                .collect();
            let name_width = names.iter().map(|n| n.len()).max().unwrap().max(5);
            let mut rows = rows(&strip, name_width, episode.n_steps).into_iter();
            let drawn = |mask: &[bool]| -> Vec<char> {
                mask.iter().map(|m| if *m { '■' } else { '·' }).collect()
            };
            assert_eq!(rows.next().unwrap().0, "state");
            assert_eq!(rows.next().unwrap().2, drawn(&steps.state.mask), "{query}");
            for (joint, name) in steps.joints.iter().zip(names) {
                let mut named = rows.next().unwrap();
                assert_eq!(named.0, name);
                if mode == "each" {
                    assert_eq!(named.1, "action");
                    assert_eq!(
                        named.2.iter().collect::<String>().trim().chars().count(),
                        episode.n_steps
                    );
                    named = rows.next().unwrap();
                }
                assert_eq!(named.1, "change");
                assert_eq!(rows.next().unwrap().2, drawn(&joint.action.mask), "{query}");
                let (_, kind, columns) = rows.next().unwrap();
                assert_eq!(kind, "segments");
                let mut expected = vec![' '; episode.n_steps];
                let of_joint = segments
                    .iter()
                    .filter(|s| s.key == episode.key && s.joint == joint.joint);
                for segment in of_joint {
                    let rank = segment.state_change_rank.to_string();
                    let n = segment.n_steps();
                    let mut bar: Vec<char> = std::iter::repeat_n('─', n).collect();
                    (bar[0], bar[n - 1]) = ('├', '┤');
                    if n == 1 {
                        bar[0] = '┃';
                    }
                    if rank.len() + 2 <= n {
                        let at = (n - rank.len()) / 2;
                        bar.splice(at..at + rank.len(), rank.chars());
                    }
                    expected.splice(segment.start_step..segment.end_step, bar);
                }
                assert_eq!(columns, expected, "{query} {name}");
            }
            assert_eq!(rows.next().unwrap().1, "step");
        }
    }
}

#[test]
fn it_fits_its_width_in_ascii_too() {
    let dir = tempfile::tempdir().unwrap();
    let out = extracted(
        dir.path(),
        &project("fixtures/recordings/cartpole.mcap"),
        &[],
    );
    for width in ["40", "61", "100", "700"] {
        let strip = shown(&[
            "show",
            text(&out),
            "--episode",
            "2",
            "--width",
            width,
            "--ascii",
        ]);
        assert!(strip.is_ascii(), "{strip}");
        // Titles are as long as they are.
        for line in strip.lines().skip(1) {
            assert!(line.len() <= width.parse().unwrap(), "{line}");
        }
    }
    let in_c = command(&["show", text(&out)])
        .env("LC_ALL", "C")
        .output()
        .unwrap();
    assert!(said(&in_c).is_ascii());
    assert!(!shown(&["show", text(&out)]).is_ascii());
}

#[test]
fn colours_come_where_they_are_asked_for_and_never_by_themselves_into_a_pipe() {
    let dir = tempfile::tempdir().unwrap();
    let out = extracted(
        dir.path(),
        &project("fixtures/recordings/cartpole.mcap"),
        &[],
    );
    let show = |flags: &[&str]| shown(&[&["show", text(&out)], flags].concat());
    assert!(!show(&[]).contains('\u{1b}'));
    assert!(!show(&["--color", "never"]).contains('\u{1b}'));
    let colored = show(&["--color", "always"]);
    assert!(colored.contains("\u{1b}[33m"));
    let mut plain = String::new();
    for (i, part) in colored.split('\u{1b}').enumerate() {
        plain.push_str(if i == 0 {
            part
        } else {
            part.split_once('m').unwrap().1
        });
    }
    assert_eq!(plain, show(&[]), "colours change nothing else");
}

#[test]
fn names_of_recordings_do_not_steer_the_terminal() {
    let dir = tempfile::tempdir().unwrap();
    let input = dir.path().join("a.mcap");
    let mut b = RecordingBuilder::new();
    b.metadata(&[
        ("env_id", "\u{1b}]0;title\u{7}"),
        ("action_names", r#"["\u001b[31mred"]"#),
    ]);
    for step in 0..60 {
        let mut message = step_message(0, step, step == 59);
        message["episode"] = "one\u{1b}[2J\ntwo".into();
        b.step(&message);
    }
    std::fs::write(&input, b.finish()).unwrap();
    let out = extracted(dir.path(), &input, &[]);
    let strip = shown(&["show", text(&out)]);
    assert!(
        strip.contains("�[31mred") && strip.contains("�]0;title�"),
        "{strip}"
    );
    let is_steering = |c: char| c.is_control() && c != '\n';
    assert!(!strip.contains(is_steering), "{strip:?}");
    let differs = command(&["diff", text(&out), text(&out)]).output().unwrap();
    assert!(!said(&differs).contains(is_steering));
}

#[test]
fn without_a_query_the_episodes_are_listed_and_without_steps_it_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let mut b = RecordingBuilder::new();
    for episode in 0..23 {
        b.episode(episode, 40);
    }
    b.episode(23, 4);
    let input = dir.path().join("many.mcap");
    std::fs::write(&input, b.finish()).unwrap();
    let out = extracted(dir.path(), &input, &["--steps", "none"]);
    let listed = shown(&["show", text(&out)]);
    assert!(listed.starts_with("episode "), "{listed}");
    assert!(listed.contains("… and 4 more episodes"), "{listed}");
    assert!(listed.contains("\n\nmany.mcap:0  "), "{listed}");
    assert!(listed.contains("no per-step table"), "{listed}");
    assert!(
        listed.contains("segments ├") && !listed.contains(" mask "),
        "{listed}"
    );
    let all = shown(&["show", text(&out), "--episode", "many.mcap"]);
    assert_eq!(all.matches("many.mcap:").count(), 24);
    let short = shown(&["show", text(&out), "--episode", "23"]);
    assert!(short.contains("too_short, 4 steps"), "{short}");

    let out = extracted(dir.path(), &input, &[]);
    let short = shown(&["show", text(&out), "--episode", "23"]);
    assert!(short.contains("change   too short"), "{short}");
}

#[test]
fn its_exit_codes_say_what_is_wrong() {
    let dir = tempfile::tempdir().unwrap();
    let out = extracted(
        dir.path(),
        &project("fixtures/recordings/cartpole.mcap"),
        &[],
    );
    for (arguments, code, word) in [
        (
            &["show", text(&out), "--episode", "7"][..],
            2,
            "no episode is called \"7\"",
        ),
        (&["show", text(&out), "--width", "39"], 2, "width is 39"),
        (&["show"], 2, "<DIR>"),
        (&["show", text(dir.path())], 1, "no results"),
    ] {
        let output = command(arguments).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{told}");
        assert!(told.contains(word), "{told}");
    }
}

#[test]
fn nobody_at_the_other_end_of_a_pipe_is_no_failure() {
    let dir = tempfile::tempdir().unwrap();
    let out = extracted(
        dir.path(),
        &project("fixtures/recordings/cartpole.mcap"),
        &[],
    );
    for arguments in [&["show", text(&out)][..], &["diff", text(&out), text(&out)]] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let run = command(arguments)
            .stdout(writer)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(run.status.code(), Some(0));
        assert!(run.stderr.is_empty());
    }
}
