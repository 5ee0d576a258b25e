"""Pose and covariance over time: odometry predicts, scans correct (an iterated extended Kalman filter)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom_scans.field import DistanceField
from navloom_scans.matching import fit_pose, misfit_of
from navloom_scans.poses import compose, pose_of, relative
from navloom_scans.sight import look_along
from navloom_scans.small import inverse, propagated
from numpy.typing import NDArray

__all__ = ["PoseTracker", "Settings", "predicted_covariance"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of the tracker and the judge: lengths in m, angles in rad; the README explains each.

    Attributes:
        start_sigma, start_turn_sigma: Uncertainty at the start, m and rad.
        way_noise, turn_per_way: Spread of odometry after 1 m, m/sqrt(m) and rad/sqrt(m).
        turn_noise: Spread of the heading after a turn of 1 rad, rad/sqrt(rad).
        rest_noise, rest_turn_noise: Spread after 1 s at rest, m/sqrt(s) and rad/sqrt(s).
        sigma: Standard deviation of an end point's distance to its wall, m.
        redundancy: Number of beams that count as one independent measurement: their errors are correlated.
        robust_scale: Misfit above which a beam has little weight, m.
        reach: Largest robust scale, and longest search for the front of a wall, m.
        least_inliers, least_share: Least number of inliers of a usable scan, in beams and as a share of its echoes.
        iterations: Largest number of steps of a fit.
        max_shift, max_turn: Largest correction by one scan, m and rad.
        least_seen: Share of the beams that must see what the map has at the start.
        trusted_share: Share of the beams to a mapped wall that must end at it, not behind it, for a trusted pose.
        sure_share: Share of the echoes from which no other pose is searched.
        search_reach, search_turn: Range of the search around the pose, m and rad.
        search_every: Time between two searches, s.
        patience: How long scans must fit, or not fit, before the state changes, s.
        lost_after: Duration of searching after which the robot is lost, s.
        lost_sigma: Standard deviation of the position above which it is not trusted, m.
    """

    start_sigma: float = 0.05
    start_turn_sigma: float = math.radians(2.0)
    way_noise: float = 0.02
    turn_per_way: float = math.radians(1.5)
    turn_noise: float = math.radians(1.5)
    rest_noise: float = 0.002
    rest_turn_noise: float = math.radians(0.1)
    sigma: float = 0.02
    redundancy: float = 10.0
    robust_scale: float = 0.08
    reach: float = 0.5
    least_inliers: int = 20
    least_share: float = 0.3
    iterations: int = 8
    max_shift: float = 0.03
    max_turn: float = math.radians(2.0)
    least_seen: float = 0.05
    trusted_share: float = 0.6
    sure_share: float = 0.9
    search_reach: float = 0.7
    search_turn: float = math.radians(20.0)
    search_every: float = 1.0
    patience: float = 0.5
    lost_after: float = 3.0
    lost_sigma: float = 1.0


def predicted_covariance(covariance: Floats, heading: float, step: Floats, time: float, s: Settings) -> Floats:
    """Covariance after a step of odometry: F P F' + Q.

    Args:
        covariance: (3, 3) before, of x, y, heading in the map frame; m², m rad, rad².
        heading: Before the step, rad, map frame.
        step: (3,) x, y, m, base frame before the step; turn, rad.
        time: Duration of the step, s.
        s: Noise of odometry. Its spread grows with the square root of the distance; across, it is a quarter of the
            spread along.
    """
    c, sn = math.cos(heading), math.sin(heading)
    x, y, turned = step.tolist()
    way, rest = math.hypot(x, y), s.rest_noise**2 * time
    along, across = s.way_noise**2 * way + rest, (0.25 * s.way_noise) ** 2 * way + rest
    turn = s.turn_per_way**2 * way + s.turn_noise**2 * abs(turned) + s.rest_turn_noise**2 * time
    return propagated(covariance, (c, sn), (x, y), (along, across, turn))


class PoseTracker:
    """Tracks the pose of the robot and its covariance.

    Attributes:
        pose: (3,) x, y, m, heading, rad in [-π, π), map frame.
        covariance: (3, 3) of the pose; m², m rad, rad².
        odometry: (3,) x, y, m, heading, rad, odometry frame, at the last prediction.
        inliers: Beams of the last scan that fit the map; 0 if it was not used.
        share: Share of the last scan's echoes that fit the map; None if it had too few echoes.
        is_proven: Whether a drive has proven the pose: then scans that are mostly occluded are used too.
    """

    def __init__(self, settings: Settings, field: DistanceField, start: Floats) -> None:
        """Begin at the start, (3,) x, y, m, heading, rad, map frame, where odometry is (0, 0, 0)."""
        self.settings, self.field = settings, field
        self.odometry = np.zeros(3)
        self.place(start)

    def place(self, pose: Floats) -> None:
        """Move to a pose, (3,) x, y, m, heading, rad, map frame, with the uncertainty of a start."""
        place, turn = self.settings.start_sigma**2, self.settings.start_turn_sigma**2
        self.pose = pose.copy()
        self.covariance: Floats = np.diag([place, place, turn])
        self.inliers = 0
        self.share: float | None = None
        self.is_proven = False

    def predict(self, odometry: Floats, time: float) -> None:
        """Move the pose by the motion of odometry since the last call.

        Args:
            odometry: (3,) x, y, m, heading, rad, odometry frame.
            time: Time since the last call, s.
        """
        step, self.odometry = relative(self.odometry, odometry), odometry.copy()
        self.advance(step, time)

    def advance(self, step: Floats, time: float) -> None:
        """Move the pose by a step, (3,) x, y, m, turn, rad, in its own frame, that took a time, s."""
        self.covariance = predicted_covariance(
            self.covariance, float(self.pose[2]), step, max(time, 0.0), self.settings
        )
        self.pose = compose(self.pose, step)
        self.inliers, self.share = 0, None

    def correct(self, beams: Floats) -> bool:
        """Correct the pose by current beams, (n, 4) end point, m, and direction, base frame; whether they were used."""
        if len(beams) < self.settings.least_inliers:
            return False
        pose, fused, inliers = self.fit(beams, self.pose, self.covariance)
        self.share = inliers / len(beams)
        if not self._is_usable(beams, pose, inliers):
            return False
        self.inliers = inliers
        self._move(pose - self.pose, inverse(fused))
        return True

    def _is_usable(self, beams: Floats, pose: Floats, inliers: int) -> bool:
        """Whether enough beams fit a pose, (3,): of all or, if most are occluded, of those to a mapped wall."""
        s, count = self.settings, len(beams)
        if not self.is_proven or inliers < s.least_inliers or inliers >= s.least_share * count:
            return inliers >= max(s.least_inliers, s.least_share * count)
        seen = look_along(self.field, beams, count, pose, 2.0 * s.robust_scale)
        return seen.fit >= s.least_seen * count and seen.fit >= s.trusted_share * (seen.fit + seen.through)

    def fit(self, beams: Floats, start: Floats, covariance: Floats) -> tuple[Floats, Floats, int]:
        """The pose near another one at which the beams fit best.

        Args:
            beams: (n, 4) end point, m, and direction, base frame.
            start: (3,) x, y, m, heading, rad, map frame: prior, and start of the search.
            covariance: (3, 3) covariance of the prior.

        Returns:
            (3,) pose, heading not wrapped; (3, 3) its inverse covariance; number of inliers, 0 if the fit failed.
        """
        s, field = self.settings, self.field
        spread = math.sqrt(max(covariance[0, 0], covariance[1, 1]))
        first = min(max(s.robust_scale, 2.0 * spread), max(s.reach, s.robust_scale))
        options = np.array([s.sigma**2 * s.redundancy, first, s.robust_scale, 2.0 * s.robust_scale, s.reach])
        information = inverse(covariance)
        pose, fused = np.empty(3), np.empty((3, 3))
        inliers = fit_pose(field.values, field.frame, beams, start, information, options, s.iterations, pose, fused)
        return pose, fused, inliers if math.isfinite(sum(pose.tolist())) else 0

    def cost_of(self, beams: Floats) -> float:
        """Negative log likelihood of beams, (n, 4), at the pose that fits them best."""
        s, field = self.settings, self.field
        pose, _, inliers = self.fit(beams, self.pose, self.covariance)
        place = pose if inliers else self.pose
        misfit: float = misfit_of(field.values, field.frame, beams, place, s.robust_scale, s.reach)
        return 0.5 * misfit / (s.sigma**2 * s.redundancy)

    def relocate(self, pose: Floats, covariance: Floats) -> None:
        """Continue from another pose: (3,) x, y, m, heading, rad, map frame, and its (3, 3) covariance."""
        self.is_proven = False
        self.pose = pose_of(*pose.tolist())
        self.covariance = 0.5 * (covariance + covariance.T)

    def _move(self, shift: Floats, covariance: Floats) -> None:
        """Apply a correction, (3,) m, m, rad, or the share that the limits allow; later scans correct the rest."""
        s = self.settings
        x, y, turn = shift.tolist()
        share = min(1.0, s.max_shift / max(math.hypot(x, y), 1e-12), s.max_turn / max(abs(turn), 1e-12))
        moved = self.pose + share * shift
        self.pose = pose_of(*moved.tolist())
        mixed = (1.0 - share) * self.covariance + share * covariance
        self.covariance = 0.5 * (mixed + mixed.T)
