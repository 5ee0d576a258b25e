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
        max_shift, max_turn: Largest correction of the reported pose in a tick of a drive, m and rad.
        least_seen: Share of the beams that must see what the map has at the start.
        trusted_share: Share of the beams to a mapped wall that must end at it, not behind it, for a trusted pose.
        sure_share: Share of the echoes from which no other pose is searched.
        search_reach, search_turn: Range of the search around the pose, m and rad.
        search_every: Time between two searches, s.
        patience: How long scans must fit, or not fit, before the state changes, s.
        lost_after: Duration of searching after which the robot is lost, s.
        lost_sigma: Standard deviation of the position above which it is not trusted, m.
        is_doubted: Whether scans may contradict odometry: errors that its noise does not explain.
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
    max_shift: float = 0.02
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
    is_doubted: bool = True


_LOOSE = np.diag([0.15**2, 0.15**2, math.radians(8.0) ** 2])
"""Covariance of the error of a step of odometry that a scan contradicts, m² and rad²."""
_WORSE, _EVERY, _RECENT = 3.0, 5, 0.1
"""When a scan is fitted without odometry too: loss in its log likelihood against the mean of recent scans, or every so
many scans; share of the newest scan in that mean."""
_DECISIVE, _USUAL = 6.0, 0.5
"""Gain in the log likelihood, summed over scans, from which the fit without odometry is the right one (a cumulative
sum, Page 1954); gain of one scan that says nothing."""
_OUTLIER = 0.9
"""Mean of rho of a beam that is no inlier, in squares of the robust scale; at the gate it is 0.8."""
_SCALE, _SCALE_WAY, _FORGET = 0.02, 2.0, 10.0
"""Error of the odometer's scale that is assumed at first, no unit, as if found in this way, m; way of its memory, m."""
_LEAST_SHARE, _PER_NOISE = 0.4, 0.18
"""Least share of the covariance that is reported, and that share for the variance of beams in squares of `sigma`."""
_HELD = 0.03
"""Standard deviation along the robot's heading below which scans show how far it has driven, m."""


def predicted_covariance(
    covariance: Floats, heading: float, step: Floats, time: float, s: Settings, scale: float = 0.0
) -> Floats:
    """Covariance after a step of odometry: F P F' + Q.

    Args:
        covariance: (3, 3) before, of x, y, heading in the map frame; m², m rad, rad².
        heading: Before the step, rad, map frame.
        step: (3,) x, y, m, base frame before the step; turn, rad.
        time: Duration of the step, s.
        s: Noise of odometry. Its spread grows with the square root of the distance; across, it is a quarter of the
            spread along.
        scale: Variance along the step from an error of the odometer's scale, m².
    """
    c, sn = math.cos(heading), math.sin(heading)
    x, y, turned = step.tolist()
    way, rest = math.hypot(x, y), s.rest_noise**2 * time
    along, across = s.way_noise**2 * way + rest + scale, (0.25 * s.way_noise) ** 2 * way + rest
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
        prior: (3, 3) covariance of all places that scans have not refuted, about the pose; see `ambiguity`.
        is_contradicted: Whether the last scan contradicted odometry.
        is_bridged: Whether a scan has contradicted odometry since the last place that was set.
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
        self.is_proven = self.is_contradicted = self.is_bridged = False
        self._doubt_place()

    def _doubt_place(self) -> None:
        """A pose set by an operator or a search may be wrong by as much as is searched."""
        s = self.settings
        place, turn = (0.5 * s.search_reach) ** 2, (0.5 * s.search_turn) ** 2
        self.prior: Floats = self.covariance + np.diag([place, place, turn])
        self._scale = [_SCALE * _SCALE_WAY, _SCALE_WAY]
        self._ahead = self._unheld = 0.0
        self._misfit, self._noise, self._doubt, self._scans = math.inf, 1.0, 0.0, 0

    def predict(self, odometry: Floats, time: float) -> None:
        """Move the pose by the motion of odometry since the last call.

        Args:
            odometry: (3,) x, y, m, heading, rad, odometry frame.
            time: Time since the last call, s.
        """
        step, self.odometry = relative(self.odometry, odometry), odometry.copy()
        self.advance(step, time)

    def predict_since(self, since_ns: int, odometry: Floats, stamp_ns: int, period_ns: int) -> float:
        """As `predict`, with the time between two stamps, ns, the first of which is 0 at the first step.

        Returns:
            The time, s.
        """
        # Before the first step, a tick at most has passed, whatever the run clock shows: a robot may have run for days.
        since_ns = since_ns or max(0, stamp_ns - period_ns)
        passed = (stamp_ns - since_ns) / 1e9
        self.predict(odometry, passed)
        return passed

    def advance(self, step: Floats, time: float) -> None:
        """Move the pose by a step, (3,) x, y, m, turn, rad, in its own frame, that took a time, s."""
        way, heading, time = math.hypot(step[0], step[1]), float(self.pose[2]), max(time, 0.0)
        self._ahead, self._unheld = self._ahead + float(step[0]), self._unheld + way
        # The spread of a wrong scale grows with the way and not with its root.
        scale = 2.0 * self.scale_error**2 * self._unheld * way if self.settings.is_doubted else 0.0
        self.covariance = predicted_covariance(self.covariance, heading, step, time, self.settings, scale)
        self.prior = predicted_covariance(self.prior, heading, step, time, self.settings, scale)
        self.pose = compose(self.pose, step)
        self.inliers, self.share = 0, None

    def correct(self, beams: Floats) -> bool:
        """Correct the pose by current beams, (n, 4) end point, m, and direction, base frame; whether they were used."""
        if len(beams) < self.settings.least_inliers:
            return False
        pose, fused, inliers = self.fit(beams, self.pose, self.covariance)
        after, self.is_contradicted = inverse(fused), False
        if self.settings.is_doubted:
            misfit, self._scans = self.misfit(beams, pose), self._scans + 1
            if misfit > self._misfit + _WORSE or self._doubt > 0.0 or self._scans % _EVERY == 0:
                loose, wide, found = self.fit(beams, self.pose, self.covariance + _LOOSE)
                other = self.misfit(beams, loose) if found >= 0.9 * inliers else misfit
                self._doubt = max(0.0, self._doubt + misfit - other - _USUAL)
                if self._doubt > _DECISIVE:
                    pose, after, inliers, misfit, self.is_contradicted = loose, inverse(wide), found, other, True
                    self._doubt = 0.0
            self._learn_noise(misfit, inliers, len(beams))
            self._misfit = misfit if math.isinf(self._misfit) else self._misfit + _RECENT * (misfit - self._misfit)
        self.share = inliers / len(beams)
        if not self._is_usable(beams, pose, inliers):
            return False
        self.inliers = inliers
        if self.is_contradicted:
            self.prior, self.is_bridged = self.prior + _LOOSE, True
        shift = pose - self.pose
        self._learn_scale(shift, after)
        self.pose = pose_of(*(self.pose + shift).tolist())
        self.covariance = 0.5 * (after + after.T)
        return True

    @property
    def map_share(self) -> float:
        """Share of the covariance that is left where scans fit the map as well as their noise alone allows.

        `redundancy` is for the errors of maps. Where beams are not further from the walls than `sigma`, there are few.
        It is 1 before the first scan.
        """
        return 1.0 if math.isinf(self._misfit) else min(1.0, max(_LEAST_SHARE, _PER_NOISE * self._noise))

    @property
    def scale_error(self) -> float:
        """Error of the odometer's scale that scans have shown, no unit."""
        return abs(self._scale[0]) / self._scale[1]

    def _learn_noise(self, misfit: float, inliers: int, count: int) -> None:
        """Learn how much more than `sigma` beams on the map are off it: real maps have errors of their own."""
        s = self.settings
        square = 2.0 * s.sigma**2 * s.redundancy * misfit - _OUTLIER * s.robust_scale**2 * (count - inliers)
        found = max(1.0, square / max(inliers, 1) / s.sigma**2)
        self._noise += _RECENT * (found - self._noise)

    def _learn_scale(self, shift: Floats, after: Floats) -> None:
        """Learn how wrong the odometer's scale is where scans show how far the robot has driven."""
        c, s = math.cos(self.pose[2]), math.sin(self.pose[2])
        if c * c * after[0, 0] + 2.0 * c * s * after[0, 1] + s * s * after[1, 1] < _HELD**2:
            ahead, kept = self._ahead, math.exp(-abs(self._ahead) / _FORGET)
            found = math.copysign(1.0, ahead) * (c * shift[0] + s * shift[1]) if ahead else 0.0
            self._scale = [kept * self._scale[0] + found, kept * self._scale[1] + abs(ahead)]
            self._unheld = 0.0
        self._ahead = 0.0

    def misfit(self, beams: Floats, pose: Floats) -> float:
        """Negative log likelihood of beams, (n, 4), at a pose, (3,)."""
        s, field = self.settings, self.field
        misfit: float = misfit_of(field.values, field.frame, beams, pose, s.robust_scale, s.reach)
        return 0.5 * misfit / (s.sigma**2 * s.redundancy)

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
        options = np.array(
            [s.sigma**2 * s.redundancy * self._noise, first, s.robust_scale, 2.0 * s.robust_scale, s.reach]
        )
        information = inverse(covariance)
        pose, fused = np.empty(3), np.empty((3, 3))
        inliers = fit_pose(field.values, field.frame, beams, start, information, options, s.iterations, pose, fused)
        return pose, fused, inliers if math.isfinite(sum(pose.tolist())) else 0

    def cost_of(self, beams: Floats) -> float:
        """Negative log likelihood of beams, (n, 4), at the pose that fits them best."""
        pose, _, inliers = self.fit(beams, self.pose, self.covariance)
        return self.misfit(beams, pose if inliers else self.pose)

    def bridge(self, pose: Floats, covariance: Floats) -> None:
        """Correct an error of odometry: to a pose, (3,), with its (3, 3) covariance."""
        self.pose = pose_of(*pose.tolist())
        self.covariance = 0.5 * (covariance + covariance.T)
        self.prior, self._misfit, self.is_bridged = self.prior + _LOOSE, math.inf, True

    def relocate(self, pose: Floats, covariance: Floats) -> None:
        """Continue from another pose: (3,) x, y, m, heading, rad, map frame, and its (3, 3) covariance."""
        self.is_proven = False
        self.pose = pose_of(*pose.tolist())
        self.covariance = 0.5 * (covariance + covariance.T)
        self._doubt_place()
