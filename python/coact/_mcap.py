"""An episode in memory as a recording: one MCAP file with the topic `/step`.

Written here and not with a library, because all steps of an episode are equally long: NumPy lays the records of all of
them out at once, without a loop in Python. Values are doubles as they are (CDR), so nothing is rounded.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, DATA_END = 1, 2, 3, 4, 5, 15
# Little-endian CDR. All members have eight bytes, so none is padded.
CDR_LITTLE_ENDIAN = (0, 1, 0, 0)

Floats = npt.NDArray[np.float64]


def write_episode(path: Path, actions: Floats, states: Floats, rewards: Floats | None) -> None:
    """Writes an episode; rows are steps."""
    fields = ["int64 step", f"float64[{actions.shape[1]}] action", f"float64[{states.shape[1]}] state"]
    if rewards is not None:
        fields.append("float64 reward")
    schema = struct.pack("<H", 1) + text("coact/msg/Step") + text("ros2msg") + text("\n".join(fields))
    channel = struct.pack("<HH", 1, 1) + text("/step") + text("cdr") + struct.pack("<I", 0)
    with path.open("wb") as file:
        file.write(MAGIC)
        file.write(record(HEADER, text("ros2") + text("coact")))
        file.write(record(SCHEMA, schema))
        file.write(record(CHANNEL, channel))
        file.write(message_records(actions, states, rewards).view(np.uint8).data)
        file.write(record(DATA_END, struct.pack("<I", 0)))
        file.write(record(FOOTER, struct.pack("<QQI", 0, 0, 0)))
        file.write(MAGIC)


def message_records(actions: Floats, states: Floats, rewards: Floats | None) -> npt.NDArray[np.void]:
    """The records of all steps."""
    values = [
        ("step", "<i8"),
        ("action", "<f8", (actions.shape[1],)),
        ("state", "<f8", (states.shape[1],)),
        *([("reward", "<f8")] if rewards is not None else []),
    ]
    content = [
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
        ("cdr_header", "u1", (4,)),
        *values,
    ]
    layout = np.dtype([("opcode", "u1"), ("length", "<u8"), *content])
    records = np.empty(len(actions), dtype=layout)
    steps = np.arange(len(actions))
    records["opcode"] = MESSAGE
    records["length"] = np.dtype(content).itemsize
    records["channel"] = 1
    records["sequence"] = steps & 0xFFFF_FFFF
    # Arrays have no clock: a nanosecond a step keeps them in order.
    records["log_time"] = records["publish_time"] = steps
    records["cdr_header"] = CDR_LITTLE_ENDIAN
    records["step"] = steps
    records["action"] = actions
    records["state"] = states
    if rewards is not None:
        records["reward"] = rewards[:, 0]
    return records


def record(opcode: int, content: bytes) -> bytes:
    """A record: opcode, length, content."""
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: str) -> bytes:
    """A string of MCAP: length, UTF-8."""
    data = value.encode()
    return struct.pack("<I", len(data)) + data
