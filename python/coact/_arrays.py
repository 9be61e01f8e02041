"""An episode in memory: arrays in, segments and masks out.

The episode goes through the binary as a recording of its own, so that what comes out is what the same episode gives in
a file, to the last bit.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, cast

import numpy as np
import numpy.typing as npt

from coact._binary import run
from coact._extract import MethodOptions, flags
from coact._mcap import write_episode
from coact._tables import read_table

if TYPE_CHECKING:
    import pyarrow

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]

# The reader takes messages of 2^20 values, which the step's number and its like are among.
MAX_COLUMNS = (1 << 20) - 8
# How the recording is read; the episode is in memory already, so a bound on its bytes would protect nothing.
READING = ["--action=/step:action", "--state=/step:state", "--episodes=recording", f"--max-episode={1 << 62}"]


@dataclass(frozen=True, eq=False, repr=False)
class Series:
    """One series of change, a value a step. NaN where the episode is too short."""

    measure: Floats
    """What was measured at each step (E_w)."""
    change: Floats
    """That between 0 and 1 over the episode (E_n)."""
    mask: Bools
    """Whether it is over the threshold: true is a notable change."""


@dataclass(frozen=True, eq=False, repr=False)
class Segments:
    """The composite actions of one joint, in time; one value each."""

    start_step: Integers
    end_step: Integers
    """Half-open: the first step behind it."""
    state_change_sum: Floats
    state_change_peak: Floats
    state_change_rank: Integers
    """1 is the largest sum."""
    reward_sum: Floats | None
    """None without rewards."""
    actions: list[Floats]
    """The actions of each: of the joint (n_steps,), or of all joints together (n_steps, n_joints)."""

    def __len__(self) -> int:
        return len(self.start_step)

    def __repr__(self) -> str:
        return f"Segments({len(self)} composite actions)"


@dataclass(frozen=True, eq=False, repr=False)
class JointExtraction:
    """What was found for one joint."""

    joint: int
    """Column of `actions`; -1 for all together."""
    action: Series
    correlated: Bools
    """Steps near which action and state change."""
    boundaries: Integers
    """The steps at which the actions are cut."""
    segments: Segments

    def __repr__(self) -> str:
        return f"JointExtraction(joint={self.joint}, {self.segments})"


@dataclass(frozen=True, eq=False, repr=False)
class Extraction:
    """What was found in one episode."""

    status: Literal["ok", "too_short"]
    reason: str | None
    """Why it is too short."""
    state: Series
    joints: tuple[JointExtraction, ...]
    """One for each column of `actions`, or one for all together."""

    def __repr__(self) -> str:
        return f"Extraction({self.status}, joints={list(self.joints)})"


def extract_arrays(
    actions: npt.ArrayLike,
    states: npt.ArrayLike,
    rewards: npt.ArrayLike | None = None,
    **options: Unpack[MethodOptions],
) -> Extraction:
    """Extracts the composite actions of one episode in memory.

    `actions` is (n_steps,) or (n_steps, n_joints); `states` (n_steps,) or (n_steps, …), flattened behind the first
    axis: the observations the actions were chosen from; `rewards`, if any, (n_steps,). An episode too short for the
    window is no error: its `status` says so. Raises `ValueError` for arrays that do not fit, `Error` for options that
    do not.

    >>> found = coact.extract_arrays(actions, states, measure="shannon")
    >>> found.joints[0].segments.start_step
    """
    action_rows = rows_of("actions", actions)
    state_rows = rows_of("states", states)
    reward_rows = None if rewards is None else rows_of("rewards", rewards)
    check_together(action_rows, state_rows, reward_rows)
    unknown = set(options) - set(MethodOptions.__annotations__)
    if unknown:
        raise TypeError(f"options of arrays are those of the method; not {', '.join(sorted(unknown))}")

    with tempfile.TemporaryDirectory(prefix="coact-") as folder:
        recording, output = Path(folder, "arrays.mcap"), Path(folder, "out")
        write_episode(recording, action_rows, state_rows, reward_rows)
        method = flags(cast(Mapping[str, object], options))
        run(["extract", str(recording), "--output", str(output), "--quiet", *READING, *method])
        (episode,) = read_table(output, "episodes").to_pylist()
        if episode["status"] not in ("ok", "too_short"):
            raise ValueError(f"the episode was not taken whole: {episode['reason']}")
        steps = read_table(output, "steps")
        segments = read_table(output, "segments")
    return extraction_of(episode, steps, segments, action_rows, has_rewards=rewards is not None)


# Arrays in ------------------------------------------------------------------------------------------------------------


def rows_of(name: str, values: npt.ArrayLike) -> Floats:
    """An array as (n_steps, n_columns) of doubles, checked on its own."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name}: rows of different lengths, or no array: {error}") from None
    if array.dtype.kind not in "biuf":
        raise TypeError(f"{name}: expected real numbers, found an array of {array.dtype}")
    if array.ndim == 0 or array.size == 0:
        raise ValueError(f"{name}: expected (n_steps,) or (n_steps, n_columns) with at least one, found {array.shape}")
    doubles = array.reshape(len(array), -1).astype(np.float64)
    bad = np.argwhere(~np.isfinite(doubles))
    if len(bad):
        step, column = bad[0]
        raise ValueError(f"{name}: {doubles[step, column]} at step {step}, column {column}; {len(bad)} are not finite")
    return doubles


def check_together(actions: Floats, states: Floats, rewards: Floats | None) -> None:
    """What one array has to be because of another."""
    if len(actions) != len(states):
        hint = "; leave out the last state, which no action was chosen from" if len(states) == len(actions) + 1 else ""
        raise ValueError(f"actions have {len(actions)} steps, states {len(states)}{hint}")
    n_columns = actions.shape[1] + states.shape[1]
    if n_columns > MAX_COLUMNS:
        raise ValueError(f"{n_columns} values a step in actions and states: at most {MAX_COLUMNS} are taken")
    if rewards is not None and rewards.shape != (len(actions), 1):
        raise ValueError(f"rewards: expected one for each of the {len(actions)} steps, found {rewards.shape}")


# Tables out -----------------------------------------------------------------------------------------------------------


def extraction_of(
    episode: dict[str, Any], steps: pyarrow.Table, segments: pyarrow.Table, actions: Floats, *, has_rewards: bool
) -> Extraction:
    """The rows of one episode as arrays."""
    n_steps = len(actions)
    # Rows are in the order of joint and step, and each joint has all steps.
    n_joints = steps.num_rows // n_steps
    by_joint = [steps.slice(index * n_steps, n_steps) for index in range(n_joints)]
    joint_of_segment = column(segments, "joint")
    joints = []
    for rows in by_joint:
        joint = int(column(rows, "joint")[0])
        first, last = np.searchsorted(joint_of_segment, [joint, joint + 1])
        of_joint = segments.slice(first, last - first)
        joints.append(
            JointExtraction(
                joint=joint,
                action=series(rows, "action"),
                correlated=column(rows, "correlated"),
                boundaries=np.flatnonzero(column(rows, "boundary")).astype(np.int32),
                segments=segments_of(of_joint, actions if joint < 0 else actions[:, joint], has_rewards=has_rewards),
            )
        )
    return Extraction(
        status=episode["status"],
        reason=episode["reason"],
        state=series(by_joint[0], "state"),
        joints=tuple(joints),
    )


def series(steps: pyarrow.Table, of: str) -> Series:
    """The columns of `of`, action or state."""
    return Series(
        measure=column(steps, f"{of}_measure"), change=column(steps, f"{of}_change"), mask=column(steps, f"{of}_mask")
    )


def segments_of(segments: pyarrow.Table, actions: Floats, *, has_rewards: bool) -> Segments:
    """The composite actions of a joint."""
    start_step, end_step = column(segments, "start_step"), column(segments, "end_step")
    return Segments(
        start_step=start_step,
        end_step=end_step,
        state_change_sum=column(segments, "state_change_sum"),
        state_change_peak=column(segments, "state_change_peak"),
        state_change_rank=column(segments, "state_change_rank"),
        reward_sum=column(segments, "reward_sum") if has_rewards else None,
        actions=[actions[start:end] for start, end in zip(start_step, end_step, strict=True)],
    )


def column(table: pyarrow.Table, name: str) -> npt.NDArray[Any]:
    """A column as an array; null is NaN."""
    return cast(npt.NDArray[Any], table[name].to_numpy())
