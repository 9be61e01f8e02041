"""The method as one would write it down: plain Python, and SciPy's distance for each pair of windows."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter

import numpy as np
from scipy.stats import wasserstein_distance

from baselines.finish import Extraction, Params, finish

# A distance at or below it is rounding.
ROUNDING = 1e-14


def extract(actions: np.ndarray, states: np.ndarray, params: Params) -> Extraction:
    """Finds the composite actions of one episode."""
    state = mean_measure(states.tolist(), params)
    joints = [mean_measure([joint], params, of_joint=True) for joint in actions.tolist()]
    return finish(state, joints, params)


def mean_measure(columns: list[list[float]], params: Params, *, of_joint: bool = False) -> np.ndarray:
    """Eq. 1 to 7; the columns share their bins, constant ones are left out unless they are a joint."""
    n_steps = len(columns[0])
    columns = [c for c in columns if of_joint or min(c) != max(c)]
    if not columns:
        return np.zeros(n_steps)
    indices = [bin_indices(column, params.bins) for column in columns]
    counts = Counter(index for column in indices for index in column)
    total = len(columns) * n_steps
    sums = [0.0] * n_steps
    for column in indices:
        measure = earth_mover([counts[index] / total for index in column], params)
        sums = [a + b for a, b in zip(sums, measure, strict=True)]
    return np.array(sums) / len(columns)


def bin_indices(column: list[float], bins: int) -> list[int]:
    """How many inner edges lie at or below each value (Eq. 1)."""
    low, high = min(column), max(column)
    edges = [low + k * ((high - low) / bins) for k in range(1, bins)]
    return [bisect_right(edges, x) for x in column]


def earth_mover(probabilities: list[float], params: Params) -> list[float]:
    """The least distance of each step's window from the `window` windows beside it."""
    n_steps, window, left = len(probabilities), params.window, params.left
    right = window - left
    windows = []
    for step in range(n_steps):
        # The first and the last windows stand in for those that would reach over the border.
        center = step + left if step < left else step - right if step >= n_steps - right else step
        windows.append(probabilities[center - left : center + right])
    measure = []
    for step in range(n_steps):
        direction = 1 if step + window <= n_steps - 1 else -1
        distances = [
            float(wasserstein_distance(windows[step], windows[step + direction * j])) for j in range(1, window + 1)
        ]
        least = min(distances)
        measure.append(0.0 if least <= ROUNDING else least)
    return measure
