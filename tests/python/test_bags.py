"""Bags and messages as other tools write them: rosbag2 directories, ROS 1, random messages of many types and encodings,
each decoded by coact through selectors and held against what Python wrote."""

from __future__ import annotations

import json
import random
import shlex
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import cbor2
import msgpack
import numpy as np
import pytest
from conftest import Run
from layouts import float_array
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as Ros2Writer
from polars.testing import assert_frame_equal
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore
from ruamel.yaml import YAML
from support import (
    ROS1,
    ROS2,
    SECOND,
    START_TIME_NANOS,
    Message,
    Topic,
    actions_of,
    cdr,
    load,
    nanos,
    ros1,
    ros1_topic,
    ros2_topic,
    stamp,
    write_recording,
)

JOINT_STATE = "sensor_msgs/msg/JointState"
COMMAND = "std_msgs/msg/Float64MultiArray"
JOINTS = ["shoulder", "elbow", "wrist"]
PERIOD = SECOND // 50
N_STEPS = 40
COUNT_COLUMNS = ["recording", "bytes"]

Logged = list[tuple[str, str, int, dict[str, Any]]]


def arm_log(seed: int, n_steps: int = N_STEPS) -> Logged:
    """Topic, type, time and content of the messages of an arm: states, each with a command 1 ms later."""
    rng = random.Random(seed)
    log: Logged = []
    for step in range(n_steps):
        time = START_TIME_NANOS + step * PERIOD
        position = [rng.uniform(-3, 3) for _ in JOINTS]
        state = {"header": stamp(time), "name": JOINTS, "position": position, "velocity": [], "effort": []}
        log.append(("/joint_states", JOINT_STATE, time, state))
        log.append(("/arm/commands", COMMAND, time + 1_000_000, {"data": [rng.uniform(-3, 3) for _ in JOINTS]}))
    return log


def commands_of(log: Logged) -> list[list[float]]:
    return [value["data"] for topic, _, _, value in log if topic == "/arm/commands"]


# rosbag2 --------------------------------------------------------------------------------------------------------------


def write_bag(path: Path, log: Logged, version: Literal[8, 9] = 9, writer: BagWriter | None = None) -> Path:
    """A bag directory of one MCAP file, written by rosbags."""
    with writer or BagWriter(path, version=version, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {}
        for topic, type_name, time, value in log:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, type_name, typestore=ROS2)
            bag.write(connections[topic], time, cdr(type_name, value))
    return path


def write_split_bag(path: Path, parts: list[Logged], version: Literal[8, 9] = 9) -> Path:
    """A bag of several files. rosbags does not split: bags of one file each become one, as rosbag2 would list them."""
    path.mkdir(parents=True)
    yaml = YAML(typ="safe")
    documents = []
    for i, log in enumerate(parts):
        part = write_bag(path.parent / f"{path.name}-part-{i}", log, version)
        (file,) = part.glob("*.mcap")
        file.rename(path / f"{path.name}_{i}.mcap")
        documents.append(yaml.load((part / "metadata.yaml").read_text())["rosbag2_bagfile_information"])
        shutil.rmtree(part)
    whole = documents[0]
    whole["relative_file_paths"] = [f"{path.name}_{i}.mcap" for i in range(len(parts))]
    whole["files"] = [
        {
            "path": name,
            "starting_time": {"nanoseconds_since_epoch": document["starting_time"]["nanoseconds_since_epoch"]},
            "duration": document["duration"],
            "message_count": document["message_count"],
        }
        for name, document in zip(whole["relative_file_paths"], documents, strict=True)
    ]
    whole["message_count"] = sum(document["message_count"] for document in documents)
    whole["duration"]["nanoseconds"] = sum(document["duration"]["nanoseconds"] for document in documents)
    with (path / "metadata.yaml").open("w") as stream:
        yaml.dump({"rosbag2_bagfile_information": whole}, stream)
    return path


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("cuts", [[30], [1], [13, 14, 60]])
def test_a_split_bag_is_one_recording_with_the_rows_of_one_file(
    run: Run, tmp_path: Path, version: Literal[8, 9], cuts: list[int]
) -> None:
    log = arm_log(seed=3)
    parts = [log[a:b] for a, b in zip([0, *cuts], [*cuts, len(log)], strict=True)]
    bag = write_split_bag(tmp_path / "runs/pick_01", parts, version)
    (whole,) = write_bag(tmp_path / "whole", log, version).glob("*.mcap")
    outs = {}
    for name, inputs in {"bag": bag, "above": bag.parent, "whole": whole}.items():
        outs[name] = tmp_path / f"out-{name}"
        run(["extract", inputs, "-o", outs[name]])
    for table in ("segments", "steps", "episodes", "recordings"):
        expected = load(outs["whole"], table).drop(COUNT_COLUMNS, strict=False)
        for name in ("bag", "above"):
            found = load(outs[name], table)
            assert set(found["recording"]) <= {"pick_01"}
            assert_frame_equal(found.drop(COUNT_COLUMNS, strict=False), expected, check_exact=True)
    assert actions_of(outs["bag"]) == commands_of(log)
    size = sum(file.stat().st_size for file in bag.glob("*.mcap"))
    assert load(outs["bag"], "recordings")["bytes"].to_list() == [size]


def test_the_files_of_a_bag_come_in_the_order_of_its_metadata(run: Run, tmp_path: Path) -> None:
    """Ten files and more: by name, `_10` would come before `_2`. A position in the topic is what tells."""
    log = arm_log(seed=4, n_steps=36)
    bag = write_split_bag(tmp_path / "bag", [log[i : i + 6] for i in range(0, len(log), 6)])
    run(["extract", bag, "-o", tmp_path / "out", "--align", "index"])
    assert actions_of(tmp_path / "out") == commands_of(log)
    assert load(tmp_path / "out", "recordings")["align"].to_list() == ["index"]


def test_two_bags_are_two_recordings_beside_plain_files(run: Run, tmp_path: Path) -> None:
    logs = [arm_log(seed) for seed in (5, 6, 7)]
    write_split_bag(tmp_path / "in/a", [logs[0][:40], logs[0][40:]])
    write_bag(tmp_path / "in/b", logs[1])
    (file,) = write_bag(tmp_path / "loose", logs[2]).glob("*.mcap")
    file.rename(tmp_path / "in/c.mcap")
    run(["extract", tmp_path / "in", "-o", tmp_path / "out"])
    recordings = load(tmp_path / "out", "recordings")
    assert recordings["recording"].to_list() == ["a", "b", "c.mcap"]
    assert recordings["status"].to_list() == ["ok"] * 3


@pytest.mark.parametrize("selectors", [[], ["--action", "/arm/commands:data", "--state", "/joint_states:position"]])
@pytest.mark.parametrize(("lacking", "kept"), [(1, slice(0, 20)), (0, slice(20, 40))])
def test_a_bag_that_lacks_a_file_is_read_as_far_as_it_is_there(
    run: Run, tmp_path: Path, lacking: int, kept: slice, selectors: list[str]
) -> None:
    logs = [arm_log(seed) for seed in (5, 6)]
    bag = write_split_bag(tmp_path / "in/a", [logs[0][:40], logs[0][40:]])
    write_bag(tmp_path / "in/b", logs[1])
    (bag / f"a_{lacking}.mcap").unlink()
    done = run(["extract", tmp_path / "in", "-o", tmp_path / "out", *selectors], expect=3)
    assert f"a_{lacking}.mcap" in done.stderr
    recordings = load(tmp_path / "out", "recordings")
    assert recordings["status"].to_list() == ["recovered", "ok"]
    assert f"a_{lacking}.mcap" in recordings["reason"][0]
    # What is lost at the beginning may be a part of the episode: then nothing of it can be used.
    episode = load(tmp_path / "out", "episodes").row(0, named=True)
    assert episode["status"] == "incomplete"
    assert f"a_{lacking}.mcap" in episode["reason"]
    assert episode["n_steps"] + episode["n_dropped_steps"] == 20
    assert f"a_{lacking}.mcap" in run(["inspect", bag], expect=3).stdout
    done = run(["extract", bag, "-o", tmp_path / "strict", "--on-damage", "fail", *selectors], expect=1)
    assert f"a_{lacking}.mcap" in done.stderr


def test_the_place_of_damage_names_the_file_of_the_bag(run: Run, tmp_path: Path) -> None:
    log = arm_log(seed=6)
    bag = write_split_bag(tmp_path / "bag", [log[:40], log[40:]])
    last = bag / "bag_1.mcap"
    last.write_bytes(last.read_bytes()[:-100])
    run(["extract", bag, "-o", tmp_path / "out"], expect=3)
    (reason,) = load(tmp_path / "out", "recordings")["reason"]
    assert "bag_1.mcap" in reason
    assert "offset" in reason


def test_files_of_a_bag_may_be_compressed_and_its_messages_may_not(run: Run, tmp_path: Path) -> None:
    log = arm_log(seed=7)
    for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
        bag = BagWriter(tmp_path / mode.name, version=9, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(mode, CompressionFormat.ZSTD)
        write_bag(bag.path, log, writer=bag)
    (file,) = (tmp_path / "FILE").glob("*.mcap.*")
    assert file.suffix == ".zstd"
    run(["extract", tmp_path / "FILE", "-o", tmp_path / "out"])
    assert actions_of(tmp_path / "out") == commands_of(log)
    done = run(["extract", tmp_path / "MESSAGE", "-o", tmp_path / "none"], expect=1)
    assert "compressed one by one" in done.stderr


@pytest.mark.parametrize("type_name", [JOINT_STATE, COMMAND])
def test_older_bags_name_a_type_and_do_not_define_it(run: Run, tmp_path: Path, type_name: str) -> None:
    log = arm_log(seed=8)
    topics = {topic: ros2_topic(name) for topic, name in [("/joint_states", JOINT_STATE), ("/arm/commands", COMMAND)]}
    bare = {topic: Topic("cdr", (how.schema[0], "ros2msg", b"")) for topic, how in topics.items() if how.schema}
    mixed = {topic: bare[topic] if how.schema and how.schema[0] == type_name else how for topic, how in topics.items()}
    messages = [Message(topic, time, cdr(name, value)) for topic, name, time, value in log]
    run(["extract", write_recording(tmp_path / "old.mcap", mixed, messages, profile="ros2"), "-o", tmp_path / "out"])
    assert actions_of(tmp_path / "out") == commands_of(log)


# ROS 1 ----------------------------------------------------------------------------------------------------------------


def test_ros_1_messages_are_read_as_those_of_ros_2(run: Run, tmp_path: Path) -> None:
    log = arm_log(seed=9)
    log2 = [Message(topic, time, cdr(name, value)) for topic, name, time, value in log]
    log1 = []
    for topic, name, time, value in log:
        value = dict(value)
        if name == JOINT_STATE:
            value["header"] = {"seq": 1, "stamp": {"sec": time // SECOND, "nanosec": time % SECOND}, "frame_id": "b"}
        log1.append(Message(topic, time, ros1(name, value)))
    for profile, make, messages in (("ros1", ros1_topic, log1), ("ros2", ros2_topic, log2)):
        topics = {"/joint_states": make(JOINT_STATE), "/arm/commands": make(COMMAND)}
        path = write_recording(tmp_path / profile / "arm.mcap", topics, messages, profile=profile)
        run(["extract", path, "-o", tmp_path / f"out-{profile}"])
        run(["extract", path, "-o", tmp_path / f"header-{profile}", "--clock", "header"], expect=1)
    for table in ("segments", "steps", "episodes"):
        assert_frame_equal(load(tmp_path / "out-ros1", table), load(tmp_path / "out-ros2", table), check_exact=True)
    assert load(tmp_path / "out-ros1", "recordings")["encoding"].to_list() == ["ros1"]
    assert actions_of(tmp_path / "out-ros1") == commands_of(log)


# Random messages of ROS -----------------------------------------------------------------------------------------------

LIMB = """
int32 LIMIT = 7
string NAME = "limb # no comment"
string<=12 label
float32 mass
bool[3] contacts
geometry_msgs/Point[2] ends   # two of them
uint8 kind
int64[<=5] ticks
string[] notes
float64 angle
"""
LIMBS = """
# Whatever a schema may hold.
std_msgs/Header header
byte flags
demo_msgs/Limb[2] fixed
int16 gap
demo_msgs/Limb[] free
builtin_interfaces/Duration age
char letter
uint16[3] code
float64 last
"""
ROS2.register(
    get_types_from_msg(LIMB, "demo_msgs/msg/Limb") | get_types_from_msg(LIMBS, "demo_msgs/msg/Limbs"),
)
TYPES = [
    *(f"std_msgs/msg/{name}MultiArray" for name in ("Float32", "Float64", "Int8", "Int16", "Int32", "Int64")),
    *(f"std_msgs/msg/{name}MultiArray" for name in ("Byte", "UInt8", "UInt16", "UInt32", "UInt64")),
    *(f"std_msgs/msg/{name}" for name in ("Bool", "Char", "Byte", "Int64", "UInt64", "Float32", "ColorRGBA")),
    *(f"geometry_msgs/msg/{name}" for name in ("Twist", "TwistStamped", "WrenchStamped", "PoseWithCovarianceStamped")),
    *(f"sensor_msgs/msg/{name}" for name in ("JointState", "Imu", "BatteryState", "Joy", "CameraInfo", "LaserScan")),
    "sensor_msgs/msg/MultiDOFJointState",
    "nav_msgs/msg/Odometry",
    "trajectory_msgs/msg/JointTrajectory",
    "trajectory_msgs/msg/MultiDOFJointTrajectory",
    "demo_msgs/msg/Limbs",
]
# Bits of the integers; those without a sign are negative. The tools differ on the sign of a byte, so it is kept small.
INTEGERS = {"int8": 8, "int16": 16, "int32": 32, "int64": 64, "octet": -7, "byte": -7, "char": -7} | {
    f"uint{bits}": -bits for bits in (8, 16, 32, 64)
}
# These hold no numbers of their own.
NO_LEAVES = {"std_msgs/msg/Header", "std_msgs/msg/MultiArrayLayout"}


def random_number(rng: random.Random, kind: str) -> tuple[Any, float]:
    """A value as it is written, and as a table shows it."""
    if kind == "bool":
        value = rng.random() < 0.5
        return value, float(value)
    if kind.startswith("float"):
        code, bits = ("<f", 32) if kind == "float32" else ("<d", 64)
        while True:
            (number,) = struct.unpack(code, rng.getrandbits(bits).to_bytes(bits // 8, "little"))
            if np.isfinite(number):
                return number, number
    bits = INTEGERS[kind]
    number = rng.getrandbits(abs(bits)) - (1 << bits - 1 if bits > 0 else 0)
    return number, float(number)


def random_text(rng: random.Random) -> str:
    """Of any length, since what follows is aligned."""
    return "".join(rng.choice("aZ09_ßλ") for _ in range(rng.randrange(9)))[:6]


def random_value(rng: random.Random, store: Typestore, kind: Any, name: str, leaves: list[float]) -> Any:
    """A random value of a field; its numbers are added to `leaves` in the order of the schema."""
    node, inner = kind
    if node == Nodetype.NAME:
        below: list[float] = []
        value = {field: random_value(rng, store, k, field, below) for field, k in store.fielddefs[inner][1]}
        if inner not in NO_LEAVES:
            leaves += below
        return value
    if node == Nodetype.BASE:
        if inner[0] == "string":
            return random_text(rng)
        value, leaf = random_number(rng, inner[0])
        if name == "nanosec":
            # Its sign is another in ROS 1, but no more than a second has to fit.
            value = leaf = rng.randrange(SECOND)
        leaves.append(leaf)
        return value
    element, length = inner
    if node == Nodetype.SEQUENCE:
        # Numbers must stay as many from message to message; texts need not.
        is_text = element[0] == Nodetype.BASE and element[1][0] == "string"
        length = rng.randrange(4) if is_text else 1 + sum(map(ord, name)) % 4
        # As many names as values, or none.
        length = 0 if name == "joint_names" else length
    return [random_value(rng, store, element, name, leaves) for _ in range(length)]


def random_messages(
    type_name: str, seed: int, store: Typestore = ROS2
) -> tuple[list[dict[str, Any]], list[list[float]]]:
    rng = random.Random(f"{type_name} {seed}")
    values, leaves = [], []
    for _ in range(14):
        leaves.append([])
        values.append(random_value(rng, store, (Nodetype.NAME, type_name), "", leaves[-1]))
    return values, leaves


def write_with_rosbags(path: Path, type_name: str, values: list[dict[str, Any]], little_endian: bool) -> None:
    topics = {"/state": ros2_topic(COMMAND), "/action": ros2_topic(type_name)}
    messages = []
    for i, value in enumerate(values):
        time = START_TIME_NANOS + i * PERIOD
        messages.append(Message("/state", time, cdr(COMMAND, {"data": [i * i]}, little_endian=little_endian)))
        messages.append(Message("/action", time, cdr(type_name, value, little_endian=little_endian)))
    write_recording(path, topics, messages, profile="ros2")


def write_ros1_messages(path: Path, type_name: str, values: list[dict[str, Any]]) -> None:
    topics = {"/state": ros1_topic(COMMAND), "/action": ros1_topic(type_name)}
    messages = []
    for i, value in enumerate(values):
        time = START_TIME_NANOS + i * PERIOD
        messages.append(Message("/state", time, ros1(COMMAND, {"data": [i * i]})))
        messages.append(Message("/action", time, ros1(type_name, value)))
    write_recording(path, topics, messages, profile="ros1")


def write_with_mcap_ros2(path: Path, type_name: str, values: list[dict[str, Any]]) -> None:
    with path.open("wb") as stream:
        writer = Ros2Writer(stream, compression=CompressionType.ZSTD)
        texts = {name: ROS2.generate_msgdef(name, ros_version=2)[0] for name in (COMMAND, type_name)}
        state, action = (writer.register_msgdef(name, texts[name]) for name in (COMMAND, type_name))
        for i, value in enumerate(values):
            time = START_TIME_NANOS + i * PERIOD
            layout = {"dim": [], "data_offset": 0}
            writer.write_message("/state", state, {"layout": layout, "data": [i * i]}, time, time)
            writer.write_message("/action", action, value, time, time)
        writer.finish()


@pytest.mark.parametrize("written_by", ["rosbags, little endian", "rosbags, big endian", "mcap-ros2-support"])
def test_whole_messages_of_ros_2_give_their_numbers_in_the_order_of_the_schema(
    run: Run, tmp_path: Path, written_by: str
) -> None:
    expected = {}
    (tmp_path / "in").mkdir()
    for type_name in TYPES:
        path = tmp_path / "in" / f"{type_name.replace('/', '.')}.mcap"
        values, expected[path.name] = random_messages(type_name, seed=11)
        if written_by == "mcap-ros2-support":
            write_with_mcap_ros2(path, type_name, values)
        else:
            write_with_rosbags(path, type_name, values, little_endian="little" in written_by)
    out = tmp_path / "out"
    run(["extract", tmp_path / "in", "-o", out, "--action", "/action:", "--state", "/state:data"])
    check_actions(out, expected)


def check_actions(out: Path, expected: dict[str, list[list[float]]]) -> None:
    """Each recording has these actions, a row a step."""
    steps = load(out, "steps")
    found = {part["recording"][0]: part for part in steps.partition_by("recording", maintain_order=True)}
    assert found.keys() == expected.keys()
    for name, actions in expected.items():
        joints = found[name].partition_by("joint", maintain_order=True)
        assert np.array([joint["action"] for joint in joints]).T.tolist() == actions, name
    assert set(load(out, "recordings")["status"]) == {"ok"}


def test_whole_messages_of_ros_1_give_their_numbers_in_the_order_of_the_schema(run: Run, tmp_path: Path) -> None:
    expected = {}
    for type_name in TYPES:
        if type_name in ROS1.fielddefs:
            path = tmp_path / "in" / f"{type_name.replace('/', '.')}.mcap"
            values, expected[path.name] = random_messages(type_name, seed=22, store=ROS1)
            write_ros1_messages(path, type_name, values)
    assert len(expected) > 25
    out = tmp_path / "out"
    run(["extract", tmp_path / "in", "-o", out, "--action", "/action:", "--state", "/state:data"])
    check_actions(out, expected)


FIELDS: list[tuple[str, list[str], Callable[[Any], list[float]]]] = [
    (
        "nav_msgs/msg/Odometry",
        ["pose.pose.position", "twist.twist.linear.y", "pose.covariance[7]", "twist.covariance[3..6]"],
        lambda m: [
            *m["pose"]["pose"]["position"].values(),
            m["twist"]["twist"]["linear"]["y"],
            m["pose"]["covariance"][7],
            *m["twist"]["covariance"][3:6],
        ],
    ),
    (
        "trajectory_msgs/msg/JointTrajectory",
        ["points[0].velocities", "points.positions[0]"],
        lambda m: [*m["points"][0]["velocities"], *(p["positions"][0] for p in m["points"])],
    ),
    (
        "demo_msgs/msg/Limbs",
        ["fixed[1].ends[0].z", "free.contacts", "age", "fixed.ticks", "last", "letter"],
        lambda m: [
            m["fixed"][1]["ends"][0]["z"],
            *(c for limb in m["free"] for c in limb["contacts"]),
            *m["age"].values(),
            *(t for limb in m["fixed"] for t in limb["ticks"]),
            m["last"],
            m["letter"],
        ],
    ),
    (
        "sensor_msgs/msg/Imu",
        ["orientation.w", "angular_velocity"],
        lambda m: [m["orientation"]["w"], *m["angular_velocity"].values()],
    ),
]


@pytest.mark.parametrize(("type_name", "paths", "pick"), FIELDS, ids=[f[0] for f in FIELDS])
def test_selectors_pick_fields_in_the_order_they_are_given(
    run: Run, tmp_path: Path, type_name: str, paths: list[str], pick: Callable[[Any], list[float]]
) -> None:
    values, _ = random_messages(type_name, seed=12)
    write_with_rosbags(tmp_path / "in.mcap", type_name, values, little_endian=True)
    selectors = [text for path in paths for text in ("--action", f"/action:{path}")]
    run(["extract", tmp_path / "in.mcap", "-o", tmp_path / "out", *selectors, "--state", "/state:data"])
    assert actions_of(tmp_path / "out") == [[float(x) for x in pick(value)] for value in values]
    listed = load(tmp_path / "out", "recordings")["action_selector"][0]
    assert listed.split() == [f"/action:{path}" for path in paths]


def test_joints_are_taken_by_name_wherever_they_stand(run: Run, tmp_path: Path) -> None:
    """The order is that of the first message, or that of the selectors; never that of a later message."""
    rng = random.Random(13)
    topics = {"/state": ros2_topic(JOINT_STATE), "/leader/joint_states": ros2_topic(JOINT_STATE)}
    messages, by_name = [], []
    for step in range(20):
        names = JOINTS if step == 0 else rng.sample(JOINTS, len(JOINTS))
        by_name.append({name: rng.uniform(-1, 1) for name in JOINTS})
        value = {"name": names, "position": [by_name[-1][name] for name in names]}
        time = START_TIME_NANOS + step * PERIOD
        messages.append(Message("/state", time, cdr(JOINT_STATE, {"name": ["a"], "position": [step % 7]})))
        messages.append(Message("/leader/joint_states", time, cdr(JOINT_STATE, value)))
    path = write_recording(tmp_path / "in.mcap", topics, messages, profile="ros2")

    run(["extract", path, "-o", tmp_path / "all"])
    assert actions_of(tmp_path / "all") == [[joints[name] for name in JOINTS] for joints in by_name]
    assert load(tmp_path / "all", "steps")["joint_name"].unique(maintain_order=True).to_list() == JOINTS

    chosen = ["wrist", "shoulder"]
    selectors = [text for name in chosen for text in ("--action", f"/leader/joint_states:position[{name}]")]
    run(["extract", path, "-o", tmp_path / "chosen", *selectors, "--state", "/state:position"])
    assert actions_of(tmp_path / "chosen") == [[joints[name] for name in chosen] for joints in by_name]
    assert load(tmp_path / "chosen", "steps")["joint_name"].unique(maintain_order=True).to_list() == chosen


def test_a_joint_that_no_message_names_is_an_error_that_lists_those_there_are(run: Run, tmp_path: Path) -> None:
    topics = {"/state": ros2_topic(JOINT_STATE), "/action": ros2_topic(COMMAND)}
    messages = []
    for step in range(20):
        time = START_TIME_NANOS + step * PERIOD
        # Two boards share the joints out: each message has some of them.
        names = JOINTS[:2] if step % 2 == 0 else JOINTS[2:]
        state = {"name": names, "position": [float(step + i) for i in range(len(names))]}
        messages.append(Message("/state", time, cdr(JOINT_STATE, state)))
        messages.append(Message("/action", time, cdr(COMMAND, {"data": [step % 5]})))
    path = write_recording(tmp_path / "in.mcap", topics, messages, profile="ros2")
    action = ["--action", "/action:data", "--state"]
    done = run(["extract", path, "-o", tmp_path / "none", *action, "/state:position[writs]"], expect=1)
    assert 'no message names "writs", they name shoulder, elbow, wrist' in done.stderr
    run(["extract", path, "-o", tmp_path / "out", *action, "/state:position[wrist]"])
    assert load(tmp_path / "out", "episodes")["n_steps"].to_list() == [19]


# Random messages without a schema -------------------------------------------------------------------------------------

# Tags of typed arrays (RFC 8746) and the elements they have in NumPy.
TYPED_ARRAYS = {
    64: "u1", 65: ">u2", 66: ">u4", 67: ">u8", 69: "<u2", 70: "<u4", 71: "<u8",
    72: "i1", 73: ">i2", 74: ">i4", 75: ">i8", 77: "<i2", 78: "<i4", 79: "<i8",
    80: ">f2", 81: ">f4", 82: ">f8", 84: "<f2", 85: "<f4", 86: "<f8",
}  # fmt: skip


def random_floats(rng: random.Random, n: int) -> list[float]:
    """Of which some fit 16 bits, some 32, and some are whole."""
    kinds = [
        lambda: float(np.float16(rng.uniform(-60_000, 60_000))),
        lambda: float(np.float32(rng.uniform(-1, 1) * 10.0 ** rng.randrange(-30, 30))),
        lambda: random_number(rng, "float64")[0],
        lambda: float(rng.randrange(-1000, 1000)),
        lambda: -0.0,
    ]
    return [rng.choice(kinds)() for _ in range(n)]


def random_steps(seed: int, shape: tuple[int, ...]) -> tuple[list[dict[str, Any]], list[list[float]]]:
    """Steps of two episodes whose action is an array of arrays of `shape`."""
    rng = random.Random(seed)
    steps, actions = [], []
    for i in range(30):
        actions.append(random_floats(rng, int(np.prod(shape))))
        steps.append(
            {
                "episode": i // 15,
                "step": i % 15,
                "action": np.array(actions[-1]).reshape(shape).tolist(),
                "state": [rng.choice([i, float(i), i / 7, rng.getrandbits(40)]), [rng.random() < 0.5]],
                "reward": rng.random(),
                "note": random_text(rng),
            }
        )
    return steps, actions


def write_steps(path: Path, encoding: str, messages: list[bytes]) -> None:
    times = [START_TIME_NANOS + i * PERIOD for i in range(len(messages))]
    topics = {"/step": Topic(encoding)}
    write_recording(path, topics, [Message("/step", t, data) for t, data in zip(times, messages, strict=True)])


def shuffled(rng: random.Random, step: dict[str, Any]) -> dict[str, Any]:
    """The same members in another order."""
    return dict(rng.sample(list(step.items()), len(step)))


@pytest.mark.parametrize("stamped", [True, False])
def test_a_stamp_has_seconds_or_is_none(run: Run, tmp_path: Path, stamped: bool) -> None:
    """A bare number could be seconds or nanoseconds: it is an error, not a table without times."""
    steps = []
    for i in range(20):
        stamp = {"sec": 1_600_000_000 + i, "nsec": 5} if stamped else 1_600_000_000.5 + i
        steps.append(json.dumps({"timestamp": stamp, "action": i % 5, "state": i % 7}).encode())
    write_steps(tmp_path / "in.mcap", "json", steps)
    args = ["extract", tmp_path / "in.mcap", "-o", tmp_path / "out", "--clock", "header"]
    if stamped:
        run(args)
        times = nanos(load(tmp_path / "out", "steps")["time"])
        assert times == [(1_600_000_000 + i) * SECOND + 5 for i in range(20)]
    else:
        assert "no stamp in seconds and nanoseconds" in run(args, expect=1).stderr


def test_cbor_messages_give_the_numbers_that_python_wrote(run: Run, tmp_path: Path) -> None:
    rng = random.Random(14)
    expected = {}
    styles: dict[str, dict[str, bool]] = {
        "plain": {},
        # Floats as short as they can be without loss.
        "canonical": {"canonical": True},
        "indefinite": {"indefinite_containers": True},
        "canonical-indefinite": {"canonical": True, "indefinite_containers": True},
    }
    for style, options in styles.items():
        for shape in ((4,), (2, 3), (2, 1, 2)):
            name = f"{style}-{len(shape)}d.mcap"
            steps, expected[name] = random_steps(seed=15, shape=shape)
            write_steps(tmp_path / "in" / name, "cbor", [cbor2.dumps(shuffled(rng, s), **options) for s in steps])
    for tag, kind in TYPED_ARRAYS.items():
        steps, _ = random_steps(seed=16, shape=(1,))
        elements = [random_array(rng, kind, 6) for _ in steps]
        for is_matrix in (False, True):
            name = f"tag-{tag}{'-matrix' if is_matrix else ''}.mcap"
            messages = []
            for step, array in zip(steps, elements, strict=True):
                typed = cbor2.CBORTag(tag, array.tobytes())
                action = cbor2.CBORTag(40, [[2, 3], typed]) if is_matrix else typed
                messages.append(cbor2.dumps(step | {"action": action}))
            write_steps(tmp_path / "in" / name, "cbor", messages)
            expected[name] = [[float(x) for x in array.tolist()] for array in elements]
    run(["extract", tmp_path / "in", "-o", tmp_path / "out"])
    check_actions(tmp_path / "out", expected)


def random_array(rng: random.Random, kind: str, n: int) -> np.ndarray:
    """Random elements of any finite value."""
    while True:
        array = np.frombuffer(rng.randbytes(n * np.dtype(kind).itemsize), dtype=kind)
        if "f" not in kind or np.isfinite(array).all():
            return array


def test_messagepack_messages_give_the_numbers_that_python_wrote(run: Run, tmp_path: Path) -> None:
    rng = random.Random(17)
    expected = {}
    for style in ("plain", "single", "integers", "bytes"):
        for shape in ((4,), (20,), (2, 3)):
            name = f"{style}-{'x'.join(map(str, shape))}.mcap"
            steps, actions = random_steps(seed=18, shape=shape)
            for i, step in enumerate(steps):
                if style == "single":
                    actions[i] = [float(np.float32(rng.uniform(-1, 1))) for _ in actions[i]]
                elif style == "integers":
                    bits = [rng.choice([4, 8, 16, 32, 63]) for _ in actions[i]]
                    actions[i] = [rng.choice([-1, 1]) * rng.getrandbits(n) for n in bits]
                elif style == "bytes":
                    actions[i] = list(rng.randbytes(len(actions[i])))
                array = np.array(actions[i], dtype=object).reshape(shape).tolist()
                step["action"] = bytes(actions[i]) if style == "bytes" else array
                actions[i] = [float(x) for x in actions[i]]
            packed = [msgpack.packb(shuffled(rng, step), use_single_float=style == "single") for step in steps]
            write_steps(tmp_path / "in" / name, "msgpack", packed)
            expected[name] = actions
    run(["extract", tmp_path / "in", "-o", tmp_path / "out"])
    check_actions(tmp_path / "out", expected)


# inspect --------------------------------------------------------------------------------------------------------------


def write_flatbuffers(path: Path, root: Path, n_steps: int = 20) -> tuple[Path, list[list[float]]]:
    """Leader and follower as arrays without names, one state more than there are actions."""
    schema = ("FloatArray", "flatbuffer", (root / "tests/data/float_array.bfbs").read_bytes())
    rng = random.Random(19)
    topics = {name: Topic("flatbuffer", schema) for name in (LEAD, FOLLOW)}
    messages, actions = [], []
    for step in range(n_steps + 1):
        time = START_TIME_NANOS + step * PERIOD
        messages.append(Message(FOLLOW, time + 3_000_000, float_array([rng.random() for _ in range(3)])))
        if step < n_steps:
            actions.append([float(np.float32(rng.uniform(-1, 1))) for _ in range(4)])
            messages.append(Message(LEAD, time, float_array(actions[-1])))
    return write_recording(path, topics, messages), actions


LEAD, FOLLOW = "/lead/arm/joint_state/position", "/follow/arm/joint_state/position"


def test_flatbuffers_are_paired_by_their_index(run: Run, root: Path, tmp_path: Path) -> None:
    path, actions = write_flatbuffers(tmp_path / "arm.mcap", root)
    selectors = ["--action", f"{LEAD}:values", "--state", f"{FOLLOW}:values", "--align", "index"]
    run(["extract", path, "-o", tmp_path / "out", *selectors])
    assert actions_of(tmp_path / "out") == actions
    assert load(tmp_path / "out", "recordings")["n_messages_refused"].to_list() == [0]


def write_ros1(path: Path) -> Path:
    """An arm in ROS 1."""
    topics = {"/joint_states": ros1_topic(JOINT_STATE), "/arm/commands": ros1_topic(COMMAND)}
    messages = [Message(topic, time, ros1(name, value | {"header": {}})) for topic, name, time, value in arm_log(20)]
    return write_recording(path, topics, messages, profile="ros1")


def test_inspect_prints_a_command_line_that_works(run: Run, root: Path, tmp_path: Path) -> None:
    """One recording of every encoding, in a folder whose name a shell would take apart."""
    folder = tmp_path / "it's a folder; $(really)"
    folder.mkdir()
    shutil.copy(root / "fixtures/recordings/pendulum.mcap", folder / "json.mcap")
    recordings = root / "tests/data/recordings"
    for encoding in ("protobuf", "cbor", "msgpack", "ros2"):
        shutil.copy(recordings / encoding / "pendulum.mcap", folder / f"{encoding}.mcap")
    shutil.copy(recordings / "ros2/pong_ram.mcap", folder / "ros2 bytes.mcap")
    write_ros1(folder / "ros1.mcap")
    write_flatbuffers(folder / "flatbuffer.mcap", root)
    write_split_bag(folder / "a bag", [arm_log(21)[:30], arm_log(21)[30:]])
    write_names_that_need_quotes(folder / "quotes.mcap")

    blocks = run(["inspect", folder]).stdout.split("\n\n")
    names = sorted([*(path.name for path in folder.glob("*.mcap")), "a bag"])
    assert [block.split("  ")[0] for block in blocks] == names
    for number, block in enumerate(blocks):
        program, *args = shlex.split(block.splitlines()[-1])
        assert program == "coact"
        assert "--action" in args
        out = tmp_path / f"out-{number}"
        args[args.index("-o") + 1] = str(out)
        run(args, expect=0)
        assert load(out, "episodes")["n_steps"].sum() > 0
    whole = json.loads(run(["inspect", folder, "--json"]).stdout)
    assert [shlex.split(one["command"])[0] for one in whole] == ["coact"] * len(names)


def write_names_that_need_quotes(path: Path) -> Path:
    """JSON without a convention, whose topics and members hold what shells and selectors give a meaning."""
    topics = {"/a b's:$x": Topic("json"), "/state [0]": Topic("json")}
    messages = []
    for step in range(20):
        time = START_TIME_NANOS + step * PERIOD
        messages.append(Message("/state [0]", time, json.dumps({"it's.so": [step, step % 3]}).encode()))
        messages.append(Message("/a b's:$x", time, json.dumps({"cmd: \"q\"": [step % 5]}).encode()))
    return write_recording(path, topics, messages)
