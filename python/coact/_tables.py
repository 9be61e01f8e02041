"""The tables of an output directory, read back: what is committed, and nothing else."""

from __future__ import annotations

import importlib.util
import inspect
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args, overload

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow

StrPath: TypeAlias = str | os.PathLike[str]
Engine: TypeAlias = Literal["polars", "pandas", "pyarrow"]

# Of shard and number. A commit names parts of its own shard.
COMMIT_NAME = re.compile(r"(\d{5})-\d{5}\.json")


class TableReader:
    """`directory` is the output directory of a run. While the run goes on, what it has committed is read.

    `engine` says what comes back: a frame of polars or of pandas, or a table of pyarrow; without it, the first of these
    that is installed. `columns` takes these columns only.
    """

    # One class for four functions: the types that depend on `engine` are then said once.
    def __init__(self, table: str, holds: str) -> None:
        self._table = table
        self.__name__ = f"read_{table}"
        self.__doc__ = f"Reads the table `{table}`: {holds}.\n\n{inspect.getdoc(type(self))}"

    def __repr__(self) -> str:
        return f"<function coact.{self.__name__}>"

    @overload
    def __call__(
        self, directory: StrPath, engine: Literal["polars"], columns: Sequence[str] | None = None
    ) -> polars.DataFrame: ...
    @overload
    def __call__(
        self, directory: StrPath, engine: Literal["pandas"], columns: Sequence[str] | None = None
    ) -> pandas.DataFrame: ...
    @overload
    def __call__(
        self, directory: StrPath, engine: Literal["pyarrow"], columns: Sequence[str] | None = None
    ) -> pyarrow.Table: ...
    @overload
    def __call__(self, directory: StrPath, engine: None = None, columns: Sequence[str] | None = None) -> Any: ...
    def __call__(self, directory: StrPath, engine: Engine | None = None, columns: Sequence[str] | None = None) -> Any:
        engine = engine or installed_engine()
        if engine not in get_args(Engine):
            raise ValueError(f"engine {engine!r}: expected one of {', '.join(get_args(Engine))}")
        table = read_table(Path(directory), self._table, columns)
        if engine == "pandas":
            return table.to_pandas()
        if engine == "polars":
            # Here and below: imported where it is needed, since these take longer to import than most runs take.
            import polars

            return polars.from_arrow(table)
        return table


read_segments = TableReader("segments", "one row a composite action")
read_steps = TableReader("steps", "one row a joint and step")
read_episodes = TableReader("episodes", "one row an episode")
read_recordings = TableReader("recordings", "one row a recording, also those that failed")


def installed_engine() -> Engine:
    """The first engine that is there; pyarrow always is."""
    return next(engine for engine in get_args(Engine) if importlib.util.find_spec(engine))


def read_table(directory: Path, table: str, columns: Sequence[str] | None = None) -> pyarrow.Table:
    """The committed rows of a table, in their order."""
    import pyarrow
    import pyarrow.parquet

    parts = committed_parts(directory, table)
    # By path and without partitions: what the directory above is called must not become a column.
    return pyarrow.concat_tables(pyarrow.parquet.read_table(part, columns=columns, partitioning=None) for part in parts)


def committed_parts(directory: StrPath, table: str) -> list[Path]:
    """The Parquet files of a table that commits name, in the order of their rows: for readers of other libraries."""
    directory = Path(directory)
    if not (directory / "_coact" / "run.json").is_file():
        raise FileNotFoundError(f"{directory} holds no run of coact extract")
    parts = []
    for commit in sorted((directory / "_coact" / "commits").glob("*.json")):
        if of_shard := COMMIT_NAME.fullmatch(commit.name):
            # A name is taken for nothing else, so that none is followed elsewhere.
            part = re.compile(rf"{table}/part-{of_shard[1]}-\d{{5}}\.parquet")
            named = json.loads(commit.read_text(encoding="utf-8"))["parts"]
            parts += [directory / path for path in named if part.fullmatch(path)]
    if not parts:
        raise FileNotFoundError(f"{directory} has no rows in {table}: {reason(directory, table)}")
    return parts


def reason(directory: Path, table: str) -> str:
    """Why a table has no parts."""
    run = json.loads((directory / "_coact" / "run.json").read_text(encoding="utf-8"))
    if table == "steps" and not run["steps"]:
        return "the run was one with steps none"
    return "the run has not committed any yet"
