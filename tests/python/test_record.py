"""Recordings made by scripts/record_rollouts.py, held against the same rollouts without it and against coact."""

from __future__ import annotations

import json
import shutil
import sys
import types
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import polars as pl
import pytest
from conftest import Run
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from mcap.reader import make_reader

import record_rollouts
from record_rollouts import RecordRollouts, RecordVectorRollouts
from scripted_policies import balance_pole

START_TIME_NANOS = 1_700_000_000_000_000_000
# With the default measure and window, shorter episodes cannot be cut.
MIN_STEPS = 10
Steps = list[dict[str, Any]]


# Reading back ---------------------------------------------------------------------------------------------------------


def read_steps(path: Path) -> dict[int, Steps]:
    """The messages of a recording by episode, in the order in which they were written."""
    episodes: dict[int, Steps] = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            assert (channel.topic, channel.message_encoding) == ("/step", "json")
            step = json.loads(message.data)
            episodes[step["episode"]].append(step)
    return dict(episodes)


def read_metadata(path: Path) -> dict[str, str]:
    with path.open("rb") as stream:
        (record,) = make_reader(stream).iter_metadata()
    assert record.name == "recording"
    return record.metadata


def read_log_times(path: Path) -> list[int]:
    with path.open("rb") as stream:
        return [m.log_time for _, _, m in make_reader(stream).iter_messages(log_time_order=False)]


def extract(run: Run, recording: Path, expect: int = 0) -> pl.DataFrame:
    """The episodes table that coact makes of a recording; the steps table is checked against it."""
    out = recording.with_suffix(".tables")
    run(["extract", recording, "-o", out, "-q"], expect)
    episodes = pl.read_parquet(out / "episodes" / "*.parquet").sort("episode")
    steps = pl.read_parquet(out / "steps" / "*.parquet")
    assert steps.filter(pl.col("joint") == 0).height == episodes["n_steps"].sum()
    return episodes


def check_tables(episodes: pl.DataFrame, recorded: dict[int, Steps], env_id: str | None) -> None:
    """coact found exactly the recorded episodes, whole."""
    assert episodes["episode"].to_list() == sorted(recorded)
    for row in episodes.iter_rows(named=True):
        steps = recorded[row["episode"]]
        assert [step["step"] for step in steps] == list(range(len(steps)))
        status = "ok" if len(steps) >= MIN_STEPS else "too_short"
        assert (row["status"], row["n_steps"], row["n_dropped_steps"]) == (status, len(steps), 0)
        assert row["episode_return"] == pytest.approx(sum(step["reward"] for step in steps), rel=1e-12, abs=1e-12)
        assert row["env_id"] == env_id


# The same rollouts, without the recorder ------------------------------------------------------------------------------


def lean(observation: np.ndarray) -> int:
    """A poor player of CartPole, whose episodes are short."""
    return int(observation[2] > 0)


def play(env: gym.Env, policy: Callable[[Any], Any], n_episodes: int, seed: int) -> list[Steps]:
    """What should be recorded of `n_episodes` of `env`, except for the number of the episode."""
    episodes = []
    for episode in range(n_episodes):
        observation, _ = env.reset(seed=seed if episode == 0 else None)
        steps: Steps = []
        ended = False
        while not ended:
            action, state = policy(observation), np.array(observation).tolist()
            observation, reward, terminated, truncated, _ = env.step(action)
            ended = terminated or truncated
            steps.append(
                {
                    "step": len(steps),
                    "action": np.asarray(action).tolist(),
                    "state": state,
                    "reward": float(reward),
                    "terminated": terminated,
                    "truncated": truncated,
                }
            )
        episodes.append(steps)
    return episodes


def without_number(steps: Steps) -> Steps:
    return [{name: value for name, value in step.items() if name != "episode"} for step in steps]


# One environment ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("policy", "n_episodes"), [("scripted", 2), ("random", 3)])
def test_cartpole_from_the_command_line(
    tmp_path: Path, run: Run, capsys: pytest.CaptureFixture[str], policy: str, n_episodes: int
) -> None:
    path = tmp_path / "cartpole.mcap"
    record_rollouts.main(["CartPole-v1", str(path), "--episodes", str(n_episodes), "--policy", policy, "--seed", "4"])
    recorded = read_steps(path)
    assert len(recorded) == n_episodes
    assert f"{n_episodes} episodes, {sum(map(len, recorded.values()))} steps" in capsys.readouterr().out
    check_tables(extract(run, path), recorded, "CartPole-v1")
    metadata = read_metadata(path)
    assert metadata["policy"] == policy
    assert metadata["seed"] == "4"
    assert metadata["rate_hz"] == "50"
    assert json.loads(metadata["action_names"]) == ["push"]
    assert json.loads(metadata["state_names"]) == ["cart_pos", "cart_vel", "pole_angle", "pole_ang_vel"]
    assert metadata["gymnasium"] == gym.__version__
    if policy == "scripted":
        expected = play(gym.make("CartPole-v1"), balance_pole, n_episodes, seed=4)
        assert [without_number(steps) for steps in recorded.values()] == expected


@pytest.mark.parametrize("env_id", ["CartPole-v1", "Pendulum-v1", "MountainCar-v0", "Acrobot-v1"])
def test_the_wrapper_records_what_happened(tmp_path: Path, run: Run, env_id: str) -> None:
    def policy_of(env: gym.Env) -> Callable[[Any], Any]:
        env.action_space.seed(5)
        return lambda _: env.action_space.sample()

    path = tmp_path / "run.mcap"
    with RecordRollouts(gym.make(env_id, max_episode_steps=60), path, policy="random") as env:
        play(env, policy_of(env), n_episodes=2, seed=3)
    bare = gym.make(env_id, max_episode_steps=60)
    expected = play(bare, policy_of(bare), n_episodes=2, seed=3)
    recorded = read_steps(path)
    assert [without_number(steps) for steps in recorded.values()] == expected
    check_tables(extract(run, path), recorded, env_id)


def test_actions_in_the_steps_table_are_the_recorded_ones(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "pendulum.mcap"
    record_rollouts.main(["Pendulum-v1", str(path), "--policy", "scripted", "--seed", "0", "--max-steps", "80"])
    extract(run, path)
    table = pl.read_parquet(path.with_suffix(".tables") / "steps" / "*.parquet").sort("step")
    assert [[action] for action in table["action"]] == [step["action"] for step in read_steps(path)[0]]


def test_pong_ram_with_a_scripted_policy(tmp_path: Path, run: Run) -> None:
    pytest.importorskip("ale_py")
    path = tmp_path / "pong.mcap"
    record_rollouts.main(
        ["ALE/Pong-v5", str(path), "--policy", "scripted", "--seed", "2", "--max-steps", "200", "--obs-type", "ram"]
    )
    recorded = read_steps(path)
    assert {len(step["state"]) for step in recorded[0]} == {128}
    assert all(type(value) is int for step in recorded[0] for value in [step["action"], *step["state"]])
    assert recorded[0][-1]["truncated"]
    metadata = read_metadata(path)
    assert metadata["rate_hz"] == "15"
    assert json.loads(metadata["action_names"]) == ["joystick"]
    assert json.loads(metadata["state_names"])[:2] == ["ram_0", "ram_1"]

    episodes = extract(run, path)
    check_tables(episodes, recorded, "ALE/Pong-v5")
    assert episodes["n_state_dims"].to_list() == [128]
    assert episodes["n_steps"].to_list() == [200]


@pytest.mark.parametrize("game", ["Boxing", "Breakout", "Skiing", "Tennis"])
def test_each_scripted_game_plays(tmp_path: Path, run: Run, game: str) -> None:
    pytest.importorskip("ale_py")
    path = tmp_path / "game.mcap"
    record_rollouts.main([f"ALE/{game}-v5", str(path), "--policy", "scripted", "--seed", "1", "--max-steps", "60"])
    recorded = read_steps(path)
    assert len({step["action"] for step in recorded[0]}) > 1
    check_tables(extract(run, path), recorded, f"ALE/{game}-v5")


def test_an_image_has_a_shape_in_place_of_names(tmp_path: Path, run: Run) -> None:
    pytest.importorskip("ale_py")
    path = tmp_path / "grey.mcap"
    record_rollouts.main(["ALE/Pong-v5", str(path), "--obs-type", "grayscale", "--max-steps", "12", "--seed", "1"])
    metadata = read_metadata(path)
    assert json.loads(metadata["state_shape"]) == [210, 160]
    assert "state_names" not in metadata
    assert extract(run, path)["n_state_dims"].to_list() == [210 * 160]


class Toy(gym.Env):
    """A nested observation and action, in keys that are not sorted, changed in place from step to step."""

    observation_space = gym.spaces.Dict(
        {
            "velocity": gym.spaces.Box(-9, 9, (2,), np.float32),
            "gear": gym.spaces.Discrete(3, start=1),
            "arm": gym.spaces.Tuple([gym.spaces.MultiBinary(2), gym.spaces.Box(-9, 9, (), np.float64)]),
        }
    )
    action_space = gym.spaces.Dict({"turn": gym.spaces.Box(-1, 1, (2,), np.float32), "brake": gym.spaces.Discrete(2)})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.n_steps = 0
        self.velocity = np.zeros(2, np.float32)
        return self.observe(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.n_steps += 1
        self.velocity += action["turn"]
        action["turn"][:] = 7
        return self.observe(), 0.5, False, self.n_steps == 20, {}

    def observe(self) -> dict[str, Any]:
        gear = np.int64(1 + self.n_steps % 3)
        arm = (np.array([self.n_steps % 2, 1], np.int8), np.array(0.1 * self.n_steps))
        return {"velocity": self.velocity, "gear": gear, "arm": arm}


def test_nested_spaces_are_laid_out_flat(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "toy.mcap"
    with RecordRollouts(Toy(), path, env_id="toy", rate_hz=10) as env:
        env.reset()
        for step in range(20):
            env.step({"turn": np.array([0.1, 0.01 * step], np.float32), "brake": step % 2})
    recorded = read_steps(path)
    velocity = np.zeros(2, np.float32)
    for number, written in enumerate(recorded[0]):
        turn = np.array([0.1, 0.01 * number], np.float32)
        assert written["action"] == [number % 2, *map(float, turn)]
        # arm, gear, velocity: sorted.
        assert written["state"] == [number % 2, 1, 0.1 * number, 1 + number % 3, *map(float, velocity)]
        velocity += turn
    metadata = read_metadata(path)
    assert json.loads(metadata["action_names"]) == ["brake", "turn_0", "turn_1"]
    names = ["arm_0_0", "arm_0_1", "arm_1", "gear", "velocity_0", "velocity_1"]
    assert json.loads(metadata["state_names"]) == names
    episodes = extract(run, path)
    check_tables(episodes, recorded, "toy")
    assert episodes.select("n_joints", "n_state_dims").row(0) == (3, 6)


# Vector environments --------------------------------------------------------------------------------------------------


def play_vector(env: RecordVectorRollouts, mode: AutoresetMode, n_steps: int, seed: int) -> None:
    """Plays `n_steps` rounds, as a training loop for the given mode does."""
    observations, _ = env.reset(seed=seed)
    for _ in range(n_steps):
        observations, _, terminations, truncations, _ = env.step(np.array([lean(one) for one in observations]))
        ended = terminations | truncations
        if mode is AutoresetMode.DISABLED and ended.any():
            observations, _ = env.reset(options={"reset_mask": ended})


@pytest.mark.parametrize("mode", AutoresetMode)
def test_vector_environments_interleave_without_bogus_steps(tmp_path: Path, run: Run, mode: AutoresetMode) -> None:
    path = tmp_path / "vector.mcap"
    vector = SyncVectorEnv([lambda: gym.make("CartPole-v1")] * 3, autoreset_mode=mode)
    with RecordVectorRollouts(vector, path) as env:
        play_vector(env, mode, n_steps=150, seed=8)
    recorded = read_steps(path)
    check_tables(extract(run, path), recorded, "CartPole-v1")

    # Each sub-environment on its own, for longer than its part of the recording.
    whole = [play(gym.make("CartPole-v1"), lean, n_episodes=12, seed=8 + index) for index in range(3)]
    by_first_state = {str(steps[0]["state"]): (i, n) for i, own in enumerate(whole) for n, steps in enumerate(own)}
    found = defaultdict(list)
    for steps in recorded.values():
        index, number = by_first_state[str(steps[0]["state"])]
        found[index].append(number)
        expected = whole[index][number]
        assert without_number(steps) == expected[: len(steps)]
        # Only what the end of the run cut off is without its last step.
        if len(steps) < len(expected):
            assert number == max(found[index])
    n_resets = 0
    for numbers in found.values():
        assert numbers == list(range(len(numbers)))
        assert len(numbers) > 2
        n_resets += len(numbers) - 1
    n_recorded = sum(map(len, recorded.values()))
    if mode is AutoresetMode.NEXT_STEP:
        # A reset takes a round; one that was the last round has no episode after it.
        assert 450 - n_resets - 3 <= n_recorded <= 450 - n_resets
    else:
        assert n_recorded == 450


def test_a_vector_from_the_command_line_records_the_first_episodes(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "vector.mcap"
    record_rollouts.main(["CartPole-v1", str(path), "--episodes", "5", "--n-envs", "3", "--seed", "1"])
    recorded = read_steps(path)
    assert all(steps[-1]["terminated"] for steps in recorded.values())
    assert len(recorded) == 5
    check_tables(extract(run, path), recorded, "CartPole-v1")


# A file that grows ----------------------------------------------------------------------------------------------------


def test_a_growing_file_holds_the_finished_episodes(tmp_path: Path, run: Run) -> None:
    path, copy = tmp_path / "growing.mcap", tmp_path / "copy.mcap"
    with RecordRollouts(gym.make("CartPole-v1"), path) as env:
        expected = play(env, lean, n_episodes=3, seed=6)
        env.reset()
        env.step(0)
        shutil.copy(path, copy)
    # There is no end of the file yet, which is worth a 3, but nothing is missing.
    episodes = extract(run, copy, expect=3)
    assert episodes["status"].to_list() == ["ok"] * 3
    assert episodes["n_steps"].to_list() == list(map(len, expected))
    recordings = pl.read_parquet(copy.with_suffix(".tables") / "recordings" / "*.parquet")
    assert recordings["status"].to_list() == ["recovered"]
    assert recordings["env_id"].to_list() == ["CartPole-v1"]


def test_an_error_in_training_leaves_a_finished_file(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "failed.mcap"
    with pytest.raises(ZeroDivisionError), RecordRollouts(gym.make("CartPole-v1"), path) as env:
        play(env, lean, n_episodes=1, seed=6)
        env.reset()
        for step in range(7):
            env.step(step % 2)
        raise ZeroDivisionError
    recorded = read_steps(path)
    assert len(recorded[1]) == 7
    assert not any(step["terminated"] or step["truncated"] for step in recorded[1])
    check_tables(extract(run, path), recorded, "CartPole-v1")


def test_an_existing_file_is_kept_unless_told_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "kept.mcap"
    path.write_text("precious")
    with pytest.raises(SystemExit, match="exists"):
        record_rollouts.main(["CartPole-v1", str(path)])
    assert path.read_text() == "precious"
    record_rollouts.main(["CartPole-v1", str(path), "--overwrite"])
    assert len(read_steps(path)) == 1


def test_a_start_time_makes_the_file_reproducible(tmp_path: Path) -> None:
    files = [tmp_path / "first.mcap", tmp_path / "second.mcap"]
    for path in files:
        options = ["--seed", "1", "--episodes", "2", "--start-time", str(START_TIME_NANOS)]
        record_rollouts.main(["CartPole-v1", str(path), *options])
    assert files[0].read_bytes() == files[1].read_bytes()
    times = read_log_times(files[0])
    assert times == [START_TIME_NANOS + 20_000_000 * step for step in range(len(times))]


def test_times_rise_without_a_known_rate(tmp_path: Path) -> None:
    path = tmp_path / "toy.mcap"
    with RecordRollouts(Toy(), path) as env:
        env.reset()
        for _ in range(20):
            env.step({"turn": np.zeros(2, np.float32), "brake": 0})
    times = read_log_times(path)
    assert times == sorted(set(times))
    assert "rate_hz" not in read_metadata(path)
    with pytest.raises(ValueError, match="rate_hz"):
        RecordRollouts(Toy(), tmp_path / "other.mcap", start_time_nanos=START_TIME_NANOS)


# Policies and misuse --------------------------------------------------------------------------------------------------


def test_a_model_file_plays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stand-in for stable-baselines3, with the two calls that are made of it."""

    class Model:
        @classmethod
        def load(cls, path: str, device: str) -> Model:
            assert (path, device) == ("runs/best.zip", "cpu")
            return cls()

        def predict(self, observation: np.ndarray, deterministic: bool) -> tuple[np.ndarray, None]:
            assert deterministic
            return np.array(lean(observation)), None

    monkeypatch.setitem(sys.modules, "stable_baselines3", types.SimpleNamespace(DQN=Model))
    path = tmp_path / "model.mcap"
    options = ["--policy", "sb3:runs/best.zip:DQN", "--seed", "3", "--episodes", "2"]
    record_rollouts.main(["CartPole-v1", str(path), *options])
    expected = play(gym.make("CartPole-v1"), lean, n_episodes=2, seed=3)
    assert [without_number(steps) for steps in read_steps(path).values()] == expected


def test_a_value_that_is_not_finite_is_an_error(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "nan.mcap"
    with RecordRollouts(Toy(), path, env_id="toy") as env:
        env.reset()
        for _ in range(15):
            env.step({"turn": np.zeros(2, np.float32), "brake": 0})
        with pytest.raises(ValueError, match="episode 0, step 15: action not finite"):
            env.step({"turn": np.array([np.nan, 0], np.float32), "brake": 0})
    assert len(read_steps(path)[0]) == 15
    assert extract(run, path)["n_steps"].to_list() == [15]


def test_a_step_after_the_last_needs_a_reset(tmp_path: Path) -> None:
    with RecordRollouts(gym.make("CartPole-v1"), tmp_path / "run.mcap") as env:
        with pytest.raises(gym.error.ResetNeeded):
            env.step(0)
        play(env, lean, n_episodes=1, seed=0)
        with pytest.raises(gym.error.ResetNeeded):
            env.step(0)


def test_autoreset_of_a_single_environment_is_no_step(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RecordRollouts(gym.wrappers.Autoreset(gym.make("CartPole-v1")), path) as env:
        observation, _ = env.reset(seed=6)
        for _ in range(150):
            observation, *_ = env.step(lean(observation))
    expected = play(gym.make("CartPole-v1"), lean, n_episodes=9, seed=6)
    for steps, whole in zip(read_steps(path).values(), expected, strict=False):
        assert without_number(steps) == whole[: len(steps)]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["CartPole-v1", "--policy", "sb3:model.zip"], "pip install stable-baselines3"),
        (["CartPole-v1", "--policy", "clever"], "no policy 'clever'"),
        (["CartPole-v1", "--obs-type", "ram"], "ALE"),
        (["Taxi-v4", "--policy", "scripted"], "no scripted policy"),
        (["NoSuchEnv-v0"], "NoSuchEnv"),
    ],
)
def test_wrong_arguments_are_explained_and_leave_no_file(tmp_path: Path, args: list[str], message: str) -> None:
    if "sb3:model.zip" in args and record_rollouts.library_versions().get("stable_baselines3"):
        pytest.skip("stable-baselines3 is installed")
    path = tmp_path / "none.mcap"
    with pytest.raises(SystemExit, match=message):
        record_rollouts.main([args[0], str(path), *args[1:]])
    assert not path.exists()
