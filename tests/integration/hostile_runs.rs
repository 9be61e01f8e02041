//! The process among hostile files, folders, limits and surroundings: it ends by itself, with its exit codes, and says
//! what it met.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::hostile::is_long;
use crate::support::broken::{self, Broken};
use crate::support::recording_builder::RecordingBuilder;
use crate::support::rows::{check_all_open, rows, temporaries};
use crate::support::subjects;

fn coact(arguments: &[&OsStr]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_coact"));
    command.args(arguments).stdin(Stdio::null());
    command
}

fn extract(input: &Path, output: &Path) -> Command {
    coact(&[
        "extract".as_ref(),
        input.as_ref(),
        "-o".as_ref(),
        output.as_ref(),
    ])
}

/// The exit code; a signal or a panic is a bug whatever came in.
#[track_caller]
fn code(output: &Output) -> i32 {
    let code = output.status.code();
    let told = stderr(output);
    assert!(
        matches!(code, Some(0..=3)) && !told.contains("panicked"),
        "{:?}: {told}",
        output.status
    );
    code.unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The summary as JSON, without the time it took.
fn summary(output: &Output) -> serde_json::Value {
    let mut summary: serde_json::Value = serde_json::from_str(&stdout(output)).unwrap();
    for wall_time in ["seconds", "sync_seconds"] {
        summary.as_object_mut().unwrap().remove(wall_time);
    }
    summary
}

fn good(n_episodes: i64) -> Vec<u8> {
    let mut b = RecordingBuilder::new();
    for episode in 0..n_episodes {
        b.episode(episode, 40);
    }
    b.finish()
}

/// Writes all broken files to a folder.
fn broken_files(folder: &Path) -> Vec<(PathBuf, Broken)> {
    fs::create_dir_all(folder).unwrap();
    broken::all()
        .into_iter()
        .enumerate()
        .map(|(i, case)| {
            let path = folder.join(format!("{i:03}.mcap"));
            fs::write(&path, &case.bytes).unwrap();
            (path, case)
        })
        .collect()
}

/// A shell that sets `limit` and becomes the command.
fn limited(limit: &str, command: &Command) -> Command {
    let mut shell = Command::new("sh");
    shell
        .arg("-c")
        .arg(format!("{limit} && exec \"$@\""))
        .arg("sh")
        .arg(command.get_program())
        .args(command.get_args())
        .stdin(Stdio::null());
    shell
}

#[cfg(unix)]
#[test]
fn a_folder_of_broken_files_costs_none_of_the_good_ones_and_little_memory() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    let cases = broken_files(&inputs);
    fs::write(inputs.join("zz_good.mcap"), good(2)).unwrap();
    let out = dir.path().join("out");
    // 1 GB of address space, threads and all: a bomb that goes off would abort the process.
    let mut command = extract(&inputs, &out);
    command.args(["--summary", "json"]);
    let run = limited("ulimit -v 1000000", &command).output().unwrap();
    assert_eq!(code(&run), 3, "{}", stderr(&run));
    let tables = rows(&out);
    assert_eq!(tables["recordings"].len(), cases.len() + 1);
    let is_of_good = |row: &&String| row.contains("zz_good");
    assert_eq!(tables["episodes"].iter().filter(is_of_good).count(), 2);
    let summary = summary(&run);
    let remarks = summary["remarks"].as_array().unwrap();
    for (path, case) in &cases {
        let name = path.file_name().unwrap().to_str().unwrap();
        let is_listed = remarks.iter().any(|r| r["recording"] == name);
        assert_eq!(is_listed, !case.clean, "{name}, {}", case.name);
    }
    // A dry run says the same, with the same code, and writes nothing.
    let mut dry = coact(&["extract".as_ref(), inputs.as_ref(), "--dry-run".as_ref()]);
    let dry = dry.args(["--summary", "json"]).output().unwrap();
    assert_eq!((code(&dry), stderr(&dry)), (3, stderr(&run)));
    assert_eq!(self::summary(&dry), summary);
    let again = dir.path().join("again");
    let fail = coact(&[
        "extract".as_ref(),
        inputs.as_ref(),
        "-o".as_ref(),
        again.as_ref(),
        "--on-damage".as_ref(),
        "fail".as_ref(),
    ])
    .output()
    .unwrap();
    assert_eq!(code(&fail), 3);
    let refused = rows(&again);
    for (path, case) in &cases {
        let name = path.file_name().unwrap().to_str().unwrap();
        if case.status == "recovered" {
            for table in ["segments", "steps", "episodes"] {
                assert!(
                    !refused[table].iter().any(|row| row.contains(name)),
                    "{}: rows in {table}",
                    case.name
                );
            }
        }
    }
}

#[test]
fn each_broken_file_alone_ends_with_an_exit_code_and_a_line() {
    let dir = tempfile::tempdir().unwrap();
    let dry_run = |path: &Path| {
        coact(&["extract".as_ref(), path.as_ref(), "--dry-run".as_ref()])
            .output()
            .unwrap()
    };
    let cases = broken_files(&dir.path().join("in"));
    let mut n = 0;
    for (path, case) in &cases {
        let run = dry_run(path);
        let expected = match case.status {
            "failed" => 1,
            _ if case.clean => 0,
            _ => 3,
        };
        let told = stderr(&run);
        assert_eq!(code(&run), expected, "{}: {told}", case.name);
        assert!(told.lines().count() <= 14, "{}: {told}", case.name);
        assert!(told.len() < 6000, "{}: {told}", case.name);
        let mut inspect = coact(&["inspect".as_ref(), path.as_ref()]);
        code(&inspect.output().unwrap());
        n += 2;
    }
    // A bounded number of the sweeps' files, each as a process.
    let stride = if is_long() { 97 } else { 1999 };
    for subject in subjects::all() {
        for at in (stride / 2..subject.bytes.len()).step_by(stride) {
            let mut bytes = subject.bytes.clone();
            bytes[at] ^= 0xff;
            for bytes in [&bytes[..], &subject.bytes[..at]] {
                let path = dir.path().join("swept.mcap");
                fs::write(&path, bytes).unwrap();
                code(&dry_run(&path));
                n += 1;
            }
        }
    }
    eprintln!("{n} processes on broken files; signals: 0, panics: 0");
}

#[cfg(unix)]
#[test]
fn what_is_no_readable_file_is_named_and_nothing_hangs() {
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    for folder in ["a", "b", "folder.mcap", "with.mcap/inside"] {
        fs::create_dir_all(inputs.join(folder)).unwrap();
    }
    for file in [
        "a/same.mcap",
        "b/same.mcap",
        "with.mcap/inside/x.mcap",
        "new\nline.mcap",
        " .mcap",
    ] {
        fs::write(inputs.join(file), good(1)).unwrap();
    }
    // Names that are not UTF-8, and one that looks like it.
    fs::write(inputs.join(OsStr::from_bytes(b"n\xff.mcap")), good(1)).unwrap();
    fs::write(inputs.join("n\\xFF.mcap"), good(1)).unwrap();
    symlink("loop.mcap", inputs.join("loop.mcap")).unwrap();
    symlink(".", inputs.join("a/around")).unwrap();
    symlink("nowhere", inputs.join("dangling.mcap")).unwrap();
    symlink("/dev/zero", inputs.join("device.mcap")).unwrap();
    let made = Command::new("mkfifo")
        .arg(inputs.join("pipe.mcap"))
        .status()
        .unwrap();
    assert!(made.success());
    let _socket = std::os::unix::net::UnixListener::bind(inputs.join("socket.mcap")).unwrap();
    let out = dir.path().join("out");
    let run = extract(&inputs, &out).output().unwrap();
    assert_eq!(code(&run), 3, "{}", stderr(&run));
    let told = stderr(&run);
    for (name, why) in [
        ("folder.mcap", "folder"),
        ("pipe.mcap", "pipe, socket or device"),
        ("socket.mcap", "pipe, socket or device"),
        ("device.mcap", "pipe, socket or device"),
        ("loop.mcap", "cannot be read"),
        ("dangling.mcap", "cannot be read"),
    ] {
        let line = told.lines().find(|line| line.contains(name));
        assert!(
            line.is_some_and(|line| line.contains(why)),
            "{name}: {told}"
        );
    }
    assert!(!told.contains("with.mcap"), "{told}");
    let episodes = &rows(&out)["episodes"];
    assert_eq!(episodes.len(), 7, "{episodes:?}");
    for name in [
        "a/same.mcap",
        "b/same.mcap",
        "n\\xFF.mcap",
        "n\\x5CxFF.mcap",
    ] {
        let quoted = format!("\"{name}\"");
        let of_name = episodes.iter().filter(|row| row.contains(&quoted)).count();
        assert_eq!(of_name, 1, "{name}: {episodes:?}");
    }
    // Each alone, as an argument.
    for name in [
        "folder.mcap",
        "pipe.mcap",
        "socket.mcap",
        "device.mcap",
        "loop.mcap",
        "dangling.mcap",
    ] {
        let run = extract(&inputs.join(name), &dir.path().join("alone").join(name))
            .output()
            .unwrap();
        assert_eq!(code(&run), 1, "{name}: {}", stderr(&run));
        assert!(stderr(&run).contains(name), "{name}: {}", stderr(&run));
    }
}

/// Root may read everything: it gives its rights up for this.
#[cfg(unix)]
#[test]
fn a_file_that_may_not_be_read_is_named() {
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::process::CommandExt;
    const NOBODY: u32 = 65_534;
    let dir = tempfile::tempdir().unwrap();
    let allow =
        |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    allow(dir.path(), 0o777);
    let inputs = dir.path().join("in");
    fs::create_dir(&inputs).unwrap();
    fs::write(inputs.join("open.mcap"), good(1)).unwrap();
    fs::write(inputs.join("secret.mcap"), good(1)).unwrap();
    fs::create_dir(inputs.join("closed")).unwrap();
    fs::write(inputs.join("closed/inside.mcap"), good(1)).unwrap();
    let program = dir.path().join("coact");
    fs::copy(env!("CARGO_BIN_EXE_coact"), &program).unwrap();
    allow(&inputs.join("secret.mcap"), 0);
    allow(&inputs.join("closed"), 0);
    let is_root = File::open(inputs.join("secret.mcap")).is_ok();
    let mut command = Command::new(&program);
    command
        .arg("extract")
        .arg(&inputs)
        .arg("-o")
        .arg(dir.path().join("out"));
    if is_root {
        command.uid(NOBODY).gid(NOBODY);
    }
    let run = command.output();
    allow(&inputs.join("closed"), 0o700);
    let run = run.unwrap();
    assert_eq!(code(&run), 3, "{}", stderr(&run));
    for name in ["secret.mcap", "closed"] {
        let told = stderr(&run);
        let line = told
            .lines()
            .find(|line| line.contains(name))
            .map(str::to_owned);
        assert!(
            line.is_some_and(|l| l.contains("ermission denied")),
            "{name}: {told}"
        );
    }
}

#[cfg(unix)]
#[test]
fn many_small_files_need_few_file_handles() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    fs::create_dir(&inputs).unwrap();
    let bytes = good(1);
    for i in 0..1500 {
        fs::write(inputs.join(format!("{i:04}.mcap")), &bytes).unwrap();
    }
    let out = dir.path().join("out");
    let run = limited("ulimit -n 64", &extract(&inputs, &out))
        .output()
        .unwrap();
    assert_eq!(code(&run), 0, "{}", stderr(&run));
    assert_eq!(rows(&out)["episodes"].len(), 1500);
}

#[test]
fn time_zone_locale_and_threads_do_not_show_in_the_tables() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    fs::create_dir(&inputs).unwrap();
    for i in 0..5 {
        fs::write(inputs.join(format!("{i}.mcap")), good(3)).unwrap();
    }
    let run = |name: &str, tz: &str, locale: &str, threads: &str| {
        let out = dir.path().join(name);
        let mut command = extract(&inputs, &out);
        command.args(["--threads", threads]);
        command
            .env("TZ", tz)
            .env("LC_ALL", locale)
            .env("LANG", locale);
        assert_eq!(code(&command.output().unwrap()), 0);
        rows(&out)
    };
    let expected = run("c", "UTC", "C", "1");
    assert_eq!(run("tr", "Asia/Kathmandu", "tr_TR.UTF-8", "2"), expected);
    assert_eq!(run("de", "America/St_Johns", "de_DE.UTF-8", "7"), expected);
}

#[cfg(unix)]
#[test]
fn nobody_at_the_other_end_of_a_pipe_is_no_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("good.mcap");
    fs::write(&path, good(2)).unwrap();
    let bad = dir.path().join("bad.mcap");
    fs::write(&bad, b"no recording").unwrap();
    let commands: [&[&OsStr]; 4] = [
        &["inspect".as_ref(), path.as_ref()],
        &[
            "extract".as_ref(),
            path.as_ref(),
            bad.as_ref(),
            "--dry-run".as_ref(),
            "-v".as_ref(),
        ],
        &["completions".as_ref(), "bash".as_ref()],
        &["--help".as_ref()],
    ];
    for arguments in commands {
        let (reader, writer) = std::io::pipe().unwrap();
        let (reader_2, writer_2) = std::io::pipe().unwrap();
        drop((reader, reader_2));
        let status = coact(arguments)
            .stdout(writer)
            .stderr(writer_2)
            .status()
            .unwrap();
        assert!(
            matches!(status.code(), Some(0 | 3)),
            "{arguments:?}: {status}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_limit_on_the_size_of_files_is_an_error_that_leaves_nothing_half_done() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    fs::create_dir(&inputs).unwrap();
    for i in 0..6 {
        fs::write(inputs.join(format!("{i}.mcap")), good(12)).unwrap();
    }
    let whole = dir.path().join("whole");
    assert_eq!(code(&extract(&inputs, &whole).output().unwrap()), 0);
    let expected = rows(&whole);
    let mut codes = Vec::new();
    // Units of 512 bytes or 1 KiB, as the shell has it.
    for limit in [0, 1, 2, 4, 8, 16, 32] {
        let out = dir.path().join(format!("out{limit}"));
        let run = limited(&format!("ulimit -f {limit}"), &extract(&inputs, &out))
            .output()
            .unwrap();
        let code = code(&run);
        codes.push(code);
        if code != 0 {
            assert_eq!(code, 1, "{}", stderr(&run));
            let told = stderr(&run);
            assert!(
                told.contains(&format!("out{limit}"))
                    && told.to_lowercase().contains("file too large"),
                "{told}"
            );
            if out.is_dir() {
                check_all_open(&out);
                assert_eq!(temporaries(&out), [] as [PathBuf; 0]);
            }
            assert!(!out.join("_SUCCESS").exists());
        }
        assert_eq!(self::code(&extract(&inputs, &out).output().unwrap()), 0);
        assert_eq!(rows(&out), expected, "limit {limit}");
    }
    assert!(codes.contains(&1), "no limit was met: {codes:?}");
}

/// Only root may mount; where it may not, there is nothing to try.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error_that_the_same_command_mends() {
    struct Mounted(PathBuf);
    impl Drop for Mounted {
        fn drop(&mut self) {
            let _gone_with_the_folder = Command::new("umount").arg(&self.0).status();
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in");
    fs::create_dir(&inputs).unwrap();
    for i in 0..6 {
        fs::write(inputs.join(format!("{i}.mcap")), good(12)).unwrap();
    }
    let run_with = |output: &Path| {
        let mut command = extract(&inputs, output);
        command.args(["--max-part-rows", "300", "--threads", "1"]);
        command.output().unwrap()
    };
    let whole = dir.path().join("whole");
    assert_eq!(code(&run_with(&whole)), 0);
    let expected = rows(&whole);
    let disk = dir.path().join("disk");
    fs::create_dir(&disk).unwrap();
    let mounted = Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=4m", "coact-test"])
        .arg(&disk)
        .stderr(Stdio::null())
        .status();
    if !mounted.is_ok_and(|status| status.success()) {
        eprintln!("no disk was filled: mounting is not allowed here");
        return;
    }
    let _mounted = Mounted(disk.clone());
    let mut n_full = 0;
    for free_kib in [0, 4, 16, 40, 64, 100, 160] {
        let out = disk.join("out");
        let filler = disk.join("filler");
        let whole_disk = 4096;
        fs::write(&filler, vec![1; (whole_disk - free_kib) << 10]).unwrap();
        let run = run_with(&out);
        if code(&run) == 1 {
            n_full += 1;
            let told = stderr(&run);
            assert!(
                told.contains("disk") && told.to_lowercase().contains("no space left"),
                "{told}"
            );
            if out.is_dir() {
                check_all_open(&out);
                assert_eq!(temporaries(&out), [] as [PathBuf; 0], "{free_kib} KiB free");
                assert!(!out.join("_SUCCESS").exists());
            }
        } else {
            assert_eq!(code(&run), 0, "{}", stderr(&run));
        }
        fs::remove_file(&filler).unwrap();
        assert_eq!(code(&run_with(&out)), 0);
        assert_eq!(rows(&out), expected, "{free_kib} KiB free");
        fs::remove_dir_all(&out).unwrap();
    }
    assert!(n_full > 2, "the disk was full {n_full} times");
    eprintln!("{n_full} full disks; rows lost: 0, doubled: 0");
}
