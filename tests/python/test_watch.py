"""`coact watch` beside files that grow: what is committed, and when, against one later `coact extract`."""

from __future__ import annotations

import io
import json
import math
import random
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from conftest import Run
from mcap.writer import CompressionType, Writer
from polars.testing import assert_frame_equal

from committed_tables import read_committed

START_TIME_NANOS = 1_700_000_000_000_000_000
PATIENCE_SECONDS = 60
KEYS = {
    "segments": ["recording", "episode", "episode_id", "joint", "segment"],
    "steps": ["recording", "episode", "episode_id", "joint", "step"],
    "episodes": ["recording", "episode", "episode_id"],
    "recordings": ["recording"],
}


# What is watched ------------------------------------------------------------------------------------------------------


class Growing:
    """A recording that is written bit by bit: the bytes of one whole file, of which more and more are there."""

    def __init__(self, path: Path, *, interleaved: bool = False, chunked: bool = True, n_episodes: int = 6) -> None:
        self.path = path
        self.ends: list[int] = []
        """Behind the chunk with the last step of each episode."""
        buffer = io.BytesIO()
        compression = CompressionType.ZSTD if chunked else CompressionType.NONE
        writer = Writer(buffer, compression=compression, use_chunking=chunked)
        writer.start(library="test_watch")
        channel = writer.register_channel("/step", "json", writer.register_schema("Step", "jsonschema", b"{}"))
        writer.add_metadata("recording", {"env_id": "Test-v0", "action_names": '["push"]'})
        for nth, step in enumerate(steps(n_episodes, interleaved=interleaved)):
            at = START_TIME_NANOS + nth * 20_000_000
            writer.add_message(channel, at, json.dumps(step).encode(), at)
            if step["terminated"]:
                writer.flush()
                self.ends.append(buffer.tell())
        writer.finish()
        self.data = buffer.getvalue()
        self.n_bytes = 0

    def grow(self, n_bytes: int | None = None) -> None:
        """Writes on up to so many bytes, to the end without a number."""
        until = len(self.data) if n_bytes is None else n_bytes
        with self.path.open("ab") as stream:
            stream.write(self.data[self.n_bytes : until])
        self.n_bytes = until


def steps(n_episodes: int, *, interleaved: bool) -> Iterator[dict[str, Any]]:
    """Steps of episodes one after the other; or of pairs at once, of which the first to begin is the last to end."""
    lengths = [30 + 7 * (episode % 4) for episode in range(n_episodes)]
    dice = random.Random(n_episodes)

    def step(episode: int, number: int) -> dict[str, Any]:
        return {
            "episode": episode,
            "step": number,
            "action": round(math.sin(number / 3 + episode), 1),
            "state": [math.cos(number * (2 + episode) / 5), dice.random()],
            "reward": 1.0,
            "terminated": number == lengths[episode] - 1,
            "truncated": False,
        }

    if not interleaved:
        for episode in range(n_episodes):
            yield from (step(episode, number) for number in range(lengths[episode]))
        return
    for first in range(0, n_episodes, 2):
        yield step(first, 0)
        yield from (step(first + 1, number) for number in range(lengths[first + 1]))
        yield from (step(first, number) for number in range(1, lengths[first]))


# The watcher ----------------------------------------------------------------------------------------------------------


@dataclass
class Watcher:
    """A process that watches `runs`, started and ended as often as a test likes."""

    command: list[str | Path]
    out: Path
    process: subprocess.Popen[str] | None = None
    told: list[str] = field(default_factory=list)

    def start(self) -> None:
        log = (self.out.parent / "told.txt").open("a")
        self.process = subprocess.Popen(self.command, stdout=subprocess.PIPE, stderr=log, text=True)
        log.close()

    def kill(self) -> None:
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def stop(self, how: signal.Signals = signal.SIGTERM) -> str:
        """Asks it to end, which is no failure; its summary."""
        assert self.process is not None
        self.process.send_signal(how)
        stdout, _ = self.process.communicate(timeout=PATIENCE_SECONDS)
        assert self.process.returncode == 0, self.said()
        return stdout

    def said(self) -> str:
        return (self.out.parent / "told.txt").read_text()

    def n(self, table: str) -> int:
        rows = read_committed(self.out, table)
        return 0 if rows is None else rows.height

    def wait_for(self, is_so: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE_SECONDS
        while not is_so():
            assert self.process is not None
            assert self.process.poll() is None, f"it ended\n{self.said()}"
            assert time.monotonic() < deadline, f"{what} did not come about\n{self.said()}"
            time.sleep(0.02)

    def wait_for_episodes(self, n: int) -> None:
        self.wait_for(lambda: self.n("episodes") >= n, f"{n} episodes")
        assert self.n("episodes") == n

    def wait_until_told(self, what: str) -> None:
        self.wait_for(lambda: what in self.said(), repr(what))


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    folder.mkdir()
    return folder


@pytest.fixture
def watching(coact: Path, runs: Path) -> Iterator[Callable[..., Any]]:
    """Starts a watcher, which does not outlive the test."""

    @contextmanager
    def watching(*options: str) -> Iterator[Watcher]:
        out = runs.parent / "live"
        watcher = Watcher([coact, "watch", runs, "-o", out, "--interval", "0.02", *options], out)
        watcher.start()
        try:
            yield watcher
        finally:
            if watcher.process is not None and watcher.process.poll() is None:
                watcher.kill()

    yield watching


def check_equal(run: Run, runs: Path, live: Path, expect: int = 0) -> None:
    """All four tables are those of a run over what is there now, but for the order of the rows; and that run finds
    nothing left to do."""
    batch = runs.parent / "batch"
    run(["extract", runs, "-o", batch, "-q"], expect)
    for table, keys in KEYS.items():
        rows = read_committed(live, table)
        assert rows is not None
        expected = pl.read_parquet(f"{batch}/{table}/*.parquet").sort(keys)
        assert_frame_equal(rows.sort(keys), expected, check_exact=True)
        # After a clean stop a glob does as well.
        assert_frame_equal(pl.read_parquet(f"{live}/{table}/*.parquet").sort(keys), expected, check_exact=True)
    parts = sorted(live.glob("*/*.parquet"))
    run(["extract", runs, "-o", live, "-q"], expect)
    assert sorted(live.glob("*/*.parquet")) == parts


# Tests ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("chunked", [True, False])
def test_each_episode_is_there_once_its_last_step_is(
    watching: Callable[..., Any], runs: Path, run: Run, chunked: bool
) -> None:
    growing = Growing(runs / "a.mcap", chunked=chunked)
    with watching() as watcher:
        for n, end in enumerate(growing.ends):
            growing.grow(end - 1)
            watcher.wait_for_episodes(n)
            growing.grow(end)
            watcher.wait_for_episodes(n + 1)
        assert watcher.n("recordings") == 0
        growing.grow()
        watcher.wait_for(lambda: watcher.n("recordings") == 1, "the row of the recording")
        assert watcher.said() == ""
        assert "1 recording complete, 0 not" in watcher.stop(signal.SIGINT)
        assert (watcher.out / "_SUCCESS").exists()
        check_equal(run, runs, watcher.out)


def test_of_interleaved_episodes_each_is_there_when_it_ends(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    growing = Growing(runs / "a.mcap", interleaved=True)
    with watching() as watcher:
        growing.grow(growing.ends[0])
        watcher.wait_for_episodes(1)
        rows = read_committed(watcher.out, "episodes")
        assert rows is not None
        assert rows["episode"].to_list() == [1], "the second to begin is the first to end"
        watcher.kill()
        watcher.start()
        growing.grow(growing.ends[2])
        watcher.wait_for_episodes(3)
        watcher.kill()
        # A run over all of it takes up what a watch has left.
        growing.grow()
        run(["extract", runs, "-o", watcher.out, "-q"])
        watcher.start()
        watcher.wait_for(lambda: not (watcher.out / "_SUCCESS").exists(), "a beginning")
        watcher.stop()
        check_equal(run, runs, watcher.out)


def test_a_file_that_grows_byte_by_byte_is_never_taken_for_a_damaged_one(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    growing = Growing(runs / "a.mcap", n_episodes=2)
    dice = random.Random(7)
    with watching() as watcher:
        n_bytes = 0
        while n_bytes < len(growing.data):
            # Every byte around the ends of records, larger pieces between.
            is_near = any(abs(end - n_bytes) < 40 for end in [20, *growing.ends, len(growing.data)])
            n_bytes = min(n_bytes + (1 if is_near else dice.randrange(1, 200)), len(growing.data))
            growing.grow(n_bytes)
            time.sleep(0.002)
        watcher.wait_for(lambda: watcher.n("recordings") == 1, "the row of the recording")
        watcher.stop()
        assert watcher.said() == ""
        check_equal(run, runs, watcher.out)


def test_killed_at_random_moments_it_loses_and_doubles_nothing(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    files = [Growing(runs / f"{name}.mcap", interleaved=name == "b", n_episodes=16) for name in "abc"]
    dice = random.Random(11)
    # Merges are many, so that some kills fall into one.
    with watching("--merge-after", "2") as watcher:
        for _ in range(12):
            for growing in files:
                growing.grow(min(growing.n_bytes + dice.randrange(len(growing.data) // 8), len(growing.data)))
            time.sleep(dice.uniform(0.0, 0.15))
            watcher.kill()
            watcher.start()
        for growing in files:
            growing.grow()
        watcher.wait_for(lambda: watcher.n("recordings") == 3, "the rows of the recordings")
        watcher.stop()
        assert watcher.said() == ""
        check_equal(run, runs, watcher.out)


def test_small_parts_are_merged_and_a_reader_never_sees_a_row_twice_or_not_at_all(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    growing = Growing(runs / "a.mcap", n_episodes=40)
    with watching("--merge-after", "4") as watcher:
        for n, end in enumerate(growing.ends, start=1):
            growing.grow(end)
            # Each look is one reader: it sees n - 1 or n episodes, each once, whatever is merged meanwhile.
            watcher.wait_for_episodes(n)
            rows = read_committed(watcher.out, "episodes")
            assert rows is not None
            assert rows["episode"].to_list() == list(range(n))
        n_parts = len(list(watcher.out.glob("segments/*.parquet")))
        assert n_parts < 16, f"{n_parts} parts of 40 commits"
        assert len(list((watcher.out / "_coact/commits").iterdir())) == n_parts
        growing.grow()
        watcher.stop()
        check_equal(run, runs, watcher.out)


def test_a_signal_commits_what_is_complete_and_the_next_process_goes_on(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    growing = Growing(runs / "a.mcap")
    with watching() as watcher:
        watcher.wait_for(lambda: watcher.n("episodes") == 0 and (watcher.out / "segments").exists(), "the tables")
        growing.grow(growing.ends[2] + 20)
        # Written before the signal: it is taken, whether or not the watcher has looked meanwhile.
        assert watcher.stop().startswith("3 episodes, "), watcher.said()
        assert watcher.n("episodes") == 3
        assert not (watcher.out / "_SUCCESS").exists(), "a recording is not complete"
        watcher.start()
        growing.grow()
        watcher.wait_for(lambda: watcher.n("recordings") == 1, "the row of the recording")
        watcher.stop()
        check_equal(run, runs, watcher.out)


def test_a_recording_that_is_gone_or_another_is_told_of_and_the_others_go_on(
    watching: Callable[..., Any], runs: Path
) -> None:
    names = ["gone", "shorter", "another", "whole"]
    files = {name: Growing(runs / f"{name}.mcap") for name in names}
    with watching() as watcher:
        for growing in files.values():
            growing.grow(growing.ends[1])
        watcher.wait_for_episodes(8)
        files["gone"].path.unlink()
        watcher.wait_until_told("gone.mcap is gone before it was complete; its 2 episodes stay")
        with files["shorter"].path.open("r+b") as stream:
            stream.truncate(100)
        watcher.wait_until_told("shorter.mcap is shorter than it was")
        Growing(runs / "new.part", interleaved=True).grow()
        (runs / "new.part").rename(files["another"].path)
        watcher.wait_until_told("another.mcap is not the recording that it was")
        files["whole"].grow()
        watcher.wait_for(lambda: watcher.n("recordings") == 1, "the row of the recording")
        summary = watcher.stop()
        assert watcher.n("episodes") == 2 + 2 + 2 + 6
        assert len(watcher.said().splitlines()) == 3, watcher.said()
        assert "1 recording complete, 2 not" in summary


def test_a_run_with_half_a_recording_is_not_marked_as_done(watching: Callable[..., Any], runs: Path) -> None:
    half, whole = Growing(runs / "half.mcap"), Growing(runs / "whole.mcap")
    with watching() as watcher:
        half.grow(half.ends[1])
        whole.grow()
        watcher.wait_for(lambda: watcher.n("episodes") == 2 + 6, "the episodes")
        half.path.unlink()
        watcher.wait_until_told("half.mcap is gone before it was complete; its 2 episodes stay")
        watcher.stop()
        assert watcher.n("recordings") == 1
        assert not (watcher.out / "_SUCCESS").exists()


def test_another_recording_put_in_the_place_of_one_being_read_is_not_taken_for_it(
    watching: Callable[..., Any], runs: Path
) -> None:
    growing = Growing(runs / "x.mcap")
    with watching() as watcher:
        growing.grow(growing.ends[1])
        watcher.wait_for_episodes(2)
        Growing(runs / "new.part", n_episodes=9).grow()
        watcher.kill()
        (runs / "new.part").rename(growing.path)
        watcher.start()
        watcher.wait_until_told("x.mcap is not the recording that it was")
        watcher.stop()
        assert watcher.n("episodes") == 2
        assert not (watcher.out / "_SUCCESS").exists()


def test_what_is_no_recording_is_told_once_and_read_again_once_it_is_one(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    (runs / "page.mcap").write_text("<!DOCTYPE html>")
    good = Growing(runs / "good.mcap")
    good.grow()
    with watching() as watcher:
        watcher.wait_for(lambda: watcher.n("recordings") == 2, "two rows")
        watcher.wait_until_told("HTML")
        rows = read_committed(watcher.out, "recordings")
        assert rows is not None
        assert dict(rows.select("recording", "status").iter_rows()) == {"good.mcap": "ok", "page.mcap": "failed"}
        time.sleep(0.2)
        assert len(watcher.said().splitlines()) == 1, watcher.said()
        (runs / "page.mcap").unlink()
        Growing(runs / "page.mcap").grow()
        watcher.wait_for_episodes(12)
        watcher.wait_for(lambda: watcher.n("recordings") == 2, "two rows")
        watcher.stop()
        check_equal(run, runs, watcher.out)


def test_what_must_be_read_as_a_whole_is_read_once_it_is_complete(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    source = Path(__file__).resolve().parents[1] / "data/recordings/ros2/pendulum.mcap"
    data = source.read_bytes()
    (runs / "robot.mcap").write_bytes(data[:-100])
    zstandard = pytest.importorskip("zstandard")
    packed = zstandard.compress(Growing(runs / "packed.mcap.zst").data)
    (runs / "packed.mcap.zst").write_bytes(packed[:500])
    with watching() as watcher:
        watcher.wait_until_told("robot.mcap is read when it is complete")
        assert watcher.n("recordings") == 0
        (runs / "robot.mcap").write_bytes(data)
        watcher.wait_for(lambda: watcher.n("recordings") == 1, "the row of the recording")
        (runs / "packed.mcap.zst").write_bytes(packed)
        watcher.wait_for(lambda: watcher.n("recordings") == 2, "the row of the recording")
        watcher.stop()
        check_equal(run, runs, watcher.out)


def test_a_run_takes_up_a_recording_that_was_never_closed(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    growing = Growing(runs / "a.mcap")
    with watching() as watcher:
        growing.grow(growing.ends[3] + 300)
        watcher.wait_for_episodes(4)
        watcher.kill()
        run(["extract", runs, "-o", watcher.out, "-q"], 3)
        rows = read_committed(watcher.out, "recordings")
        assert rows is not None
        assert rows["status"].to_list() == ["recovered"]
        check_equal(run, runs, watcher.out, 3)


def test_names_stay_as_recordings_come_and_a_run_knows_them(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    (runs / "deep").mkdir()
    Growing(runs / "deep/a.mcap").grow()
    with watching() as watcher:
        watcher.wait_for(lambda: watcher.n("recordings") == 1, "the row of the recording")
        watcher.stop()
        # A run by itself would call it a.mcap.
        run(["extract", runs, "-o", watcher.out, "-q"])
        Growing(runs / "b.mcap").grow()
        watcher.start()
        watcher.wait_for(lambda: watcher.n("recordings") == 2, "the row of the recording")
        watcher.stop()
        check_equal(run, runs, watcher.out)


def test_only_one_process_watches_and_arguments_are_checked(
    watching: Callable[..., Any], runs: Path, run: Run
) -> None:
    with watching() as watcher:
        watcher.wait_for((watcher.out / "segments").exists, "the tables")
        for command in ("watch", "extract"):
            Growing(runs / f"{command}.mcap").grow()
            assert "in use by another process" in run([command, runs, "-o", watcher.out], 1).stderr
    assert "is no folder" in run(["watch", runs / "watch.mcap", "-o", runs / "out"], 2).stderr
    assert "no output directory" in run(["watch", runs], 2).stderr
    assert "--events" in run(["watch", runs, "-o", runs / "out", "--events", runs / "events"], 2).stderr
    assert "interval" in run(["watch", runs, "-o", runs / "out", "--interval", "0"], 2).stderr
