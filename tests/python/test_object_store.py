"""Recordings in a store that speaks S3, on this machine, behind a proxy that cuts connections in the middle of bodies.

Needs `moto[server]` and a `coact` with the feature `cloud`: scripts/test_cloud.sh has both.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from mcap.writer import CompressionType, Writer

if "COACT_CLOUD" not in os.environ:
    pytest.skip("the program is built without object stores", allow_module_level=True)

from store import Proxy, client, serve

TABLES = ("segments", "steps", "episodes", "recordings")
BUCKET = "recordings"
# A connection gives this much, then it is cut.
CUT_AFTER = 700_000


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory, root: Path) -> Path:
    """Recordings of several kinds, one larger than what is asked for at a time, one damaged, one empty."""
    folder = tmp_path_factory.mktemp("local") / "runs"
    (folder / "small").mkdir(parents=True)
    for name in ("cartpole.mcap", "fetch_pickandplace.mcap", "pendulum.mcap"):
        (folder / "small" / name).write_bytes((root / "fixtures/recordings" / name).read_bytes())
    write_large(folder / "large 1.mcap")
    whole = (folder / "large 1.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    (folder / "filled.mcap").write_bytes(whole[: len(whole) // 2] + bytes(100_000))
    (folder / "empty.mcap").write_bytes(b"")
    (folder / "notes.txt").write_text("no recording")
    return folder


def write_large(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("Step", "jsonschema", b"{}")
        channel = writer.register_channel("/step", "json", schema)
        for i in range(12_000):
            state = [math.sin(i * (k + 1) / 97) + (i // 50) % 3 for k in range(48)]
            step = {"episode": i // 400, "step": i % 400, "action": [(i // 9) % 4, math.cos(i / 31)], "state": state}
            data = json.dumps(step).encode()
            writer.add_message(channel, log_time=i * 10_000_000, publish_time=0, data=data)
        writer.finish()
    assert path.stat().st_size > 10_000_000


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[str, int]]:
    yield from serve()


@pytest.fixture(scope="module")
def proxy(server: tuple[str, int], local: Path) -> Proxy:
    s3 = client(server)
    s3.create_bucket(Bucket=BUCKET)
    for path in local.rglob("*"):
        if path.is_file():
            s3.put_object(Bucket=BUCKET, Key=f"runs/{path.relative_to(local)}", Body=path.read_bytes())
    return Proxy(server)


@pytest.fixture
def run(coact: Path, proxy: Proxy) -> Iterator[Callable[..., subprocess.CompletedProcess[str]]]:
    proxy.cut_after, proxy.on_bytes, proxy.n_cuts = None, None, 0

    def run(*args: object) -> subprocess.CompletedProcess[str]:
        command = [str(coact), *map(str, args)]
        return subprocess.run(command, env=proxy.env(), capture_output=True, text=True, timeout=120, check=False)

    yield run


def assert_same_tables(found: Path, expected: Path, *, sort: bool = False) -> None:
    """A recording that failed and was tried again stands behind the others: those tables are sorted first."""
    for table in TABLES:
        tables = [pq.read_table(out / table) for out in (found, expected)]
        if sort and table == "recordings":
            tables = [t.sort_by("recording") for t in tables]
        assert tables[0].equals(tables[1]), table


@pytest.fixture(scope="module")
def expected(coact: Path, local: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("expected") / "out"
    done = subprocess.run([coact, "extract", local, "-o", out, "-q"], check=False, timeout=120)
    assert done.returncode == 3
    assert len(pq.read_table(out / "episodes")) > 60
    return out


@pytest.mark.parametrize("cut_after", [None, CUT_AFTER], ids=["whole", "cut"])
def test_rows_are_those_of_local_files(run, proxy: Proxy, expected: Path, tmp_path: Path, cut_after) -> None:  # noqa: ANN001
    proxy.cut_after = cut_after
    out = tmp_path / "out"
    done = run("extract", f"s3://{BUCKET}/runs", "-o", out, "-q")
    assert done.returncode == 3, done.stderr
    assert_same_tables(out, expected)
    assert (proxy.n_cuts > 20) == (cut_after is not None)
    # The same command finds all that did not fail as it was.
    again = run("extract", f"s3://{BUCKET}/runs", "-o", out, "--summary", "json")
    assert json.loads(again.stdout)["n_recordings_before"] == 6
    assert_same_tables(out, expected, sort=True)


def test_shards_read_from_a_store(run, expected: Path, tmp_path: Path) -> None:  # noqa: ANN001
    out = tmp_path / "out"
    assert run("plan", f"s3://{BUCKET}/runs/", "-o", out, "--shards", 3).returncode == 0
    for shard in (3, 1, 2):
        assert run("extract", "--shard", f"{shard}/3", "-o", out, "-q").returncode in (0, 3)
    assert run("finish", out).returncode == 3
    assert_same_tables(out, expected)


def test_a_recording_that_is_replaced_while_it_is_read_is_told_of(run, proxy, server, tmp_path: Path) -> None:  # noqa: ANN001
    s3 = client(server)
    key = "replaced/large.mcap"
    body = s3.get_object(Bucket=BUCKET, Key="runs/large 1.mcap")["Body"].read()
    s3.put_object(Bucket=BUCKET, Key=key, Body=body)
    other = body.replace(b'"episode": 2,', b'"episode": 3,')
    once = threading.Lock()

    def replace(n_bytes: int) -> None:
        if n_bytes > 1_000_000 and once.acquire(blocking=False):
            s3.put_object(Bucket=BUCKET, Key=key, Body=other)

    proxy.on_bytes = replace
    done = run("extract", f"s3://{BUCKET}/{key}", "-o", tmp_path / "out", "-q")
    assert done.returncode in (1, 3)
    assert "it was replaced while it was read" in done.stderr


def test_what_a_store_cannot_do_is_refused_by_name(run, tmp_path: Path) -> None:  # noqa: ANN001
    out = tmp_path / "out"
    for args, code, told in (
        ((f"s3://{BUCKET}/runs/*.mcap",), 2, "object stores have none"),
        ((f"s3://{BUCKET}/nothing",), 1, "no recordings found"),
        (("s3://no-such-bucket/runs",), 1, "cannot list s3://no-such-bucket/runs"),
        (("ftp://host/a.mcap",), 1, "ftp:// is no store"),
        ((f"s3://{BUCKET}/gone.mcap",), 1, "no such object"),
        (("https://127.0.0.1:1/runs",), 1, "name each recording"),
    ):
        done = run("extract", *args, "-o", out)
        assert (done.returncode, told in done.stderr) == (code, True), (args, done.stderr)


def test_inspect_reads_from_a_store(run) -> None:  # noqa: ANN001
    done = run("inspect", f"s3://{BUCKET}/runs/small/cartpole.mcap")
    assert done.returncode == 0
    assert "/step" in done.stdout
