"""The method in numba, as fast as we could make it, and as one would write it first.

`extract` does what the program does: exact integer counts, values that two windows share left out, the loop over the
windows turned into vectors by the compiler. `extract_directly` is the straight version: one window after the other in
f64, each sorted where it is compared. Columns are shared out among threads in blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import lru_cache

import numpy as np
from numba import njit

from baselines.finish import Extraction, Params, finish
from baselines.with_numpy import search, tail_sums

# Tallies in turn: a run of equal bins would wait for its own counter at every step.
TALLIES = 8

# No `fastmath`: edges must be exact, and it made none of these loops faster.
compiled = njit(boundscheck=False, nogil=True, error_model="numpy")


def extract(actions: np.ndarray, states: np.ndarray, params: Params, threads: Executor | None = None) -> Extraction:
    """Finds the composite actions of one episode."""
    state = mean_measure(states, params, threads)
    joints = [mean_measure(joint[np.newaxis], params, None) for joint in actions]
    return finish(state, joints, params)


def mean_measure(columns: np.ndarray, params: Params, threads: Executor | None) -> np.ndarray:
    """Eq. 1 to 7: E_w averaged over the columns, which share their bins; constant ones are left out."""
    n_steps, width = columns.shape[1], params.window
    bins = np.empty(columns.shape, np.uint8 if params.bins <= 256 else np.uint16)
    blocks = [columns] if threads is None else np.array_split(columns, 2)
    outs = [bins] if threads is None else np.array_split(bins, 2)
    counted = list(each(threads, lambda block, out: bin_and_count(block, params.bins, out), blocks, outs))
    is_used = np.concatenate([used for used, _ in counted])
    counts = sum(counts for _, counts in counted)
    if not is_used.all():
        bins = bins[is_used]
    if not len(bins):
        return np.zeros(n_steps)
    if int(counts.max()) * width >= 2**31:
        raise ValueError("too many values: counts do not fit into 32 bits")
    table = counts.astype(np.int32)
    blocks = [bins] if threads is None else np.array_split(bins, 2)
    parts = each(threads, lambda block: sums_of_least(block, table, params), blocks)
    return sum(parts) / (float(width * bins.size) * len(bins))


def each(threads: Executor | None, f: Callable, *items: Sequence) -> list:
    """`f` of each item, on threads if there are some."""
    return list(map(f, *items) if threads is None else threads.map(f, *items))


# Eq. 1 and 3 ----------------------------------------------------------------------------------------------------------


def bin_and_count(columns: np.ndarray, n_bins: int, out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bins columns; says which are not constant, and how many values each bin holds."""
    tallies = np.zeros((TALLIES, n_bins), np.int64)
    lows, highs = np.empty(len(columns)), np.empty(len(columns))
    for i in bin_columns(columns, n_bins, out, tallies, lows, highs):
        out[i] = search(columns[i], lows[i], highs[i], n_bins)
        tally(out[i], tallies)
    return lows != highs, tallies.sum(axis=0)


@compiled
def extent(column):
    """Minimum and maximum, in lanes: a single running minimum would wait for itself at every value."""
    lanes = 32
    n = len(column) // lanes * lanes
    lows, highs = np.full(lanes, column[0]), np.full(lanes, column[0])
    for first in range(0, n, lanes):
        for k in range(lanes):
            x = column[np.uint64(first + k)]
            lows[k] = min(lows[k], x)
            highs[k] = max(highs[k], x)
    low, high = lows.min(), highs.max()
    for t in range(n, len(column)):
        low, high = min(low, column[t]), max(high, column[t])
    return low, high


@compiled
def bin_column(column, low, width, reciprocal, last, out):
    """One multiplication finds the bin or the one above; one exact edge decides."""
    for t in range(len(column)):
        guess = np.rint((column[t] - low) * reciprocal)
        index = np.int32(guess) - np.int32(column[t] < low + guess * width)
        out[t] = min(np.int32(index), np.int32(last))


@compiled
def tally(bins, tallies):
    """Counts the bins of a column."""
    n = len(bins) // TALLIES * TALLIES
    for first in range(0, n, TALLIES):
        for k in range(TALLIES):
            tallies[k, bins[np.uint64(first + k)]] += 1
    for t in range(n, len(bins)):
        tallies[0, bins[t]] += 1


@compiled
def bin_columns(columns, n_bins, out, tallies, lows, highs):
    """Bins and counts all columns but those whose edges are blurred by rounding; their indices are returned."""
    blurred = []
    for i in range(len(columns)):
        low, high = extent(columns[i])
        lows[i], highs[i] = low, high
        if low == high:
            continue
        width = (high - low) / n_bins
        reciprocal = 1 / width
        if np.isfinite(width) and width > max(abs(low), abs(high)) * 2.0**-30 and np.isfinite(reciprocal):
            bin_column(columns[i], low, width, reciprocal, n_bins - 1, out[i])
            tally(out[i], tallies)
        else:
            blurred.append(i)
    return blurred


# Eq. 4 to 7 -----------------------------------------------------------------------------------------------------------


def sums_of_least(bins: np.ndarray, table: np.ndarray, params: Params) -> np.ndarray:
    """For each step the sum over the columns of the least distance, times W and in counts."""
    n_columns, n_steps = bins.shape
    width = params.window
    n_regular = n_steps - 2 * width
    tails = np.empty((n_columns, min(3 * width, n_steps)), table.dtype)
    by_step = np.zeros(n_steps, dtype=np.int64)
    tail = params.left + n_regular
    # Sums of 32 bits are emptied before they can overflow.
    n_fit = (2**31 - 1) // max(1, int(table.max()) * width)
    add_columns(width)(bins, table, n_fit, tails, by_step[params.left : tail])
    by_step[tail : tail + width] = tail_sums(tails, n_steps, params)
    return by_step


@lru_cache
def add_columns(width: int) -> Callable:
    """The kernel for windows of this width: `sums[s] += least distance of the window at s from the W that follow`."""
    names: dict = {"np": np}
    # Source of our own, from a number: numba has no other way to unroll loops.
    exec(kernel_source(width), names)
    add_least = compiled(names["add_least"])

    @compiled
    def add(bins, table, n_fit, tails, sums):
        n_columns, n_steps = bins.shape
        values = np.empty(n_steps, np.int32)
        narrow = np.zeros(len(sums), np.int32)
        for c in range(n_columns):
            column = bins[c]
            for t in range(n_steps):
                values[t] = table[np.uint64(column[t])]
            tails[c] = values[n_steps - tails.shape[1] :]
            add_least(values, narrow)
            if (c + 1) % n_fit == 0 or c + 1 == n_columns:
                for s in range(len(sums)):
                    sums[s] += narrow[s]
                    narrow[s] = 0

    return add


def kernel_source(width: int) -> str:
    """Straight code for one window, so that the loop over the windows is the one that becomes vectors.

    Sorted values are variables: f0, f1, … are the first of the window itself, b0, b1, … the first ones behind it.
    """
    lines = ["def add_least(x, sums):", "    for s in range(np.uint64(len(sums))):"]
    for j in range(width):
        for side, start in (("f", j), ("b", width + j)):
            lines.append(f"        carry = x[s + np.uint64({start})]")
            for i in range(j):
                lines.append(f"        {side}{i}, carry = min({side}{i}, carry), max({side}{i}, carry)")
            lines.append(f"        {side}{j} = carry")
        distance = " + ".join(f"abs(np.int32(f{i} - b{i}))" for i in range(j + 1))
        lines.append(f"        distance = np.int32({distance})")
        lines.append(f"        least = {'min(least, distance)' if j else 'distance'}")
    lines.append("        sums[s] = np.int32(sums[s] + least)")
    return "\n".join(lines)


# The straight version -------------------------------------------------------------------------------------------------


def extract_directly(actions: np.ndarray, states: np.ndarray, params: Params) -> Extraction:
    """Finds the composite actions of one episode, with loops as one would write them first."""
    used = states[states.min(axis=1) != states.max(axis=1)]
    state = measure_directly(used, params.bins, params.window) if len(used) else np.zeros(states.shape[1])
    joints = [measure_directly(joint[np.newaxis], params.bins, params.window) for joint in actions]
    return finish(state, joints, params)


@compiled
def measure_directly(columns, bins, window):
    """Eq. 1 to 7."""
    n_columns, n_steps = columns.shape
    indices = np.empty((n_columns, n_steps), np.int64)
    counts = np.zeros(bins, np.int64)
    edges = np.empty(bins - 1)
    for c in range(n_columns):
        low, high = columns[c].min(), columns[c].max()
        for k in range(1, bins):
            edges[k - 1] = low + k * ((high - low) / bins)
        indices[c] = np.searchsorted(edges, columns[c], side="right")
        for index in indices[c]:
            counts[index] += 1
    probabilities = counts / (n_columns * n_steps)
    sums = np.zeros(n_steps)
    left = window // 2 + 1
    right = window - left
    windows = np.empty((n_steps, window))
    for c in range(n_columns):
        for t in range(n_steps):
            center = t + left if t < left else t - right if t >= n_steps - right else t
            for i in range(window):
                windows[t, i] = probabilities[indices[c, center - left + i]]
            windows[t].sort()
        for t in range(n_steps):
            direction = 1 if t + window <= n_steps - 1 else -1
            least = np.inf
            for j in range(1, window + 1):
                distance = 0.0
                for i in range(window):
                    distance += abs(windows[t, i] - windows[t + direction * j, i])
                least = min(least, distance / window)
            if least > 1e-14:
                sums[t] += least
    return sums / n_columns
