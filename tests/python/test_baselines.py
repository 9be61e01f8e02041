"""The Python versions of the method that speed is compared with find what the program finds."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from baselines.finish import Params
from conftest import Run
from support import START_TIME_NANOS, Message, Topic, load, write_recording

# Behind its import what it needs beyond scripts/requirements.txt.
VERSIONS = [
    ("with_numpy", "extract", None),
    ("with_scipy", "extract", "scipy"),
    ("with_numba", "extract", "numba"),
    ("with_numba", "extract_directly", "numba"),
]


@pytest.mark.parametrize(("module", "function", "needs"), VERSIONS, ids=lambda v: str(v))
@pytest.mark.parametrize(
    ("n_steps", "window", "bins"), [(11, 5, 64), (14, 5, 64), (13, 4, 7), (400, 5, 64), (401, 8, 300)]
)
def test_a_version_finds_what_the_program_finds(
    run: Run, tmp_path: Path, module: str, function: str, needs: str | None, n_steps: int, window: int, bins: int
) -> None:
    if needs is not None:
        pytest.importorskip(needs)
    extract = getattr(importlib.import_module(f"baselines.{module}"), function)
    if module == "with_scipy":
        n_steps = min(n_steps, 100)
    actions, states = arrays(n_steps)
    recording = write(tmp_path / "episode.mcap", actions, states)
    out = tmp_path / "out"
    run(["extract", recording, "-o", out, "--window", str(window), "--bins", str(bins)])

    found = extract(actions, states, Params(bins=bins, window=window))

    steps, segments = load(out, "steps"), load(out, "segments")
    for i, joint in enumerate(found.joints):
        rows = steps.filter(pl.col("joint") == i)
        for name, series in (("action", joint.action), ("state", found.state)):
            np.testing.assert_allclose(series.measure, rows[f"{name}_measure"], rtol=0, atol=1e-12)
            np.testing.assert_allclose(series.change, rows[f"{name}_change"], rtol=0, atol=1e-12)
            np.testing.assert_array_equal(series.mask, rows[f"{name}_mask"])
        np.testing.assert_array_equal(joint.correlated, rows["correlated"])
        pieces = segments.filter(pl.col("joint") == i)
        np.testing.assert_array_equal(joint.starts, pieces["start_step"])
        np.testing.assert_array_equal(joint.ends, pieces["end_step"])
        np.testing.assert_allclose(joint.sums, pieces["state_change_sum"], rtol=1e-9)
        np.testing.assert_allclose(joint.peaks, pieces["state_change_peak"], rtol=1e-12)


def arrays(n_steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Two joints; states that drift, that are noise, that are constant, and whose edges are blurred by rounding."""
    random = np.random.default_rng(n_steps)
    drift = np.cumsum(random.integers(-1, 2, size=(3, n_steps)), axis=1).astype(float)
    noise = random.random((3, n_steps))
    blurred = 1e16 + 2.0 * random.integers(0, 9, n_steps)
    actions = np.stack([drift[0], noise[0]])
    return actions, np.stack([drift[1], noise[1], np.full(n_steps, 3.0), drift[2], noise[2], blurred])


def write(path: Path, actions: np.ndarray, states: np.ndarray) -> Path:
    """A recording of these steps."""
    steps = zip(actions.T.tolist(), states.T.tolist(), strict=True)
    messages = [
        Message("/step", START_TIME_NANOS + step, json.dumps({"action": action, "state": state}).encode())
        for step, (action, state) in enumerate(steps)
    ]
    return write_recording(path, {"/step": Topic("json")}, messages)
