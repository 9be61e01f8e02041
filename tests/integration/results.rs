//! Results read back: what was written, to the bit, in any order, from parts that a commit names alone.

use std::fs;
use std::path::Path;

use coact::extraction::{ExtractionParams, RawParams};
use coact::model::{Episode, EpisodeStatus, JointMode, Outcome};
use coact::pipeline::{self, Config, Interrupt};
use coact::results::{EpisodeRow, Results, ResultsError};
use coact::tables::TableOptions;

use crate::tables::{episode, write};

/// Options under which every few episodes begin a new part.
fn small_parts(mode: JointMode) -> TableOptions {
    let joints = match mode {
        JointMode::Each => "each",
        JointMode::Together => "together",
    };
    TableOptions {
        max_part_rows: 150,
        metadata: vec![
            ("coact.joints".to_owned(), joints.to_owned()),
            ("coact.threshold".to_owned(), "0.5".to_owned()),
        ],
        ..TableOptions::default()
    }
}

/// Episodes of all kinds: short ones, one that is none, one longer than a part.
fn episodes() -> Vec<Episode> {
    [60, 3, 41, 0, 500, 60, 11, 61, 10]
        .into_iter()
        .enumerate()
        .map(|(i, n)| episode(i as i64, n, (i % 2 == 0).then(|| vec![0.5; n])))
        .collect()
}

fn rows(results: &Results) -> Vec<EpisodeRow> {
    results.episodes().map(Result::unwrap).collect()
}

#[track_caller]
fn check_steps(results: &Results, episodes: &[Episode], outcomes: &[Outcome], mode: JointMode) {
    let rows = rows(results);
    assert_eq!(rows.len(), episodes.len());
    let mut reader = results.steps();
    // Backwards as well: each is found by itself.
    for i in (0..rows.len()).chain((0..rows.len()).rev()) {
        let (row, episode) = (&rows[i], &episodes[i]);
        assert_eq!(row.key, episode.key);
        assert_eq!(row.n_steps, episode.n_steps());
        let steps = reader.read(row).unwrap().unwrap();
        if row.n_steps == 0 {
            assert!(steps.joints.is_empty());
            continue;
        }
        assert_eq!(steps.times, episode.times);
        assert_eq!(
            steps.joints.len(),
            if mode == JointMode::Each { 2 } else { 1 }
        );
        for (j, joint) in steps.joints.iter().enumerate() {
            if mode == JointMode::Each {
                assert_eq!(
                    (joint.joint, &joint.actions[..]),
                    (j as i32, episode.actions.column(j))
                );
            } else {
                assert_eq!((joint.joint, joint.actions.len()), (-1, 0));
            }
            let Outcome::Extracted(found) = &outcomes[i] else {
                assert_eq!(row.status, EpisodeStatus::TooShort);
                assert!(joint.action.measure.is_empty() && steps.state.change.is_empty());
                assert!(joint.segment.iter().all(|&s| s == -1));
                continue;
            };
            assert_eq!(steps.state, found.state);
            assert_eq!(joint.action, found.joints[j].action);
            assert_eq!(joint.correlated, found.joints[j].correlated);
            let boundaries: Vec<usize> = (0..row.n_steps).filter(|&t| joint.boundary[t]).collect();
            assert_eq!(boundaries, found.joints[j].boundaries);
            for (k, segment) in found.joints[j].segments.iter().enumerate() {
                let inside = &joint.segment[segment.start_step..segment.end_step];
                assert!(inside.iter().all(|&s| s == k as i32));
            }
        }
    }
}

#[test]
fn every_episode_is_found_in_any_order() {
    for mode in [JointMode::Each, JointMode::Together] {
        let dir = tempfile::tempdir().unwrap();
        let episodes = episodes();
        let outcomes = write(dir.path(), mode, &small_parts(mode), &episodes);
        assert!(
            fs::read_dir(dir.path().join("steps")).unwrap().count() > 1,
            "several parts"
        );
        let results = Results::open(dir.path()).unwrap();
        assert!(results.is_finished() && results.has_steps());
        assert_eq!(results.parameters().threshold(), Some(0.5));
        assert_eq!(
            results.parameters().is_together(),
            mode == JointMode::Together
        );
        check_steps(&results, &episodes, &outcomes, mode);
    }
}

#[test]
fn segments_come_back_with_and_without_their_actions() {
    let dir = tempfile::tempdir().unwrap();
    let episodes = episodes();
    let outcomes = write(
        dir.path(),
        JointMode::Each,
        &small_parts(JointMode::Each),
        &episodes,
    );
    let results = Results::open(dir.path()).unwrap();
    let mut found = results.segments_with_actions().map(Result::unwrap);
    let mut without = results.segments().map(Result::unwrap);
    for (episode, outcome) in episodes.iter().zip(&outcomes) {
        let Outcome::Extracted(extraction) = outcome else {
            continue;
        };
        for (j, joint) in extraction.joints.iter().enumerate() {
            for (k, expected) in joint.segments.iter().enumerate() {
                let row = found.next().unwrap();
                assert_eq!(row.key, episode.key);
                assert_eq!((row.joint, row.segment), (j as i32, k));
                assert_eq!(
                    (row.start_step, row.end_step, row.state_change_rank),
                    (
                        expected.start_step,
                        expected.end_step,
                        expected.state_change_rank
                    )
                );
                assert_eq!(row.state_change_sum, expected.state_change_sum);
                assert_eq!(
                    row.actions,
                    episode.actions.column(j)[row.start_step..row.end_step]
                );
                let short = without.next().unwrap();
                assert!(short.actions.is_empty());
                assert_eq!(
                    (short.start_step, short.end_time),
                    (row.start_step, row.end_time)
                );
            }
        }
    }
    assert!(found.next().is_none() && without.next().is_none());
}

#[test]
fn what_a_run_says_of_its_recordings_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let input = dir.path().join("in");
    fs::create_dir(&input).unwrap();
    fs::copy("fixtures/recordings/cartpole.mcap", input.join("good.mcap")).unwrap();
    fs::write(input.join("bad.mcap"), "no recording").unwrap();
    let out = dir.path().join("out");
    let config = Config {
        inputs: vec![input],
        shard: None,
        output: Some(out.clone()),
        events: None,
        params: ExtractionParams::new(RawParams::default()).unwrap(),
        read: coact::recording::ReadOptions::default(),
        steps: false,
        overwrite: false,
        threads: 1,
        max_part_rows: coact::tables::DEFAULT_MAX_PART_ROWS,
        faults: None,
        parameters: vec![("measure".to_owned(), "earth-mover".to_owned())],
    };
    let summary = pipeline::run(&config, &|_| {}, &Interrupt::default()).unwrap();
    let results = Results::open(&out).unwrap();
    assert_eq!(results.parameters().get("measure"), Some("earth-mover"));
    let recordings: Vec<_> = results.recordings().map(Result::unwrap).collect();
    let told: Vec<_> = recordings
        .iter()
        .map(|r| (&*r.recording, r.status.as_str(), r.n_episodes))
        .collect();
    assert_eq!(told, [("bad.mcap", "failed", 0), ("good.mcap", "ok", 3)]);
    assert!(recordings[0].reason.is_some());
    assert_eq!(recordings[1].n_messages, summary.n_messages);
    // The per-step table was not asked for.
    assert!(!results.has_steps());
    let rows = rows(&results);
    assert_eq!(
        rows.iter().map(|r| r.n_segments as u64).sum::<u64>(),
        summary.n_segments
    );
    assert_eq!(rows[0].environment(), "CartPole-v1");
    assert!(results.steps().read(&rows[0]).unwrap().is_none());
}

#[test]
fn a_run_that_goes_on_is_read_as_far_as_it_is_committed() {
    let dir = tempfile::tempdir().unwrap();
    let episodes = episodes();
    let outcomes = write(
        dir.path(),
        JointMode::Each,
        &small_parts(JointMode::Each),
        &episodes,
    );
    let commits = dir.path().join("_coact/commits");
    let mut names: Vec<_> = fs::read_dir(&commits)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    names.sort();
    fs::remove_file(names.last().unwrap()).unwrap();
    fs::remove_file(dir.path().join("_SUCCESS")).unwrap();
    fs::write(dir.path().join("steps/part-00000-00099.parquet"), "half").unwrap();
    let results = Results::open(dir.path()).unwrap();
    assert!(!results.is_finished());
    let n = rows(&results).len();
    assert!(n < episodes.len(), "the last group is nobody's");
    check_steps(&results, &episodes[..n], &outcomes[..n], JointMode::Each);
}

#[track_caller]
fn refused(directory: &Path) -> String {
    Results::open(directory).unwrap_err().to_string()
}

#[test]
fn what_holds_no_results_is_told() {
    let dir = tempfile::tempdir().unwrap();
    assert!(refused(&dir.path().join("none")).ends_with("none is not a directory"));
    assert!(refused(dir.path()).contains("holds no results"));
    write(
        dir.path(),
        JointMode::Each,
        &small_parts(JointMode::Each),
        &[episode(0, 60, None)],
    );
    let run = dir.path().join("_coact/run.json");
    let text = fs::read_to_string(&run).unwrap();
    fs::write(
        &run,
        text.replace("\"table_version\": 1", "\"table_version\": 99"),
    )
    .unwrap();
    assert!(refused(dir.path()).contains("version 99, and this coact reads version 1"));
    fs::write(&run, "{").unwrap();
    assert!(
        refused(dir.path()).contains("run.json: EOF"),
        "{}",
        refused(dir.path())
    );
}

#[test]
fn a_part_that_is_not_what_it_must_be_is_an_error_not_rows() {
    let dir = tempfile::tempdir().unwrap();
    let episodes = [episode(0, 60, None), episode(1, 60, None)];
    write(
        dir.path(),
        JointMode::Each,
        &small_parts(JointMode::Each),
        &episodes,
    );
    let results = Results::open(dir.path()).unwrap();
    let rows = rows(&results);
    let part = |table: &str| dir.path().join(table).join("part-00000-00000.parquet");
    let steps = fs::read(part("steps")).unwrap();
    // Of another run, whose episodes are shorter.
    let other = tempfile::tempdir().unwrap();
    let shorter = [episode(0, 40, None), episode(1, 80, None)];
    write(
        other.path(),
        JointMode::Each,
        &small_parts(JointMode::Each),
        &shorter,
    );
    fs::copy(
        other.path().join("steps/part-00000-00000.parquet"),
        part("steps"),
    )
    .unwrap();
    let e = results.steps().read(&rows[0]).unwrap_err();
    assert!(e.to_string().contains("stands where step"), "{e}");
    fs::copy(part("episodes"), part("steps")).unwrap();
    let e = results.steps().read(&rows[0]).unwrap_err();
    assert!(e.to_string().contains("is expected"), "{e}");
    fs::write(part("steps"), &steps[..steps.len() / 2]).unwrap();
    let e = results.steps().read(&rows[0]).unwrap_err();
    assert!(matches!(e, ResultsError::Parquet { .. }), "{e}");
    fs::remove_file(part("segments")).unwrap();
    let mut segments = results.segments();
    assert!(matches!(
        segments.next(),
        Some(Err(ResultsError::Io { .. }))
    ));
    assert!(segments.next().is_none());
}
