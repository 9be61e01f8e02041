#!/usr/bin/env python3
# /// script
# requires-python = ">=3.11"
# dependencies = ["gymnasium==1.4.0", "mcap==1.6.0", "numpy==2.4.6", "polars==2.1.0"]
# ///
"""Train an agent that takes composite actions of its own past into its set of actions, while it trains.

A tabular Q-learner in CartPole-v1 (its state in bins) records its episodes; `coact watch`, which this
script starts and ends, extracts each as it ends. Every few episodes the learner asks the tables for the composite
actions since, and makes the strongest of them macro actions: one choice then stands for their first steps, and is
learnt like a single action, over as many steps as it took (Sutton, Precup and Singh, Between MDPs and semi-MDPs, 1999).

Input: a directory to be made. Output: DIR/runs/training.mcap, DIR/out with the tables, and on stdout the learner's
progress and what it took over.

Example: train_and_watch.py training --coact target/release/coact --episodes 400
"""

from __future__ import annotations

import argparse
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import gymnasium as gym
import numpy as np
import polars as pl

from committed_tables import read_committed
from record_rollouts import RecordRollouts

# Of cart position, cart velocity, pole angle and its velocity; what is beyond the bounds is in the outer bins.
N_BINS = (3, 3, 8, 8)
BOUNDS = np.array([2.4, 2.0, 0.21, 2.0])
LEARNING_RATE = 0.2
DISCOUNT = 0.99
EPSILON = 0.05
# A composite action may be as long as an episode; of a long one only the beginning fits where it is tried again.
MAX_MACRO_STEPS = 4
MIN_MACRO_STEPS = 2

Macro = tuple[int, ...]


class Learner:
    """Q-learning over binned states, with actions that may take several steps."""

    def __init__(self, env: gym.Env, seed: int) -> None:
        self.dice = np.random.default_rng(seed)
        # All that can be chosen: first the environment's own actions.
        self.macros: list[Macro] = [(action,) for action in range(env.action_space.n)]
        self.values = np.zeros((*N_BINS, len(self.macros)))

    def add(self, macro: Macro) -> None:
        self.macros.append(macro)
        # No better than what is known, so that what was learnt is not lost.
        best = self.values.max(axis=-1, keepdims=True)
        self.values = np.concatenate([self.values, best], axis=-1)

    def bins(self, state: np.ndarray) -> tuple[int, ...]:
        share = (state + BOUNDS) / (2 * BOUNDS)
        return tuple(np.clip(share * N_BINS, 0, np.array(N_BINS) - 1).astype(int).tolist())

    def choose(self, state: np.ndarray) -> int:
        if self.dice.random() < EPSILON:
            return int(self.dice.integers(len(self.macros)))
        values = self.values[self.bins(state)]
        return int(self.dice.choice(np.flatnonzero(values == values.max())))

    def learn(
        self, state: np.ndarray, choice: int, rewards: Sequence[float], next_state: np.ndarray, terminated: bool
    ) -> None:
        """`rewards` are those of the steps that the choice took."""
        earned = sum(DISCOUNT**n * reward for n, reward in enumerate(rewards))
        ahead = 0.0 if terminated else self.values[self.bins(next_state)].max()
        target = earned + DISCOUNT ** len(rewards) * ahead
        at = (*self.bins(state), choice)
        self.values[at] += LEARNING_RATE * (target - self.values[at])


def play(env: gym.Env, learner: Learner) -> float:
    """One episode; what it returned."""
    state, _ = env.reset()
    total, terminated, truncated = 0.0, False, False
    while not (terminated or truncated):
        choice = learner.choose(state)
        before, rewards = state, []
        for action in learner.macros[choice]:
            state, reward, terminated, truncated, _ = env.step(action)
            rewards.append(float(reward))
            if terminated or truncated:
                break
        learner.learn(before, choice, rewards, state, terminated)
        total += sum(rewards)
    return total


def strongest(segments: pl.DataFrame, known: Sequence[Macro]) -> Macro | None:
    """The composite action with the greatest change of state that is not known yet, as a macro action."""
    for actions in segments.sort("state_change_sum", descending=True)["actions"]:
        macro = tuple(int(action) for action in actions[:MAX_MACRO_STEPS])
        if len(macro) >= MIN_MACRO_STEPS and macro not in known:
            return macro
    return None


@contextmanager
def watch(coact: Path, runs: Path, out: Path) -> Iterator[None]:
    """`coact watch` beside what is done meanwhile."""
    process = subprocess.Popen([coact, "watch", runs, "-o", out, "--steps", "none"])
    try:
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def train(args: argparse.Namespace) -> None:
    runs, out = args.directory / "runs", args.directory / "out"
    runs.mkdir(parents=True)
    with (
        watch(args.coact, runs, out),
        RecordRollouts(gym.make("CartPole-v1"), runs / "training.mcap", policy="Q-learning with macros") as env,
    ):
        learner = Learner(env, args.seed)
        env.reset(seed=args.seed)
        returns: list[float] = []
        last_seen = -1
        for number in range(1, args.episodes + 1):
            returns.append(play(env, learner))
            if number % args.every:
                continue
            mean = np.mean(returns[-args.every :])
            print(f"episodes to {number}: mean return {mean:.1f}, {len(learner.macros)} actions", flush=True)
            segments = read_committed(out, "segments")
            new = segments.filter(pl.col("episode") > last_seen) if segments is not None else pl.DataFrame()
            if new.is_empty():
                continue
            last_seen = new["episode"].max()
            macro = strongest(new, learner.macros)
            if macro and len(learner.macros) < args.max_actions:
                learner.add(macro)
                print(f"  new action {macro}, of episodes up to {last_seen}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR", help="where recording and tables go; must not exist")
    parser.add_argument("--coact", type=Path, default=Path("coact"), help="the program [coact]")
    parser.add_argument("--episodes", type=int, default=400, metavar="N", help="episodes to train [400]")
    parser.add_argument("--every", type=int, default=20, metavar="N", help="episodes between two looks [20]")
    parser.add_argument("--max-actions", type=int, default=6, metavar="N", help="actions with macros at most [6]")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    if args.directory.exists():
        raise SystemExit(f"train_and_watch.py: {args.directory} exists: choose another directory")
    train(args)


if __name__ == "__main__":
    main()
