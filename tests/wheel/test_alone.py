"""The wheel with nothing but what it asks for itself: no pandas, no polars, no reader of MCAP."""

from __future__ import annotations

import importlib.util
import os
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
    run(sys.executable, "-m", "coact", "extract", tmp_path, "-o", tmp_path / "out", expect=1)


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
def test_an_interrupt_is_passed_on(tmp_path: Path) -> None:
    """Ctrl-C of the Python process alone, as in a notebook: a run that is asked to stop commits what is complete."""
    ready, asked, stand_in = tmp_path / "ready", tmp_path / "asked", tmp_path / "coact"
    os.mkfifo(ready)
    # It says when it listens, and works for ever.
    stand_in.write_text(f"#!/bin/sh\ntrap 'touch {asked}; exit 130' INT\necho > {ready}\nwhile :; do sleep 0.1; done\n")
    stand_in.chmod(0o755)
    script = f"""
import os, pathlib, signal, subprocess, coact, coact._binary
communicate = subprocess.Popen.communicate
def interrupted(self):
    subprocess.Popen.communicate = communicate
    open({str(ready)!r}).read()
    os.kill(os.getpid(), signal.SIGINT)
    return self.communicate()
subprocess.Popen.communicate = interrupted
coact._binary.binary = lambda: pathlib.Path({str(stand_in)!r})
coact.extract("recordings", "out")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert "KeyboardInterrupt" in done.stderr
    assert done.returncode == -signal.SIGINT
    assert asked.exists()
