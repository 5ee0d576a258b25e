"""Sensor mounts from the transforms of a bag, for `bag_import`; and the rotation and heading of a quaternion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BASES", "FrameTree", "Mount", "heading_of", "is_unit", "quaternion_matrix", "wrap"]

Floats = NDArray[np.float64]
BASES = ("base_link", "base_footprint")
"""Usual names of the robot's frame, the preferred one first (REP 105)."""
FLOOR = "base_footprint"
"""Frame whose origin is on the floor."""
UNIT = 0.05
"""Largest deviation of a unit quaternion's length from 1."""


@dataclass(frozen=True, eq=False)
class Mount:
    """Pose of a sensor's frame in base: rotation (3, 3), translation (3,), m; z is from the floor if that is known."""

    rotation: Floats
    translation: Floats

    @property
    def tilt(self) -> float:
        """Angle between the sensor's plane and the floor, rad; 0 for a sensor mounted upside down."""
        return float(np.arccos(np.clip(abs(self.rotation[2, 2]), 0.0, 1.0)))


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


class FrameTree:
    """The static transforms of a bag, and the first transform of each moving frame."""

    def __init__(self) -> None:
        self._up: dict[str, tuple[str, Floats, bool]] = {}

    def add(self, message: Any, is_static: bool) -> None:
        """Store the transforms of a TFMessage. A static transform replaces a moving one of the same frame."""
        for transform in message.transforms:
            child, parent = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
            known = self._up.get(child)
            if known is not None and (known[2] or not is_static):
                continue
            at, turn = transform.transform.translation, transform.transform.rotation
            motion = np.eye(4)
            motion[:3, :3] = quaternion_matrix(turn.x, turn.y, turn.z, turn.w)
            motion[:3, 3] = at.x, at.y, at.z
            self._up[child] = (parent, motion, is_static)

    def knows(self, frame: str) -> bool:
        """Whether a frame appears in any transform."""
        return frame in self._up or any(parent == frame for parent, _, _ in self._up.values())

    def parent(self, frame: str) -> str:
        """The parent of a frame; empty if it has none."""
        return self._up[frame][0] if frame in self._up else ""

    def base(self, child_of_odometry: str) -> str:
        """The robot's frame: the first of BASES in the tree, else the child frame of the odometry, else base_link."""
        return next((name for name in BASES if self.knows(name)), child_of_odometry.lstrip("/") or BASES[0])

    def between(self, frame: str, base: str) -> Floats | None:
        """(4, 4) transform of points from `frame` to `base`; None if the tree does not connect them."""
        root_of_frame, from_frame = self._climb(frame.lstrip("/"))
        root_of_base, from_base = self._climb(base)
        shared = next((name for name in root_of_frame if name in root_of_base), None)
        if shared is None:
            return None
        return np.linalg.inv(from_base[root_of_base.index(shared)]) @ from_frame[root_of_frame.index(shared)]

    def mount(self, frame: str, base: str) -> Mount | None:
        """Pose of a sensor's frame in base; None if unknown. Its height is from the floor if the bag has that frame."""
        motion = self.between(frame, base)
        if motion is None:
            return None
        if self.knows(FLOOR) and base != FLOOR:
            floor = self.between(frame, FLOOR)
            if floor is not None:
                motion = motion.copy()
                motion[2, 3] = floor[2, 3]
        return Mount(motion[:3, :3], motion[:3, 3])

    def _climb(self, frame: str) -> tuple[list[str], list[Floats]]:
        """A frame and its ancestors, nearest first, and the (4, 4) transform from the frame to each."""
        names, motions = [frame], [np.eye(4)]
        while names[-1] in self._up and len(names) < 64:
            parent, motion, _ = self._up[names[-1]]
            names.append(parent)
            motions.append(motion @ motions[-1])
        return names, motions
