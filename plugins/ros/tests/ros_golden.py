"""Bytes and hashes made by ROS 2 itself: those of Kilted by its own serializer and generators."""

import json
from pathlib import Path

from navloom_ros.message_types import Types

DATA = Path(__file__).parent / "data"
KILTED = Types("kilted")
WHEELS = json.loads((DATA / "kilted_wheels.json").read_text("utf-8"))
"""`hashes` by type, and `messages` with `type`, `value` and `cdr`; written by `peers/make_golden.py`."""
HASHES = json.loads((DATA / "golden_type_hashes.json").read_text("utf-8"))
"""Hashes of 148 messages and services."""
CDR = {name: bytes.fromhex(text) for name, text in json.loads((DATA / "golden_cdr.json").read_text("utf-8")).items()}
"""Bytes of 12 messages."""
OF_NAV2 = {
    "nav2_msgs/action/NavigateToPose_SendGoal": {
        "jazzy": "RIHS01_a4fcb3bee1bf32e21a0e541a943b221aa0826996e2c98f079b47022b256f48b5",
        "kilted": "RIHS01_a4fcb3bee1bf32e21a0e541a943b221aa0826996e2c98f079b47022b256f48b5",
        "lyrical": "RIHS01_a4fcb3bee1bf32e21a0e541a943b221aa0826996e2c98f079b47022b256f48b5",
    },
    "nav2_msgs/action/NavigateToPose_GetResult": {
        "jazzy": "RIHS01_c407920357d566771e8882b4ef4d1f1a84ee922d609920ccd57faa6d6e391dc5",
        "kilted": "RIHS01_c407920357d566771e8882b4ef4d1f1a84ee922d609920ccd57faa6d6e391dc5",
        "lyrical": "RIHS01_c407920357d566771e8882b4ef4d1f1a84ee922d609920ccd57faa6d6e391dc5",
    },
    "nav2_msgs/action/NavigateToPose_FeedbackMessage": {
        "jazzy": "RIHS01_9d1f6fa2eb975ce733b419ac2e97b134d8ff92b6478b6559feed9a50bdfd82b3",
        "kilted": "RIHS01_9d1f6fa2eb975ce733b419ac2e97b134d8ff92b6478b6559feed9a50bdfd82b3",
        "lyrical": "RIHS01_2c1b4ec1a0e3a53c9aa326aabe717670eeef0ff3d4c3351ff940613b2011728a",
    },
    "tf2_msgs/msg/TFMessage": {
        "jazzy": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
        "kilted": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
        "lyrical": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    },
}
"""Hashes of types that are not in the wheels, from their packages in each distribution."""
DIFFERENT = {
    "jazzy": {"nav_msgs/msg/Goals"},
    "lyrical": {"lifecycle_msgs/msg/TransitionEvent", "geometry_msgs/msg/Pose2D"},
}
"""Types of the golden hashes that a distribution lacks or has with other fields."""


def masked(name: str, data: bytes) -> bytes:
    """The bytes with zero padding, because Fast CDR leaves it uninitialised. A change of padding changes no value."""
    meant = KILTED.encode(KILTED.decode(name, data))
    kept = bytearray(data)
    for place in range(4, len(data)):
        if all(_means(name, data, place, other) == meant for other in (0, 1, 0xFF)):
            kept[place] = 0
    return bytes(kept)


def _means(name: str, data: bytes, place: int, value: int) -> bytes:
    """The message re-encoded after a change of one byte; empty if it cannot be decoded."""
    try:
        return KILTED.encode(KILTED.decode(name, data[:place] + bytes([value]) + data[place + 1 :]))
    except ValueError:
        return b""
