"""Eq. 8 to 11 and PART: from the measures of an episode to its composite actions, in NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# A change this near the threshold equals it; a span at or below this share of the maximum is rounding.
TIE = 1e-9
CONSTANT = 1e-12


@dataclass(frozen=True)
class Params:
    """Parameters of the method, with its defaults."""

    bins: int = 64
    window: int = 5
    threshold: float = 0.5

    @property
    def left(self) -> int:
        """Steps of a window before its own (Eq. 4)."""
        return self.window // 2 + 1


@dataclass(frozen=True)
class Series:
    """E_w, E_n and the mask of change."""

    measure: np.ndarray
    change: np.ndarray
    mask: np.ndarray


@dataclass(frozen=True)
class Joint:
    """What was found for one joint: segments are half-open, `starts` and `ends` in time."""

    action: Series
    correlated: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    sums: np.ndarray
    peaks: np.ndarray
    ranks: np.ndarray


@dataclass(frozen=True)
class Extraction:
    """What was found in one episode."""

    state: Series
    joints: list[Joint]


def finish(state_measure: np.ndarray, action_measures: Sequence[np.ndarray], params: Params) -> Extraction:
    """All that follows from the measures."""
    state = series(state_measure, params)
    n_state_changes = running_count(state.mask)
    joints = []
    for measure in action_measures:
        action = series(measure, params)
        correlated = correlate(running_count(action.mask), n_state_changes, params.window)
        joints.append(partition(action, correlated, state.change))
    return Extraction(state, joints)


def series(measure: np.ndarray, params: Params) -> Series:
    """Eq. 8 and 9."""
    low, high = measure.min(), measure.max()
    if high - low <= CONSTANT * abs(high):
        return Series(measure, np.zeros_like(measure), np.zeros(measure.shape, dtype=bool))
    change = (measure - low) / (high - low)
    return Series(measure, change, change > params.threshold + TIE)


def running_count(mask: np.ndarray) -> np.ndarray:
    """Truths before each step, and in all."""
    counts = np.zeros(len(mask) + 1, dtype=np.int32)
    np.cumsum(mask, out=counts[1:])
    return counts


def correlate(action: np.ndarray, state: np.ndarray, window: int) -> np.ndarray:
    """Eq. 10 and 11: both change in the `window` steps from a step on, or up to it at the end of the episode."""
    n_ahead = len(action) - 1 - window
    correlated = np.empty(len(action) - 1, dtype=bool)
    ahead = [counts[window:-1] > counts[:n_ahead] for counts in (action, state)]
    behind = [counts[n_ahead + 1 :] > counts[n_ahead + 1 - window : -window] for counts in (action, state)]
    np.logical_and(*ahead, out=correlated[:n_ahead])
    np.logical_and(*behind, out=correlated[n_ahead:])
    return correlated


def partition(action: Series, correlated: np.ndarray, state_change: np.ndarray) -> Joint:
    """PART: cut at the last step of each run of truths; and the score."""
    boundaries = np.flatnonzero(correlated & ~np.append(correlated[1:], False))
    if len(boundaries) == 1:
        starts, ends = np.array([0]), boundaries + 1
    else:
        starts, ends = boundaries[:-1], boundaries[1:]
    if not len(starts):
        none = np.empty(0)
        return Joint(action, correlated, starts, ends, none, none, none.astype(int))
    change = state_change[: ends[-1]]
    sums = np.add.reduceat(change, starts)
    ranks = np.empty(len(sums), dtype=int)
    ranks[np.argsort(-sums, kind="stable")] = np.arange(1, len(sums) + 1)
    return Joint(action, correlated, starts, ends, sums, np.maximum.reduceat(change, starts), ranks)
