"""`extract_arrays` against golden results, and against the same episodes in files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import coact
from conftest import golden, recorded_episodes

# As for the golden results in Rust: agreement of E_w (relative, or absolute near zero), and of E_n.
MEASURE = {"rtol": 1e-10, "atol": 1e-13}
CHANGE = {"rtol": 0.0, "atol": 1e-9}


def check_mask(found: npt.NDArray[np.bool_], expected: str | None) -> None:
    """A mask is a string of 0 and 1; `?` is either."""
    if expected is not None:
        assert len(found) == len(expected)
        assert "".join("?" if e == "?" else str(int(f)) for f, e in zip(found, expected, strict=True)) == expected


def check_series(found: npt.NDArray[np.float64], expected: list[float] | None, tolerance: dict[str, float]) -> None:
    if expected is not None:
        np.testing.assert_allclose(found, expected, **tolerance)


@pytest.mark.parametrize("name", ["cartpole", "fetch_pickandplace"])
def test_equals_the_golden_results(fixtures: Path, name: str) -> None:
    episodes = recorded_episodes(fixtures / f"{name}.mcap")
    n_compared = 0
    for expected in golden(name)["episodes"]:
        episode = episodes[expected["episode"]]
        for case in expected["cases"]:
            keys = ["measure", "profile", "bins", "window", "threshold", "order", "tolerance", "joints"]
            options: Any = {key: case[key] for key in keys}
            found = coact.extract_arrays(episode["actions"], episode["states"], **options)
            check_mask(found.state.mask, case["state_mask"])
            check_series(found.state.measure, case.get("state_measure"), MEASURE)
            check_series(found.state.change, case.get("state_change"), CHANGE)
            assert len(found.joints) == len(case["action_mask"])
            for k, joint in enumerate(found.joints):
                check_mask(joint.action.mask, case["action_mask"][k])
                check_mask(joint.correlated, case["correlated"][k])
                if case["boundaries"][k] is not None:
                    assert joint.boundaries.tolist() == case["boundaries"][k]
                if case["segments"][k] is not None:
                    spans = np.column_stack([joint.segments.start_step, joint.segments.end_step])
                    assert spans.tolist() == [segment[:2] for segment in case["segments"][k]]
                    n_compared += len(spans)
    assert n_compared > 100


@pytest.mark.parametrize("joints", ["each", "together"])
@pytest.mark.parametrize("name", ["cartpole", "halfcheetah", "fetch_pickandplace", "pong_gray", "tennis_ram"])
def test_equals_the_same_episode_in_a_file(fixtures: Path, tmp_path: Path, name: str, joints: Any) -> None:
    """Every value, to the last bit."""
    done = coact.extract(fixtures / f"{name}.mcap", tmp_path / "out", joints=joints)
    assert done.output
    steps, segments = coact.read_steps(done.output, "polars"), coact.read_segments(done.output, "polars")
    for number, episode in recorded_episodes(fixtures / f"{name}.mcap").items():
        found = coact.extract_arrays(episode["actions"], episode["states"], episode["rewards"], joints=joints)
        assert found.status == "ok"
        for joint in found.joints:
            rows = steps.filter(episode=number, joint=joint.joint)
            for series, of in [(joint.action, "action"), (found.state, "state")]:
                np.testing.assert_array_equal(series.measure, rows[f"{of}_measure"].to_numpy())
                np.testing.assert_array_equal(series.change, rows[f"{of}_change"].to_numpy())
                np.testing.assert_array_equal(series.mask, rows[f"{of}_mask"].to_numpy())
            np.testing.assert_array_equal(joint.correlated, rows["correlated"].to_numpy())
            np.testing.assert_array_equal(joint.boundaries, np.flatnonzero(rows["boundary"].to_numpy()))
            pieces = segments.filter(episode=number, joint=joint.joint)
            assert len(joint.segments) == len(pieces)
            for column in [
                "start_step",
                "end_step",
                "state_change_sum",
                "state_change_peak",
                "state_change_rank",
                "reward_sum",
            ]:
                np.testing.assert_array_equal(getattr(joint.segments, column), pieces[column].to_numpy())
            assert [actions.ravel().tolist() for actions in joint.segments.actions] == pieces["actions"].to_list()


def test_values_arrive_to_the_last_bit() -> None:
    """Bins of one value apart tell whether any was rounded on its way."""
    rng = np.random.default_rng(7)
    actions = rng.standard_normal((64, 2)) * 10.0 ** rng.integers(-300, 300, (64, 2))
    found = coact.extract_arrays(actions, rng.standard_normal(64), threshold=0.0, joints="each")
    for joint in found.joints:
        for start, end, values in zip(
            joint.segments.start_step, joint.segments.end_step, joint.segments.actions, strict=True
        ):
            np.testing.assert_array_equal(values, actions[start:end, joint.joint])
    assert sum(len(joint.segments) for joint in found.joints) > 0


def test_shapes_and_types_are_taken_as_they_come() -> None:
    rng = np.random.default_rng(1)
    actions, images = rng.integers(0, 4, 200, dtype=np.int8), rng.integers(0, 256, (200, 3, 5), dtype=np.uint8)
    expected = coact.extract_arrays(actions.astype(float)[:, None], images.reshape(200, 15).astype(float))
    for found in [
        coact.extract_arrays(actions, images),
        coact.extract_arrays(actions.tolist(), images.tolist()),
        coact.extract_arrays(np.repeat(actions, 2)[::2], np.asfortranarray(images)),
    ]:
        np.testing.assert_array_equal(found.state.measure, expected.state.measure)
        np.testing.assert_array_equal(found.joints[0].action.measure, expected.joints[0].action.measure)
        assert len(found.joints[0].segments) == len(expected.joints[0].segments) > 0
        assert found.joints[0].segments.reward_sum is None


def test_an_episode_too_short_says_so() -> None:
    found = coact.extract_arrays([0, 1], [1.0, 2.0])
    assert found.status == "too_short"
    assert found.reason
    assert np.isnan(found.state.measure).all()
    assert not found.joints[0].action.mask.any()
    assert len(found.joints[0].segments) == 0


@pytest.mark.parametrize(
    ("actions", "states", "rewards", "error", "message"),
    [
        ([0, 1], [1, 2, 3], None, ValueError, r"actions have 2 steps, states 3; leave out the last state"),
        ([0, 1, 2], [1, 2], None, ValueError, r"actions have 3 steps, states 2$"),
        ([0, 1], [1, 2], [1.0], ValueError, r"rewards: expected one for each of the 2 steps, found \(1, 1\)"),
        ([0, 1], [1, 2], [[1, 2], [3, 4]], ValueError, r"found \(2, 2\)"),
        ([], [], None, ValueError, r"actions: expected .*, found \(0,\)"),
        (1.0, [1], None, ValueError, r"actions: expected .*, found \(\)"),
        ([0, 1], np.empty((2, 0)), None, ValueError, r"states: expected .*, found \(2, 0\)"),
        ([0, 1], [[1.0, 2.0], [3.0, np.nan]], None, ValueError, r"states: nan at step 1, column 1; 1 are not finite"),
        ([0, np.inf], [1, 2], None, ValueError, r"actions: inf at step 1, column 0"),
        ([0, [1, 2]], [1, 2], None, ValueError, r"actions: rows of different lengths"),
        (["a", "b"], [1, 2], None, TypeError, r"actions: expected real numbers, found an array of <U1"),
        ([1j, 2j], [1, 2], None, TypeError, r"actions: expected real numbers"),
        ([None, 1], [1, 2], None, TypeError, r"actions: expected real numbers"),
        (
            [0],
            np.zeros((1, 1 << 20)),
            None,
            ValueError,
            r"1048577 values a step in actions and states: at most 1048568",
        ),
    ],
)
def test_arrays_that_do_not_fit_are_told(
    actions: Any, states: Any, rewards: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        coact.extract_arrays(actions, states, rewards)


def test_the_widest_state_is_taken() -> None:
    rng = np.random.default_rng(2)
    states = rng.integers(0, 2, (16, (1 << 20) - 9), dtype=np.uint8)
    found = coact.extract_arrays(rng.integers(0, 2, 16), states, rng.random(16))
    assert found.status == "ok"


def test_options_that_do_not_fit_are_told() -> None:
    with pytest.raises(coact.Error, match="bins is 1: expected 2") as error:
        coact.extract_arrays([0, 1], [1, 2], bins=1)
    assert error.value.exit_code == 2
    with pytest.raises(TypeError, match="not dry_run"):
        coact.extract_arrays([0, 1], [1, 2], dry_run=True)  # type: ignore[call-arg]
