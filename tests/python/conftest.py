"""What the Python tests share: the binary, from the environment variable COACT, and the scripts as modules."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def root() -> Path:
    """The root of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def coact() -> Path:
    """The binary under test."""
    binary = Path(os.environ.get("COACT", ROOT / "target/release/coact")).resolve()
    if not binary.is_file():
        pytest.fail(f"no binary at {binary}: cargo build --release, or set COACT")
    return binary


@pytest.fixture(scope="session")
def run(coact: Path) -> Run:
    """Runs the binary with arguments and checks its exit code."""

    def run(args: Sequence[str | Path], expect: int = 0) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [coact, *args], capture_output=True, text=True, encoding="utf-8", timeout=120, check=False
        )
        assert done.returncode == expect, f"exit {done.returncode}, expected {expect}\n{done.stdout}{done.stderr}"
        return done

    return run
