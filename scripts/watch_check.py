#!/usr/bin/env python3
# /// script
# requires-python = ">=3.11"
# dependencies = ["gymnasium==1.4.0", "mcap==1.6.0", "numpy==2.4.6", "polars==2.1.0"]
# ///
"""Hold `coact watch` against a training loop that records beside it, and against `coact extract` afterwards.

An agent plays CartPole and records it, at a pace that can be given; a watcher extracts beside it, and is killed (-9) and
started again at random moments. Measured: for each episode the time from the moment its last step is written to the
moment a reader of the tables sees its rows (those during which the watcher was killed apart), and the watcher's memory.
Checked: all four tables are those of a later `coact extract`, sorted by key: nothing lost, nothing doubled.

Output: the figures on stdout; exit 1 where a table differs.

Example: watch_check.py --coact target/release/coact --episodes 200 --kills 5
"""

from __future__ import annotations

import argparse
import random
import signal
import statistics
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import gymnasium as gym
import polars as pl

from committed_tables import read_committed
from record_rollouts import RecordRollouts
from scripted_policies import scripted_policy

KEYS = {
    "segments": ["recording", "episode", "joint", "segment"],
    "steps": ["recording", "episode", "joint", "step"],
    "episodes": ["recording", "episode"],
    "recordings": ["recording"],
}
MAX_WAIT_SECONDS = 60.0


class Watcher:
    """The process, across its kills."""

    def __init__(self, coact: Path, runs: Path, out: Path) -> None:
        self.command = [coact, "watch", runs, "-o", out, "-q"]
        self.peak_kib = 0
        self.kills: list[tuple[float, float]] = []
        """From the kill to the start of the next process."""
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(self.command)

    def kill(self) -> None:
        self.measure()
        at = time.monotonic()
        self.process.kill()
        self.process.wait()
        self.start()
        self.kills.append((at, time.monotonic()))

    def measure(self) -> int:
        """Memory it has now, KiB."""
        fields = dict(
            line.split(":", 1) for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
        )
        self.peak_kib = max(self.peak_kib, int(fields["VmHWM"].split()[0]))
        return int(fields["VmRSS"].split()[0])

    def stop(self) -> None:
        self.measure()
        self.process.send_signal(signal.SIGTERM)
        if code := self.process.wait():
            raise SystemExit(f"the watcher ended with {code}")


class Reader(threading.Thread):
    """Looks at the committed tables again and again; when it saw each episode first."""

    def __init__(self, out: Path) -> None:
        super().__init__(daemon=True)
        self.out = out
        self.seen: dict[int, float] = {}
        self.problems: list[str] = []
        self.is_over = threading.Event()

    def run(self) -> None:
        while not self.is_over.is_set():
            rows = read_committed(self.out, "episodes") if self.out.is_dir() else None
            if rows is None:
                time.sleep(0.01)
                continue
            episodes = rows["episode"].to_list()
            now = time.monotonic()
            if len(set(episodes)) < len(episodes):
                self.problems.append("a reader saw an episode twice")
            if gone := self.seen.keys() - set(episodes):
                self.problems.append(f"a reader saw episodes {sorted(gone)} no more")
            for episode in episodes:
                self.seen.setdefault(episode, now)
            time.sleep(0.01)


def play(args: argparse.Namespace, runs: Path, watcher: Watcher, dice: random.Random) -> list[float]:
    """Records episodes, and kills the watcher now and then; when the last step of each was written."""
    ends: list[float] = []
    kill_at = set(dice.sample(range(args.episodes // 10, args.episodes), args.kills))
    with RecordRollouts(gym.make("CartPole-v1"), runs / "training.mcap") as env:
        env.reset(seed=args.seed)
        for episode in range(args.episodes):
            state, _ = env.reset()
            # Half of the episodes are short and come close together.
            policy = scripted_policy(env) if dice.random() < 0.5 else lambda _: env.action_space.sample()
            over = False
            while not over:
                state, _, terminated, truncated, _ = env.step(policy(state))
                over = terminated or truncated
                if args.step_seconds:
                    time.sleep(args.step_seconds)
            ends.append(time.monotonic())
            if episode in kill_at:
                time.sleep(dice.uniform(0.0, 0.3))
                watcher.kill()
    return ends


def compare(runs: Path, out: Path, coact: Path, batch: Path) -> list[str]:
    """What differs between the tables and those of a run over what is there now."""
    subprocess.run([coact, "extract", runs, "-o", batch, "-q"], check=True)
    problems = []
    for table, keys in KEYS.items():
        rows = read_committed(out, table)
        expected = pl.read_parquet(f"{batch}/{table}/*.parquet").sort(keys)
        is_same = rows is not None and rows.sort(keys).equals(expected)
        if not is_same:
            problems.append(f"{table} differs from that of a later run")
        print(f"{table}: {expected.height} rows, {'the same' if is_same else 'NOT the same'}")
    again = subprocess.run([coact, "extract", runs, "-o", out, "-q"], check=False).returncode
    if again:
        problems.append(f"a later run into the same directory ended with {again}")
    return problems


def check(args: argparse.Namespace, directory: Path) -> list[str]:
    runs, out = directory / "runs", directory / "out"
    runs.mkdir()
    dice = random.Random(args.seed)
    watcher = Watcher(args.coact.resolve(), runs, out)
    reader = Reader(out)
    reader.start()
    ends = play(args, runs, watcher, dice)
    deadline = time.monotonic() + MAX_WAIT_SECONDS
    while len(reader.seen) < args.episodes and time.monotonic() < deadline:
        time.sleep(0.01)
    resting_kib = watcher.measure()
    reader.is_over.set()
    reader.join()
    watcher.stop()
    problems = list(reader.problems)
    if missing := set(range(args.episodes)) - reader.seen.keys():
        return [*problems, f"episodes {sorted(missing)} never came"]

    def was_killed(end: float, seen: float) -> bool:
        return any(killed < seen and end < started for killed, started in watcher.kills)

    waits = [(reader.seen[n] - end, was_killed(end, reader.seen[n])) for n, end in enumerate(ends)]
    undisturbed = [wait for wait, killed in waits if not killed]
    killed = [wait for wait, killed in waits if killed]
    n_parts = len(list(out.glob("segments/*.parquet")))
    print(f"{args.episodes} episodes in {ends[-1] - ends[0]:.1f} s, {args.kills} kills, {n_parts} parts at the end")
    print(f"last step written to rows seen: median {statistics.median(undisturbed):.3f} s, worst {max(undisturbed):.3f} s")
    if killed:
        print(f"where the watcher was killed meanwhile ({len(killed)} episodes): worst {max(killed):.3f} s")
    print(f"memory of the watcher: {resting_kib / 1024:.0f} MiB at rest, {watcher.peak_kib / 1024:.0f} MiB at most")
    return problems + compare(runs, out, args.coact.resolve(), directory / "batch")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--coact", type=Path, default=Path("target/release/coact"), help="the program")
    parser.add_argument("--episodes", type=int, default=200, metavar="N", help="[200]")
    parser.add_argument("--kills", type=int, default=5, metavar="N", help="kill -9 of the watcher [5]")
    parser.add_argument("--step-seconds", type=float, default=0.001, metavar="S", help="pause after each step [0.001]")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        problems = check(args, Path(directory))
    for problem in problems:
        print(problem)
    raise SystemExit(1 if problems else 0)


if __name__ == "__main__":
    main()
