"""The binary: where it is, and how it is run."""

from __future__ import annotations

import functools
import importlib.metadata
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

FILE_NAME = "coact.exe" if sys.platform == "win32" else "coact"

# Exit codes that are no failure: all done; done, with losses that are told.
DONE = 0
DONE_WITH_LOSSES = 3

# An interrupted run commits what is complete within two seconds; a disk may be slow.
SECONDS_TO_STOP = 10.0


class Error(Exception):
    """`coact` failed. What it said is the text, and `stderr` as it stood."""

    def __init__(self, command: Sequence[str], exit_code: int, stderr: str) -> None:
        super().__init__(command, exit_code, stderr)
        self.command = list(command)
        """What was run."""
        self.exit_code = exit_code
        """1 failed, 2 bad arguments, 130 or 143 interrupted; negative: the signal that ended it."""
        self.stderr = stderr
        """All that it wrote to stderr."""

    def __str__(self) -> str:
        said = self.stderr.strip().removeprefix("coact: ")
        return said or f"coact ended with exit code {self.exit_code} and said nothing"


class Output(NamedTuple):
    """What a process that did not fail left."""

    exit_code: int
    stdout: str
    stderr: str


@functools.cache
def binary() -> Path:
    """The `coact` binary that was installed with this package."""
    # The list of installed files knows it for every way of installing but `pip install --target`, which moves it.
    listed = importlib.metadata.files("coact") or []
    candidates = [Path(str(file.locate())) for file in listed if file.name == FILE_NAME]
    candidates.append(Path(__file__).parents[1] / "bin" / FILE_NAME)
    for candidate in candidates:
        if candidate.is_file():
            return candidate.resolve()
    tried = ", ".join(map(str, candidates))
    raise FileNotFoundError(f"the coact binary is not where its package was installed (looked at {tried})")


def run(arguments: Sequence[str]) -> Output:
    """Runs the binary to its end.

    Raises `Error` if it failed. Ctrl-C is passed on, so that what is complete is committed.
    """
    command = [str(binary()), *arguments]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
    ) as process:
        try:
            stdout, stderr = process.communicate()
        except BaseException:
            stop(process)
            raise
    if process.returncode not in (DONE, DONE_WITH_LOSSES):
        raise Error(command, process.returncode, stderr)
    return Output(process.returncode, stdout, stderr)


def stop(process: subprocess.Popen[str]) -> None:
    """Asks a process to stop, and makes it if it does not."""
    # In a terminal it has got the signal already, elsewhere (notebooks, threads) it has not.
    process.send_signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)
    try:
        process.communicate(timeout=SECONDS_TO_STOP)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
