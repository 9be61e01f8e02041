"""The earth mover's measure of the method, profile `paper`, in plain NumPy: slow, obvious, and independent of coact."""

from __future__ import annotations

import numpy as np

# The default window and bins.
WINDOW = 5
BINS = 64


def measure(columns: np.ndarray, window: int = WINDOW, bins: int = BINS) -> np.ndarray:
    """E_w of each step, averaged over the columns that are not constant; the columns share their bins (Eq. 1 to 7)."""
    n_steps = len(columns)
    varying = [column for column in columns.T if column.min() != column.max()]
    if not varying:
        return np.zeros(n_steps)
    indices = np.array([bin_indices(column, bins) for column in varying])
    frequency = np.bincount(indices.ravel(), minlength=bins) / indices.size
    return np.mean([earth_mover(frequency[index], window) for index in indices], axis=0)


def bin_indices(column: np.ndarray, bins: int) -> np.ndarray:
    """How many inner edges lie at or below each value."""
    low, high = column.min(), column.max()
    edges = low + np.arange(1, bins) * ((high - low) / bins)
    return np.searchsorted(edges, column, side="right")


def earth_mover(probabilities: np.ndarray, window: int) -> np.ndarray:
    """The least distance of each step's window to one of the `window` windows beside it."""
    n_steps = len(probabilities)
    left = window // 2 + 1
    right = window - left
    windows = np.empty((n_steps, window))
    for step in range(n_steps):
        # The first and the last windows stand in for those that would reach over the border.
        center = step + left if step < left else step - right if step >= n_steps - right else step
        windows[step] = np.sort(probabilities[center - left : center + right])
    result = np.empty(n_steps)
    for step in range(n_steps):
        direction = 1 if step + window <= n_steps - 1 else -1
        neighbours = windows[step + direction * np.arange(1, window + 1)]
        distances = np.abs(windows[step] - neighbours).mean(axis=1)
        result[step] = np.where(distances <= 1e-14, 0, distances).min()
    return result
