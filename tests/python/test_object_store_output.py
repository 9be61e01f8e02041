"""Tables in a store that speaks S3: the rows of a local run, once each, whatever happens to connections and processes.

Needs `moto[server]` and a `coact` with the feature `cloud`: scripts/test_cloud.sh has both.
"""

from __future__ import annotations

import json
import os
import random
import signal
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
BUCKET = "results"
# Several part groups, of recordings that have 100 to 1,000 steps.
SMALL_PARTS = "--max-part-rows=1500"
# What is uploaded in pieces is larger.
PIECE = 8 << 20


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[str, int]]:
    yield from serve()


@pytest.fixture(scope="module")
def s3(server: tuple[str, int]):  # noqa: ANN201
    s3 = client(server)
    s3.create_bucket(Bucket=BUCKET)
    return s3


@pytest.fixture
def proxy(server: tuple[str, int], s3) -> Proxy:  # noqa: ANN001
    return Proxy(server)


class Process:
    """`coact` in the environment of a proxy."""

    def __init__(self, coact: Path, proxy: Proxy, folder: Path) -> None:
        self.coact, self.proxy, self.folder = coact, proxy, folder
        folder.mkdir()

    def start(self, *args: object) -> subprocess.Popen[str]:
        env = {**self.proxy.env(), "TMPDIR": str(self.folder)}
        command = [str(self.coact), *map(str, args)]
        return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def __call__(self, *args: object) -> subprocess.CompletedProcess[str]:
        process = self.start(*args)
        out, err = process.communicate(timeout=120)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def staged(self) -> list[Path]:
        return list(self.folder.iterdir())


@pytest.fixture
def run(coact: Path, proxy: Proxy, tmp_path: Path) -> Process:
    return Process(coact, proxy, tmp_path / "staging")


@pytest.fixture(scope="module")
def recordings(root: Path) -> Path:
    return root / "fixtures/recordings"


@pytest.fixture(scope="module")
def local(coact: Path, recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of a local run, in parts of the same size."""
    out = tmp_path_factory.mktemp("local") / "out"
    subprocess.run([coact, "extract", recordings, "-o", out, "-q", SMALL_PARTS], check=True, timeout=120)
    assert len(list((out / "_coact/commits").iterdir())) > 3
    return out


@pytest.fixture
def fetch(s3, tmp_path: Path) -> Callable[[str], Path]:  # noqa: ANN001
    """All of a prefix as a folder."""

    def fetch(prefix: str) -> Path:
        folder = tmp_path / f"fetched-{prefix}"
        for key in keys(s3, prefix):
            path = folder / key
            path.parent.mkdir(parents=True, exist_ok=True)
            s3.download_file(BUCKET, key, str(path))
        return folder / prefix

    return fetch


def keys(s3, prefix: str) -> list[str]:  # noqa: ANN001
    pages = s3.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=f"{prefix}/")
    return [found["Key"] for page in pages for found in page.get("Contents", [])]


def assert_same_rows(found: Path, expected: Path, *, sort: bool = False) -> None:
    """All parts are read, also those that no commit names: there must be none."""
    for table in TABLES:
        tables = [pq.read_table(out / table) for out in (found, expected)]
        if sort:
            order = [(name, "ascending") for name in ("recording", "episode", "joint", "step", "start_step")]
            tables = [t.sort_by([o for o in order if o[0] in t.column_names]) for t in tables]
        assert tables[0].equals(tables[1]), table
    assert (found / "_SUCCESS").is_file()


def test_rows_are_those_of_a_local_run(run: Process, fetch, local: Path, recordings: Path) -> None:  # noqa: ANN001
    done = run("extract", recordings, "-o", f"s3://{BUCKET}/whole/", "-q", SMALL_PARTS)
    assert done.returncode == 0, done.stderr
    found = fetch("whole")
    assert_same_rows(found, local)
    of = lambda out: sorted(str(p.relative_to(out)) for p in out.rglob("*") if "lock-" not in p.name)  # noqa: E731
    assert of(found) == of(local)
    assert run.staged() == []
    # The program reads what was fetched, too.
    assert run("diff", found, local).returncode == 0
    # Again: nothing is read, nothing changes.
    requests: list[str] = []
    run.proxy.on_request = requests.append
    again = run("extract", recordings, "-o", f"s3://{BUCKET}/whole", "--summary", "json", SMALL_PARTS)
    assert json.loads(again.stdout)["n_recordings_before"] == 12
    assert not [r for r in requests if not r.startswith(("GET ", "HEAD "))]


def test_another_run_is_refused_and_overwritten(run: Process, s3, fetch, local, recordings: Path) -> None:  # noqa: ANN001
    out = f"s3://{BUCKET}/another"
    s3.put_object(Bucket=BUCKET, Key="another/notes.txt", Body=b"mine")
    assert run("extract", recordings, "-o", out, "-q", "--bins", 4, SMALL_PARTS).returncode == 0
    before = keys(s3, "another")
    done = run("extract", recordings, "-o", out, SMALL_PARTS)
    assert done.returncode == 2
    assert f"{out} holds another run (bins was 4, is" in done.stderr
    assert keys(s3, "another") == before
    assert run("extract", recordings, "-o", out, "-q", SMALL_PARTS, "--overwrite").returncode == 0
    assert_same_rows(fetch("another"), local)
    assert "another/notes.txt" in keys(s3, "another")


def test_cut_uploads_are_made_again(run: Process, fetch, tmp_path: Path) -> None:  # noqa: ANN001
    folder = tmp_path / "runs"
    folder.mkdir()
    write_noise(folder / "noise.mcap")
    assert run("extract", folder, "-o", tmp_path / "local", "-q").returncode == 0
    parts = [path.stat().st_size for path in (tmp_path / "local").rglob("*.parquet")]
    assert max(parts) > PIECE
    run.proxy.n_cut_requests = 12
    run.proxy.n_lost_answers = 3
    done = run("extract", folder, "-o", f"s3://{BUCKET}/cut", "-q")
    assert done.returncode == 0, done.stderr
    assert run.proxy.n_cuts == 15
    assert_same_rows(fetch("cut"), tmp_path / "local")


def write_noise(path: Path) -> None:
    """Values that no compression makes smaller."""
    rng = random.Random(1)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("Step", "jsonschema", b"{}")
        channel = writer.register_channel("/step", "json", schema)
        for i in range(40_000):
            action = [round(rng.random(), 9) for _ in range(32)]
            step = {"episode": i // 400, "step": i % 400, "action": action, "state": [rng.random()]}
            writer.add_message(channel, log_time=i * 10_000_000, publish_time=0, data=json.dumps(step).encode())
        writer.finish()


@pytest.mark.parametrize("nth", [1, 2, 3, 5, 6, 7, 11, 16, 21, 26, 31])
def test_what_a_killed_process_left_is_neither_lost_nor_doubled(run: Process, fetch, local, recordings, nth: int) -> None:  # noqa: ANN001
    out = f"s3://{BUCKET}/killed-{nth}"
    left = [nth]
    process: list[subprocess.Popen[str]] = []
    started = threading.Event()

    def kill(request: str) -> None:
        if request.startswith("PUT "):
            left[0] -= 1
            if left[0] == 0:
                started.wait(10)
                process[0].kill()

    run.proxy.on_request = kill
    process.append(run.start("extract", recordings, "-o", out, "-q", SMALL_PARTS))
    started.set()
    process[0].communicate(timeout=120)
    assert process[0].returncode == -signal.SIGKILL
    again = run("extract", recordings, "-o", out, "-q", SMALL_PARTS)
    assert again.returncode == 0, again.stderr
    assert_same_rows(fetch(f"killed-{nth}"), local, sort=True)


def test_a_run_that_is_stopped_goes_on(run: Process, fetch, local, recordings: Path) -> None:  # noqa: ANN001
    out = f"s3://{BUCKET}/stopped"
    process: list[subprocess.Popen[str]] = []
    started = threading.Event()
    n_puts = [0]

    def stop(request: str) -> None:
        n_puts[0] += request.startswith("PUT ")
        if n_puts[0] == 4:
            started.wait(10)
            process[0].send_signal(signal.SIGTERM)

    run.proxy.on_request = stop
    process.append(run.start("extract", recordings, "-o", out, "-q", SMALL_PARTS))
    started.set()
    process[0].communicate(timeout=120)
    assert process[0].returncode in (0, 143)
    assert run.staged() == []
    assert run("extract", recordings, "-o", out, "-q", SMALL_PARTS).returncode == 0
    assert_same_rows(fetch("stopped"), local, sort=True)


def test_two_processes_at_once_give_one_copy(run: Process, fetch, local, recordings: Path) -> None:  # noqa: ANN001
    overtaken = 0
    for round in range(6):
        out = f"s3://{BUCKET}/twice-{round}"
        both = [run.start("extract", recordings, "-o", out, "-q", SMALL_PARTS) for _ in range(2)]
        told = [process.communicate(timeout=120)[1] for process in both]
        codes = [process.returncode for process in both]
        assert sorted(codes) in ([0, 0], [0, 1], [1, 1]), told
        for code, err in zip(codes, told, strict=True):
            assert code == 0 or "is being written by another process as well" in err
        overtaken += 1 in codes
        # Whoever comes last finds all as it should be, or makes it so.
        assert run("extract", recordings, "-o", out, "-q", SMALL_PARTS).returncode == 0
        assert_same_rows(fetch(f"twice-{round}"), local, sort=True)
    assert overtaken > 0


def test_recordings_that_failed_are_tried_again(run: Process, fetch, recordings: Path, tmp_path: Path) -> None:  # noqa: ANN001
    folder = tmp_path / "runs"
    folder.mkdir()
    for path in recordings.glob("*.mcap"):
        (folder / path.name).write_bytes(path.read_bytes())
    whole = (folder / "cartpole.mcap").read_bytes()
    (folder / "cartpole.mcap").write_bytes(b"")
    out = f"s3://{BUCKET}/failed"
    assert run("extract", folder, "-o", out, "-q", SMALL_PARTS).returncode == 3
    (folder / "cartpole.mcap").write_bytes(whole)
    assert run("extract", folder, "-o", out, "-q", SMALL_PARTS).returncode == 0
    assert run("extract", folder, "-o", tmp_path / "local", "-q", SMALL_PARTS).returncode == 0
    assert_same_rows(fetch("failed"), tmp_path / "local", sort=True)


def test_shards_need_no_disk_that_they_share(run: Process, s3, fetch, local, recordings: Path) -> None:  # noqa: ANN001
    out = f"s3://{BUCKET}/shards"
    for path in recordings.glob("*.mcap"):
        s3.upload_file(str(path), BUCKET, f"recordings/{path.name}")
    source = f"s3://{BUCKET}/recordings"
    assert "holds no plan" in run("finish", out).stderr
    assert run("plan", source, "-o", out, "--shards", 3, SMALL_PARTS).returncode == 0
    assert "the same plan" in run("plan", source, "-o", out, "--shards", 3, SMALL_PARTS).stdout
    other = run("plan", source, "-o", out, "--shards", 2, SMALL_PARTS)
    assert (other.returncode, f"{out} holds another run" in other.stderr) == (2, True)
    whole = run("extract", source, "-o", out, SMALL_PARTS)
    assert (whole.returncode, "a plan, whose shards" in whole.stderr) == (2, True)
    for shard in (3, 1):
        assert run("extract", "--shard", f"{shard}/3", "-o", out, "-q").returncode == 0
    missing = run("finish", out)
    assert (missing.returncode, "missing shards: 2" in missing.stderr) == (1, True)
    # One that is killed behind its first part.
    process: list[subprocess.Popen[str]] = []
    started = threading.Event()

    def kill(request: str) -> None:
        if "/commits/" in request and request.startswith("PUT "):
            started.wait(10)
            process[0].kill()

    run.proxy.on_request = kill
    process.append(run.start("extract", "--shard", "2/3", "-o", out, "-q"))
    started.set()
    process[0].communicate(timeout=120)
    run.proxy.on_request = None
    assert run("extract", "--shard", "2/3", "-o", out, "-q").returncode == 0
    # A part that no commit names is not removed under a process that may be about to name it.
    s3.put_object(Bucket=BUCKET, Key="shards/segments/part-00001-00077.parquet", Body=b"unfinished")
    unnamed = run("finish", out)
    assert (unnamed.returncode, "run 1 again" in unnamed.stderr) == (1, True), unnamed.stderr
    assert run("extract", "--shard", "1/3", "-o", out, "-q").returncode == 0
    done = run("finish", out)
    assert done.returncode == 0, done.stderr
    assert_same_rows(fetch("shards"), local)


def test_what_cannot_go_to_a_store_is_refused_by_name(run: Process, recordings: Path, tmp_path: Path) -> None:
    out = f"s3://{BUCKET}/refused"
    for args, code, told in (
        (("extract", recordings, "-o", tmp_path / "out", "--events", out), 2, "events go to a file system"),
        (("watch", recordings, "-o", out), 2, "tables that grow go to a file system"),
        (("compare", recordings, "-o", f"{out}.parquet"), 2, "go to a file system"),
        (("extract", recordings, "-o", "https://127.0.0.1:1/out"), 2, "expected s3://, gs:// or az://"),
        (("extract", recordings, "-o", "ftp://host/out"), 2, "ftp:// is no store"),
        (("extract", recordings, "-o", "s3://no-such-bucket/out"), 1, "s3://no-such-bucket/out"),
    ):
        done = run(*args)
        assert (done.returncode, told in done.stderr) == (code, True), (args, done.returncode, done.stderr)
    assert run.staged() == []
