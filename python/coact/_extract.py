"""Recordings to tables: `coact extract` as a function."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypedDict, Unpack, cast

from coact._binary import DONE, run

StrPath: TypeAlias = str | os.PathLike[str]

# What the result is made of, and what has no place in a function.
TAKEN = {
    "output": "it is the second argument",
    "summary": "the summary is in the result",
    "quiet": "the summary is in the result",
    "progress": "stderr is kept for the result; run `coact extract` for progress",
    "print_config": "nothing would be extracted; run `coact extract --print-config`",
    "help": "run `coact extract --help`",
}


class MethodOptions(TypedDict, total=False):
    """Options of the method. What is left out, or None, has the default of the command line."""

    measure: str | None
    """`earth-mover` (default), `shannon`, `approximate`, `sample`, `permutation`, `kl`, `jensen-shannon` …"""
    profile: Literal["paper", "authors"] | None
    bins: int | None
    window: int | None
    """Steps."""
    threshold: float | None
    order: int | None
    tolerance: float | None
    joints: Literal["each", "together"] | None


class ExtractOptions(MethodOptions, total=False):
    """Options of `coact extract`, by the names of its flags with `_` for `-`."""

    action: str | Sequence[str] | None
    """Selectors, `TOPIC:PATH`."""
    state: str | Sequence[str] | None
    episodes: str | None
    align: Literal["before", "nearest", "index"] | None
    max_age: float | None
    """Seconds."""
    clock: Literal["log", "publish", "header"] | None
    on_damage: Literal["recover", "fail"] | None
    max_record: int | str | None
    """Bytes, or such as `256MiB`."""
    max_chunk: int | str | None
    max_episode: int | str | None
    max_open_episodes: int | None
    steps: Literal["full", "none"] | None
    events: StrPath | None
    """Directory."""
    overwrite: bool | None
    dry_run: bool | None
    threads: int | None
    config: StrPath | None
    verbose: bool | None
    """Say more in `Run.diagnostics`."""


@dataclass(frozen=True)
class Run:
    """A run that did not fail."""

    output: Path | None
    """Where the tables are; None after a dry run without one."""
    exit_code: int
    """0, or 3 where something was lost: a recording failed or was recovered, a message was refused, …"""
    summary: Mapping[str, Any] = field(repr=False)
    """The object of `--summary json`."""
    diagnostics: str = field(repr=False)
    """What the run said: losses are named here."""

    @property
    def is_complete(self) -> bool:
        """Whether nothing was lost. Losses are in `diagnostics` and `summary["remarks"]`."""
        return self.exit_code == DONE

    @property
    def n_segments(self) -> int:
        """Composite actions found by this run."""
        return int(self.summary["n_segments"])


def extract(
    paths: StrPath | Iterable[StrPath], output: StrPath | None = None, **options: Unpack[ExtractOptions]
) -> Run:
    """Extracts composite actions from recordings into Parquet tables, as `coact extract` does.

    `paths` is files, folders and globs, one or many; `output` the directory for the tables. Losses are no error: see
    `Run.is_complete`. Raises `Error` if the run failed or the options are wrong.

    >>> run = coact.extract("recordings", "out", measure="shannon", threshold=0.3)
    """
    arguments = flags(cast(Mapping[str, object], options))
    if output is not None:
        arguments.append(f"--output={os.fspath(output)}")
    inputs = [os.fspath(path) for path in ([paths] if isinstance(paths, str | os.PathLike) else paths)]
    done = run(["extract", "--summary", "json", "--progress", "never", *arguments, "--", *inputs])
    return Run(
        output=None if output is None else Path(output),
        exit_code=done.exit_code,
        summary=json.loads(done.stdout),
        diagnostics=done.stderr,
    )


def flags(options: Mapping[str, object]) -> list[str]:
    """Options as the command line has them. What a name or value may be is the binary's to say."""
    arguments: list[str] = []
    for name, value in options.items():
        if name in TAKEN:
            raise TypeError(f"option {name!r} is not taken here: {TAKEN[name]}")
        flag = "--" + name.replace("_", "-")
        if value is True:
            arguments.append(flag)
        elif value is not None and value is not False:
            values = value if isinstance(value, list | tuple) else [value]
            # With `=`: a value may begin with a hyphen.
            arguments += [f"{flag}={text(name, each)}" for each in values]
    return arguments


def text(name: str, value: object) -> str:
    """A value as the command line has it."""
    # NumPy's numbers are more than their digits in `repr`.
    plain = value.item() if hasattr(value, "item") else value
    if isinstance(plain, os.PathLike):
        plain = os.fspath(plain)
    if isinstance(plain, bool) or not isinstance(plain, str | int | float):
        raise TypeError(f"option {name!r}: expected text or a number, found {value!r}")
    # All digits, and no exponent, which not every flag takes.
    return plain if isinstance(plain, str) else f"{Decimal(repr(plain)):f}"
