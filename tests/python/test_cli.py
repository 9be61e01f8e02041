"""The command as a user runs it: exit codes, what is printed where, and what is in the files."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from conftest import Run
from polars.testing import assert_frame_equal

TABLES = ("segments", "steps", "episodes", "recordings")
NO_EPISODE, BAD_ARGUMENTS, PARTIAL = 1, 2, 3
# Not the defaults.
METHOD = {"measure": "approximate", "bins": 32, "window": 8, "threshold": 0.3, "order": 2, "joints": "together"}


def as_options(method: dict[str, Any]) -> list[str]:
    """The options of the command line that ask for `method`."""
    return [text for name, value in method.items() for text in (f"--{name}", str(value))]


def load(out: Path, table: str) -> pl.DataFrame:
    """A table, as the README loads it."""
    return pl.read_parquet(f"{out}/{table}/*.parquet")


def assert_same_tables(left: Path, right: Path) -> None:
    """All tables are equal, to the last bit."""
    for table in TABLES:
        assert_frame_equal(load(left, table), load(right, table), check_exact=True)


@pytest.fixture(scope="session")
def recordings(root: Path) -> Path:
    """The folder of the fixtures."""
    return root / "fixtures" / "recordings"


@pytest.fixture(scope="session")
def cartpole(recordings: Path) -> Path:
    """A small recording."""
    return recordings / "cartpole.mcap"


# Help and arguments ---------------------------------------------------------------------------------------------------


def test_help_names_commands_options_and_exit_codes(run: Run) -> None:
    top = run(["--help"])
    assert "extract" in top.stdout
    assert top.stderr == ""
    extract = run(["extract", "--help"])
    assert extract.stderr == ""
    for option in ("--output", "--measure", "--profile", "--threads", "--summary", "--config", "--print-config"):
        assert f"{option} " in extract.stdout or f"{option}\n" in extract.stdout
    for text in ("earth-mover", "Examples:", "Exit codes:"):
        assert text in extract.stdout


def test_version(run: Run) -> None:
    name, version = run(["--version"]).stdout.split()
    assert name == "coact"
    assert all(part.isdigit() for part in version.split("."))


@pytest.mark.parametrize(
    "args",
    [
        ["--no-such-option"],
        ["--bins", "1"],
        ["--window", "1"],
        ["--threshold", "1"],
        ["--threshold", "nan"],
        ["--measure", "nothing"],
        ["--order", "3"],
    ],
)
def test_bad_arguments_exit_with_2_and_write_nothing(run: Run, cartpole: Path, tmp_path: Path, args: list[str]) -> None:
    done = run(["extract", cartpole, "-o", tmp_path / "out", *args], expect=BAD_ARGUMENTS)
    assert done.stdout == ""
    assert args[0] in done.stderr or args[0].lstrip("-") in done.stderr
    assert not (tmp_path / "out").exists()


def test_another_run_is_kept_unless_overwritten(run: Run, cartpole: Path, recordings: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run(["extract", cartpole, "-o", out])
    before = load(out, "recordings")
    refused = run(["extract", recordings / "pendulum.mcap", "-o", out], expect=BAD_ARGUMENTS)
    assert "--overwrite" in refused.stderr
    assert_frame_equal(load(out, "recordings"), before)
    run(["extract", recordings / "pendulum.mcap", "-o", out, "--overwrite"])
    for table in TABLES:
        assert set(load(out, table)["recording"]) == {"pendulum.mcap"}


def test_dry_run_reads_and_writes_nothing(run: Run, cartpole: Path, tmp_path: Path) -> None:
    done = run(["extract", cartpole, "-o", tmp_path / "out", "--dry-run", "--summary", "json"])
    assert json.loads(done.stdout)["n_messages_used"] > 0
    assert not (tmp_path / "out").exists()


# Summary --------------------------------------------------------------------------------------------------------------


def test_the_json_summary_agrees_with_the_tables(run: Run, recordings: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run(["extract", recordings, "-o", out, "--summary", "json"])
    assert done.stderr == ""
    summary = json.loads(done.stdout)
    tables = {table: load(out, table) for table in TABLES}

    assert summary["outcome"] == "done"
    assert summary["remarks"] == []
    assert summary["recordings"] == dict(Counter(tables["recordings"]["status"]))
    assert summary["episodes"] == dict(Counter(tables["episodes"]["status"]))
    assert summary["n_steps"] == tables["episodes"]["n_steps"].sum()
    assert summary["n_dropped_steps"] == tables["episodes"]["n_dropped_steps"].sum()
    assert summary["n_segments"] == len(tables["segments"]) == tables["episodes"]["n_segments"].sum()
    for name in ("n_messages", "n_messages_used", "n_messages_refused", "bytes"):
        assert summary[name] == tables["recordings"][name].sum()
    assert summary["bytes"] == sum(path.stat().st_size for path in recordings.iterdir())

    env_ids = tables["episodes"].select("recording", "episode", "env_id")
    segments = tables["segments"].join(env_ids, on=["recording", "episode"], validate="m:1")
    assert set(summary["environments"]) == set(env_ids["env_id"])
    for env_id, environment in summary["environments"].items():
        episodes = tables["episodes"].filter(pl.col("env_id") == env_id)
        assert environment["n_recordings"] == episodes["recording"].n_unique()
        assert environment["n_episodes"] == len(episodes)
        assert environment["n_steps"] == episodes["n_steps"].sum()
        for joint, counts in environment["joints"].items():
            of_joint = segments.filter(pl.col("env_id") == env_id, pl.col("joint") == int(joint))
            assert of_joint["joint_name"].unique().to_list() == [counts["joint_name"]]
            assert counts["n_segments"] == len(of_joint)
            assert counts["n_segment_steps"] == of_joint["n_steps"].sum()


def test_the_text_summary_has_the_totals(run: Run, cartpole: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run(["extract", cartpole, "-o", out])
    assert done.stderr == ""
    *_, total = done.stdout.splitlines()
    n_steps, n_segments = load(out, "episodes")["n_steps"].sum(), len(load(out, "segments"))
    assert total.startswith(f"1 recording, 3 episodes, {n_steps} steps: {n_segments} composite actions in ")


def test_quiet_prints_nothing(run: Run, cartpole: Path, tmp_path: Path) -> None:
    done = run(["extract", cartpole, "-o", tmp_path / "out", "--quiet"])
    assert (done.stdout, done.stderr) == ("", "")


def test_the_number_of_threads_changes_nothing(run: Run, recordings: Path, tmp_path: Path) -> None:
    for threads in ("1", "2"):
        run(["extract", recordings, "-o", tmp_path / threads, "--threads", threads])
    assert_same_tables(tmp_path / "1", tmp_path / "2")
    assert len(load(tmp_path / "1", "segments")) > 0


# Recordings -----------------------------------------------------------------------------------------------------------


def test_recordings_say_what_was_read_and_how(run: Run, recordings: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run(["extract", recordings, "-o", out])
    table = load(out, "recordings")
    assert table["recording"].to_list() == sorted(path.name for path in recordings.iterdir())
    assert table["bytes"].to_list() == [(recordings / name).stat().st_size for name in table["recording"]]
    same = {
        "status": "ok",
        "reason": None,
        "encoding": "json",
        "action_selector": "/step:action",
        "state_selector": "/step:state",
        "episode_rule": "field:/step:episode",
        "n_messages_refused": 0,
    }
    assert table.select(list(same)).unique().to_dicts() == [same]
    assert (table["causes"].list.len() == 0).all()
    assert (table["n_messages"] == table["n_messages_used"] + table["n_messages_refused"]).all()
    used = load(out, "episodes").group_by("recording", maintain_order=True).agg(pl.len(), pl.col("n_steps").sum())
    assert table["n_episodes"].to_list() == used["len"].to_list()
    assert table["n_messages_used"].to_list() == used["n_steps"].to_list()


def test_a_file_that_is_no_recording_does_not_harm_a_good_one(run: Run, cartpole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "mixed"
    folder.mkdir()
    shutil.copy(cartpole, folder)
    (folder / "bad.mcap").write_text("no recording\n", encoding="utf-8")
    out, out_good = tmp_path / "out", tmp_path / "good"
    done = run(["extract", folder, "-o", out, "--summary", "json"], expect=PARTIAL)
    run(["extract", cartpole, "-o", out_good])

    assert "bad.mcap" in done.stderr
    summary = json.loads(done.stdout)
    assert summary["outcome"] == "partial"
    assert summary["recordings"] == {"failed": 1, "ok": 1}
    assert [remark["recording"] for remark in summary["remarks"]] == ["bad.mcap"]

    table = load(out, "recordings")
    assert dict(table.select("recording", "status").rows()) == {"bad.mcap": "failed", "cartpole.mcap": "ok"}
    failed = table.row(by_predicate=pl.col("status") == "failed", named=True)
    assert "not an MCAP recording" in failed["reason"]
    assert (failed["bytes"], failed["n_messages"], failed["n_episodes"]) == (13, 0, 0)
    for name in ("segments", "steps", "episodes"):
        assert_frame_equal(load(out, name), load(out_good, name), check_exact=True)


def test_a_cut_recording_keeps_what_is_whole(run: Run, recordings: Path, tmp_path: Path) -> None:
    whole = recordings / "mountaincar.mcap"
    cut = tmp_path / "cut" / "mountaincar.mcap"
    cut.parent.mkdir()
    content = whole.read_bytes()
    cut.write_bytes(content[: len(content) * 3 // 4])
    out, out_whole = tmp_path / "out", tmp_path / "whole"
    done = run(["extract", cut, "-o", out], expect=PARTIAL)
    run(["extract", whole, "-o", out_whole])

    assert "mountaincar.mcap" in done.stderr
    recording = load(out, "recordings").row(0, named=True)
    assert recording["status"] == "recovered"
    assert recording["n_messages"] == recording["n_messages_used"] + recording["n_messages_refused"]
    ok = load(out, "episodes").filter(pl.col("status") == "ok")["episode"].to_list()
    assert ok
    for name in ("segments", "steps", "episodes"):
        kept = pl.col("episode").is_in(ok)
        assert_frame_equal(load(out, name).filter(kept), load(out_whole, name).filter(kept), check_exact=True)


def test_only_a_bad_file_fails(run: Run, tmp_path: Path) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_text("no recording\n", encoding="utf-8")
    done = run(["extract", bad, "-o", tmp_path / "out"], expect=NO_EPISODE)
    assert "bad.mcap" in done.stderr


def test_an_empty_folder_fails_with_one_line(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "nothing"
    folder.mkdir()
    done = run(["extract", folder, "-o", tmp_path / "out"], expect=NO_EPISODE)
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("coact: no recordings found")
    assert str(folder) in line
    assert not (tmp_path / "out").exists()


# Options from a file --------------------------------------------------------------------------------------------------


def test_a_printed_config_gives_the_same_run(run: Run, cartpole: Path, tmp_path: Path) -> None:
    asked, again = tmp_path / "asked", tmp_path / "again"
    args = ["extract", cartpole, "-o", asked, *as_options(METHOD)]
    printed = run([*args, "--print-config"])
    assert not asked.exists()
    assert printed.stderr == ""
    options = tomllib.loads(printed.stdout)
    assert options["inputs"] == [str(cartpole)]
    assert options["output"] == str(asked)
    assert {name: options[name] for name in METHOD} == METHOD

    config = tmp_path / "run.toml"
    config.write_text(printed.stdout, encoding="utf-8")
    assert run(["extract", "--config", config, "--print-config"]).stdout == printed.stdout
    run(args)
    run(["extract", "--config", config, "-o", again])
    assert_same_tables(asked, again)


def test_the_command_line_wins_over_a_config(run: Run, cartpole: Path, tmp_path: Path) -> None:
    config = tmp_path / "run.toml"
    config.write_text("bins = 16\nwindow = 7\n", encoding="utf-8")
    printed = run(["extract", cartpole, "-o", tmp_path / "out", "--config", config, "--bins", "8", "--print-config"])
    options = tomllib.loads(printed.stdout)
    assert (options["bins"], options["window"]) == (8, 7)


def test_an_unknown_name_in_a_config_is_refused(run: Run, cartpole: Path, tmp_path: Path) -> None:
    config = tmp_path / "run.toml"
    config.write_text("bin = 16\n", encoding="utf-8")
    done = run(["extract", cartpole, "-o", tmp_path / "out", "--config", config], expect=BAD_ARGUMENTS)
    assert "run.toml" in done.stderr
    assert "bin" in done.stderr


# Metadata of the files ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def out(run: Run, cartpole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of one recording, with METHOD."""
    out = tmp_path_factory.mktemp("metadata") / "out"
    run(["extract", cartpole, "-o", out, *as_options(METHOD)])
    return out


@pytest.fixture(params=TABLES)
def part(request: pytest.FixtureRequest, out: Path) -> Path:
    """The only file of each table."""
    (part,) = (out / request.param).iterdir()
    return part


def test_every_column_has_its_meaning_and_every_number_its_unit(part: Path) -> None:
    for field in flat_fields(pq.read_schema(part)):
        assert field.metadata[b"description"].decode().strip(), field.name
        kind = field.type.value_type if pa.types.is_list(field.type) else field.type
        measured = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_timestamp(kind)
        assert (b"unit" in field.metadata) == measured, field.name


def flat_fields(schema: pa.Schema) -> list[pa.Field]:
    """The columns, and the fields of those that are lists of structs."""
    lists = [field.type for field in schema if pa.types.is_list(field.type)]
    return [*schema, *(field for kind in lists if pa.types.is_struct(kind.value_type) for field in kind.value_type)]


def test_every_file_has_the_version_and_the_parameters(run: Run, part: Path) -> None:
    metadata = {key.decode(): value.decode() for key, value in pq.read_metadata(part).metadata.items()}
    expected = {f"coact.{name}": str(value) for name, value in METHOD.items()}
    expected |= {"coact.profile": "paper", "coact.steps": "full", "coact.table": part.parent.name}
    expected["coact.version"] = run(["--version"]).stdout.split()[1]
    assert {key: metadata.get(key) for key in expected} == expected
    assert int(metadata["coact.table_version"]) >= 1


def test_no_file_names_the_machine(out: Path, cartpole: Path, part: Path) -> None:
    metadata = pq.read_metadata(part)
    # Compressed pages are looked into as they are read.
    texts = [str(metadata.metadata), metadata.created_by, str(pq.read_table(part).to_pydict())]
    for name in (str(out), str(out.parent), str(cartpole.parent)):
        assert not any(name in text for text in texts)


def test_pages_are_zstd_with_statistics_and_an_index(part: Path) -> None:
    metadata = pq.read_metadata(part)
    assert metadata.num_row_groups >= 1
    for i in range(metadata.num_columns):
        column = metadata.row_group(0).column(i)
        assert column.compression == "ZSTD"
        # Lists without an element have no minimum or maximum.
        assert column.is_stats_set or "." in column.path_in_schema
        assert column.has_offset_index
        assert column.has_column_index


def test_a_full_or_closed_stdout_is_no_panic(coact: Path, root: Path) -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [coact, "extract", root / "fixtures", "--dry-run"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 1
    assert done.stderr == "coact: cannot write to stdout: No space left on device (os error 28)\n"
    reader, writer = os.pipe()
    os.close(reader)
    closed = subprocess.run(
        [coact, "extract", root / "fixtures", "--dry-run"], stdout=writer, stderr=subprocess.PIPE, text=True
    )
    os.close(writer)
    assert (closed.returncode, closed.stderr) == (0, "")
