#!/usr/bin/env python3
# /// script
# requires-python = ">=3.11"
# dependencies = ["aiohttp==3.14.5", "coact", "ray[data]==2.60.0"]  # aiohttp: Ray Data fails by chance without it
# ///
"""Extract composite actions on a Ray cluster: plan, one task a shard, finish.

Input: recordings, and what `coact plan` takes besides, behind `--`. Recordings and output directory are seen by all
nodes under the same paths, and the wheel of coact (docs/python.md) is installed on each.

Output: the directory, as one `coact extract` would have written it; with `--dataset TABLE` also the schema and number
of rows of the Ray Dataset of a table. On stderr a line for each shard as it ends. A shard whose worker or node died, or
whose command failed, is tried again, and goes on where it stopped. Shards that failed for good are listed at the end;
the exit code is that of `coact finish`: 0 done, 3 done with losses, 1 recordings are missing. The same command again
does what is missing.

Example: coact_ray.py recordings --output out --shards 100 --address auto -- --measure shannon --steps none

  from coact_ray import run_plan
  dataset = run_plan(["recordings"], "out", n_shards=100)      # rows of `segments` as a ray.data.Dataset
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray
import ray.data
from ray import cloudpickle
from ray.exceptions import RayError

import coact

DONE, FAILED, DONE_WITH_LOSSES = 0, 1, 3

# Runs the command in the place of this interpreter, and has the kernel end it with the worker. Ray ends what a dead
# worker leaves running, too, but not where it dies itself; the command would then hold the shard's lock against the
# next try.
LAUNCH = """
import ctypes, os, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    if os.getppid() != int(sys.argv[1]):
        sys.exit("the worker is gone")
os.execvp(sys.argv[2], sys.argv[2:])
"""


@dataclass(frozen=True)
class Plan:
    """What is to be done, and how."""

    output: Path
    n_shards: int
    n_tries: int = 3
    """Of one shard."""
    threads: int = 1
    """Of one shard; as many CPUs are asked of Ray."""
    command: str | None = None
    """The coact command on the nodes, instead of that of the installed wheel."""


@dataclass
class Outcome:
    """How a plan ended."""

    exit_code: int
    """That of `coact finish`."""
    said: str
    """What that said."""
    failed: dict[int, str] = field(default_factory=dict)
    """Shards that failed for good, and why."""


class PlanError(Exception):
    """A plan that could not be made, or was not done."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message, exit_code)
        self.exit_code = exit_code

    def __str__(self) -> str:
        return str(self.args[0])


def run_plan(
    inputs: Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    n_shards: int,
    options: Sequence[str] = (),
    table: str = "segments",
    **how: Any,
) -> ray.data.Dataset:
    """Extracts recordings on the cluster that is connected, or on this machine; the rows of `table` as a Dataset.

    `options` are those of `coact plan`, as typed; `how` the fields of `Plan`. Raises `PlanError` if it was not done
    whole; losses (exit code 3) are no error.
    """
    plan = Plan(Path(output).absolute(), n_shards, **how)
    make_plan(plan, inputs, options)
    outcome = run_shards(plan)
    if outcome.exit_code not in (DONE, DONE_WITH_LOSSES):
        raise PlanError(told(outcome), outcome.exit_code)
    return dataset_of(plan.output, table)


def dataset_of(output: Path, table: str) -> ray.data.Dataset:
    """The rows of a table. They come in no order: sort by the key where that matters."""
    parts = [str(part) for part in coact.committed_parts(output, table)]
    return ray.data.read_parquet(parts, partitioning=None)


def make_plan(plan: Plan, inputs: Sequence[str | os.PathLike[str]], options: Sequence[str]) -> None:
    """Shares the recordings out among shards. The same plan again keeps what is done."""
    shares = [f"--output={plan.output}", f"--shards={plan.n_shards}"]
    done = subprocess.run(
        [plan.command or coact.binary(), "plan", *shares, *options, "--", *inputs],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != DONE:
        raise PlanError(done.stderr.strip(), done.returncode)
    tell(done.stdout.strip())


def run_shards(plan: Plan) -> Outcome:
    """Runs every shard as a task, again where it failed, and closes the run."""
    # By value: nodes need not have this file.
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    # Tries are counted here and not by Ray, so that each is told.
    task = ray.remote(num_cpus=plan.threads, max_retries=0, scheduling_strategy="SPREAD")(run_shard)
    tries = dict.fromkeys(range(1, plan.n_shards + 1), 1)
    running = {task.remote(plan, shard): shard for shard in tries}
    outcome = Outcome(FAILED, "")
    n_done = 0
    while running:
        (ended,), _ = ray.wait(list(running), num_returns=1)
        shard = running.pop(ended)
        try:
            line = ray.get(ended)
        except RayError as error:
            reason = reason_of(error)
            if tries[shard] < plan.n_tries:
                tries[shard] += 1
                tell(f"shard {shard}/{plan.n_shards}: {reason}; try {tries[shard]} of {plan.n_tries}")
                running[task.remote(plan, shard)] = shard
                continue
            outcome.failed[shard] = reason
            line = f"failed: {reason}"
        n_done += 1
        tell(f"[{n_done}/{plan.n_shards}] shard {shard}/{plan.n_shards}: {line}")
    return finish(plan, outcome)


def finish(plan: Plan, outcome: Outcome) -> Outcome:
    """Closes the run. What is in the directory says whether it is whole, not what tasks said."""
    done = subprocess.run(
        [plan.command or coact.binary(), "finish", plan.output], capture_output=True, text=True, check=False
    )
    outcome.exit_code = done.returncode
    outcome.said = (done.stdout + done.stderr).strip()
    return outcome


# On a worker ----------------------------------------------------------------------------------------------------------


class ShardError(Exception):
    """The command of a shard failed."""


def run_shard(plan: Plan, shard: int) -> str:
    """Extracts one shard; what is told of it."""
    began = time.monotonic()
    command = [str(plan.command or coact.binary()), "extract", f"--shard={shard}/{plan.n_shards}"]
    options = [f"--output={plan.output}", f"--threads={plan.threads}", "--summary=json", "--progress=never"]
    done = subprocess.run(
        [sys.executable, "-c", LAUNCH, str(os.getpid()), *command, *options],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in (DONE, DONE_WITH_LOSSES):
        said = done.stderr.strip().splitlines()
        raise ShardError(f"exit code {done.returncode}: {said[-1] if said else 'nothing said'}")
    summary = json.loads(done.stdout)
    counts = f"{sum(summary['recordings'].values())} recordings, {summary['n_steps']:,} steps"
    took = f"{time.monotonic() - began:.1f} s on node {ray.get_runtime_context().get_node_id()[:8]}"
    losses = ", with losses" if done.returncode == DONE_WITH_LOSSES else ""
    return f"{counts}, {summary['n_segments']:,} composite actions in {took}{losses}"


# The command line -----------------------------------------------------------------------------------------------------


def reason_of(error: RayError) -> str:
    """In one line: what the shard said, or what became of its worker."""
    cause = getattr(error, "cause", None)
    if isinstance(cause, ShardError):
        return str(cause)
    first = str(error).strip().partition("\n")[0]
    return f"{type(error).__name__}: {first}"


def told(outcome: Outcome) -> str:
    """The end of a run as text."""
    failed = [f"shard {shard} failed: {reason}" for shard, reason in sorted(outcome.failed.items())]
    return "\n".join([*failed, outcome.said])


def tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def positive(text: str) -> int:
    if (number := int(text)) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return number


def arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", metavar="INPUT", nargs="+", help="files, folders and globs")
    parser.add_argument("--output", "-o", metavar="DIR", type=Path, required=True, help="directory for the tables")
    parser.add_argument("--shards", metavar="N", type=positive, required=True, help="a few for each CPU are good")
    parser.add_argument("--address", help="of the cluster, as for ray.init [that of RAY_ADDRESS, else this machine]")
    parser.add_argument("--tries", metavar="N", type=positive, default=3, help="of one shard [3]")
    parser.add_argument("--threads", metavar="N", type=positive, default=1, help="of one shard, and its CPUs [1]")
    parser.add_argument("--coact", metavar="PATH", help="the command on the nodes [that of the installed wheel]")
    parser.add_argument("--dataset", metavar="TABLE", choices=("segments", "steps", "episodes", "recordings"))
    own = list(argv)
    options: list[str] = []
    if "--" in own:
        split = own.index("--")
        own, options = own[:split], own[split + 1 :]
    args = parser.parse_args(own)
    args.options = options
    return args


def main(argv: Sequence[str] | None = None) -> int:
    """The command line; its exit code."""
    args = arguments(sys.argv[1:] if argv is None else argv)
    plan = Plan(args.output.absolute(), args.shards, args.tries, args.threads, args.coact)
    try:
        make_plan(plan, args.inputs, args.options)
    except PlanError as error:
        tell(str(error))
        return error.exit_code
    ray.init(address=args.address, log_to_driver=False, logging_level="warning")
    outcome = run_shards(plan)
    tell(told(outcome))
    if args.dataset and outcome.exit_code in (DONE, DONE_WITH_LOSSES):
        ray.data.DataContext.get_current().enable_progress_bars = False
        dataset = dataset_of(plan.output, args.dataset)
        print(f"{dataset.schema()}\n{dataset.count():,} rows")
    return outcome.exit_code


if __name__ == "__main__":
    sys.exit(main())
