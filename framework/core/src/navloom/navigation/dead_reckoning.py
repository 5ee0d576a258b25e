"""The default localizer: the odometry, beginning at the start pose."""

from __future__ import annotations

import math

import numpy as np

from navloom.messages import Pose2D, PoseEstimate
from navloom.plugins.hooks import hookimpl
from navloom.plugins.registry import Registry
from navloom.roles import Claim, Context, Localizer, LocalizerInput, Params

__all__ = ["OdometryLocalizer"]

UNKNOWN = np.zeros((3, 3))
# Shared by all estimates, which are immutable messages.
UNKNOWN.flags.writeable = False


class OdometryLocalizer(Localizer[Params]):
    """Places the odometry frame at the start pose. Drift is not corrected, and the covariance is zero."""

    name = "odometry"
    claims = {Claim.TRANSLATION, Claim.ROTATION}
    accepts = ()

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self._seen = Pose2D(0.0, 0.0, 0.0)
        self.place(context.start)

    def place(self, pose: Pose2D) -> None:
        """Move the odometry frame so that its newest pose becomes this pose in the map."""
        seen, turn = self._seen, math.remainder(pose.heading - self._seen.heading, math.tau)
        cos, sin = math.cos(turn), math.sin(turn)
        x, y = pose.x - cos * seen.x + sin * seen.y, pose.y - sin * seen.x - cos * seen.y
        self._origin = (x, y, turn, cos, sin)

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        x0, y0, turn, cos, sin = self._origin
        seen = self._seen = given.odometry.pose
        heading = math.remainder(turn + seen.heading, math.tau)
        pose = Pose2D(x0 + cos * seen.x - sin * seen.y, y0 + sin * seen.x + cos * seen.y, heading)
        return PoseEstimate(given.odometry.stamp_ns, pose, given.odometry.twist, UNKNOWN)


# In the core, although only an entry point refers to it: it is the localizer that a robot has without any further
# distribution.
@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the localizer."""
    registry.add(OdometryLocalizer)
