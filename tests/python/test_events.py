"""Events files as the official Python reader has them, against the table of segments."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from conftest import Run
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from support import load

SECOND = 1_000_000_000


def decoded(path: Path) -> list[tuple[str, int, Any]]:
    """Topic, time and content of each message, by the schemas in the file alone; every check sum is checked."""
    classes: dict[int, Any] = {}
    found = []
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert schema is not None and (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            if schema.id not in classes:
                pool = descriptor_pool.DescriptorPool()
                for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                    pool.Add(file)
                classes[schema.id] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            found.append((channel.topic, message.log_time, classes[schema.id].FromString(message.data)))
    return found


def nanos(time: Any) -> int:
    return int(time.seconds * SECOND + time.nanos)


@pytest.fixture(scope="module")
def extracted(root: Path, run: Run, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("events")
    out, events = folder / "out", folder / "events"
    run(["extract", root / "fixtures", "-o", out, "--events", events])
    return out, events


def test_events_are_the_segments(extracted: tuple[Path, Path]) -> None:
    out, events = extracted
    segments = load(out, "segments").with_columns(pl.col("start_time", "end_time").dt.epoch("ns"))
    recordings = load(out, "recordings")["recording"].to_list()
    files = sorted(str(path.relative_to(events)) for path in events.rglob("*.mcap"))
    assert files == sorted(name.removesuffix(".mcap") + ".events.mcap" for name in recordings)
    for name in recordings:
        expected = segments.filter(recording=name).drop("recording", "actions").to_dicts()
        found = []
        for topic, log_time, event in decoded(events / (name.removesuffix(".mcap") + ".events.mcap")):
            if topic == "/coact/events":
                assert log_time == nanos(event.start_time)
                metadata = {pair.key: pair.value for pair in event.metadata}
                found.append(metadata | {"start_time": nanos(event.start_time), "end_time": nanos(event.end_time)})
        as_text = [{k: str(v) for k, v in row.items() if v is not None} for row in expected]
        # Python and Rust write some floats differently, and mean the same.
        floats = {"state_change_sum", "state_change_peak", "reward_sum"}
        for rows in (found, as_text):
            for row in rows:
                row.update({k: float(row[k]) for k in floats & row.keys()})
                row.update({k: int(row[k]) for k in ("start_time", "end_time")})
        key = lambda row: tuple(sorted((k, str(v)) for k, v in row.items()))  # noqa: E731
        assert sorted(found, key=key) == sorted(as_text, key=key)


def test_a_viewer_that_opens_both_files_has_one_time(extracted: tuple[Path, Path], root: Path) -> None:
    _, events = extracted
    recording = root / "fixtures/recordings/cartpole.mcap"
    with recording.open("rb") as stream:
        steps = Counter(m.log_time for _, c, m in make_reader(stream).iter_messages() if c.topic == "/step")
    messages = decoded(events / "cartpole.events.mcap")
    times = {t: Counter(time for topic, time, _ in messages if topic == t) for t in ("/coact/state", "/coact/joints/push")}
    assert times["/coact/state"] == times["/coact/joints/push"] == steps


def test_the_summary_lists_topics_and_the_parameters_are_told(extracted: tuple[Path, Path]) -> None:
    _, events = extracted
    with (events / "halfcheetah.events.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        (metadata,) = reader.iter_metadata()
    assert summary is not None and summary.statistics is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/coact/events", "/coact/state", "/coact/joints/bthigh"} <= topics
    assert metadata.name == "coact"
    assert metadata.metadata["recording"] == "halfcheetah.mcap"
    assert metadata.metadata["coact.measure"] == "earth-mover"
