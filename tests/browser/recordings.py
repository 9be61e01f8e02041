"""Recordings with names and numbers of episodes that the fixtures have not."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from mcap.writer import Writer

START_TIME_NANOS = 1_700_000_000_000_000_000
STEP_NANOS = 50_000_000


def write_recording(
    path: Path, episodes: Sequence[int | str], n_steps: int, metadata: dict[str, str], n_joints: int = 1
) -> Path:
    """Writes episodes of which every 20th step changes action and state, each episode in its own rhythm."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("Step", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/step", "json", schema)
        time = START_TIME_NANOS
        for place, episode in enumerate(episodes):
            for step in range(n_steps):
                phase = (step + place % 7) // 20
                action = [(step * (joint + 3) + phase * 5) % (4 + phase % 3) for joint in range(n_joints)]
                message = {"episode": episode, "step": step, "action": action, "state": [phase % 4 * 1.5, step % 5 * 0.1], "reward": 1.0}
                writer.add_message(channel, time, json.dumps(message).encode(), time)
                time += STEP_NANOS
        writer.add_metadata("recording", metadata)
        writer.finish()
    return path
