"""A localizer's poses on an imported log, beside the recorded odometry: differences, states, and the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from navloom.geometry.angles import wrap
from navloom.messages import PoseEstimate
from numpy.typing import NDArray

__all__ = ["LocalizerTrack"]

Floats = NDArray[np.float64]
NAMES = (
    "time_s,odometry_x,odometry_y,odometry_heading,localizer_x,localizer_y,localizer_heading,"
    "xx,xy,x_heading,yy,y_heading,heading_heading,state"
)
"""Columns: s after the first pose; m and rad in the map frame; covariance, m², m rad, rad²; state."""


@dataclass(frozen=True, eq=False)
class LocalizerTrack:
    """Poses of a localizer.

    Attributes:
        poses: (n, 7) time, s after the first, then x, y, m, heading, rad, by recorded odometry and by the localizer,
            both in the map frame.
        estimates: The localizer's estimate of each of these poses.
    """

    poses: Floats
    estimates: Sequence[PoseEstimate]

    @property
    def is_tracking(self) -> NDArray[np.bool_]:
        """(n,) Whether the localizer was tracking."""
        return np.array([estimate.state == "tracking" for estimate in self.estimates], dtype=np.bool_)

    def summary(self) -> dict[str, Any]:
        """Number of poses, their differences from odometry, m and rad, and times without tracking, s."""
        poses = self.poses
        away = np.hypot(*(poses[:, 4:6] - poses[:, 1:3]).T)
        turned = np.abs(wrap(poses[:, 6] - poses[:, 3]))
        spans = np.diff(poses[:, 0], append=poses[-1:, 0])
        states = np.array([estimate.state for estimate in self.estimates])
        last = int(np.flatnonzero(self.is_tracking)[-1]) if self.is_tracking.any() else -1
        found: dict[str, Any] = {"poses": len(poses)}
        for name, values in (("position", away), ("heading", turned)):
            found[name] = {
                "rms": float(np.sqrt((values**2).mean())) if values.size else None,
                "max": float(values.max()) if values.size else None,
                "end": float(values[-1]) if values.size else None,
            }
        for state in ("searching", "lost"):
            found[f"{state}_s"] = float(spans[states == state].sum()) if states.size else 0.0
        found["not_tracking_from_s"] = float(poses[last + 1, 0]) if last + 1 < len(poses) else None
        return found

    def table(self) -> str:
        """The poses as CSV."""
        lines = [NAMES]
        for row, estimate in zip(self.poses.tolist(), self.estimates, strict=True):
            upper = estimate.covariance[np.triu_indices(3)].tolist()
            pose = ",".join(f"{value:.6f}" for value in row)
            lines.append(f"{pose},{','.join(f'{value:.3e}' for value in upper)},{estimate.state}")
        return "\n".join(lines) + "\n"
