//! The tables: written, read back, compared by content. File bytes are never compared.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use arrow::array::{Array, AsArray, RecordBatch};
use arrow::datatypes::{DataType, Float64Type, Int32Type, Int64Type, TimestampNanosecondType};
use coact::extraction::{ExtractionParams, RawParams, extract};
use coact::model::{Columns, Episode, EpisodeKey, Incomplete, JointMode, Outcome};
use coact::tables::{OutputDirectory, RowsBuilder, Table, TableOptions, TableWriter, holds_run};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

/// All rows of one table, in the order of its parts.
pub(crate) fn read_table(directory: &Path, table: Table) -> Vec<RecordBatch> {
    let mut parts: Vec<_> = fs::read_dir(directory.join(table.name()))
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    parts.sort();
    let mut batches = Vec::new();
    for part in parts {
        let reader = ParquetRecordBatchReaderBuilder::try_new(fs::File::open(part).unwrap())
            .unwrap()
            .build()
            .unwrap();
        batches.extend(reader.map(Result::unwrap));
    }
    batches
}

fn one(directory: &Path, table: Table) -> RecordBatch {
    let batches = read_table(directory, table);
    arrow::compute::concat_batches(&table.schema(), &batches).unwrap()
}

pub(crate) fn episode(number: i64, n: usize, rewards: Option<Vec<f64>>) -> Episode {
    // Values that stay for a while and then jump, at other times in each column.
    let wave = |k: usize| {
        (0..n)
            .map(|t| ((t * t / (19 + 9 * k)) % (3 + k)) as f64 * 0.1 - 0.25)
            .collect::<Vec<f64>>()
    };
    Episode {
        key: EpisodeKey {
            recording: Arc::from("a/r.mcap"),
            episode: number,
            episode_id: Some(Arc::from(number.to_string())),
        },
        env_id: Some(Arc::from("Test-v0")),
        actions: Columns::new(n, vec![wave(0), wave(1)]),
        states: Columns::new(n, vec![wave(2), wave(0), wave(3)]),
        joint_names: Some(Arc::from([Arc::from("left"), Arc::from("right")])),
        times: Some(
            (0..n)
                .map(|t| 1_700_000_000_000_000_000 + t as i64 * 1_000_000_000)
                .collect(),
        ),
        rewards,
        incomplete: None,
        n_dropped_steps: 0,
    }
}

pub(crate) fn write(
    directory: &Path,
    mode: JointMode,
    options: &TableOptions,
    episodes: &[Episode],
) -> Vec<Outcome> {
    let params = ExtractionParams::new(RawParams {
        joints: mode,
        ..RawParams::default()
    })
    .unwrap();
    let mut writer = TableWriter::create(directory, options).unwrap();
    let mut outcomes = Vec::new();
    for episode in episodes {
        let outcome = extract(episode, &params);
        let mut rows = RowsBuilder::new(mode, options.steps);
        rows.append_episode(episode, &outcome);
        writer.write(&rows.finish(), &[]).unwrap();
        outcomes.push(outcome);
    }
    writer.finish().unwrap();
    outcomes
}

/// A type as text; the metadata of a struct's fields, whose order is not defined, left out.
fn type_name(data_type: &DataType) -> String {
    match data_type {
        DataType::List(item) => format!(
            "List({}{})",
            type_name(item.data_type()),
            if item.is_nullable() { " null" } else { "" }
        ),
        DataType::Struct(fields) => {
            let fields: Vec<String> = fields
                .iter()
                .map(|f| format!("{} {}", f.name(), type_name(f.data_type())))
                .collect();
            format!("Struct({})", fields.join(", "))
        }
        other => other.to_string(),
    }
}

#[test]
fn the_schemas_are_as_published() {
    let text = |table: Table| {
        let fields: Vec<String> = table
            .schema()
            .fields()
            .iter()
            .map(|f| {
                format!(
                    "{} {}{}",
                    f.name(),
                    type_name(f.data_type()),
                    if f.is_nullable() { " null" } else { "" }
                )
            })
            .collect();
        fields.join(", ")
    };
    assert_eq!(
        text(Table::Segments),
        "recording Utf8, episode Int64, episode_id Utf8 null, joint Int32, joint_name Utf8 null, segment Int32, start_step Int32, \
         end_step Int32, n_steps Int32, start_time Timestamp(ns, \"UTC\") null, end_time Timestamp(ns, \"UTC\") null, \
         state_change_sum Float64, state_change_peak Float64, state_change_rank Int32, reward_sum Float64 null, \
         actions List(Float64)"
    );
    assert_eq!(
        text(Table::Steps),
        "recording Utf8, episode Int64, episode_id Utf8 null, joint Int32, joint_name Utf8 null, step Int32, \
         time Timestamp(ns, \"UTC\") null, action Float64 null, action_measure Float64 null, action_change Float64 null, \
         action_mask Boolean, state_measure Float64 null, state_change Float64 null, state_mask Boolean, correlated Boolean, \
         boundary Boolean, segment Int32"
    );
    assert_eq!(
        text(Table::Episodes),
        "recording Utf8, episode Int64, episode_id Utf8 null, env_id Utf8 null, status Utf8, reason Utf8 null, n_steps Int32, \
         n_joints Int32, n_state_dims Int32, start_time Timestamp(ns, \"UTC\") null, end_time Timestamp(ns, \"UTC\") null, \
         episode_return Float64 null, n_segments Int32, mean_segment_steps Float64 null, n_dropped_steps Int64"
    );
    assert_eq!(
        text(Table::Recordings),
        "recording Utf8, bytes Int64, status Utf8, reason Utf8 null, env_id Utf8 null, encoding Utf8 null, action_selector Utf8 null, \
         state_selector Utf8 null, episode_rule Utf8 null, clock Utf8 null, align Utf8 null, n_messages Int64, n_messages_used Int64, \
         n_messages_refused Int64, causes List(Struct(cause Utf8, count Int64, first_offset Int64)), n_episodes Int64"
    );
}

#[test]
fn values_come_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let episode = episode(3, 60, Some(vec![0.1; 60]));
    let outcomes = write(
        dir.path(),
        JointMode::Each,
        &TableOptions::default(),
        std::slice::from_ref(&episode),
    );
    let Outcome::Extracted(found) = &outcomes[0] else {
        panic!("long enough")
    };
    let steps = one(dir.path(), Table::Steps);
    assert_eq!(steps.num_rows(), 120);
    let f64s = |name: &str| steps[name].as_primitive::<Float64Type>().values().to_vec();
    assert_eq!(
        f64s("action"),
        [episode.actions.column(0), episode.actions.column(1)].concat()
    );
    assert_eq!(
        f64s("action_measure"),
        [
            &found.joints[0].action.measure[..],
            &found.joints[1].action.measure[..]
        ]
        .concat()
    );
    assert_eq!(
        f64s("state_change"),
        [&found.state.change[..], &found.state.change[..]].concat()
    );
    assert_eq!(
        steps["time"]
            .as_primitive::<TimestampNanosecondType>()
            .values()[..60],
        episode.times.as_ref().unwrap()[..]
    );
    let segment_of = steps["segment"].as_primitive::<Int32Type>().values();
    let boundary = steps["boundary"].as_boolean();
    for (k, joint) in found.joints.iter().enumerate() {
        for t in 0..60 {
            assert_eq!(boundary.value(60 * k + t), joint.boundaries.contains(&t));
            let expected = joint
                .segments
                .iter()
                .position(|s| (s.start_step..s.end_step).contains(&t));
            assert_eq!(segment_of[60 * k + t], expected.map_or(-1, |i| i as i32));
        }
    }
    let segments = one(dir.path(), Table::Segments);
    let n_segments: usize = found.joints.iter().map(|j| j.segments.len()).sum();
    assert!(n_segments > 2 && segments.num_rows() == n_segments);
    let first = &found.joints[0].segments[0];
    let actions = segments["actions"].as_list::<i32>().value(0);
    assert_eq!(
        actions.as_primitive::<Float64Type>().values()[..],
        episode.actions.column(0)[first.start_step..first.end_step]
    );
    assert_eq!(
        segments["end_time"]
            .as_primitive::<TimestampNanosecondType>()
            .value(0),
        episode.times.as_ref().unwrap()[first.end_step - 1]
    );
    assert_eq!(segments["joint_name"].as_string::<i32>().value(0), "left");
    let episodes = one(dir.path(), Table::Episodes);
    assert_eq!(
        episodes["n_segments"].as_primitive::<Int32Type>().value(0),
        n_segments as i32
    );
    assert!(
        (episodes["episode_return"]
            .as_primitive::<Float64Type>()
            .value(0)
            - 6.0)
            .abs()
            < 1e-9
    );
}

#[test]
fn joints_together_have_one_row_a_step_and_all_their_actions() {
    let dir = tempfile::tempdir().unwrap();
    let episode = episode(0, 60, None);
    write(
        dir.path(),
        JointMode::Together,
        &TableOptions::default(),
        std::slice::from_ref(&episode),
    );
    let steps = one(dir.path(), Table::Steps);
    assert_eq!(
        (
            steps.num_rows(),
            steps["action"].null_count(),
            steps["joint_name"].null_count()
        ),
        (60, 60, 60)
    );
    assert!(
        steps["joint"]
            .as_primitive::<Int32Type>()
            .values()
            .iter()
            .all(|j| *j == -1)
    );
    let segments = one(dir.path(), Table::Segments);
    let start = segments["start_step"].as_primitive::<Int32Type>().value(0) as usize;
    let actions = segments["actions"].as_list::<i32>().value(0);
    let actions = actions.as_primitive::<Float64Type>().values();
    assert_eq!(
        actions.len(),
        2 * segments["n_steps"].as_primitive::<Int32Type>().value(0) as usize
    );
    assert_eq!(
        actions[..2],
        [
            episode.actions.column(0)[start],
            episode.actions.column(1)[start]
        ]
    );
}

#[test]
fn short_and_incomplete_episodes_have_rows_too() {
    let dir = tempfile::tempdir().unwrap();
    let short = episode(0, 7, Some(vec![1.0; 7]));
    let mut both = episode(1, 7, None);
    both.incomplete = Some(Incomplete {
        reason: "step number 7 is missing".to_owned(),
    });
    let mut rewards = vec![1.0; 30];
    rewards[29] = f64::NAN;
    let unrewarded = episode(2, 30, Some(rewards));
    write(
        dir.path(),
        JointMode::Each,
        &TableOptions::default(),
        &[short, both, unrewarded],
    );
    let episodes = one(dir.path(), Table::Episodes);
    let status: Vec<_> = episodes["status"]
        .as_string::<i32>()
        .iter()
        .flatten()
        .collect();
    assert_eq!(status, ["too_short", "incomplete", "ok"]);
    let returns = episodes["episode_return"].as_primitive::<Float64Type>();
    assert_eq!(
        (returns.value(0), returns.is_null(1), returns.is_null(2)),
        (7.0, true, true)
    );
    let steps = one(dir.path(), Table::Steps);
    assert_eq!(steps.num_rows(), 2 * (7 + 7 + 30));
    assert_eq!(steps["action_measure"].null_count(), 28);
    assert_eq!(
        steps["action_mask"].null_count() + steps["segment"].null_count(),
        0
    );
    assert!(
        steps["segment"].as_primitive::<Int32Type>().values()[..28]
            .iter()
            .all(|s| *s == -1)
    );
}

#[test]
fn parts_are_cut_between_episodes_and_all_tables_have_as_many() {
    let dir = tempfile::tempdir().unwrap();
    let episodes: Vec<_> = (0..10).map(|i| episode(i, 60, None)).collect();
    let options = TableOptions {
        max_part_rows: 300,
        ..TableOptions::default()
    };
    write(dir.path(), JointMode::Each, &options, &episodes);
    for table in Table::ALL {
        let mut names: Vec<_> = fs::read_dir(dir.path().join(table.name()))
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        assert_eq!(
            names,
            [
                "part-00000-00000.parquet",
                "part-00000-00001.parquet",
                "part-00000-00002.parquet",
                "part-00000-00003.parquet"
            ]
        );
    }
    let keys = one(dir.path(), Table::Episodes);
    assert_eq!(
        keys["episode"].as_primitive::<Int64Type>().values()[..],
        (0..10).collect::<Vec<i64>>()[..]
    );
    assert_eq!(one(dir.path(), Table::Steps).num_rows(), 1200);
}

#[test]
fn a_run_without_rows_still_has_a_part_in_every_table() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), JointMode::Each, &TableOptions::default(), &[]);
    for table in Table::ALL {
        assert_eq!(one(dir.path(), table).num_rows(), 0);
    }
    assert!(dir.path().join("_SUCCESS").is_file());
}

#[test]
fn without_steps_there_is_no_such_folder() {
    let dir = tempfile::tempdir().unwrap();
    write(
        dir.path(),
        JointMode::Each,
        &TableOptions {
            steps: false,
            ..TableOptions::default()
        },
        &[episode(0, 60, None)],
    );
    assert!(!dir.path().join("steps").exists() && dir.path().join("segments").exists());
}

#[test]
fn files_that_are_not_ours_are_never_touched() {
    let dir = tempfile::tempdir().unwrap();
    assert!(!holds_run(dir.path()).unwrap());
    fs::create_dir(dir.path().join("steps")).unwrap();
    for foreign in ["notes.txt", "steps/mine.parquet"] {
        fs::write(dir.path().join(foreign), b"mine").unwrap();
    }
    assert!(!holds_run(dir.path()).unwrap());
    write(dir.path(), JointMode::Each, &TableOptions::default(), &[]);
    assert!(holds_run(dir.path()).unwrap());
    OutputDirectory::open(dir.path(), &TableOptions::default(), true).unwrap();
    assert!(
        dir.path().join("notes.txt").is_file() && dir.path().join("steps/mine.parquet").is_file()
    );
}

#[test]
fn a_writer_that_is_dropped_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let episode = episode(0, 60, None);
    let outcome = extract(
        &episode,
        &ExtractionParams::new(RawParams::default()).unwrap(),
    );
    let mut writer = TableWriter::create(dir.path(), &TableOptions::default()).unwrap();
    let mut rows = RowsBuilder::new(JointMode::Each, true);
    rows.append_episode(&episode, &outcome);
    writer.write(&rows.finish(), &[]).unwrap();
    drop(writer);
    for table in Table::ALL {
        assert_eq!(
            fs::read_dir(dir.path().join(table.name())).unwrap().count(),
            0
        );
    }
}
