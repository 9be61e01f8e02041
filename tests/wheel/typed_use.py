"""What a user's own type checker has to accept, and (by `warn_unused_ignores` of mypy's strict) to refuse. Not run."""

from __future__ import annotations

from typing import Any, assert_type

import numpy as np
import numpy.typing as npt
import polars

import coact


def accepted() -> None:
    run = coact.extract(["a.mcap"], "out", measure="shannon", window=8, state=["/step:state"], steps="none")
    assert_type(run, coact.Run)
    assert_type(coact.read_segments("out", "polars"), polars.DataFrame)
    assert_type(coact.read_steps("out"), Any)
    found = coact.extract_arrays([0, 1], np.zeros((2, 4)), joints="together", threshold=0.3)
    assert_type(found.joints[0].action.mask, npt.NDArray[np.bool_])
    assert_type(found.joints[0].segments.actions, list[npt.NDArray[np.float64]])


def refused() -> None:
    coact.extract("a.mcap", "out", steps="some")  # type: ignore[arg-type]
    coact.extract("a.mcap", "out", windows=8)  # type: ignore[call-arg]
    coact.extract_arrays([0], [1], steps="none")  # type: ignore[call-arg]
    coact.read_segments("out", "excel")  # type: ignore[call-overload]
