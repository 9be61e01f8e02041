"""What tests of recordings share: writing small ones, and loading the tables that come of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

START_TIME_NANOS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Topic:
    """How the messages of a topic are encoded: a schema is its name, its encoding and its text."""

    encoding: str
    schema: tuple[str, str, bytes] | None = None


@dataclass(frozen=True)
class Message:
    """A message; times in nanoseconds since the Unix epoch."""

    topic: str
    log_time: int
    data: bytes
    publish_time: int | None = None


def write_recording(
    path: Path,
    topics: Mapping[str, Topic],
    messages: Iterable[Message],
    metadata: Mapping[str, str] | None = None,
    profile: str = "",
) -> Path:
    """Writes messages in the order given; `metadata` becomes the record `recording`. Not compressed: sizes and offsets
    are those of the guide whatever the version of a library."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 16, compression=CompressionType.NONE)
        writer.start(profile=profile, library="tests")
        channels = {}
        for topic, how in topics.items():
            schema_id = 0
            if how.schema is not None:
                name, encoding, text = how.schema
                schema_id = writer.register_schema(name, encoding, text)
            channels[topic] = writer.register_channel(topic, how.encoding, schema_id)
        for message in messages:
            publish_time = message.log_time if message.publish_time is None else message.publish_time
            writer.add_message(channels[message.topic], message.log_time, message.data, publish_time)
        if metadata is not None:
            writer.add_metadata("recording", dict(metadata))
        writer.finish()
    return path


def read_messages(path: Path) -> list[tuple[Any, Any, Any]]:
    """Schema, channel and message of each message, in the order of the file."""
    with path.open("rb") as stream:
        return list(make_reader(stream).iter_messages(log_time_order=False))


def read_metadata(path: Path) -> dict[str, str]:
    """The record `recording`."""
    with path.open("rb") as stream:
        (record,) = (m for m in make_reader(stream).iter_metadata() if m.name == "recording")
    return record.metadata


def load(out: Path, table: str) -> pl.DataFrame:
    """A table, as the README loads it."""
    return pl.read_parquet(f"{out}/{table}/*.parquet")


def actions_of(out: Path) -> list[list[float]]:
    """The action of every step, over all joints: what the selectors took."""
    steps = load(out, "steps")
    joints = [part["action"].to_list() for part in steps.partition_by("joint", maintain_order=True)]
    return [list(step) for step in zip(*joints, strict=True)]


def nanos(column: pl.Series) -> list[int]:
    """Times as nanoseconds since the Unix epoch."""
    return column.dt.epoch("ns").to_list()


# ROS ------------------------------------------------------------------------------------------------------------------

ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def ros2_topic(type_name: str) -> Topic:
    """A topic of ROS 2, with the schema that rosbag2 writes for the type (`package/msg/Type`)."""
    text, _ = ROS2.generate_msgdef(type_name, ros_version=2)
    return Topic("cdr", (type_name, "ros2msg", text.encode()))


def ros1_topic(type_name: str) -> Topic:
    """A topic of ROS 1, as the conversion of a bag to MCAP writes it."""
    text, _ = ROS1.generate_msgdef(type_name, ros_version=1)
    return Topic("ros1", (type_name.replace("/msg/", "/"), "ros1msg", text.encode()))


def ros_object(store: Typestore, type_name: str, value: Mapping[str, Any]) -> Any:
    """A message of plain dictionaries and lists as rosbags has it. Fields that are not given are empty or zero."""
    _, fields = store.fielddefs[type_name]
    return store.types[type_name](**{name: ros_value(store, kind, value.get(name)) for name, kind in fields})


def ros_value(store: Typestore, kind: Any, value: Any) -> Any:
    node, inner = kind
    if node == Nodetype.NAME:
        return ros_object(store, inner, value or {})
    if node == Nodetype.BASE:
        return value if value is not None else "" if inner[0] in ("string", "wstring") else 0
    element, length = inner
    values = value if value is not None else [None] * (length if node == Nodetype.ARRAY else 0)
    items = [ros_value(store, element, item) for item in values]
    is_number = element[0] == Nodetype.BASE and element[1][0] not in ("string", "wstring")
    return np.array(items, dtype=NUMPY_TYPES.get(element[1][0], element[1][0])) if is_number else items


NUMPY_TYPES = {"octet": "uint8", "byte": "uint8", "char": "uint8"}


def cdr(type_name: str, value: Mapping[str, Any], *, little_endian: bool = True) -> bytes:
    """A message of ROS 2."""
    message = ros_object(ROS2, type_name, value)
    return bytes(ROS2.serialize_cdr(message, type_name, little_endian=little_endian))


def ros1(type_name: str, value: Mapping[str, Any]) -> bytes:
    """A message of ROS 1."""
    return bytes(ROS1.serialize_ros1(ros_object(ROS1, type_name, value), type_name))


def stamp(nanos: int) -> dict[str, Any]:
    """A header of ROS 2 with this time."""
    return {"stamp": {"sec": nanos // SECOND, "nanosec": nanos % SECOND}, "frame_id": "base"}
