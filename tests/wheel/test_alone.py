"""The wheel with nothing but what it asks for itself: no pandas, no polars, no reader of MCAP."""

from __future__ import annotations

import importlib.util
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pyarrow
import pytest

import coact


def run(*command: str | Path, expect: int = 0) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == expect, done.stderr
    return done.stdout


def test_is_the_installed_package() -> None:
    assert Path(coact.__file__).is_relative_to(sys.prefix)
    assert coact.binary().is_relative_to(sys.prefix)
    assert not importlib.util.find_spec("pandas")
    assert not importlib.util.find_spec("polars")


def test_command_and_module_are_the_binary() -> None:
    expected = f"coact {version('coact')}\n"
    assert run(Path(sys.prefix, "bin", "coact"), "--version") == expected
    assert run(sys.executable, "-m", "coact", "--version") == expected
    assert coact.__version__ == version("coact")


def test_module_passes_exit_codes_on(tmp_path: Path) -> None:
    run(sys.executable, "-m", "coact", "extract", "--no-such-flag", expect=2)
    run(sys.executable, "-m", "coact", "extract", tmp_path, "-o", tmp_path / "out", expect=2)


def test_tables_come_from_pyarrow_where_nothing_else_is(fixtures: Path, tmp_path: Path) -> None:
    done = coact.extract(fixtures / "cartpole.mcap", tmp_path / "out")
    segments = coact.read_segments(done.output or "")
    assert isinstance(segments, pyarrow.Table)
    assert segments.num_rows == done.n_segments > 0
    with pytest.raises(ModuleNotFoundError, match="polars"):
        coact.read_segments(tmp_path / "out", "polars")


def test_importing_is_light() -> None:
    """What takes long to import is imported when it is needed."""
    loaded = run(sys.executable, "-c", "import coact, sys; print(*sys.modules)").split()
    assert "coact" in loaded
    assert "pyarrow" not in loaded


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_an_interrupt_stops_the_run_and_leaves_no_process(fixtures: Path, tmp_path: Path) -> None:
    """Ctrl-C of this process alone, as in a notebook. The input is a pipe that no one writes to."""
    fifo = tmp_path / "ours"
    fifo.mkdir()
    script = (
        "import coact, os, signal, threading, subprocess, sys\n"
        "real = subprocess.Popen.communicate\n"
        "def communicate(self, *args, **kwargs):\n"
        "    print(self.pid, flush=True)\n"
        "    subprocess.Popen.communicate = real\n"
        "    raise KeyboardInterrupt\n"
        "subprocess.Popen.communicate = communicate\n"
        "coact.extract(sys.argv[1], sys.argv[2])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, fixtures, tmp_path / "out"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "KeyboardInterrupt" in done.stderr
    assert done.returncode == -signal.SIGINT
    pid = int(done.stdout)
    assert not Path(f"/proc/{pid}").exists()
    # What it left is whole: the same call goes on.
    assert coact.extract(fixtures, tmp_path / "out").is_complete
