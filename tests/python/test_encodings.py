"""Real recordings in every encoding: those of the same episodes give the same tables, those of robots are put on the
clock of their commands as Python does it."""

from __future__ import annotations

import json
import random
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import reference
from conftest import Run
from mcap_ros2.decoder import DecoderFactory
from polars.testing import assert_frame_equal
from support import SECOND, Message, Topic, actions_of, load, nanos, read_messages, read_metadata, write_recording

EACH_ROBOT = pytest.mark.parametrize("name", ["pendulum", "halfcheetah", "pong_ram"])
STATE_TOPIC = {"pendulum": "/joint_states", "halfcheetah": "/joint_states", "pong_ram": "/ram"}


@pytest.fixture(scope="session")
def recordings(root: Path) -> Path:
    """The folder of recordings in other encodings than those of the fixtures."""
    return root / "tests/data/recordings"


# The native convention ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def json_out(run: Run, root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of the JSON recording whose episodes the other encodings hold too."""
    out = tmp_path_factory.mktemp("json") / "out"
    run(["extract", root / "fixtures/recordings/pendulum.mcap", "-o", out])
    return out


@pytest.mark.parametrize("encoding", ["protobuf", "cbor", "msgpack"])
def test_every_encoding_gives_the_tables_of_json(
    run: Run, recordings: Path, json_out: Path, tmp_path: Path, encoding: str
) -> None:
    out = tmp_path / "out"
    run(["extract", recordings / encoding / "pendulum.mcap", "-o", out])
    for table in ("segments", "steps", "episodes"):
        assert_frame_equal(load(out, table), load(json_out, table), check_exact=True)
    of_file = ["bytes", "encoding"]
    assert load(out, "recordings")["encoding"].to_list() == [encoding]
    assert_frame_equal(load(out, "recordings").drop(of_file), load(json_out, "recordings").drop(of_file))
    assert load(out, "segments").height > 0


# ROS 2 ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bag:
    """What a robot logged: each topic's times and values, in the order of time."""

    command_times: list[int]
    commands: np.ndarray
    state_times: list[int]
    states: np.ndarray

    def before(self, max_age: int | None = None) -> tuple[list[int], list[int]]:
        """Which commands have a state at or before them, and the latest such state of each."""
        commands, states = [], []
        for i, time in enumerate(self.command_times):
            latest = bisect_right(self.state_times, time) - 1
            if latest >= 0 and (max_age is None or time - self.state_times[latest] <= max_age):
                commands.append(i)
                states.append(latest)
        return commands, states

    def nearest(self) -> tuple[list[int], list[int]]:
        """Every command, and the state nearest to it; of two equally near the earlier."""
        distances = [[abs(state - time) for state in self.state_times] for time in self.command_times]
        return list(range(len(self.command_times))), [row.index(min(row)) for row in distances]


def read_bag(path: Path, state_topic: str) -> Bag:
    """Reads a bag with `mcap` and `mcap-ros2-support`, which share no line with coact."""
    decoders = DecoderFactory()
    found: dict[str, list[tuple[int, list[float]]]] = {"/command": [], state_topic: []}
    for schema, channel, message in read_messages(path):
        decoded = decoders.decoder_for(channel.message_encoding, schema)(message.data)
        values = decoded.position if schema.name.endswith("JointState") else decoded.data
        found[channel.topic].append((message.log_time, list(values)))
    commands, states = (sorted(found[topic], key=lambda m: m[0]) for topic in ("/command", state_topic))
    return Bag(
        [time for time, _ in commands],
        np.array([values for _, values in commands], dtype=float),
        [time for time, _ in states],
        np.array([values for _, values in states], dtype=float),
    )


def selectors(name: str) -> list[str]:
    """Options that a recording needs: bytes can be a state or an action, so `auto` does not guess."""
    return ["--action", "/command:data", "--state", "/ram:data"] if name == "pong_ram" else []


def check(out: Path, bag: Bag, aligned: tuple[list[int], list[int]], joint_names: list[str]) -> None:
    """The steps are the commands with the states of their times."""
    commands, states = aligned
    steps = load(out, "steps")
    expected = bag.commands[commands]
    assert actions_of(out) == expected.tolist()
    for joint, (name, part) in enumerate(
        zip(joint_names, steps.partition_by("joint", maintain_order=True), strict=True)
    ):
        assert set(part["joint_name"]) == {name}
        assert nanos(part["time"]) == [bag.command_times[i] for i in commands]
        action_measure = reference.measure(expected[:, [joint]])
        np.testing.assert_allclose(part["action_measure"], action_measure, rtol=1e-10, atol=1e-13)
    # The tables hold no states: their measure tells whether they are the right ones.
    state_measure = reference.measure(bag.states[states])
    assert len(set(state_measure)) > 20
    first_joint = steps.filter(steps["joint"] == 0)
    np.testing.assert_allclose(first_joint["state_measure"], state_measure, rtol=1e-10, atol=1e-13)


@EACH_ROBOT
def test_commands_are_steps_with_the_latest_state(run: Run, recordings: Path, tmp_path: Path, name: str) -> None:
    path, out = recordings / f"ros2/{name}.mcap", tmp_path / "out"
    run(["extract", path, "-o", out, *selectors(name)])
    bag = read_bag(path, STATE_TOPIC[name])
    check(out, bag, bag.before(), json.loads(read_metadata(path)["action_names"]))
    recording = load(out, "recordings").row(0, named=True)
    n_messages = len(bag.commands) + len(bag.states)
    assert recording["env_id"] == read_metadata(path)["env_id"]
    assert (recording["encoding"], recording["align"], recording["clock"]) == ("cdr", "before", "log")
    assert recording["state_selector"] == f"{STATE_TOPIC[name]}:{'data' if name == 'pong_ram' else 'position'}"
    assert (recording["n_messages"], recording["n_messages_used"]) == (n_messages, n_messages)


def rewritten(source: Path, target: Path, keep: float, seed: int) -> Path:
    """A copy without the states of the first `keep` seconds, its messages in an order that is not that of time."""
    messages = read_messages(source)
    start = min(message.log_time for *_, message in messages)
    topics = {c.topic: Topic(c.message_encoding, (s.name, s.encoding, s.data)) for s, c, _ in messages}
    kept = [
        Message(channel.topic, message.log_time, message.data)
        for _, channel, message in messages
        if channel.topic == "/command" or message.log_time >= start + keep * SECOND
    ]
    random.Random(seed).shuffle(kept)
    return write_recording(target, topics, kept, read_metadata(source), profile="ros2")


@EACH_ROBOT
def test_steps_before_the_first_state_are_dropped_and_counted(
    run: Run, recordings: Path, tmp_path: Path, name: str
) -> None:
    path = rewritten(recordings / f"ros2/{name}.mcap", tmp_path / "late.mcap", keep=1.5, seed=1)
    out = tmp_path / "out"
    run(["extract", path, "-o", out, *selectors(name)])
    bag = read_bag(path, STATE_TOPIC[name])
    aligned = bag.before()
    n_dropped = len(bag.commands) - len(aligned[0])
    assert n_dropped > 20
    check(out, bag, aligned, json.loads(read_metadata(path)["action_names"]))
    episode = load(out, "episodes").row(0, named=True)
    assert (episode["status"], episode["n_dropped_steps"]) == ("ok", n_dropped)
    recording = load(out, "recordings").row(0, named=True)
    assert recording["n_messages_used"] == recording["n_messages"] - n_dropped
    assert [(c["cause"], c["count"]) for c in recording["causes"]] == [("step before the first state", n_dropped)]


def test_the_nearest_state_may_come_after_its_command(run: Run, recordings: Path, tmp_path: Path) -> None:
    path, out = recordings / "ros2/pendulum.mcap", tmp_path / "out"
    run(["extract", path, "-o", out, "--align", "nearest"])
    bag = read_bag(path, "/joint_states")
    assert bag.nearest() != bag.before()
    check(out, bag, bag.nearest(), ["torque"])


def test_states_past_the_greatest_age_are_not_used(run: Run, recordings: Path, tmp_path: Path) -> None:
    path, out = recordings / "ros2/pendulum.mcap", tmp_path / "out"
    run(["extract", path, "-o", out, "--max-age", "0.025"], expect=3)
    bag = read_bag(path, "/joint_states")
    aligned = bag.before(max_age=25_000_000)
    assert 100 < len(aligned[0]) < len(bag.commands)
    check(out, bag, aligned, ["torque"])
