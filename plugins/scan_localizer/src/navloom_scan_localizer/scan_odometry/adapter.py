"""Scan matching against recently seen surfaces, as a navloom localizer."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from navloom import (
    Claim,
    Context,
    Localizer,
    LocalizerInput,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Twist2D,
)
from navloom_scans import beams, matching, small
from navloom_scans.poses import relative
from navloom_scans.readings import echoes_of, range_scans, silent_of
from navloom_scans.small import inverse
from navloom_scans.trail import OdometryTrail
from numpy.typing import NDArray

from navloom_scan_localizer import surface
from navloom_scan_localizer.judging import distance_of, position_sigma, shift_to
from navloom_scan_localizer.params import ScanOdometryParams
from navloom_scan_localizer.surface import LocalSurface
from navloom_scan_localizer.sweep import Sweep
from navloom_scan_localizer.tracking import PoseTracker
from navloom_scan_localizer.unaided import UnaidedMotion, are_unanimous, hold_unseen

__all__ = ["ScanOdometry"]

_COVERED = 0.5
"""Share of a scan's echoes on known surfaces with which the next scans can do without it."""

_LOST_TURN_DEG = 30.0
"""Standard deviation of the heading from which the pose is lost, degrees."""

_CAUTIOUS_FOR = 10.0
"""How long scans are matched with settled surfaces alone after a body that moves was seen, s."""

_AGREED = 0.5
"""Square of the Mahalanobis distance up to which a pose agrees with that of the wheels, no unit; small, since they err
less than their covariance says."""

_HELD = 0.05
"""Standard deviation of a fit without a prior, m and rad, up to which scans show the whole pose: half of `_WIDE`'s."""

_SECTOR = math.radians(30.0)
"""Width of a sector of a scan, rad: most bodies are in one alone, and the walls of a room in all of them."""

_WIDE = np.diag([0.1**2, 0.1**2, math.radians(10.0) ** 2])
"""Covariance of the motion between two scans that wheels may have missed, m² and rad²."""


class ScanOdometry(Localizer[ScanOdometryParams]):
    """Corrects wheel odometry by matching each scan against the surfaces seen by earlier scans."""

    name = "scan_odometry"
    claims = {Claim.CORRECTS_DRIFT}
    accepts = (RangeScan,)
    needs_sensor = True

    def __init__(self, params: ScanOdometryParams, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        """Return to the start pose and forget all surfaces; odometry has to begin there too."""
        p, start = self.params, self.context.start
        self._surface = LocalSurface(p.spacing, p.max_range, p.before, p.behind, p.memory)
        self._aided, self._unaided = p.settings(), p.unaided()
        self._tracker, self._stamp_ns = PoseTracker(self._aided, self._surface.field, np.zeros(3)), 0
        # What the pose is if every narrow thing in view moves.
        self._wary = PoseTracker(self._aided, self._surface.field, np.zeros(3))
        self._trail = OdometryTrail(p.max_age, self.context.period)
        self._motion, self._sweep = UnaidedMotion(), Sweep()
        self.place(start)

    def place(self, pose: Pose2D) -> None:
        """Move the estimate to a pose and forget all surfaces."""
        p, place = self.params, np.array([pose.x, pose.y, pose.heading])
        self._surface = LocalSurface(p.spacing, p.max_range, p.before, p.behind, p.memory)
        self._surface.follow(pose.x, pose.y)
        self._tracker.place(place)
        self._wary.place(place)
        self._tracker.field = self._surface.field
        self._key, self._scans = place.copy(), 0
        self._moved_at, self._is_cautious = -math.inf, False
        self._motion.place(place)
        self._drift, self._unseen = np.zeros((3, 3)), np.zeros((3, 3))

    @classmethod
    def warm_up(cls) -> None:
        beams.warm_up()
        matching.warm_up()
        surface.warm_up()
        small.warm_up()

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        odometry, tracker, motion = given.odometry, self._tracker, self._motion
        twist = odometry.twist
        if motion.is_possible:
            motion.see_odometry(_row(odometry.pose), _row(twist))
        before = tracker.pose
        if motion.is_certain:
            twist = Twist2D(*motion.velocity.tolist())
            tracker.settings = self._unaided
            passed = (odometry.stamp_ns - self._stamp_ns) / 1e9
            tracker.advance(motion.velocity * passed, passed)
        else:
            tracker.settings = self._aided
            for estimate in (tracker, self._wary):
                period_ns = round(1e9 * self.context.period)
                estimate.predict_since(self._stamp_ns, _row(odometry.pose), odometry.stamp_ns, period_ns)
            self._trail.add(odometry.stamp_ns, tracker.odometry)
        self._stamp_ns = odometry.stamp_ns
        points, can_wait = self._near(given, twist), False
        # The first scan has nothing to be matched with.
        if len(points) and self._scans:
            if is_due := self._sweep.is_due(twist.wz, [scan.time_offsets for scan in range_scans(given.scans)]):
                self._sweep.compare(lambda order: tracker.cost_of(self._near(given, twist, order)))
                points = self._near(given, twist)
            if motion.is_possible:
                points, twist = self._correct_unaided(given, points, twist)
            else:
                tracker.correct(self._standing(points))
            # In an order that is not certain, scans would teach the surfaces their own distortion.
            can_wait = is_due and (tracker.share or 0.0) > _COVERED
        elif given.scans:
            motion.stop()
        if len(points):
            self._watch(given, twist, points)
            twist = twist if motion.is_certain else odometry.twist
        if len(points) and not can_wait and (motion.is_certain or not motion.witnesses):
            self._learn(points)
        if self._is_cautious:
            self._keep_unseen(before)
        covariance = tracker.covariance + self._drift + self._unseen
        sigma, limit = position_sigma(covariance, self.params.lost_sigma), self.params.lost_sigma
        is_lost = sigma > limit
        why = f"the position has a standard deviation of {sigma:.2f} m, more than {limit:g} m" if is_lost else ""
        turn_deg = math.degrees(math.sqrt(covariance[2, 2]))
        if not is_lost and turn_deg > _LOST_TURN_DEG:
            is_lost = True
            why = f"the heading has a standard deviation of {turn_deg:.0f}°, more than {_LOST_TURN_DEG:g}°"
        if is_lost and motion.is_certain:
            # Scans that fit again do not tell how far the robot went unseen.
            self._drift, tracker.covariance = covariance, 1e-6 * np.eye(3)
        pose = Pose2D(*tracker.pose.tolist())
        state: Literal["tracking", "lost"] = "lost" if is_lost else "tracking"
        return PoseEstimate(odometry.stamp_ns, pose, twist, covariance, state, why)

    def _watch(self, given: LocalizerInput, twist: Twist2D, points: NDArray[np.float64]) -> None:
        """Look for bodies that move; while there are any, the next scan is matched with settled surfaces alone.

        Args:
            points: (n, 4), see `_near`.
        """
        time, tracker, wary, motion = self._stamp_ns / 1e9, self._tracker, self._wary, self._motion
        settled, was_cautious = self._surface.settled(), self._is_cautious
        if not was_cautious and not motion.is_possible:
            wary.field = settled
            wary.correct(self._surface.standing(points, wary.pose))
        if is_moving := self._surface.has_moving(points, tracker.pose, time):
            self._moved_at = time
        self._is_cautious = time - self._moved_at < _CAUTIOUS_FOR
        if motion.is_certain and not motion.is_proven:
            tracker.field = settled
            self._prove(points, is_moving)
        if self._is_cautious and not was_cautious and not motion.is_possible:
            # Until now the bodies may have pulled the pose, and the latest surfaces with it. Where nothing is settled,
            # the other pose is that of the wheels alone, which no surface would fit: if they agree, the pose is kept.
            is_held = wary.covariance[:2, :2].trace() < _WIDE[:2, :2].trace()
            if is_held or distance_of(shift_to(tracker.pose, wary.pose), inverse(wary.covariance)) > _AGREED:
                tracker.pose, tracker.covariance = wary.pose.copy(), wary.covariance.copy()
            self._surface.forget_unsettled()
            self._key = tracker.pose.copy()
        elif was_cautious or motion.is_certain:
            wary.pose, wary.covariance = tracker.pose.copy(), tracker.covariance.copy()
        tracker.field = settled if self._is_cautious else self._surface.field
        trail = None if motion.is_certain else self._trail
        silent = silent_of(range_scans(given.scans), given.odometry.stamp_ns, twist, self.params, trail)
        self._surface.look(np.concatenate((points, *silent)), len(points), tracker.pose, time)

    def _prove(self, points: NDArray[np.float64], is_moving: bool) -> None:
        """Take it back that odometry is missing if a body moves before surfaces that stand still show the motion.

        Args:
            points: (n, 4), see `_near`. is_moving: Whether bodies that move are among them.
        """
        tracker, motion = self._tracker, self._motion
        if self._is_held(points):
            motion.is_proven = math.dist(motion.start[:2], tracker.pose[:2]) > self.params.reach
        elif is_moving:
            motion.is_certain, moved_at = False, self._moved_at
            self.place(Pose2D(*motion.start.tolist()))
            self._moved_at = moved_at

    def _is_held(self, points: NDArray[np.float64]) -> bool:
        """Whether walls that stand still show the whole pose to points, (n, 4)."""
        tracker = self._tracker
        walls = self._surface.standing(points, tracker.pose, only_wide=True)
        _, fused, inliers = tracker.fit(walls, tracker.pose, tracker.covariance + _WIDE)
        return inliers >= self.params.least_inliers and float(inverse(fused).diagonal().max()) < _HELD**2

    def _standing(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Those of the points, (n, 4), with which the pose may be corrected: all, unless there are bodies that move."""
        tracker = self._tracker
        return self._surface.standing(points, tracker.pose) if self._is_cautious else points

    def _keep_unseen(self, before: NDArray[np.float64]) -> None:
        """Keep the errors of steps that no scan has corrected: the surfaces that are seen next carry them.

        Args:
            before: (3,) pose before the step, map frame.
        """
        tracker, step = self._tracker, self._tracker.pose - before
        moved = np.array([[1.0, 0.0, -step[1]], [0.0, 1.0, step[0]], [0.0, 0.0, 1.0]])
        self._unseen = small.sandwich(moved, self._unseen)
        if not tracker.inliers:
            self._unseen = self._unseen + tracker.covariance
            tracker.covariance = 1e-6 * np.eye(3)

    def _near(self, given: LocalizerInput, twist: Twist2D, order: float | None = None) -> NDArray[np.float64]:
        """The points of all scans within `max_range`, (n, 4), see `echoes_of`, in that order or that of the sweep."""
        trail = None if self._motion.is_certain else self._trail
        order = self._sweep.order if order is None else order
        points = echoes_of(range_scans(given.scans), given.odometry.stamp_ns, twist, self.params, trail, order)
        joined = points[0] if len(points) == 1 else np.concatenate(points) if points else np.empty((0, 4))
        return joined[: beams.keep_near(joined, self.params.max_range)]

    def _correct_unaided(
        self, given: LocalizerInput, points: NDArray[np.float64], twist: Twist2D
    ) -> tuple[NDArray[np.float64], Twist2D]:
        """Correct the pose by points, (n, 4), while odometry is or may be missing.

        Returns:
            The points, moved by the velocity that the scans show; and this velocity.
        """
        tracker, motion, time = self._tracker, self._motion, self._stamp_ns / 1e9
        if not motion.is_certain:
            # While a scan has shown motion, the robot is no longer near the pose at which the tracker holds it.
            guess = motion.pose_at(time) if motion.witnesses else tracker.pose
            pose, fused, inliers = tracker.fit(self._standing(points), guess, tracker.covariance + _WIDE)
            if inliers >= self.params.least_inliers:
                is_away = motion.is_away(pose, inverse(fused))
                is_witness = is_away and (not self._is_cautious or self._is_held(points))
                motion.see_pose(pose, time, is_witness and self._is_shown_by_all(self._standing(points), guess))
            if not motion.is_certain:
                tracker.correct(self._standing(points))
                return points, twist
            tracker.pose = guess
            tracker.covariance += _WIDE
        prior, covariance = tracker.pose, tracker.covariance
        if not tracker.correct(self._standing(points)):
            motion.stop()
            return points, twist
        # The first fit shows the velocity during the scan; with it, the second is exact.
        pose, _ = hold_unseen(tracker.pose, tracker.covariance, prior, covariance)
        points = self._near(given, Twist2D(*motion.velocity_at(pose, time).tolist()))
        tracker.pose, tracker.covariance = prior, covariance
        tracker.correct(self._standing(points))
        tracker.pose, tracker.covariance = hold_unseen(tracker.pose, tracker.covariance, prior, covariance)
        motion.see_pose(tracker.pose, time, True)
        return points, Twist2D(*motion.velocity.tolist())

    def _is_shown_by_all(self, points: NDArray[np.float64], guess: NDArray[np.float64]) -> bool:
        """Whether points, (n, 4), in every other sector and those between show the same motion from a guess, (3,)."""
        bearings = np.arctan2(points[:, 3], points[:, 2])
        is_even = np.floor(bearings / _SECTOR) % 2.0 == 0.0
        poses = []
        for half in (points[is_even], points[~is_even]):
            pose, fused, inliers = self._tracker.fit(half, guess, self._tracker.covariance + _WIDE)
            if inliers < self.params.least_inliers or not self._motion.is_away(pose, inverse(fused)):
                return False
            poses += [pose, inverse(fused)]
        return are_unanimous(*poses)

    def _learn(self, points: NDArray[np.float64]) -> None:
        """Add a scan to the surfaces if the robot has moved enough since the last one that was added."""
        p, pose = self.params, self._tracker.pose
        step = relative(self._key, pose)
        way = math.hypot(step[0], step[1])
        # Adding each scan of a standing robot would average its noise into the surface, and weigh one view too much.
        if self._scans >= p.first_scans and way < p.key_way and abs(step[2]) < math.radians(p.key_turn_deg):
            return
        turn = math.radians(p.drift_deg) ** 2 * way
        # An error of the heading moves the robot about the start, in proportion to its distance.
        across = np.array([self.context.start.y - pose[1], pose[0] - self.context.start.x, 1.0])
        self._drift += np.diag([p.drift**2 * way, p.drift**2 * way, 0.0]) + 0.25 * turn * np.outer(across, across)
        self._surface.follow(float(pose[0]), float(pose[1]))
        self._surface.add(points, pose)
        self._key, self._scans = pose.copy(), self._scans + 1


def _row(given: Pose2D | Twist2D) -> NDArray[np.float64]:
    """(3,) x, y, heading of a pose, or vx, vy, wz of a velocity."""
    if isinstance(given, Pose2D):
        return np.array([given.x, given.y, given.heading])
    return np.array([given.vx, given.vy, given.wz])
