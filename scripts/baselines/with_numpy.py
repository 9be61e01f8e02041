"""The method in NumPy, as fast as we could make it: exact integer counts on planes that stay in the cache.

A plane holds one value per window: every call works on all windows of a few columns at once. What makes it fast:

- Two windows that start j steps apart share all but j values on each side, and shared values cancel in the earth
  mover's distance. What is left are the first j values of a window and those W steps later, both kept sorted by a
  network of minima and maxima; the latter are the same plane, shifted by W.
- Where the counts allow it, planes are 16 bits wide: twice the values per instruction and per byte of cache. Sums are
  cut to the least distance so far before they could overflow, which the minimum does not see.
- Bins are bytes, and two of them are looked up and counted at a time.
- Values are binned by one multiplication and one comparison with an exact edge.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from baselines.finish import Extraction, Params, finish

# Values per plane: enough for the overhead of a call to vanish, few enough for ten planes to stay in the cache.
PLANE = 60_000
# Pairs of bins that are counted at a time.
PAIRS = 1 << 18
# Bins that are held in a byte and looked up in pairs; the guess of a bin may be one too high.
MAX_BYTE_BINS = 255
# Counts whose sums of two distances fit into 16 bits.
MAX_NARROW = 2**15 - 1


def extract(actions: np.ndarray, states: np.ndarray, params: Params) -> Extraction:
    """Finds the composite actions of one episode."""
    state = mean_measure(states, params)
    joints = [mean_measure(joint[np.newaxis], params) for joint in actions]
    return finish(state, joints, params)


def mean_measure(columns: np.ndarray, params: Params) -> np.ndarray:
    """Eq. 1 to 7: E_w averaged over the columns, which share their bins; constant ones are left out."""
    n_steps = columns.shape[1]
    bins = bin_columns(columns, params.bins)
    if not len(bins):
        return np.zeros(n_steps)
    counts = count(bins, params.bins)
    sums = sums_of_least(bins, counts, params)
    # As in the program: integers divided once.
    return sums / (float(params.window * bins.size) * len(bins))


# Eq. 1 and 3 ----------------------------------------------------------------------------------------------------------


def bin_columns(columns: np.ndarray, bins: int) -> np.ndarray:
    """The bin of each value: how many inner edges lie at or below it. Constant columns are left out."""
    n_columns, n_steps = columns.shape
    dtype = np.uint8 if bins <= MAX_BYTE_BINS else np.uint16
    found = np.empty((n_columns, n_steps), dtype)
    lows, highs = np.empty(n_columns), np.empty(n_columns)
    rows = min(max(1, PLANE // n_steps), n_columns)
    guess, edge = np.empty((rows, n_steps)), np.empty((rows, n_steps))
    is_below = np.empty((rows, n_steps), dtype=bool)
    for first in range(0, n_columns, rows):
        block = columns[first : first + rows]
        some = slice(0, len(block))
        low = np.min(block, axis=1, out=lows[first : first + rows])[:, np.newaxis]
        high = np.max(block, axis=1, out=highs[first : first + rows])[:, np.newaxis]
        with np.errstate(all="ignore"):
            width = (high - low) / bins
            reciprocal = 1 / width
            is_exact = np.isfinite(width) & np.isfinite(reciprocal) & (width > np.maximum(abs(low), abs(high)) * 2**-30)
            np.subtract(block, low, out=guess[some])
            np.multiply(guess[some], reciprocal, out=guess[some])
            # The nearest integer is the bin, or the one above: one exact edge decides.
            np.rint(guess[some], out=guess[some])
            np.multiply(guess[some], width, out=edge[some])
            np.add(edge[some], low, out=edge[some])
            np.less(block, edge[some], out=is_below[some])
            out = found[first : first + rows]
            np.copyto(out, guess[some], casting="unsafe")
        np.subtract(out, is_below[some].view(np.uint8), out=out)
        np.minimum(out, dtype(bins - 1), out=out)
        for row in np.flatnonzero(~is_exact & (low != high)):
            out[row] = search(block[row], low[row, 0], high[row, 0], bins)
    return found if (lows != highs).all() else found[lows != highs]


def search(column: np.ndarray, low: float, high: float, bins: int) -> np.ndarray:
    """The same for columns whose edges are blurred by rounding."""
    edges = low + np.arange(1, bins) * ((high - low) / bins)
    return np.searchsorted(edges, column, side="right")


def count(bins: np.ndarray, n_bins: int) -> np.ndarray:
    """How many values each bin holds, all columns together."""
    flat = bins.reshape(-1)
    if bins.dtype != np.uint8:
        return np.bincount(flat, minlength=n_bins)
    n_pairs = n_bins * 256
    pairs = np.zeros(n_pairs, dtype=np.intp)
    even = flat[: len(flat) // 2 * 2].view("<u2")
    for first in range(0, len(even), PAIRS):
        pairs += np.bincount(even[first : first + PAIRS], minlength=n_pairs)
    grid = pairs.reshape(n_bins, 256)[:, :n_bins]
    return grid.sum(axis=0) + grid.sum(axis=1) + np.bincount(flat[len(even) * 2 :], minlength=n_bins)


# Eq. 4 to 7 -----------------------------------------------------------------------------------------------------------


def sums_of_least(bins: np.ndarray, counts: np.ndarray, params: Params) -> np.ndarray:
    """For each step the sum over the columns of the least distance, times W and in counts."""
    n_columns, n_steps = bins.shape
    largest, width = int(counts.max()), params.window
    dtype = np.int16 if largest <= MAX_NARROW else np.int32 if largest * width < 2**31 else np.int64
    look_up = Table(counts.astype(dtype))
    # An even number, as two columns are added at a time; no plane is wider than there are columns.
    rows = min(max(2, PLANE // n_steps // 2 * 2), n_columns)
    planes = Planes(rows * n_steps, width, dtype)
    n_regular = n_steps - 2 * width
    sums = Sums(n_regular, bound=largest * width)
    tails = np.empty((n_columns, min(3 * width, n_steps)), dtype)
    for first in range(0, n_columns, rows):
        some = bins[first : first + rows]
        values = planes.x[: some.size]
        look_up(some.reshape(-1), values)
        tails[first : first + rows] = values.reshape(some.shape)[:, n_steps - tails.shape[1] :]
        sums.add(planes.least()[: some.size].reshape(some.shape)[:, :n_regular])
    by_step = np.zeros(n_steps, dtype=np.int64)
    tail = params.left + n_regular
    by_step[params.left : tail] = sums.total()
    by_step[tail : tail + width] = tail_sums(tails, n_steps, params)
    return by_step


class Sums:
    """Sums over many columns of numbers up to `bound`, in 32 bits as long as they fit."""

    def __init__(self, n: int, bound: int) -> None:
        self.n_fit = (2**32 - 1) // max(1, bound)
        self.n_added = 0
        self.narrow = np.zeros(n, dtype=np.uint32)
        self.wide = np.zeros(n, dtype=np.int64)

    def add(self, rows: np.ndarray) -> None:
        """Adds the rows."""
        if self.n_added + len(rows) > self.n_fit:
            self.total()
        if len(rows) > self.n_fit:
            self.wide += rows.sum(axis=0, dtype=np.int64)
            return
        self.n_added += len(rows)
        if rows.dtype == np.int16 and len(rows) % 2 == 0:
            # Two numbers of 15 bits fit into 16: half as many conversions.
            half = len(rows) // 2
            rows = np.add(rows[:half].view(np.uint16), rows[half:].view(np.uint16))
        for row in rows:
            np.add(self.narrow, row, out=self.narrow, casting="unsafe")

    def total(self) -> np.ndarray:
        """All that was added."""
        self.wide += self.narrow
        self.narrow[:] = 0
        self.n_added = 0
        return self.wide


class Table:
    """`values[bin]`, for bytes two at a time."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values
        self.pairs = None
        if len(values) <= MAX_BYTE_BINS and values.dtype.itemsize <= 4:
            pairs = np.zeros((len(values), 256, 2), values.dtype)
            pairs[:, : len(values), 0] = values
            pairs[:, : len(values), 1] = values[:, np.newaxis]
            self.pairs = pairs.reshape(-1, 2).view(f"u{2 * values.dtype.itemsize}").reshape(-1)

    def __call__(self, bins: np.ndarray, out: np.ndarray) -> None:
        """Looks up `bins`."""
        n_even = len(bins) // 2 * 2 if self.pairs is not None else 0
        if n_even:
            np.take(self.pairs, bins[:n_even].view("<u2"), out=out[:n_even].view(self.pairs.dtype), mode="clip")
        if n_even < len(bins):
            np.take(self.values, bins[n_even:], out=out[n_even:], mode="clip")


class Planes:
    """The windows that start at the first `n` values of a buffer, and all that their distances need.

    The buffer holds some columns one behind the other: windows that reach over the end of one are not of interest.
    """

    def __init__(self, n: int, width: int, dtype: type) -> None:
        self.n, self.width = n, width
        self.is_narrow = dtype == np.int16
        self.x = np.zeros(n + 2 * width, dtype)
        self.shifted = [Plane(self.x[j : j + n + width], n) for j in range(width)]
        self.free = [Plane(np.empty(n + width, dtype), n) for _ in range(width + 2)]
        self.least_distance, self.total, self.term = (np.empty(n, dtype) for _ in range(3))

    def least(self) -> np.ndarray:
        """The least distance of each window from the W that follow it, times W."""
        ordered = [self.shifted[0]]
        ordered[0].distance(out=self.least_distance)
        for carry in self.shifted[1:]:
            ordered = self.insert(ordered, carry)
            if self.is_narrow:
                self.take_nearer_narrow(ordered)
            else:
                self.take_nearer(ordered)
        self.free += ordered
        return self.least_distance

    def insert(self, ordered: list[Plane], carry: Plane) -> list[Plane]:
        """The planes with one more value per window, sorted."""
        result = []
        for plane in ordered:
            low, high = self.free.pop(), self.free.pop()
            np.minimum(plane.values, carry.values, out=low.values)
            np.maximum(plane.values, carry.values, out=high.values)
            self.free += (p for p in (plane, carry) if p.values.base is not self.x)
            result.append(low)
            carry = high
        return [*result, carry]

    def take_nearer(self, ordered: list[Plane]) -> None:
        """`least = min(least, Σ |front − behind|)` over the sorted planes."""
        ordered[0].distance(out=self.total)
        for plane in ordered[1:]:
            plane.distance(out=self.term)
            np.add(self.total, self.term, out=self.total)
        np.minimum(self.least_distance, self.total, out=self.least_distance)

    def take_nearer_narrow(self, ordered: list[Plane]) -> None:
        """The same in 16 bits: what is above the least so far may as well be equal to it."""
        least, total, term = (a.view(np.uint16) for a in (self.least_distance, self.total, self.term))
        ordered[0].distance(out=self.total)
        for i, plane in enumerate(ordered[1:]):
            plane.distance(out=self.term)
            if i > 0:
                np.minimum(total, least, out=total)
            np.add(total, term, out=total)
        np.minimum(least, total, out=least)


class Plane:
    """One value per window, and the same W steps later."""

    def __init__(self, values: np.ndarray, n: int) -> None:
        self.values = values
        self.front, self.behind = values[:n], values[len(values) - n :]

    def distance(self, out: np.ndarray) -> None:
        """How far apart the two are."""
        np.subtract(self.front, self.behind, out=out)
        np.absolute(out, out=out)


def tail_sums(tails: np.ndarray, n_steps: int, params: Params) -> np.ndarray:
    """The same for the last W windows, which have fewer ahead of them, or look back; `tails` ends the columns."""
    width, left = params.window, params.left
    windows = np.sort(sliding_window_view(tails[:, :-1].astype(np.int64), width, axis=1), axis=2)
    first = n_steps - tails.shape[1]
    n_starts = n_steps - width
    result = np.zeros(width, dtype=np.int64)
    for i, start in enumerate(range(n_starts - width, n_starts)):
        if start + left + width <= n_steps - 1:
            others = range(start + 1, n_starts)
        elif start < left:
            # Among those it is compared with is its own, repeated at the border.
            continue
        else:
            others = range(max(0, start - width), start)
        own, other = windows[:, [start - first]], windows[:, others.start - first : others.stop - first]
        result[i] = np.abs(own - other).sum(axis=2).min(axis=1).sum()
    return result
