"""Sensor mounts from the transforms of a bag, for `bag_import`; and the rotation and heading of a quaternion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BASES",
    "SAME_HEADING",
    "SAME_PLACE",
    "FrameTree",
    "Mount",
    "heading_of",
    "is_unit",
    "quaternion_matrix",
    "wrap",
]

Floats = NDArray[np.float64]
BASES = ("base_link", "base_footprint")
"""Usual names of the robot's frame, the preferred one first (REP 105)."""
FLOOR = "base_footprint"
"""Frame whose origin is on the floor."""
SAME_PLACE, SAME_HEADING = 0.01, 0.02
"""Largest distance, m, and turn, rad, between two poses that count as one: of frames, or of a fixed mount."""
UNIT = 0.05
"""Largest deviation of a unit quaternion's length from 1."""


@dataclass(frozen=True, eq=False)
class Mount:
    """Pose of a sensor's frame in base: rotation (3, 3), translation (3,), m; z is from the floor if that is known."""

    rotation: Floats
    translation: Floats

    @property
    def matrix(self) -> Floats:
        """(4, 4) transform from the sensor's frame to base."""
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = self.rotation, self.translation
        return found


def is_unit(quaternion: Any) -> bool:
    """Whether the length of a quaternion message is 1; false for NaN."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return abs(math.sqrt(x * x + y * y + z * z + w * w) - 1.0) < UNIT


def heading_of(quaternion: Any) -> float | None:
    """Heading of a quaternion message in the plane, rad; None if its length is not 1."""
    if not is_unit(quaternion):
        return None
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def quaternion_matrix(x: float, y: float, z: float, w: float) -> Floats:
    """Rotation matrix (3, 3) of a quaternion; identity for one of length 0, as in unset messages."""
    length = float(np.sqrt(x * x + y * y + z * z + w * w))
    if length < 1e-9:
        return np.eye(3)
    x, y, z, w = x / length, y / length, z / length, w / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def wrap(angles: Floats) -> Floats:
    """Angles, rad, wrapped to [-π, π)."""
    turned = angles - math.tau * np.round(angles / math.tau)
    return np.where((turned >= math.pi) | (turned < -math.pi), -math.pi, turned)


@dataclass(eq=False)
class _Link:
    """A frame in its parent: (4, 4) transform, the topic that gave it, and why it is in doubt; empty if it is not."""

    parent: str
    motion: Floats
    is_static: bool
    topic: str
    doubt: str = ""


class FrameTree:
    """The static transforms of a bag, and the first transform of each moving frame. Invalid ones are ignored."""

    def __init__(self) -> None:
        self._up: dict[str, _Link] = {}

    def add(self, message: Any, is_static: bool, topic: str = "") -> None:
        """Store the transforms of a TFMessage. A static transform replaces a moving one of the same frame."""
        for transform in message.transforms:
            child, parent = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
            at, turn = transform.transform.translation, transform.transform.rotation
            if not is_unit(turn) or not np.isfinite([at.x, at.y, at.z]).all():
                continue
            motion = np.eye(4)
            motion[:3, :3] = quaternion_matrix(turn.x, turn.y, turn.z, turn.w)
            motion[:3, 3] = at.x, at.y, at.z
            known = self._up.get(child)
            if known is None or (is_static and not known.is_static):
                self._up[child] = _Link(parent, motion, is_static, topic)
            elif known.is_static == is_static and not known.doubt:
                known.doubt = _doubt(child, known, _Link(parent, motion, is_static, topic))

    def doubt(self, frame: str, base: str) -> str:
        """Why the pose of `frame` in `base` is not one fixed pose; empty if it is, or is unknown."""
        above, over_base = self._climb(frame.lstrip("/"))[0], self._climb(base)[0]
        own = [name for name in above if name not in over_base] + [name for name in over_base if name not in above]
        return next((self._up[name].doubt for name in own if name in self._up and self._up[name].doubt), "")

    def names(self) -> set[str]:
        """All frames."""
        return set(self._up) | {link.parent for link in self._up.values()}

    def knows(self, frame: str) -> bool:
        """Whether a frame appears in any transform."""
        return frame in self._up or any(link.parent == frame for link in self._up.values())

    def parent(self, frame: str) -> str:
        """The parent of a frame; empty if it has none."""
        return self._up[frame].parent if frame in self._up else ""

    def base(self, child_of_odometry: str) -> str:
        """The robot's frame: the first of BASES in the tree, else the odometry's child, else a prefixed one."""
        known = [name for name in BASES if self.knows(name)]
        prefixed = [name for end in BASES for name in sorted(self.names()) if name.endswith(f"/{end}")]
        return next(filter(None, [*known, child_of_odometry.lstrip("/"), *prefixed]), BASES[0])

    def find(self, target: str, frame: str) -> Floats | None:
        """(4, 4) transform of points from `frame` to `target`; None if the tree does not connect them."""
        root_of_frame, from_frame = self._climb(frame.lstrip("/"))
        root_of_base, from_base = self._climb(target.lstrip("/"))
        shared = next((name for name in root_of_frame if name in root_of_base), None)
        if shared is None:
            return None
        return np.linalg.inv(from_base[root_of_base.index(shared)]) @ from_frame[root_of_frame.index(shared)]

    def mount(self, frame: str, base: str) -> Mount | None:
        """Pose of a sensor's frame in base; None if unknown. Its height is from the floor if the bag has that frame."""
        motion = self.find(base, frame)
        if motion is None:
            return None
        if self.knows(FLOOR) and base != FLOOR:
            floor = self.find(FLOOR, frame)
            if floor is not None:
                motion = motion.copy()
                motion[2, 3] = floor[2, 3]
        return Mount(motion[:3, :3], motion[:3, 3])

    def _climb(self, frame: str) -> tuple[list[str], list[Floats]]:
        """A frame and its ancestors, nearest first, and the (4, 4) transform from the frame to each."""
        names, motions = [frame], [np.eye(4)]
        while names[-1] in self._up and len(names) < 64:
            link = self._up[names[-1]]
            names.append(link.parent)
            motions.append(link.motion @ motions[-1])
        return names, motions


def _doubt(child: str, known: _Link, other: _Link) -> str:
    """Why a frame has no fixed pose in its parent; empty if two transforms of it agree."""
    moved = np.linalg.inv(known.motion) @ other.motion
    away = float(np.linalg.norm(moved[:3, 3]))
    turn = math.acos(max(-1.0, min(1.0, (float(np.trace(moved[:3, :3])) - 1.0) / 2.0)))
    if known.parent == other.parent and away <= SAME_PLACE and turn <= SAME_HEADING:
        return ""
    if known.topic != other.topic or known.parent != other.parent:
        where = f"in {known.parent} by {known.topic}, in {other.parent} by {other.topic}"
        return f"two poses of the frame {child}, {where}; take one robot's topics with --namespace NAME"
    kind = "has two poses" if known.is_static else "moves"
    return f"the frame {child} {kind} in {known.parent}, by {away:.2f} m and {math.degrees(turn):.0f}°"
