"""`extract` and the functions that read tables."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import polars as pl
import pyarrow
import pytest

import coact


def flags_of_extract() -> set[str]:
    """What the command line takes, as its help has it."""
    done = subprocess.run([coact.binary(), "extract", "--help"], capture_output=True, text=True, check=True)
    return set(re.findall(r"^ {2,6}(?:-\w, )?--([a-z][a-z-]*)", done.stdout, re.MULTILINE))


def test_options_are_the_flags() -> None:
    """The typed options and the flags hold each other; what is missing is missing for a reason."""
    not_for_functions = {"output", "print-config", "progress", "summary", "quiet", "help"}
    # Flags of a plan's shards, which a function on one machine has no use for.
    not_for_functions |= {"shard"}
    typed = {name.replace("_", "-") for name in coact.ExtractOptions.__annotations__}
    flags = flags_of_extract()
    assert {"measure", "window", "max-open-episodes"} <= flags
    assert typed == flags - not_for_functions


def test_every_kind_of_option_arrives(fixtures: Path, tmp_path: Path) -> None:
    config = tmp_path / "run.toml"
    config.write_text("bins = 32\n", encoding="utf-8")
    done = coact.extract(
        [fixtures / "cartpole.mcap", str(fixtures / "pend*.mcap")],
        str(tmp_path / "out"),
        measure="s",
        window=np.int64(4),
        threshold=np.float64(0.1),
        joints=None,
        action=["/step:action"],
        state=("/step:state[0]", "/step:state[2]"),
        max_age=1e-05,
        max_record="1MiB",
        steps="none",
        overwrite=False,
        events=tmp_path / "events",
        config=config,
    )
    assert done.exit_code == 0
    assert done.is_complete
    assert done.summary["recordings"] == {"ok": 2}
    assert done.output == tmp_path / "out"
    run = json.loads((tmp_path / "out/_coact/run.json").read_text())["parameters"]
    found = {
        key: run[f"coact.{key}"] for key in ("measure", "window", "threshold", "joints", "bins", "max-record", "steps")
    }
    assert found == {
        "measure": "shannon",
        "window": "4",
        "threshold": "0.1",
        "joints": "each",
        "bins": "32",
        "max-record": "1MiB",
        "steps": "none",
    }
    assert json.loads(run["coact.state"]) == ["/step:state[0]", "/step:state[2]"]
    assert run["coact.max-age"] == "0.00001"
    assert len(list((tmp_path / "events").iterdir())) == 2


def test_flags_without_a_value(fixtures: Path, tmp_path: Path) -> None:
    done = coact.extract(fixtures, dry_run=True, verbose=True)
    assert done.output is None
    assert done.n_segments > 0
    assert "cartpole.mcap" in done.diagnostics
    coact.extract(fixtures, tmp_path / "out", window=4)
    with pytest.raises(coact.Error, match="window was 4, is 5") as error:
        coact.extract(fixtures, tmp_path / "out")
    assert error.value.exit_code == 2
    coact.extract(fixtures, tmp_path / "out", overwrite=True)


def test_a_path_that_looks_like_a_flag(fixtures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(fixtures / "cartpole.mcap", "--quiet.mcap")
    assert coact.extract("--quiet.mcap", "-o").output == Path("-o")
    assert coact.read_segments("-o", "polars")["recording"].unique().to_list() == ["--quiet.mcap"]


def test_losses_are_no_error(fixtures: Path, tmp_path: Path) -> None:
    whole = (fixtures / "tennis_ram.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 3 // 4])
    done = coact.extract(tmp_path / "cut.mcap", tmp_path / "out")
    assert done.exit_code == 3
    assert not done.is_complete
    assert "cut.mcap" in done.diagnostics
    assert [remark["status"] for remark in done.summary["remarks"]] == ["recovered"]


def test_a_failure_is_an_error(fixtures: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("no recording")
    with pytest.raises(coact.Error, match=r"text\.mcap") as error:
        coact.extract(tmp_path / "text.mcap", tmp_path / "out")
    assert error.value.exit_code == 1
    assert error.value.stderr.endswith("\n")
    assert error.value.command[1] == "extract"
    with pytest.raises(coact.Error, match="unexpected argument '--no-such'") as error:
        coact.extract(fixtures, tmp_path / "out", no_such=1)  # type: ignore[call-arg]
    assert error.value.exit_code == 2


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"summary": "text"}, "the summary is in the result"),
        ({"print_config": True}, "nothing would be extracted"),
        ({"window": object()}, "option 'window': expected text or a number"),
        ({"action": [True]}, "option 'action': expected text or a number, found True"),
    ],
)
def test_options_that_make_no_sense(fixtures: Path, option: dict[str, object], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        coact.extract(fixtures, dry_run=True, **option)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def results(fixtures: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A name that readers would take for a partition.
    output = tmp_path_factory.mktemp("run") / "episode=7"
    coact.extract(fixtures, output)
    return output


@pytest.mark.parametrize(
    ("read", "table"),
    [
        (coact.read_segments, "segments"),
        (coact.read_steps, "steps"),
        (coact.read_episodes, "episodes"),
        (coact.read_recordings, "recordings"),
    ],
)
def test_tables_in_every_engine(results: Path, read: object, table: str) -> None:
    assert callable(read)
    expected = pl.read_parquet(results / table / "*.parquet", hive_partitioning=False)
    assert len(expected) > 0
    in_polars, in_pandas, in_pyarrow = read(results, "polars"), read(results, "pandas"), read(results, "pyarrow")
    assert expected.equals(in_polars)
    assert isinstance(in_pandas, pd.DataFrame)
    assert isinstance(in_pyarrow, pyarrow.Table)
    assert list(in_pandas.columns) == in_pyarrow.column_names == expected.columns
    assert in_pandas["recording"].tolist() == in_pyarrow["recording"].to_pylist() == expected["recording"].to_list()
    assert isinstance(read(results), pl.DataFrame)
    assert read(str(results), "pandas", columns=["recording"]).columns.tolist() == ["recording"]


def test_only_what_is_committed_is_read(fixtures: Path, results: Path, tmp_path: Path) -> None:
    """A part without its commit is what a run that was killed leaves: the next one writes it again."""
    output = tmp_path / "out"
    coact.extract(fixtures, output)
    n_segments = len(coact.read_segments(output, "polars"))
    shutil.copy(output / "segments/part-00000-00000.parquet", output / "segments/part-00000-00001.parquet")
    (output / "_coact/commits/.00000-00001.json.tmp").write_text("{")
    assert len(coact.read_segments(output, "polars")) == n_segments
    (output / "_coact/commits/00000-00000.json").unlink()
    with pytest.raises(FileNotFoundError, match="has no rows in segments: the run has not committed any yet"):
        coact.read_segments(output)


def test_tables_that_are_not_there(fixtures: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="holds no run"):
        coact.read_segments(tmp_path)
    coact.extract(fixtures / "cartpole.mcap", tmp_path / "out", steps="none")
    with pytest.raises(FileNotFoundError, match="has no rows in steps: the run was one with steps none"):
        coact.read_steps(tmp_path / "out")
    with pytest.raises(ValueError, match="engine 'spark': expected one of polars, pandas, pyarrow"):
        coact.read_segments(tmp_path / "out", "spark")  # type: ignore[call-overload]
