//! `coact compare`: held against as many runs of `coact extract`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::{Command, Output};

use arrow::array::AsArray;
use arrow::datatypes::{Float64Type, Int32Type, Int64Type};
use coact::extraction::Measure;
use coact::tables::Table;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;

use crate::support::project;
use crate::support::recording_builder::RecordingBuilder;
use crate::tables::read_table;

fn coact(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_coact"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[track_caller]
fn json(arguments: &[&str]) -> Value {
    let output = coact(arguments);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{told}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Boundaries by environment, recording, episode and joint.
type Boundaries = BTreeMap<(String, String, i64, i32), BTreeSet<i32>>;

#[derive(Default)]
struct Extracted {
    /// By environment: episodes, steps, composite actions, steps in them.
    counts: BTreeMap<String, [i64; 4]>,
    boundaries: Boundaries,
}

/// What the tables of a run say.
fn extracted(out: &Path) -> Extracted {
    let mut found = Extracted::default();
    let mut environments = BTreeMap::new();
    for batch in read_table(out, Table::Episodes) {
        let column = |name: &str| batch.column_by_name(name).unwrap();
        let (recordings, envs) = (
            column("recording").as_string::<i32>(),
            column("env_id").as_string::<i32>(),
        );
        let steps = column("n_steps").as_primitive::<Int32Type>();
        for row in 0..batch.num_rows() {
            let environment = envs.value(row).to_owned();
            let counts = found.counts.entry(environment.clone()).or_default();
            counts[0] += 1;
            counts[1] += i64::from(steps.value(row));
            environments.insert(recordings.value(row).to_owned(), environment);
        }
    }
    for batch in read_table(out, Table::Segments) {
        let column = |name: &str| batch.column_by_name(name).unwrap();
        let recordings = column("recording").as_string::<i32>();
        let episodes = column("episode").as_primitive::<Int64Type>();
        let [joints, starts, ends] =
            ["joint", "start_step", "end_step"].map(|c| column(c).as_primitive::<Int32Type>());
        for row in 0..batch.num_rows() {
            let recording = recordings.value(row).to_owned();
            let environment = environments[&recording].clone();
            let (start, end) = (starts.value(row), ends.value(row));
            let counts = found.counts.get_mut(&environment).unwrap();
            counts[2] += 1;
            counts[3] += i64::from(end - start);
            let key = (
                environment,
                recording,
                episodes.value(row),
                joints.value(row),
            );
            found
                .boundaries
                .entry(key)
                .or_default()
                .extend([start, end]);
        }
    }
    found
}

/// F1 by the definition in the help: each boundary takes the first free one that is near enough.
fn f1(environment: &str, a: &Boundaries, b: &Boundaries, tolerance: i32) -> f64 {
    let of = |boundaries: &Boundaries| -> Boundaries {
        let entries = boundaries.iter().filter(|(key, _)| key.0 == environment);
        entries.map(|(k, v)| (k.clone(), v.clone())).collect()
    };
    let (a, b) = (of(a), of(b));
    let n = |boundaries: &Boundaries| boundaries.values().map(BTreeSet::len).sum::<usize>();
    let mut n_matched = 0;
    for (key, steps) in &a {
        let mut free = b.get(key).cloned().unwrap_or_default();
        for &step in steps {
            let partner = free
                .range(step - tolerance..=step + tolerance)
                .next()
                .copied();
            n_matched += usize::from(partner.is_some_and(|partner| free.remove(&partner)));
        }
    }
    match n(&a) + n(&b) {
        0 => 1.0,
        all => 2.0 * n_matched as f64 / all as f64,
    }
}

#[test]
fn it_says_what_eight_runs_say() {
    let dir = tempfile::tempdir().unwrap();
    let fixtures = project("fixtures/recordings");
    let compared = json(&["compare", text(&fixtures), "--json", "--tolerance", "3"]);
    assert_eq!(compared["tolerance_steps"], 3);
    let runs: BTreeMap<&str, Extracted> = Measure::ALL
        .iter()
        .map(|measure| {
            let out = dir.path().join(measure.name());
            let arguments = [
                "extract",
                text(&fixtures),
                "-o",
                text(&out),
                "--steps",
                "none",
            ];
            let run = coact(&[&arguments[..], &["--measure", measure.name()]].concat());
            assert_eq!(run.status.code(), Some(0));
            (measure.name(), extracted(&out))
        })
        .collect();
    let n_environments = runs["kl"].counts.len();
    assert_eq!(n_environments, 11);
    let measures = compared["measures"].as_array().unwrap();
    assert_eq!(measures.len(), 8 * n_environments);
    for row in measures {
        let name = row["measure"].as_str().unwrap();
        let [n_episodes, n_steps, n_segments, n_segment_steps] =
            runs[name].counts[row["environment"].as_str().unwrap()].map(|n| n as f64);
        assert_eq!(row["profile"], "paper");
        assert_eq!(row["n_episodes"], n_episodes as i64, "{row}");
        assert_eq!(row["mean_segments"], n_segments / n_episodes, "{row}");
        assert_eq!(row["mean_length"], n_segment_steps / n_segments, "{row}");
        assert_eq!(row["mean_steps"], n_steps / n_episodes, "{row}");
        assert!(row["seconds"].as_f64().unwrap() > 0.0, "{row}");
    }
    let agreement = compared["agreement"].as_array().unwrap();
    assert_eq!(agreement.len(), 28 * n_environments);
    for row in agreement {
        let boundaries = |side: &str| &runs[row[side].as_str().unwrap()].boundaries;
        let environment = row["environment"].as_str().unwrap();
        let expected = f1(environment, boundaries("a"), boundaries("b"), 3);
        assert!(
            (row["f1"].as_f64().unwrap() - expected).abs() < 1e-12,
            "{row}: {expected}"
        );
    }
}

fn without_times(mut comparison: Value) -> Value {
    for row in comparison["measures"].as_array_mut().unwrap() {
        row.as_object_mut().unwrap().remove("seconds");
    }
    comparison
}

#[test]
fn any_number_of_threads_gives_the_same_and_parquet_has_the_rows() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("measures.parquet");
    let fixture = project("fixtures/recordings/cartpole.mcap");
    let run = |threads: &str| {
        let arguments = ["compare", text(&fixture), "--json", "--profiles", "both"];
        json(&[&arguments[..], &["-o", text(&file), "--threads", threads]].concat())
    };
    let one = run("1");
    let two = run("2");
    assert_eq!(without_times(one), without_times(two.clone()));
    let measures = two["measures"].as_array().unwrap();
    assert_eq!(measures.len(), 16);
    let reader = ParquetRecordBatchReaderBuilder::try_new(std::fs::File::open(&file).unwrap());
    let batches: Vec<_> = reader
        .unwrap()
        .build()
        .unwrap()
        .map(Result::unwrap)
        .collect();
    let [batch] = &batches[..] else {
        panic!("one batch");
    };
    let column = |name: &str| batch.column_by_name(name).unwrap();
    assert_eq!(batch.num_rows(), 16);
    for (row, expected) in measures.iter().enumerate() {
        assert_eq!(
            column("measure").as_string::<i32>().value(row),
            expected["measure"].as_str().unwrap()
        );
        assert_eq!(
            column("profile").as_string::<i32>().value(row),
            expected["profile"].as_str().unwrap()
        );
        for number in ["mean_segments", "mean_length", "mean_steps", "seconds"] {
            let value = column(number).as_primitive::<Float64Type>();
            let value = (!arrow::array::Array::is_null(value, row)).then(|| value.value(row));
            assert_eq!(value, expected[number].as_f64(), "{number} of {expected}");
        }
        let others = column("agreement").as_list::<i32>().value(row);
        let others = others.as_struct();
        assert_eq!(others.column(0).len(), 15);
        let f1 = others.column(2).as_primitive::<Float64Type>();
        let name = |c: usize, i: usize| others.column(c).as_string::<i32>().value(i).to_owned();
        for other in 0..15 {
            let pair = two["agreement"].as_array().unwrap().iter().find(|pair| {
                let side =
                    |side: &str| (pair[side].clone(), pair[format!("{side}_profile")].clone());
                let this = (expected["measure"].clone(), expected["profile"].clone());
                let that = (Value::from(name(0, other)), Value::from(name(1, other)));
                (side("a"), side("b")) == (this.clone(), that.clone())
                    || (side("b"), side("a")) == (this, that)
            });
            assert_eq!(pair.unwrap()["f1"], f1.value(other));
        }
    }
}

#[track_caller]
fn check(arguments: &[&str], code: i32, word: &str) {
    let output = coact(arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{told}");
    assert!(told.contains(word), "{told}");
}

#[test]
fn its_exit_codes_are_those_of_extract() {
    let dir = tempfile::tempdir().unwrap();
    let mut b = RecordingBuilder::new();
    b.episode(0, 60);
    std::fs::write(dir.path().join("good.mcap"), b.finish()).unwrap();
    let folder = text(dir.path());
    check(&["compare", folder], 0, "");
    check(&["compare"], 2, "INPUT");
    check(&["compare", folder, "--window", "3"], 2, "window is 3");
    check(&["compare", folder, "--align", "sideways"], 2, "sideways");
    let nowhere = dir.path().join("no/such/folder/x.parquet");
    check(&["compare", folder, "-o", text(&nowhere)], 1, "x.parquet");
    std::fs::write(dir.path().join("bad.mcap"), "junk").unwrap();
    check(&["compare", folder], 3, "bad.mcap failed");
    check(
        &["compare", text(&dir.path().join("bad.mcap"))],
        1,
        "no episode",
    );
}
