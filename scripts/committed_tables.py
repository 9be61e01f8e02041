#!/usr/bin/env python3
# /// script
# requires-python = ">=3.11"
# dependencies = ["polars==2.1.0"]
# ///
"""Read the tables of a run that is still going on, as `coact watch` writes them.

Input: an output directory and a table. Output: its rows, as they were committed at one moment; on stdout their number,
and the last of them.

Globs of the tables' folders do nearly as well. But while `coact watch` merges small parts into one, for some
milliseconds, they give rows twice, or name a file that is gone when it is opened.

Example: committed_tables.py out segments
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import polars as pl


def committed_parts(out: Path, table: str) -> list[Path]:
    """The parts of a table that count, in the order of their rows; none where there is no run yet."""
    while True:
        try:
            commits = {path.stem: json.loads(path.read_bytes()) for path in (out / "_coact/commits").glob("*-*.json")}
        except FileNotFoundError:
            # It was merged into another, which the listing did not have yet.
            continue
        replaced = {
            f"{name.split('-')[0]}-{number:05}" for name, commit in commits.items() for number in commit.get("replaces", [])
        }
        counting = sorted(commits.keys() - replaced, key=lambda name: [int(number) for number in name.split("-")])
        return [out / part for name in counting for part in commits[name]["parts"] if part.startswith(f"{table}/")]


def read_committed(out: Path, table: str) -> pl.DataFrame | None:
    """The rows of a table that are committed; None where there is no run yet."""
    while True:
        parts = committed_parts(out, table)
        try:
            return pl.concat([pl.read_parquet(part) for part in parts]) if parts else None
        except FileNotFoundError:
            # Merged since.
            continue


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="DIR", help="output directory of coact")
    parser.add_argument("table", choices=("segments", "steps", "episodes", "recordings"))
    args = parser.parse_args()
    rows = read_committed(args.out, args.table)
    if rows is None:
        raise SystemExit(f"{args.out}: no tables yet")
    print(f"{rows.height} rows")
    print(rows.tail(5))


if __name__ == "__main__":
    main()
