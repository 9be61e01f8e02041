#!/usr/bin/env python3
# /// script
# requires-python = ">=3.11"
# dependencies = ["duckdb==2.0.1", "matplotlib==3.11.2", "pandas==3.1.1", "polars==2.1.0", "pyarrow==26.0.1"]
# ///
"""Load the tables of coact in DuckDB, polars and pandas, and answer three questions with them.

Input: a directory that `coact extract … -o DIR` wrote.
Output, on stdout: 1. the composite actions that changed the state most (DuckDB); 2. their lengths in steps per
environment (polars); 3. where the masks of one episode lie (pandas), with `--plot` also as a picture (PNG, SVG or PDF
by the name of the file). The episode is that of the strongest composite action, or the one that `--episode` names.

Example: load_results.py out --plot masks.png --episode cartpole.mcap:0
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import duckdb
import pandas as pd
import polars as pl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

N_STRONGEST = 10
# More would not fit on a picture that can be looked at.
MAX_PLOTTED_JOINTS = 16
MASKS = ["action_mask", "state_mask", "correlated", "boundary"]
# A logged id that is no integer is only in `episode_id`, so all three name an episode.
EPISODE_KEY = ["recording", "episode", "episode_id"]


class Episode(NamedTuple):
    """Names an episode, as in the tables."""

    recording: str
    episode: int

    def __str__(self) -> str:
        return f"{self.recording}:{self.episode}"


def main(argv: Sequence[str] | None = None) -> None:
    """The command line."""
    args = parse_args(argv)
    if not any((args.results / "segments").glob("*.parquet")):
        raise SystemExit(f"{args.results}: no tables in segments/; is it an output directory of coact extract?")

    print(f"1. The {N_STRONGEST} composite actions that changed the state most")
    strongest = strongest_segments(args.results)
    show(strongest, "none: no episode gave a composite action")

    print("\n2. Lengths of the composite actions in steps, per environment")
    show(lengths_by_environment(args.results), "none: no episodes")

    print("\n3. Steps of one episode in each mask")
    if not has_steps(args.results):
        leave_out("no steps/ in it: extract with --steps full", wanted=args.plot or args.episode)
        return
    episode = args.episode or default_episode(args.results, strongest)
    if episode is None:
        leave_out("no episode has steps", wanted=args.plot)
        return
    steps = episode_steps(args.results, episode)
    if steps.empty:
        raise SystemExit(f"{args.results}: no steps of an episode {episode}")
    print(f"{episode}, {steps['step'].nunique()} steps")
    show(pl.from_pandas(mask_counts(steps)), "none")
    if args.plot:
        masks_figure(steps).savefig(args.plot, dpi=120)
        print(f"\nplotted in {args.plot}")


def parse_args(argv: Sequence[str] | None) -> argparse.Namespace:
    """What was asked for."""
    summary, _, details = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=details, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", metavar="DIR", type=Path, help="directory with the tables")
    parser.add_argument("--plot", metavar="FILE", type=Path, help="plot the masks of the episode into this file")
    parser.add_argument("--episode", metavar="RECORDING:EPISODE", type=parse_episode, help="as in the tables")
    return parser.parse_args(argv)


def parse_episode(text: str) -> Episode:
    """`RECORDING:EPISODE`; a recording may have a colon in its name."""
    recording, _, episode = text.rpartition(":")
    try:
        number = int(episode)
    except ValueError:
        number = None
    if not recording or number is None:
        raise argparse.ArgumentTypeError(f"expected RECORDING:EPISODE, such as cartpole.mcap:0, found {text!r}")
    return Episode(recording, number)


def leave_out(reason: str, wanted: object) -> None:
    """Says why there is no third answer; that is an error only if it was asked for."""
    if wanted:
        raise SystemExit(f"no plot: {reason}")
    print(f"none: {reason}")


def show(frame: pl.DataFrame, if_empty: str) -> None:
    """Prints a whole table."""
    if frame.is_empty():
        print(if_empty)
        return
    with pl.Config(
        tbl_formatting="NOTHING",
        tbl_hide_column_data_types=True,
        tbl_hide_dataframe_shape=True,
        tbl_rows=-1,
        tbl_cols=-1,
        tbl_width_chars=1000,
        fmt_str_lengths=200,
        float_precision=3,
    ):
        print(frame)


# 1. Strongest composite actions, with DuckDB --------------------------------------------------------------------------


def strongest_segments(results: Path, limit: int = N_STRONGEST) -> pl.DataFrame:
    """The composite actions with the largest sum of the state's change, the largest first."""
    query = """
        select recording, episode, joint, joint_name, start_step, end_step, n_steps, state_change_sum
        from read_parquet(?)
        order by state_change_sum desc, recording, episode, joint, segment
        limit ?
    """
    with duckdb.connect() as connection:
        return connection.sql(query, params=[str(results / "segments" / "*.parquet"), limit]).pl()


# 2. Lengths per environment, with polars ------------------------------------------------------------------------------


def lengths_by_environment(results: Path) -> pl.DataFrame:
    """Number, mean, median and maximum of `n_steps` by `env_id`; an environment without composite actions has n = 0."""
    episodes = pl.read_parquet(results / "episodes" / "*.parquet").select(*EPISODE_KEY, "env_id")
    segments = pl.read_parquet(results / "segments" / "*.parquet").select(*EPISODE_KEY, "n_steps")
    n_steps = pl.col("n_steps")
    return (
        episodes.join(segments, on=EPISODE_KEY, how="left", nulls_equal=True, validate="1:m")
        .group_by("env_id")
        .agg(n=n_steps.count(), mean=n_steps.mean(), median=n_steps.median(), max=n_steps.max())
        .sort("env_id")
    )


# 3. Masks of an episode, with pandas and matplotlib -------------------------------------------------------------------


def has_steps(results: Path) -> bool:
    """Whether there is a table of steps."""
    return any((results / "steps").glob("*.parquet"))


def default_episode(results: Path, strongest: pl.DataFrame) -> Episode | None:
    """The episode of the strongest composite action, else the first one with steps."""
    if not strongest.is_empty():
        return Episode(*strongest.select("recording", "episode").row(0))
    episodes = pd.read_parquet(results / "episodes", columns=["recording", "episode"], filters=[("n_steps", ">", 0)])
    if episodes.empty:
        return None
    return Episode(episodes["recording"].iloc[0], int(episodes["episode"].iloc[0]))


def episode_steps(results: Path, episode: Episode) -> pd.DataFrame:
    """The rows of `steps` of one episode; reads no more than the row groups it is in."""
    return pd.read_parquet(
        results / "steps", filters=[("recording", "==", episode.recording), ("episode", "==", episode.episode)]
    )


def mask_counts(steps: pd.DataFrame) -> pd.DataFrame:
    """The number of steps in each mask, one row a joint; composite actions are counted too."""
    joints = steps.groupby("joint", sort=True)
    counts = joints[MASKS].sum()
    counts.insert(0, "joint_name", joints["joint_name"].first())
    counts["segments"] = joints["segment"].max() + 1
    return counts.reset_index()


def masks_figure(steps: pd.DataFrame) -> Figure:
    """Two panels a joint, its action and the change of its action; below them the change of the state."""
    joints = [rows for _, rows in steps.groupby("joint", sort=True)]
    plotted = joints[:MAX_PLOTTED_JOINTS]
    n_panels = 2 * len(plotted) + 1
    figure = Figure(figsize=(12, 1 + 1.5 * n_panels), layout="constrained")
    panels = figure.subplots(n_panels, sharex=True)

    for rows, action, change in zip(plotted, panels[0:-1:2], panels[1::2], strict=True):
        plot_action(action, rows)
        plot_change(change, rows, "action")
    plot_change(panels[-1], joints[0], "state")

    panels[-1].set_xlabel("step")
    first = steps.iloc[0]
    left_out = f", first {len(plotted)} of {len(joints)} joints" if len(plotted) < len(joints) else ""
    figure.suptitle(f"{Episode(first['recording'], first['episode'])}{left_out}")
    # By label, since every joint has the same ones.
    legend: dict[str, Artist] = {}
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        legend |= zip(labels, handles, strict=True)
    figure.legend(list(legend.values()), list(legend), loc="outside upper right", ncols=len(legend), fontsize="small")
    return figure


def plot_action(panel: Axes, rows: pd.DataFrame) -> None:
    """Trace of the action, steps where action and state change together, and the cuts between composite actions."""
    if rows["action"].notna().any():
        panel.step(rows["step"], rows["action"], where="mid", color="black", linewidth=0.8)
    else:
        panel.set_yticks([])
    shade(panel, rows, "correlated", color="tab:green")
    for i, step in enumerate(rows.loc[rows["boundary"], "step"]):
        panel.axvline(step, color="tab:red", linewidth=0.8, label=None if i else "boundary")
    panel.set_ylabel(joint_title(rows.iloc[0]))


def plot_change(panel: Axes, rows: pd.DataFrame, of: str) -> None:
    """The change of `of` (action or state), with its mask."""
    panel.plot(rows["step"], rows[f"{of}_change"], color="black", linewidth=0.8)
    shade(panel, rows, f"{of}_mask", color="tab:blue" if of == "action" else "tab:orange")
    panel.set_ylim(-0.05, 1.05)
    panel.set_ylabel(f"{of}\nchange")


def shade(panel: Axes, rows: pd.DataFrame, mask: str, color: str) -> None:
    """Shades the steps in a mask over the whole height of a panel, a step from half before it to half after it."""
    masked = rows.loc[rows[mask], "step"]
    runs = masked.groupby((masked.diff() != 1).cumsum()).agg(["min", "size"])
    panel.broken_barh(
        [(first - 0.5, n_steps) for first, n_steps in runs.itertuples(index=False)],
        (0, 1),
        transform=panel.get_xaxis_transform(),
        color=color,
        alpha=0.3,
        linewidth=0,
        label=mask.replace("_", " "),
    )


def joint_title(row: pd.Series) -> str:
    """The name of a joint, else its number."""
    if row["joint"] < 0:
        return "all joints"
    return row["joint_name"] if pd.notna(row["joint_name"]) else f"joint {row['joint']}"


if __name__ == "__main__":
    main()
