"""The tables as users load them: pandas, polars and DuckDB without options, and scripts/load_results.py."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from conftest import Run
from mcap.reader import make_reader
from mcap.writer import Writer
from polars.testing import assert_frame_equal

import load_results
from load_results import Episode

# Columns and types of each table; `?` may be null.
KEY = {"recording": "string", "episode": "int64", "episode_id": "string?"}
TABLES: dict[str, dict[str, str]] = {
    "segments": KEY
    | {
        "joint": "int32",
        "joint_name": "string?",
        "segment": "int32",
        "start_step": "int32",
        "end_step": "int32",
        "n_steps": "int32",
        "start_time": "timestamp?",
        "end_time": "timestamp?",
        "state_change_sum": "float64",
        "state_change_peak": "float64",
        "state_change_rank": "int32",
        "reward_sum": "float64?",
        "actions": "list of float64",
    },
    "steps": KEY
    | {
        "joint": "int32",
        "joint_name": "string?",
        "step": "int32",
        "time": "timestamp?",
        "action": "float64?",
        "action_measure": "float64?",
        "action_change": "float64?",
        "action_mask": "bool",
        "state_measure": "float64?",
        "state_change": "float64?",
        "state_mask": "bool",
        "correlated": "bool",
        "boundary": "bool",
        "segment": "int32",
    },
    "episodes": KEY
    | {
        "env_id": "string?",
        "status": "string",
        "reason": "string?",
        "n_steps": "int32",
        "n_joints": "int32",
        "n_state_dims": "int32",
        "start_time": "timestamp?",
        "end_time": "timestamp?",
        "episode_return": "float64?",
        "n_segments": "int32",
        "mean_segment_steps": "float64?",
        "n_dropped_steps": "int64",
    },
    "recordings": {
        "recording": "string",
        "bytes": "int64",
        "status": "string",
        "reason": "string?",
        "env_id": "string?",
        "encoding": "string?",
        "action_selector": "string?",
        "state_selector": "string?",
        "episode_rule": "string?",
        "clock": "string?",
        "align": "string?",
        "n_messages": "int64",
        "n_messages_used": "int64",
        "n_messages_refused": "int64",
        "causes": "list of causes",
        "n_episodes": "int64",
    },
}
POLARS_TYPES: dict[str, pl.DataType | type[pl.DataType]] = {
    "string": pl.String,
    "int32": pl.Int32,
    "int64": pl.Int64,
    "float64": pl.Float64,
    "bool": pl.Boolean,
    "timestamp": pl.Datetime("ns", "UTC"),
    "list of float64": pl.List(pl.Float64),
    "list of causes": pl.List(pl.Struct({"cause": pl.String, "count": pl.Int64, "first_offset": pl.Int64})),
}
PANDAS_TYPES = {
    "string": "str",
    "timestamp": "datetime64[ns, UTC]",
    "list of float64": "object",
    "list of causes": "object",
}
DUCKDB_TYPES = {
    "string": "VARCHAR",
    "int32": "INTEGER",
    "int64": "BIGINT",
    "float64": "DOUBLE",
    "bool": "BOOLEAN",
    "timestamp": "TIMESTAMPTZ_NS",
    "list of float64": "DOUBLE[]",
    "list of causes": "STRUCT(cause VARCHAR, count BIGINT, first_offset BIGINT)[]",
}
JOINT_KEY = ["recording", "episode", "joint"]
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

every_table = pytest.mark.parametrize("table", list(TABLES))


# Runs -----------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def out(run: Run, root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of the fixtures."""
    out = tmp_path_factory.mktemp("fixtures") / "out"
    run(["extract", root / "fixtures", "-o", out])
    return out


@pytest.fixture(scope="session")
def out_in_shards(run: Run, root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of the fixtures from four shards, the last first."""
    out = tmp_path_factory.mktemp("shards") / "out"
    run(["plan", root / "fixtures", "-o", out, "--shards", "4"])
    for shard in (4, 2, 3, 1):
        run(["extract", "--shard", f"{shard}/4", "-o", out])
    run(["finish", out])
    return out


@pytest.fixture(scope="session")
def out_together(run: Run, root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some with the joints together."""
    out = tmp_path_factory.mktemp("together") / "out"
    recordings = root / "fixtures" / "recordings"
    inputs = [recordings / "fetch_pickandplace.mcap", recordings / "cartpole.mcap"]
    run(["extract", *inputs, "-o", out, "--joints", "together"])
    return out


@pytest.fixture(scope="session")
def out_too_short(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of one episode of four steps, without rewards, names or an environment: no composite action."""
    folder = tmp_path_factory.mktemp("short")
    with (folder / "short.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("step", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/step", "json", schema)
        for step in range(4):
            message = {"episode": "one", "step": step, "action": [step, -step], "state": [0.5 * step]}
            writer.add_message(channel, step, json.dumps(message).encode(), step)
        writer.finish()
    run(["extract", folder / "short.mcap", "-o", folder / "out"])
    return folder / "out"


@pytest.fixture(params=["out", "out_together", "out_too_short"])
def any_out(request: pytest.FixtureRequest) -> Path:
    """Each of these runs."""
    return request.getfixturevalue(request.param)


def load(out: Path, table: str) -> pl.DataFrame:
    """A table, as the README loads it."""
    return pl.read_parquet(f"{out}/{table}/*.parquet")


# Loading without options ----------------------------------------------------------------------------------------------


@every_table
def test_types_in_polars(any_out: Path, table: str) -> None:
    expected = {name: POLARS_TYPES[kind.rstrip("?")] for name, kind in TABLES[table].items()}
    assert dict(pl.read_parquet(f"{any_out}/{table}/*.parquet").schema) == expected


@every_table
def test_types_in_pandas(any_out: Path, table: str) -> None:
    frame = pd.read_parquet(f"{any_out}/{table}")
    plain = {name: kind.rstrip("?") for name, kind in TABLES[table].items()}
    assert {name: str(dtype) for name, dtype in frame.dtypes.items()} == {
        name: PANDAS_TYPES.get(kind, kind) for name, kind in plain.items()
    }
    if table == "segments":
        assert all(isinstance(actions, np.ndarray) and actions.dtype == np.float64 for actions in frame["actions"])


@every_table
def test_types_in_duckdb(any_out: Path, table: str) -> None:
    relation = duckdb.sql(f"from '{any_out}/{table}/*.parquet'")
    expected = {name: DUCKDB_TYPES[kind.rstrip("?")] for name, kind in TABLES[table].items()}
    assert dict(zip(relation.columns, map(str, relation.types), strict=True)) == expected


@every_table
def test_only_what_may_be_null_is_declared_so(any_out: Path, table: str) -> None:
    for part in (any_out / table).iterdir():
        schema = pq.read_schema(part)
        assert {field.name: field.nullable for field in schema} == {
            name: kind.endswith("?") for name, kind in TABLES[table].items()
        }
        assert not any(pa.types.is_dictionary(field.type) for field in schema)


@every_table
def test_all_three_load_the_same_rows_in_the_same_order(any_out: Path, table: str) -> None:
    in_polars = load(any_out, table)
    in_pandas = pd.read_parquet(f"{any_out}/{table}")
    in_duckdb = duckdb.sql(f"from '{any_out}/{table}/*.parquet'").pl()

    assert len(in_polars) == len(in_pandas) == len(in_duckdb)
    # DuckDB calls UTC by its other name.
    assert_frame_equal(in_duckdb.cast(dict(in_polars.schema)), in_polars, check_exact=True)
    assert_frame_equal(pl.from_pandas(in_pandas, schema_overrides=dict(in_polars.schema)), in_polars, check_exact=True)


@every_table
def test_shards_are_loaded_as_one_run_in_the_same_order(out: Path, out_in_shards: Path, table: str) -> None:
    assert_frame_equal(load(out_in_shards, table), load(out, table), check_exact=True)


def test_there_is_something_to_load(out: Path, root: Path) -> None:
    assert len(load(out, "recordings")) == len(list((root / "fixtures").rglob("*.mcap")))
    assert all(len(load(out, table)) > 0 for table in TABLES)


def test_a_run_without_composite_actions_has_empty_tables(out_too_short: Path) -> None:
    assert load(out_too_short, "segments").is_empty()
    steps = load(out_too_short, "steps")
    assert steps["action"].to_list() == [0, 1, 2, 3, 0, -1, -2, -3]
    for column in ("action_measure", "action_change", "state_measure", "state_change"):
        assert steps[column].null_count() == len(steps)
    assert not steps.select(pl.any_horizontal(load_results.MASKS).any()).item()
    assert steps["segment"].unique().to_list() == [-1]
    episode = load(out_too_short, "episodes").row(0, named=True)
    assert (episode["episode"], episode["episode_id"], episode["status"]) == (0, "one", "too_short")
    assert (episode["env_id"], episode["episode_return"], episode["mean_segment_steps"]) == (None, None, None)


# What the tables say about each other and about the recordings --------------------------------------------------------


def test_steps_hold_the_actions_and_times_of_the_recordings(out: Path, root: Path) -> None:
    columns = [*JOINT_KEY, "joint_name", "step", "action", pl.col("time").dt.epoch("ns")]
    found = load(out, "steps").select(columns).rows_by_key(JOINT_KEY)

    expected = defaultdict(list)
    for path in sorted((root / "fixtures").rglob("*.mcap")):
        with path.open("rb") as stream:
            reader = make_reader(stream)
            (metadata,) = (record.metadata for record in reader.iter_metadata() if record.name == "recording")
            names = json.loads(metadata["action_names"])
            for _, _, message in reader.iter_messages(topics=["/step"], log_time_order=False):
                logged = json.loads(message.data)
                for joint, action in enumerate(np.atleast_1d(logged["action"]).tolist()):
                    series = expected[path.name, logged["episode"], joint]
                    series.append((names[joint], len(series), action, message.log_time))
    assert dict(found) == dict(expected)


def test_segments_are_made_of_their_steps(out: Path) -> None:
    series = load(out, "steps").partition_by(JOINT_KEY, as_dict=True)
    for segment in load(out, "segments").iter_rows(named=True):
        steps = series[tuple(segment[name] for name in JOINT_KEY)]
        inside = steps[segment["start_step"] : segment["end_step"]]
        assert segment["n_steps"] == len(inside) == segment["end_step"] - segment["start_step"] > 0
        assert inside["step"].to_list() == list(range(segment["start_step"], segment["end_step"]))
        assert segment["actions"] == inside["action"].to_list()
        assert inside["joint_name"].unique().to_list() == [segment["joint_name"]]
        assert inside["segment"].unique().to_list() == [segment["segment"]]
        assert (segment["start_time"], segment["end_time"]) == (inside["time"][0], inside["time"][-1])
        assert segment["state_change_sum"] == pytest.approx(sum(inside["state_change"]), rel=1e-12, abs=1e-12)
        assert segment["state_change_peak"] == max(inside["state_change"])


def test_steps_outside_segments_are_marked_so(out: Path) -> None:
    in_steps = load(out, "steps").filter(pl.col("segment") >= 0).height
    assert in_steps == load(out, "segments")["n_steps"].sum()


def test_segments_are_numbered_in_time_and_ranked_by_change(out: Path) -> None:
    for _, segments in load(out, "segments").group_by(JOINT_KEY):
        assert segments["segment"].to_list() == list(range(len(segments)))
        assert segments["start_step"].is_sorted()
        by_rank = segments.sort("state_change_rank")
        assert by_rank["state_change_rank"].to_list() == list(range(1, len(segments) + 1))
        assert by_rank["state_change_sum"].is_sorted(descending=True)


def test_states_repeat_for_each_joint(out: Path) -> None:
    columns = ["state_measure", "state_change", "state_mask"]
    values = load(out, "steps").group_by("recording", "episode", "step").agg(pl.struct(columns).n_unique().alias("n"))
    assert values["n"].unique().to_list() == [1]


def test_episodes_count_their_segments(out: Path) -> None:
    lengths = load(out, "segments").rows_by_key(["recording", "episode"], named=True)
    for episode in load(out, "episodes").iter_rows(named=True):
        n_steps = [segment["n_steps"] for segment in lengths.get((episode["recording"], episode["episode"]), [])]
        assert episode["n_segments"] == len(n_steps)
        mean = statistics.fmean(n_steps) if n_steps else None
        assert episode["mean_segment_steps"] == (mean if mean is None else pytest.approx(mean, rel=1e-12))


def test_joints_together_have_rows_of_actions(out_together: Path, out: Path) -> None:
    together = load(out_together, "segments")
    assert set(together["joint"]) == {-1}
    assert together["joint_name"].null_count() == len(together) > 0
    steps = load(out_together, "steps")
    assert steps["action"].null_count() == len(steps) == load(out_together, "episodes")["n_steps"].sum()

    each = load(out, "steps").group_by("recording", "episode", "step", maintain_order=True).agg("action")
    rows_of_episodes = each.rows_by_key(["recording", "episode"])
    for segment in together.iter_rows(named=True):
        rows = rows_of_episodes[segment["recording"], segment["episode"]]
        inside = [action for step, actions in rows[segment["start_step"] : segment["end_step"]] for action in actions]
        assert segment["actions"] == inside


# scripts/load_results.py ----------------------------------------------------------------------------------------------


def test_strongest_segments(out: Path) -> None:
    rows = [row for part in (out / "segments").iterdir() for row in pq.read_table(part).to_pylist()]
    rows.sort(key=lambda row: row["state_change_sum"], reverse=True)
    strongest = load_results.strongest_segments(out)
    assert strongest.to_dicts() == [{name: row[name] for name in strongest.columns} for row in rows[:10]]
    assert load_results.strongest_segments(out, limit=3).rows() == strongest.rows()[:3]


def test_lengths_by_environment(out: Path) -> None:
    env_ids = {(row["recording"], row["episode"]): row["env_id"] for row in load(out, "episodes").to_dicts()}
    lengths = defaultdict(list)
    for row in load(out, "segments").to_dicts():
        lengths[env_ids[row["recording"], row["episode"]]].append(row["n_steps"])
    expected = [
        (env_id, len(n), pytest.approx(statistics.fmean(n)), statistics.median(n), max(n))
        for env_id, n in sorted(lengths.items())
    ]
    assert load_results.lengths_by_environment(out).rows() == expected


def test_lengths_list_environments_without_composite_actions(out_too_short: Path) -> None:
    assert load_results.lengths_by_environment(out_too_short).rows() == [(None, 0, None, None, None)]


def test_mask_counts(out: Path) -> None:
    steps = load_results.episode_steps(out, Episode("halfcheetah.mcap", 1))
    rows = load(out, "steps").filter(pl.col("recording") == "halfcheetah.mcap", pl.col("episode") == 1).to_dicts()
    segments = load(out, "segments").filter(pl.col("recording") == "halfcheetah.mcap", pl.col("episode") == 1)
    for counts in load_results.mask_counts(steps).to_dict("records"):
        of_joint = [row for row in rows if row["joint"] == counts["joint"]]
        assert counts["joint_name"] == of_joint[0]["joint_name"]
        for mask in load_results.MASKS:
            assert counts[mask] == sum(row[mask] for row in of_joint)
        assert counts["segments"] == segments.filter(pl.col("joint") == counts["joint"]).height
    assert len(load_results.mask_counts(steps)) == 6


def test_the_figure_shows_the_steps(out: Path) -> None:
    steps = load_results.episode_steps(out, Episode("fetch_pickandplace.mcap", 0))
    panels = load_results.masks_figure(steps).axes
    assert [panel.get_ylabel().replace("\n", " ") for panel in panels] == [
        *("dx", "action change", "dy", "action change", "dz", "action change", "gripper", "action change"),
        "state change",
    ]
    for joint, (action, change) in enumerate(zip(panels[0:8:2], panels[1:8:2], strict=True)):
        rows = steps[steps["joint"] == joint]
        trace, *boundaries = action.lines
        np.testing.assert_array_equal(trace.get_ydata(), rows["action"])
        assert [line.get_xdata()[0] for line in boundaries] == rows.loc[rows["boundary"], "step"].to_list()
        np.testing.assert_array_equal(change.lines[0].get_ydata(), rows["action_change"])
        assert shaded_steps(action) == rows.loc[rows["correlated"], "step"].to_list()
        assert shaded_steps(change) == rows.loc[rows["action_mask"], "step"].to_list()
        np.testing.assert_array_equal(panels[8].lines[0].get_ydata(), rows["state_change"])
        assert shaded_steps(panels[8]) == rows.loc[rows["state_mask"], "step"].to_list()


def shaded_steps(panel: load_results.Axes) -> list[int]:
    """The steps in the middle of which a panel is shaded."""
    spans = [path.get_extents().intervalx for collection in panel.collections for path in collection.get_paths()]
    return [step for first, last in spans for step in range(round(first + 0.5), round(last + 0.5))]


def test_the_figure_of_joints_together_or_of_many_joints(out_together: Path, out: Path) -> None:
    together = load_results.episode_steps(out_together, Episode("fetch_pickandplace.mcap", 0))
    assert load_results.masks_figure(together).axes[0].get_ylabel() == "all joints"

    one = load_results.episode_steps(out, Episode("cartpole.mcap", 0))
    many = pd.concat([one.assign(joint=joint, joint_name=None) for joint in range(40)])
    figure = load_results.masks_figure(many)
    assert len(figure.axes) == 2 * load_results.MAX_PLOTTED_JOINTS + 1
    assert "first 16 of 40 joints" in figure.get_suptitle()
    assert figure.axes[2].get_ylabel() == "joint 1"


def test_as_a_command(out: Path, root: Path, tmp_path: Path) -> None:
    plot = tmp_path / "masks.png"
    command = [sys.executable, root / "scripts/load_results.py", out, "--plot", plot, "--episode", "cartpole.mcap:1"]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert load_results.strongest_segments(out)["recording"][0] in done.stdout
    assert "ALE/Tennis-v5" in done.stdout
    assert "cartpole.mcap:1, " in done.stdout
    assert plot.read_bytes().startswith(PNG_SIGNATURE)


def test_the_episode_is_by_default_that_of_the_strongest(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    load_results.main([str(out)])
    recording, episode, *_ = load_results.strongest_segments(out).row(0)
    assert f"\n{recording}:{episode}, " in capsys.readouterr().out


def test_without_composite_actions(out_too_short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plot = tmp_path / "masks.png"
    load_results.main([str(out_too_short), "--plot", str(plot)])
    printed = capsys.readouterr().out
    assert "none: no episode gave a composite action" in printed
    assert "short.mcap:0, 4 steps" in printed
    assert plot.read_bytes().startswith(PNG_SIGNATURE)


def test_without_steps(run: Run, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    run(["extract", root / "fixtures/recordings/cartpole.mcap", "-o", out, "--steps", "none"])
    load_results.main([str(out)])
    printed = capsys.readouterr().out
    assert "CartPole-v1" in printed
    assert "none: no steps/ in it" in printed
    with pytest.raises(SystemExit, match="no plot: no steps/ in it"):
        load_results.main([str(out), "--plot", str(tmp_path / "masks.png")])


@pytest.mark.parametrize(
    ("make_args", "message"),
    [
        (lambda out: [str(out.parent)], "no tables in segments/"),
        (lambda out: [str(out), "--episode", "cartpole.mcap:99"], "no steps of an episode cartpole.mcap:99"),
        (lambda out: [str(out), "--episode", "nothing.mcap:0"], "no steps of an episode nothing.mcap:0"),
    ],
)
def test_what_is_not_there_is_said(out: Path, make_args: Callable[[Path], list[str]], message: str) -> None:
    with pytest.raises(SystemExit, match=message):
        load_results.main(make_args(out))


def test_episodes_are_parsed_from_the_right() -> None:
    assert load_results.parse_episode("a:b/c.mcap:-3") == Episode("a:b/c.mcap", -3)
    for text in ("c.mcap", "c.mcap:", ":3", "c.mcap:x"):
        with pytest.raises(load_results.argparse.ArgumentTypeError, match="expected RECORDING:EPISODE"):
            load_results.parse_episode(text)
