#!/usr/bin/env python3
# /// script
# requires-python = ">=3.11"
# dependencies = ["matplotlib==3.11.2", "numba==0.68.1", "numpy==2.4.6", "scipy==1.17.1"]
# ///
"""Time the extraction against Python on the same arrays: plain SciPy, NumPy and numba (`scripts/baselines/`).

The program takes part through `cargo build --release --example time_extraction`: extraction alone, nothing read or
written. Measure: earth mover, profile `paper`. Half of the columns drift by small integers as the RAM of an Atari does,
half are noise of 17 digits. All results are checked to be equal before anything is timed; then all are timed in turn,
round by round, each sample the median of three runs. Compilation by numba is not timed. SciPy is timed on the first
steps and columns alone, and compared per value.

Output, on stdout: a table of ns per value (step × column, actions included), `--json` for programs, `--plot` a picture.

Example: compare_speed.py --plot speed.svg
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from baselines import with_numba, with_numpy, with_scipy
from baselines.finish import Extraction, Params, Series

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = ROOT / "target/release/examples/time_extraction"
RUNS_PER_SAMPLE = 3
# E_w and E_n of equal results: NumPy and numba give the same bits, SciPy adds in another order.
TOLERANCE = 1e-12


@dataclass(frozen=True)
class Arrays:
    """One episode, column-major; and the file that the program reads it from."""

    actions: np.ndarray
    states: np.ndarray
    file: Path

    @property
    def n_values(self) -> int:
        """Steps × columns."""
        return self.actions.size + self.states.size


@dataclass
class Contender:
    """One way to extract, and its samples in seconds."""

    name: str
    arrays: Arrays
    sample: Callable[[], float]
    seconds: list[float] = field(default_factory=list)

    def nanos_per_value(self, of: Callable[[list[float]], float]) -> float:
        """The median or minimum of the samples."""
        return of(self.seconds) / self.arrays.n_values * 1e9


def main(argv: Sequence[str] | None = None) -> None:
    """The command line."""
    args = parse_args(argv)
    if not args.program.is_file():
        raise SystemExit(f"{args.program}: not found; cargo build --release --example time_extraction")
    params = Params(bins=args.bins, window=args.window)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as threads:
        arrays = make_arrays(args, Path(folder) / "episode.f64")
        part = take_part(arrays, args, Path(folder) / "part.f64")
        check_all(arrays, part, params, args.program, threads)
        contenders = make_contenders(arrays, part, params, args.program, threads)
        for _ in range(args.rounds):
            for contender in contenders:
                contender.seconds.append(contender.sample())
    result = summarize(contenders, args)
    print(json.dumps(result, indent=2) if args.json else as_text(result))
    if args.plot:
        plot(result, args.plot)


def parse_args(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--steps", type=int, default=10_000, help="steps of the episode, T")
    parser.add_argument("--state-dims", type=int, default=128, help="columns of the states, d")
    parser.add_argument("--joints", type=int, default=1, help="columns of the actions")
    parser.add_argument("--scipy-steps", type=int, default=1_000, help="steps that SciPy is timed on")
    parser.add_argument("--scipy-state-dims", type=int, default=8, help="columns of the states that SciPy is timed on")
    parser.add_argument("--window", type=int, default=5)
    parser.add_argument("--bins", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=7, help="samples of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--program", type=Path, default=PROGRAM, help="the example time_extraction")
    parser.add_argument("--json", action="store_true", help="print JSON, with all samples")
    parser.add_argument("--plot", type=Path, metavar="FILE.svg", help="write a picture")
    return parser.parse_args(argv)


# Arrays ---------------------------------------------------------------------------------------------------------------


def make_arrays(args: argparse.Namespace, file: Path) -> Arrays:
    """An episode from the seed."""
    random = np.random.default_rng(args.seed)
    shape = (args.joints + args.state_dims, args.steps)
    moves = random.choice([0, 1, -1], p=[0.75, 0.125, 0.125], size=shape)
    is_drift = (np.arange(shape[0]) % 2 == 0)[:, np.newaxis]
    columns = np.where(is_drift, (128 + np.cumsum(moves, axis=1)) % 256, random.random(shape))
    return save(columns[: args.joints], columns[args.joints :], file)


def take_part(arrays: Arrays, args: argparse.Namespace, file: Path) -> Arrays:
    """The first steps and columns."""
    steps = slice(args.scipy_steps)
    return save(arrays.actions[:, steps], arrays.states[: args.scipy_state_dims, steps], file)


def save(actions: np.ndarray, states: np.ndarray, file: Path) -> Arrays:
    """The arrays, contiguous, and as the program reads them."""
    np.concatenate([actions, states]).astype("<f8").tofile(file)
    return Arrays(np.ascontiguousarray(actions), np.ascontiguousarray(states), file)


# Contenders -----------------------------------------------------------------------------------------------------------


def make_contenders(
    arrays: Arrays, part: Arrays, params: Params, program: Path, threads: ThreadPoolExecutor
) -> list[Contender]:
    """All of them; the first is what the others are compared with."""

    def python(extract: Callable[..., Extraction], of: Arrays = arrays, runs: int = RUNS_PER_SAMPLE) -> partial[float]:
        return partial(sample, partial(extract, of.actions, of.states, params), runs)

    def ours(n_threads: int) -> partial[float]:
        return partial(sample_program, program, arrays, params, n_threads)

    return [
        Contender("coact", arrays, ours(1)),
        Contender("coact, 2 threads", arrays, ours(2)),
        Contender("numba, the same algorithm", arrays, python(with_numba.extract)),
        Contender("numba, the same algorithm, 2 threads", arrays, python(partial(with_numba.extract, threads=threads))),
        Contender("NumPy, the same algorithm", arrays, python(with_numpy.extract)),
        Contender("numba, straight loops", arrays, python(with_numba.extract_directly)),
        Contender("SciPy, pair by pair", part, python(with_scipy.extract, part, 1)),
    ]


def sample(extract: Callable[[], Extraction], runs: int) -> float:
    """Seconds that an extraction in this process takes."""
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        extract()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def sample_program(program: Path, arrays: Arrays, params: Params, n_threads: int) -> float:
    """Seconds that the program takes, by its own clock."""
    options = ["--repetitions", str(RUNS_PER_SAMPLE), "--threads", str(n_threads)]
    return statistics.median(run_program(program, arrays, params, options)["seconds"])


def run_program(program: Path, arrays: Arrays, params: Params, options: Sequence[str]) -> dict[str, Any]:
    """What the program prints."""
    shapes = ["--joints", str(len(arrays.actions)), "--state-dims", str(len(arrays.states))]
    method = ["--window", str(params.window), "--bins", str(params.bins), "--threshold", str(params.threshold)]
    command = [program, arrays.file, *shapes, *method, *options]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


# Equality -------------------------------------------------------------------------------------------------------------


def check_all(arrays: Arrays, part: Arrays, params: Params, program: Path, threads: ThreadPoolExecutor) -> None:
    """Holds every result against the program's; this also compiles what numba is to run."""
    contenders = {
        "NumPy": with_numpy.extract,
        "numba": with_numba.extract,
        "numba, 2 threads": partial(with_numba.extract, threads=threads),
        "numba, straight loops": with_numba.extract_directly,
    }
    for of, extractors in ((arrays, contenders), (part, contenders | {"SciPy": with_scipy.extract})):
        expected = run_program(program, of, params, ["--repetitions", "0", "--warm-up", "0", "--found"])["found"]
        if not any(joint["segments"] for joint in expected["joints"]):
            raise SystemExit("no composite actions: nothing to compare; more steps or another --seed")
        for name, extract in extractors.items():
            check(name, extract(of.actions, of.states, params), expected)


def check(name: str, found: Extraction, expected: dict[str, Any]) -> None:
    """Series to `TOLERANCE`, masks and segments exactly."""
    check_series(f"{name}: state", found.state, expected["state"])
    for i, (joint, other) in enumerate(zip(found.joints, expected["joints"], strict=True)):
        what = f"{name}: joint {i}"
        check_series(what, joint.action, other["action"])
        require(np.array_equal(joint.correlated, other["correlated"]), f"{what}: correlated")
        starts, ends, sums, peaks, ranks = np.array(other["segments"]).reshape(-1, 5).T
        require(np.array_equal(joint.starts, starts) and np.array_equal(joint.ends, ends), f"{what}: segments")
        require(np.allclose(joint.sums, sums, rtol=1e-9, atol=1e-9), f"{what}: sums")
        require(np.allclose(joint.peaks, peaks, rtol=0, atol=TOLERANCE), f"{what}: peaks")
        # Sums that differ in their last bit may change places; the sums in order of rank do not.
        by_rank = [joint.sums[np.argsort(joint.ranks)], sums[np.argsort(ranks)]]
        require(np.allclose(*by_rank, rtol=1e-9, atol=1e-9), f"{what}: ranks")


def check_series(what: str, found: Series, expected: dict[str, Any]) -> None:
    for name in ("measure", "change"):
        difference = np.abs(getattr(found, name) - np.array(expected[name])).max()
        require(difference <= TOLERANCE, f"{what}: {name} is off by {difference}")
    require(np.array_equal(found.mask, expected["mask"]), f"{what}: mask")


def require(holds: bool, what: str) -> None:
    if not holds:
        raise SystemExit(f"results differ, nothing was timed: {what}")


# Results --------------------------------------------------------------------------------------------------------------


def summarize(contenders: Sequence[Contender], args: argparse.Namespace) -> dict[str, Any]:
    """What was found, for `--json`."""
    ours = contenders[0].nanos_per_value(statistics.median)
    rows = [
        {
            "name": c.name,
            "n_steps": c.arrays.states.shape[1],
            "n_joints": len(c.arrays.actions),
            "n_state_dims": len(c.arrays.states),
            "median_ns_per_value": c.nanos_per_value(statistics.median),
            "least_ns_per_value": c.nanos_per_value(min),
            "times_slower": c.nanos_per_value(statistics.median) / ours,
            "seconds": c.seconds,
        }
        for c in contenders
    ]
    packages = {name: version(name) for name in ("numpy", "scipy", "numba")}
    machine = {"cpu": cpu(), "n_cores": os.cpu_count(), "python": platform.python_version(), **packages}
    method = {"measure": "earth-mover", "profile": "paper", "window": args.window, "bins": args.bins}
    return {"machine": machine, "method": method, "rounds": args.rounds, "results": rows}


def cpu() -> str:
    """The name of the processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def as_text(result: dict[str, Any]) -> str:
    """The table."""
    first, machine, method = result["results"][0], result["machine"], result["method"]
    lines = [
        f"earth mover, window {method['window']}, {method['bins']} bins; T = {first['n_steps']:,}, "
        f"d = {first['n_state_dims']}, {first['n_joints']} joint(s); one thread unless said",
        f"{machine['cpu']}, {machine['n_cores']} cores; Python {machine['python']}, NumPy {machine['numpy']}, "
        f"SciPy {machine['scipy']}, numba {machine['numba']}",
        "all results are equal; "
        f"median and least of {result['rounds']} samples, taken in turn, each the median of {RUNS_PER_SAMPLE} runs",
        "",
        f"{'':<38}{'ns per value':>14}{'least':>12}{'times slower':>14}",
    ]
    notes = []
    for row in result["results"]:
        figures = (row["median_ns_per_value"], row["least_ns_per_value"], row["times_slower"])
        nanos, least, ratio = (f"{x:,.0f}" if x >= 100 else f"{x:.2f}" for x in figures)
        is_part = row["n_steps"] != first["n_steps"] or row["n_state_dims"] != first["n_state_dims"]
        lines.append(f"{row['name'] + (' *' if is_part else ''):<38}{nanos:>14}{least:>12}{ratio:>14}")
        if is_part:
            notes = [
                "",
                f"* timed on T = {row['n_steps']:,}, d = {row['n_state_dims']}; one run a sample; compared per value",
            ]
    return "\n".join([*lines, *notes])


def plot(result: dict[str, Any], path: Path) -> None:
    """Bars on a logarithmic axis; readable on light and dark pages, as the background is left out."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # The same picture for the same figures; text as text, so that it is found and small.
    mpl.rcParams.update({"svg.hashsalt": "coact", "svg.fonttype": "none", "font.size": 11})
    gray, ours, others = "#808080", "#2f9e6e", "#7a8fb8"
    rows = result["results"]
    figure = Figure(figsize=(9, 0.42 * len(rows) + 0.9), layout="constrained")
    axes = figure.subplots()
    nanos = [row["median_ns_per_value"] for row in rows]
    colors = [ours if row["name"].startswith("coact") else others for row in rows]
    bars = axes.barh([row["name"] for row in rows], nanos, color=colors)
    axes.bar_label(bars, [f"{x:,.0f}" if x >= 100 else f"{x:.1f}" for x in nanos], padding=4, color=gray)
    axes.set_xscale("log")
    axes.set_xlim(min(nanos) / 3, max(nanos) * 5)
    axes.invert_yaxis()
    axes.set_xlabel("ns per value (step × column)", color=gray)
    axes.tick_params(colors=gray, which="both")
    axes.spines[["top", "right"]].set_visible(False)
    for spine in axes.spines.values():
        spine.set_color(gray)
    figure.savefig(path, transparent=True, metadata={"Date": None} if path.suffix == ".svg" else None)


if __name__ == "__main__":
    main()
