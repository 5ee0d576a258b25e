"""The latest transforms of a live robot's /tf and /tf_static: where its base and its sensors are now.

`navloom_ros.frames` does the same for a bag, where the first transform of a moving frame counts.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_ros.frames import is_unit, quaternion_matrix

__all__ = ["Frames", "heading_of", "planar", "rotation"]

Floats = NDArray[np.float64]

MOST_FRAMES = 1000
"""Most frames that are stored; further ones are ignored."""


class Frames:
    """The newest transform of each frame to its parent. Leading slashes of names are ignored."""

    def __init__(self) -> None:
        self._in_parent: dict[str, tuple[str, Floats]] = {}

    def add(self, message: Any) -> None:
        """Store the transforms of a TFMessage; invalid ones are ignored."""
        for transform in message.transforms:
            child, moved = transform.child_frame_id.lstrip("/"), transform.transform.translation
            turned = rotation(transform.transform.rotation)
            # Anyone on the network can publish transforms: names must not fill the memory.
            known = child in self._in_parent or len(self._in_parent) < MOST_FRAMES
            if turned is None or not known or not np.isfinite([moved.x, moved.y, moved.z]).all():
                continue
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = turned, (moved.x, moved.y, moved.z)
            self._in_parent[child] = transform.header.frame_id.lstrip("/"), matrix

    def find(self, target: str, frame: str) -> Floats | None:
        """The (4, 4) transform from `frame` to `target`; None if the tree does not connect them."""
        from_frame, from_target = self._chain(frame.lstrip("/")), self._chain(target.lstrip("/"))
        for name, to_common in from_frame.items():
            if name in from_target:
                found: Floats = np.linalg.inv(from_target[name]) @ to_common
                return found
        return None

    def _chain(self, frame: str) -> dict[str, Floats]:
        """A frame and its ancestors, nearest first, each with the (4, 4) transform from the frame to it."""
        matrix = np.eye(4)
        chain = {frame: matrix}
        while (above := self._in_parent.get(frame)) is not None and above[0] not in chain:  # stops at a cycle
            frame, matrix = above[0], above[1] @ matrix
            chain[frame] = matrix
        return chain


def rotation(quaternion: Any) -> Floats | None:
    """The (3, 3) rotation matrix of a quaternion message; None if its length is not 1."""
    if not is_unit(quaternion):
        return None
    return quaternion_matrix(quaternion.x, quaternion.y, quaternion.z, quaternion.w)


def heading_of(matrix: Floats) -> float:
    """Heading of a transform's x axis in the plane, rad."""
    return math.atan2(matrix[1, 0], matrix[0, 0])


def planar(x: float, y: float, heading: float) -> Floats:
    """The (4, 4) transform of a pose in the plane, m and rad."""
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
