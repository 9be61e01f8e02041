"""The configurations in `configs/`, each on a recording of the layout that it is for."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import layouts
import polars as pl
import pytest
from conftest import Run
from support import START_TIME_NANOS, load, nanos

CONFIGS = ["leader_follower", "protobuf_logs", "ros2_arm"]


def test_every_configuration_has_a_test(root: Path) -> None:
    assert sorted(path.stem for path in (root / "configs").glob("*")) == CONFIGS


@pytest.mark.parametrize("name", CONFIGS)
def test_nothing_but_what_is_written_differs_from_the_defaults(run: Run, root: Path, name: str) -> None:
    path = root / f"configs/{name}.toml"
    used = tomllib.loads(run(["extract", "--config", path, "--print-config"]).stdout)
    defaults = tomllib.loads(run(["extract", "--print-config"]).stdout)
    written = {
        key: [value] if key in ("action", "state") and isinstance(value, str) else value
        for key, value in tomllib.loads(path.read_text()).items()
    }
    assert used == defaults | written


def extract(run: Run, root: Path, tmp_path: Path, name: str, inputs: Path, expect: int = 0) -> Path:
    out = tmp_path / "out"
    run(["extract", "--config", root / f"configs/{name}.toml", inputs, "-o", out], expect)
    return out


def test_ros2_arm(run: Run, root: Path, tmp_path: Path) -> None:
    layouts.write_arm(tmp_path / "in/arm.mcap")
    layouts.write_split_bag(tmp_path / "in/pick_01")
    out = extract(run, root, tmp_path, "ros2_arm", tmp_path / "in")
    episodes = load(out, "episodes")
    assert episodes["recording"].to_list() == ["arm.mcap", "pick_01"]
    assert episodes["n_steps"].to_list() == [300, 300]
    steps = load(out, "steps").filter(pl.col("recording") == "arm.mcap")
    assert steps["joint_name"].unique(maintain_order=True).to_list() == layouts.ARM
    assert load(out, "segments").height > 0


def test_leader_follower(run: Run, root: Path, tmp_path: Path) -> None:
    layouts.write_leader_follower(tmp_path / "in/demo.mcap")
    out = extract(run, root, tmp_path, "leader_follower", tmp_path / "in", expect=3)
    recording = load(out, "recordings").row(0, named=True)
    assert (recording["clock"], recording["align"]) == ("header", "before")
    # The follower is silent for 0.4 s: but for 50 ms, the 20 steps in it are without a state.
    (cause,) = recording["causes"]
    assert cause["cause"] == "step without a state within --max-age"
    assert cause["count"] == 18
    episode = load(out, "episodes").row(0, named=True)
    assert (episode["status"], episode["n_steps"], episode["n_dropped_steps"]) == ("ok", 482, 18)
    assert load(out, "steps")["joint"].unique().to_list() == [-1]


def test_protobuf_logs(run: Run, root: Path, tmp_path: Path) -> None:
    layouts.write_protobuf_logs(tmp_path / "in")
    out = extract(run, root, tmp_path, "protobuf_logs", tmp_path / "in")
    episodes = load(out, "episodes")
    assert episodes["recording"].to_list() == ["episode_000000.mcap", "episode_000001.mcap"]
    assert episodes.select("n_steps", "n_joints", "n_state_dims").rows() == [(400, 14, 14)] * 2
    # That of the day, not that since the start of the machine.
    assert all(time > START_TIME_NANOS for time in nanos(episodes["start_time"]))
    assert not (out / "steps").exists()
    check_columns(out, [layouts.Motion(10, 7).command, layouts.Motion(20, 7).command])


def check_columns(out: Path, arms: list[Callable[[int], list[float]]]) -> None:
    """The joints of a segment are those of the arms, one after the other."""
    segments = load(out, "segments").filter(pl.col("recording") == "episode_000000.mcap")
    assert segments.height > 0
    for row in segments.iter_rows(named=True):
        # The right leader is as old as the left, since both publish at once.
        times = [1_000_000 + step * 20_000_000 for step in range(row["start_step"], row["end_step"])]
        arm, joint = divmod(row["joint"], 7)
        assert row["actions"] == pytest.approx([arms[arm](t)[joint] for t in times], rel=1e-6)
