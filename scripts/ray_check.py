#!/usr/bin/env python3
"""Hold a run on a Ray cluster, one of whose workers is killed, against the same run by one process.

Input: recordings, to which some generated ones are added. Needs ray, mcap, polars and the wheel of coact, as
scripts/test_ray.sh installs them. Linux.
Output: what coact_ray.py says, then one line for each table with the number of equal rows. Exit code 1 if rows differ.

The cluster has two nodes on this machine. One shard is made to stop as soon as it has committed its first part; then
its worker gets SIGKILL. So the kill always falls into the middle of a shard, on a machine of any speed.

Example: ray_check.py fixtures --shards 8
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import ray
import ray.data
from mcap.writer import Writer
from ray.cluster_utils import Cluster

import coact
import coact_ray

# Small parts, so that the shard that is killed has one and lacks others.
OPTIONS = ["--max-part-rows=2000"]
EPISODE_STEPS = 500
TABLES = {
    coact.read_segments: ["recording", "episode", "joint", "segment"],
    coact.read_steps: ["recording", "episode", "joint", "step"],
    coact.read_episodes: ["recording", "episode"],
    coact.read_recordings: ["recording"],
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", metavar="INPUT", nargs="+", type=Path)
    parser.add_argument("--shards", metavar="N", type=int, default=8)
    args = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="coact-ray-") as folder:
        work = Path(folder)
        args.inputs.append(generated(work / "generated"))
        local = coact.extract([path.absolute() for path in args.inputs], work / "local")
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
        cluster.add_node(num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False, logging_level="warning")
        print(f"{len(ray.nodes())} nodes, {ray.cluster_resources()['CPU']:.0f} CPUs", flush=True)
        try:
            exit_code = run_with_a_kill(args, work)
            ray.data.DataContext.get_current().enable_progress_bars = False
            dataset_rows = coact_ray.dataset_of(work / "on_ray", "segments").count()
        finally:
            ray.shutdown()
            cluster.shutdown()
        expect(exit_code == local.exit_code, f"exit code {exit_code}, of the local run {local.exit_code}")
        expect(dataset_rows == local.n_segments, f"{dataset_rows} rows in the Dataset, {local.n_segments} expected")
        print(f"Dataset: {dataset_rows:,} rows")
        for read, key in TABLES.items():
            rows, expected = (read(work / run, "polars").sort(key) for run in ("on_ray", "local"))
            expect(rows.equals(expected), f"{read}: rows differ")
            print(f"{read.__name__}: {len(rows):,} equal rows")
    return 0


def generated(folder: Path) -> Path:
    """Recordings of one length, and one that is much larger and has many episodes."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for number, n_episodes in enumerate([2, 2, 2, 2, 2, 2, 60]):
        with (folder / f"{number}.mcap").open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/step", "json", schema_id=0)
            for episode, step in itertools.product(range(n_episodes), range(EPISODE_STEPS)):
                values = {"action": int(rng.integers(4)), "state": rng.standard_normal(8).tolist()}
                data = json.dumps({"episode": episode, "step": step, **values}).encode()
                writer.add_message(channel, log_time=step, data=data, publish_time=step)
            writer.finish()
    return folder


def run_with_a_kill(args: argparse.Namespace, work: Path) -> int:
    """Runs the plan, and kills the worker of one shard in the middle of it."""
    output = work / "on_ray"
    # The shard with the most bytes is the one that has several parts for certain.
    shares = ["--output", output, f"--shards={args.shards}", *OPTIONS]
    subprocess.run([coact.binary(), "plan", *shares, "--", *args.inputs], check=True, capture_output=True)
    victim = largest_shard(output)
    stand_in, stopped = work / "coact", work / "stopped"
    stand_in.write_text(stopping(victim, args.shards, output, stopped))
    stand_in.chmod(0o755)

    kills: list[int] = []
    threading.Thread(target=kill_worker, args=(stopped, output, victim, kills), daemon=True).start()
    began = time.monotonic()
    plan = coact_ray.Plan(output, args.shards, command=str(stand_in))
    coact_ray.make_plan(plan, args.inputs, OPTIONS)
    outcome = coact_ray.run_shards(plan)
    print(f"{coact_ray.told(outcome)}\n{args.shards} shards in {time.monotonic() - began:.1f} s", flush=True)
    # While the shard ran, its lock was held, and the run could not be closed.
    expect(kills == [coact_ray.FAILED], f"no worker was killed in the middle of a shard: {kills}")
    expect(not outcome.failed, f"shards failed: {outcome.failed}")
    return outcome.exit_code


def largest_shard(output: Path) -> int:
    """Number of the shard with the most bytes."""
    shards = json.loads((output / "_coact" / "plan.json").read_text(encoding="utf-8"))["shards"]
    return max(range(1, len(shards) + 1), key=lambda number: shards[number - 1]["bytes"])


def stopping(victim: int, n_shards: int, output: Path, stopped: Path) -> str:
    """A command in place of coact: at the first try of one shard, it is stopped after its first commit."""
    commits = shlex.quote(str(output / "_coact" / "commits")) + f"/{victim:05}-*.json"
    marker = shlex.quote(str(stopped))
    return f"""#!/bin/sh
case "$*" in *--shard={victim}/{n_shards}*) if [ ! -e {marker} ]; then
    (
        until ls {commits} >/dev/null 2>&1; do :; done
        kill -STOP $$
        echo "$PPID" > {marker}.new && mv {marker}.new {marker}
    ) &
fi ;; esac
exec {shlex.quote(str(coact.binary()))} "$@"
"""


def kill_worker(stopped: Path, output: Path, victim: int, kills: list[int]) -> None:
    """Waits for the shard to stop, and kills its worker; adds what `coact finish` said of the run before that."""
    while not stopped.exists():
        time.sleep(0.01)
    unfinished = subprocess.run([coact.binary(), "finish", output], capture_output=True, text=True, check=False)
    n_parts = len(list((output / "_coact" / "commits").glob(f"{victim:05}-*.json")))
    print(f"the worker of shard {victim}, which has {n_parts} parts, is killed; finish: {unfinished.stderr.strip()}")
    kills.append(unfinished.returncode)
    os.kill(int(stopped.read_text()), signal.SIGKILL)


def expect(holds: bool, otherwise: str) -> None:
    if not holds:
        raise SystemExit(f"ray_check.py: {otherwise}")


if __name__ == "__main__":
    sys.exit(main())
