"""Small recordings in the layouts of `docs/recordings.md`, under the names that its commands use."""

from __future__ import annotations

import json
import random
import shutil
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from support import (
    SECOND,
    START_TIME_NANOS,
    Message,
    Topic,
    cdr,
    ros2_topic,
    stamp,
    write_recording,
)

JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
BOOL = "std_msgs/msg/Bool"
TEXT = "std_msgs/msg/String"
ARM = ["shoulder", "elbow", "wrist", "gripper"]


class Motion:
    """An arm that is sent from one target to the next and follows slowly: commands and states at any time."""

    def __init__(self, seed: int, n_joints: int = len(ARM), seconds: int = 60) -> None:
        rng = random.Random(seed)
        self.targets = [[rng.uniform(-1, 1) for _ in range(n_joints)] for _ in range(seconds + 1)]

    def command(self, nanos: int) -> list[float]:
        """The target, reached in steps of a tenth of a second over the first half of each second."""
        second, rest = divmod(nanos, SECOND)
        share = min(rest // (SECOND // 10), 5) / 5
        before, after = self.targets[second - 1 if second else 0], self.targets[second]
        return [a + (b - a) * share for a, b in zip(before, after, strict=True)]

    def position(self, nanos: int) -> list[float]:
        """A little behind the command."""
        late = [self.command(max(0, nanos - lag * SECOND // 20)) for lag in (1, 2, 3)]
        return [sum(values) / 3 for values in zip(*late, strict=True)]


def ticks(seconds: float, hz: int, phase: int = 0) -> Iterator[int]:
    """Nanoseconds since the start, `hz` times a second."""
    return (phase + i * SECOND // hz for i in range(int(seconds * hz)))


def joint_state(nanos: int, names: list[str], position: list[float]) -> bytes:
    header = stamp(START_TIME_NANOS + nanos)
    return cdr(JOINT_STATE, {"header": header, "name": names, "position": position})


def in_time(messages: list[Message]) -> list[Message]:
    return sorted(messages, key=lambda m: m.log_time)


# ROS 2 ----------------------------------------------------------------------------------------------------------------


def arm_messages(motion: Motion, seconds: float, start: int = 0, n_joints: int = len(ARM)) -> list[Message]:
    """States at 100 Hz and commands at 25 Hz, each 2 ms behind a state."""
    at = START_TIME_NANOS + start
    states = [
        Message("/joint_states", at + t, joint_state(start + t, ARM, motion.position(start + t)))
        for t in ticks(seconds, 100)
    ]
    commands = [
        Message("/arm/commands", at + t, cdr(MULTI_ARRAY, {"data": motion.command(start + t)[:n_joints]}))
        for t in ticks(seconds, 25, phase=2_000_000)
    ]
    return in_time(states + commands)


def arm_topics() -> dict[str, Topic]:
    return {"/joint_states": ros2_topic(JOINT_STATE), "/arm/commands": ros2_topic(MULTI_ARRAY)}


def write_arm(path: Path) -> Path:
    """An arm with one topic of commands."""
    metadata = {"env_id": "pick", "action_names": json.dumps(ARM)}
    return write_recording(path, arm_topics(), arm_messages(Motion(1), 12), metadata, profile="ros2")


def write_arm_and_gripper(path: Path) -> Path:
    """An arm whose gripper has a topic of its own."""
    motion = Motion(2)
    gripper = [
        Message("/gripper/commands", START_TIME_NANOS + t, cdr(MULTI_ARRAY, {"data": motion.command(t)[3:]}))
        for t in ticks(12, 5)
    ]
    topics = arm_topics() | {"/gripper/commands": ros2_topic(MULTI_ARRAY)}
    return write_recording(path, topics, in_time(arm_messages(motion, 12, n_joints=3) + gripper), profile="ros2")


def write_leader_follower(path: Path, seed: int = 3) -> Path:
    """Teleoperation: two topics of joint states, the follower's with a pause of 0.4 s."""
    motion = Motion(seed)
    leader = [
        Message("/leader/joint_states", START_TIME_NANOS + t, joint_state(t, ARM, motion.command(t)))
        for t in ticks(10, 50, phase=1_000_000)
    ]
    follower = [
        Message("/follower/joint_states", START_TIME_NANOS + t, joint_state(t, ARM, motion.position(t)))
        for t in ticks(10, 50)
        if not 4 * SECOND <= t < 4.4 * SECOND
    ]
    topics = {m.topic: ros2_topic(JOINT_STATE) for m in (leader[0], follower[0])}
    return write_recording(path, topics, in_time(leader + follower), profile="ros2")


def write_long(path: Path) -> Path:
    """Three tasks in one file: a pause of 5 s between them, a text at the start and a flag at the end of each."""
    motion = Motion(4)
    messages = []
    for task in range(3):
        start = task * 15 * SECOND
        at = START_TIME_NANOS + start
        messages.append(Message("/task", at, cdr(TEXT, {"data": f"task {task}"})))
        messages += arm_messages(motion, 10, start=start)
        messages.append(Message("/done", at + 10 * SECOND, cdr(BOOL, {"data": True})))
    topics = arm_topics() | {"/task": ros2_topic(TEXT), "/done": ros2_topic(BOOL)}
    return write_recording(path, topics, messages, profile="ros2")


def write_split_bag(folder: Path) -> Path:
    """A rosbag2 directory of two files."""
    messages = arm_messages(Motion(5), 12)
    names = [f"{folder.name}_{i}.mcap" for i in range(2)]
    for name, part in zip(names, (messages[:700], messages[700:]), strict=True):
        write_recording(folder / name, arm_topics(), part, profile="ros2")
    listed = "\n".join(f"    - {name}" for name in names)
    (folder / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  relative_file_paths:\n{listed}\n"
    )
    return folder


# Protobuf -------------------------------------------------------------------------------------------------------------

FIELD_TYPES = {"float": 2, "double": 1, "string": 9}


def protobuf_schema(package: str, messages: dict[str, list[tuple[str, str]]]) -> descriptor_pb2.FileDescriptorSet:
    """Messages whose fields are `name: type`, `type[]` if repeated; other types are messages."""
    file = descriptor_pb2.FileDescriptorProto(name=f"{package}.proto", package=package, syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    for name, fields in messages.items():
        message = file.message_type.add(name=name)
        for number, (field, kind) in enumerate(fields, start=1):
            label = 3 if kind.endswith("[]") else 1
            kind = kind.removesuffix("[]")
            added = message.field.add(name=field, number=number, label=label, type=FIELD_TYPES.get(kind, 11))
            if kind not in FIELD_TYPES:
                added.type_name = f".{kind}"
    needed = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(needed)
    return descriptor_pb2.FileDescriptorSet(file=[needed, file])


def protobuf_class(schema: descriptor_pb2.FileDescriptorSet, name: str) -> Callable[..., Any]:
    pool = descriptor_pool.DescriptorPool()
    for file in schema.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def write_protobuf_logs(folder: Path, n_files: int = 2) -> Path:
    """Two arms and their leaders, a file each episode; log time counts from the start of the machine."""
    fields = [("positions", "float[]"), ("velocities", "float[]"), ("efforts", "float[]")]
    schema = protobuf_schema("arms", {"JointState": fields})
    joint_state = protobuf_class(schema, "arms.JointState")
    topic = Topic("protobuf", ("arms.JointState", "protobuf", schema.SerializeToString()))
    for episode in range(n_files):
        messages = []
        for side, seed in (("left", 10), ("right", 20)):
            motion = Motion(seed + episode, n_joints=7)
            for role, values, phase in (("leader", motion.command, 1_000_000), ("follower", motion.position, 0)):
                for t in ticks(8, 50, phase):
                    data = joint_state(positions=values(t), velocities=[0.0] * 7).SerializeToString()
                    since_boot = (600 + 20 * episode) * SECOND + t
                    published = START_TIME_NANOS + since_boot
                    messages.append(Message(f"/{role}_{side}/joints/state", since_boot, data, published))
        topics = dict.fromkeys(sorted({m.topic for m in messages}), topic)
        write_recording(folder / f"episode_{episode:06d}.mcap", topics, in_time(messages))
    return folder


def write_foxglove(path: Path) -> Path:
    """Joints by name, some of which a message may leave out."""
    fields = [("name", "string"), ("position", "double")]
    states = [("timestamp", "google.protobuf.Timestamp"), ("joints", "foxglove.JointState[]")]
    schema = protobuf_schema("foxglove", {"JointState": fields, "JointStates": states})
    joint_states = protobuf_class(schema, "foxglove.JointStates")
    topic = Topic("protobuf", ("foxglove.JointStates", "protobuf", schema.SerializeToString()))
    motion, rng, messages = Motion(6), random.Random(6), []
    for t in ticks(10, 50):
        for name, values in (("/joints/target", motion.command(t)), ("/joints/measured", motion.position(t))):
            joints = [{"name": joint, "position": value} for joint, value in zip(ARM, values, strict=True)]
            if name == "/joints/measured" and t > 0:
                joints = rng.sample(joints, rng.randrange(1, len(joints) + 1))
            data = joint_states(joints=joints)
            data.timestamp.FromNanoseconds(START_TIME_NANOS + t)
            messages.append(Message(name, START_TIME_NANOS + t, data.SerializeToString()))
    return write_recording(path, dict.fromkeys(("/joints/target", "/joints/measured"), topic), messages)


# FlatBuffers, JSON ----------------------------------------------------------------------------------------------------


def float_array(values: list[float]) -> bytes:
    """A message of tests/data/float_array.fbs, laid out by hand: root, table of fields, table, vector."""
    head = struct.pack("<IHHHxxiIi", 12, 6, 8, 4, 8, 4, len(values))
    return head + struct.pack(f"<{len(values)}f", *values)


def write_flatbuffers(path: Path, root: Path) -> Path:
    """A leader and a follower whose messages are counted, not timed."""
    schema = ("FloatArray", "flatbuffer", (root / "tests/data/float_array.bfbs").read_bytes())
    topics = {f"/{role}/arm/joint_state/position": Topic("flatbuffer", schema) for role in ("lead", "follow")}
    motion, messages = Motion(7), []
    for t in ticks(8, 30):
        for topic, values in zip(topics, (motion.command(t), motion.position(t)), strict=True):
            messages.append(Message(topic, START_TIME_NANOS + t, float_array(values)))
    return write_recording(path, topics, messages)


def write_flags(path: Path) -> Path:
    """A training run that logs observations and actions under names of its own, and when an episode is done."""
    motion, messages = Motion(8, n_joints=2), []
    for i, t in enumerate(ticks(30, 20)):
        content = {"obs": {"q": motion.position(t), "t": t / SECOND}, "act": motion.command(t), "done": i % 200 == 199}
        messages.append(Message("/train", START_TIME_NANOS + t, json.dumps(content).encode()))
    return write_recording(path, {"/train": Topic("json")}, messages)


def write_damaged(path: Path) -> Path:
    """Cut in the middle, as by a full disk."""
    write_long(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def write_all(folder: Path, root: Path) -> Path:
    """Everything that `docs/recordings.md` reads."""
    folder.mkdir(parents=True, exist_ok=True)
    fixtures, others = root / "fixtures/recordings", root / "tests/data/recordings"
    (folder / "runs").mkdir()
    for name in ("cartpole", "pendulum"):
        shutil.copy(fixtures / f"{name}.mcap", folder / "runs" / f"{name}.mcap")
    (folder / "others").mkdir()
    for encoding in ("protobuf", "cbor", "msgpack"):
        shutil.copy(others / encoding / "pendulum.mcap", folder / "others" / f"{encoding}.mcap")
    shutil.copy(others / "ros2/pong_ram.mcap", folder / "pong.mcap")
    write_flags(folder / "train.mcap")
    write_arm(folder / "arm.mcap")
    write_arm_and_gripper(folder / "arm_gripper.mcap")
    for i in range(2):
        write_leader_follower(folder / "teleop" / f"demo_{i}.mcap", seed=30 + i)
    write_protobuf_logs(folder / "logs")
    write_foxglove(folder / "joints.mcap")
    write_flatbuffers(folder / "lead_follow.mcap", root)
    write_long(folder / "session.mcap")
    write_split_bag(folder / "bags/pick_01")
    write_damaged(folder / "cut.mcap")
    return folder
