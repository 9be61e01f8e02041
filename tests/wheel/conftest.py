"""What the tests of the installed package share. They see it as a user does: nothing here is on the path but it."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def fixtures() -> Path:
    """The folder of recordings."""
    return ROOT / "fixtures" / "recordings"


def recorded_episodes(recording: Path) -> dict[int, dict[str, list[Any]]]:
    """Actions, states and rewards of each episode of a recording, read by the reference reader."""
    from mcap.reader import make_reader  # not there in the first of the two environments

    episodes: dict[int, dict[str, list[Any]]] = defaultdict(lambda: {"actions": [], "states": [], "rewards": []})
    with recording.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics="/step"):
            step = json.loads(message.data)
            episode = episodes[step["episode"]]
            episode["actions"].append(step["action"])
            episode["states"].append(step["state"])
            episode["rewards"].append(step["reward"])
    return dict(episodes)


def golden(name: str) -> dict[str, Any]:
    """Exact results of an independent program, `tests/golden`."""
    return json.loads((ROOT / "tests" / "golden" / f"{name}.json").read_text(encoding="utf-8"))
