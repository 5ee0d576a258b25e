"""Whether a simulated platform agrees with itself: scans and stamps, twist and odometry, truth and world."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from navloom.geometry.collision import clearance
from navloom.geometry.world import Box, Cylinder, Place, World
from navloom.messages import PoseTrack, RangeScan
from navloom.roles import Platform, PlatformOutput, SensorSpec
from numpy.typing import NDArray

from navloom_check import builders
from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PERIOD
from navloom_check.checks import check
from navloom_check.contract.platform_truth import (
    START,
    context_of,
    expected_ranges,
    has_defaults,
    made_world,
    outputs_of,
    track_of,
)
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import Player

__all__ = ["CHECKS"]

Floats = NDArray[np.float64]

NARROW = 0.03
"""Greatest half angle of a beam whose echo shows a direction, rad."""
FEWEST = 10
"""Fewest echoes of a scan that is compared."""
TURN = 0.7
"""Turn rate of the robot, rad/s."""
SPUN_UP, TURNS, USED = 20, 50, 8
"""Steps until the robot turns steadily, steps of the turn, and the scans of each sensor that are compared."""
TICKS = 5
"""Greatest error of a stamp that is tried, ticks; so many last steps are left out, since no later pose is known."""
TURNED = np.radians(np.setdiff1d(np.arange(-15.0, 15.5, 0.5), [0.0]))
"""Errors of all bearings that are tried, rad."""
ASIDE = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)
MOVED = [(x, y) for x in ASIDE for y in ASIDE if x or y]
"""Errors of all origins that are tried, m."""
BETTER, WORSE = 0.5, 0.015
"""Greatest share of the difference that is left if an error explains the echoes, and least decrease of it, m."""
WINDOW = 4
"""Ticks over which speeds are compared: encoders are coarse."""
APART, LASTS = 0.35, 6
"""Share of the commanded speed by which twist and odometry may differ, and ticks for which they may differ by more."""
REST, DRIVE, COAST = 5, 25, 20
"""Ticks for which zero, a velocity, and zero again are commanded."""
SETTLING = 10
"""Ticks after a new command in which the robot accelerates."""
AHEAD = 0.07
"""Time by which the twist may be ahead of the motion, s: one tick, and a little."""
GAP = 0.1
"""Greatest error of a clearance, m."""


@check("contract", {"platform"}, "Echoes fit the world best at the stamps, bearings and origins that the scan gives.")
def aligned(bench: Bench) -> Iterator[Finding]:
    """Scans of a robot that is stopped, then of one that turns; only of beams as narrow as a laser's.

    Scans of the previous tick, bearings that are some beams off and a forgotten mount show here.
    """
    cls: type[Platform] = bench.subject.thing
    kinds = [kind for kind, message in cls.sensor_kinds.items() if issubclass(message, RangeScan)]
    specs = tuple(SensorSpec(kind, kind) for kind in kinds if has_defaults(cls, kind))
    if not specs:
        raise NotRun("it has no range sensor that works without settings")
    context = context_of(bench, specs)
    outputs = outputs_of(bench, context, (0.0, 0.0), USED)
    track = track_of(context, outputs)
    for name, scans in _narrow(outputs).items():
        if what := _error_at_rest(scans, track):
            yield _finding(name, what, "stopped", context.start.heading)
            return
    outputs = outputs_of(bench, context, (0.0, TURN), TURNS)
    if any(out.truth is None for out in outputs):
        return
    track = track_of(context, outputs)
    for name, scans in _narrow(outputs[SPUN_UP:-TICKS]).items():
        if what := _error_in_time(scans, track):
            yield _finding(name, what, f"turning at {TURN} rad/s", context.start.heading)
            return


def _finding(name: str, what: str, does: str, heading: float) -> Finding:
    return Finding(
        f"gives echoes of the sensor {name!r} that {what}", "the bearings and origins of the beams in the base frame, "
        "and as stamp the time at which they were taken: after the robot has moved in this tick",
        given=f"a robot {does} at {START[:2]} m heading {heading:g} rad, walls to the left and ahead, and a box",
    )  # fmt: skip


def _narrow(outputs: Sequence[PlatformOutput]) -> dict[str, list[RangeScan]]:
    """A few scans of each sensor whose beams are narrow and have echoes."""
    found: dict[str, list[RangeScan]] = {}
    for out in outputs:
        for name, scan in out.scans.items():
            if not isinstance(scan, RangeScan) or scan.half_angles.max(initial=0.0) > NARROW:
                continue
            if np.isfinite(scan.ranges).sum() >= FEWEST:
                found.setdefault(name, []).append(scan)
    return {name: scans[:: max(1, len(scans) // USED)] for name, scans in found.items()}


def _error_at_rest(scans: Sequence[RangeScan], track: PoseTrack) -> str:
    """In words, an error of bearings or origins that explains the echoes; empty for none."""
    own = _difference(scans, track)
    turned = [_difference(scans, track, turned=one) for one in TURNED]
    moved = [_difference(scans, track, moved=one) for one in MOVED]
    if not _explains(min(*turned, *moved), own):
        return ""
    if min(turned) <= min(moved):
        return f"fit the world with bearings {math.degrees(TURNED[int(np.argmin(turned))]):+.1f}° off"
    x, y = MOVED[int(np.argmin(moved))]
    return f"fit the world with origins moved by ({x:g}, {y:g}) m"


def _error_in_time(scans: Sequence[RangeScan], track: PoseTrack) -> str:
    """In words, an error of the stamps that explains the echoes; empty for none."""
    own = _difference(scans, track)
    late = [ticks for ticks in range(-TICKS, TICKS + 1) if ticks]
    others = [_difference(scans, track, later_ns=round(1e9 * ticks * PERIOD)) for ticks in late]
    if not _explains(min(others), own):
        return ""
    ticks = late[int(np.argmin(others))]
    return f"fit the world {abs(ticks) * PERIOD:g} s {'before' if ticks < 0 else 'after'} their stamps"


def _difference(
    scans: Sequence[RangeScan],
    track: PoseTrack,
    *,
    later_ns: int = 0,
    turned: float = 0.0,
    moved: tuple[float, float] = (0.0, 0.0),
) -> float:
    """Median difference between the ranges of scans and those that the world gives, m."""
    world = made_world()
    return float(np.median(np.concatenate([
        np.abs(scan.ranges[np.isfinite(scan.ranges)]
               - expected_ranges(scan, track, world, later_ns=later_ns, turned=turned, moved=moved, rays=1))
        for scan in scans
    ])))  # fmt: skip


def _explains(error: float, own: float) -> bool:
    return error <= BETTER * own and own - error >= WORSE


@check("contract", {"platform"}, "The twist in odometry is that of its poses, also while the robot accelerates.")
def odometry_twist(bench: Bench) -> Iterator[Finding]:
    """Localizers and avoiders predict with it. A commanded velocity is not yet driven."""
    for v, w in ((0.5, 0.0), (0.0, 1.0)):
        commands = [(0.0, 0.0)] * REST + [(v, w)] * DRIVE + [(0.0, 0.0)] * COAST
        with alike():
            player = Player(bench.subject, context_of(bench, ()), bench.seed)
            odometry = [
                player.step(builders.platform_input(command, k * PERIOD)).odometry for k, command in enumerate(commands)
            ]
        poses = np.array([(one.pose.x, one.pose.y, one.pose.heading) for one in odometry])
        told = np.array([one.twist.vx if v else one.twist.wz for one in odometry])[1:]
        driven = _driven(poses)[:, 0 if v else 1]
        most, unit = (v, "m/s") if v else (w, "rad/s")
        if said := _apart(told, driven, most, unit) or _ahead(told, driven, most, unit):
            yield Finding(
                f"gives odometry {said}", "the velocity that was driven, not the commanded one",
                given=f"a robot that is commanded {v:g} m/s and {w:g} rad/s, and then to stop",
            )  # fmt: skip
            return


def _driven(poses: Floats) -> Floats:
    """(n - 1, 2) forward speed, m/s, and turn rate, rad/s, between poses (n, 3)."""
    step = np.diff(poses, axis=0)
    turned = (step[:, 2] + math.pi) % math.tau - math.pi
    middle = poses[:-1, 2] + 0.5 * turned
    return np.column_stack([step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle), turned]) / PERIOD


def _apart(told: Floats, driven: Floats, most: float, unit: str) -> str:
    """In words, that twist and poses differ for long; empty if they do not."""
    mean = np.ones(WINDOW) / WINDOW
    told, driven = np.convolve(told, mean, "valid"), np.convolve(driven, mean, "valid")
    off = np.abs(told - driven)
    longest = max((len(list(run)) for is_off, run in groupby(off > APART * most) if is_off), default=0)
    if longest < LASTS:
        return ""
    worst = int(np.argmax(off))
    return (
        f"with a twist of {told[worst]:.2f} {unit} while its poses move at {driven[worst]:.2f} {unit}, for {longest} "
        "ticks"
    )


def _ahead(told: Floats, driven: Floats, most: float, unit: str) -> str:
    """In words, that the twist is ahead of the poses at the start of a drive and at its end; empty if it is not.

    A filtered twist is behind them, and one with a wrong scale is ahead at the start only.
    """
    lead = PERIOD * (told - driven)
    starts, ends = lead[REST - 1 :][:SETTLING].sum(), -lead[REST + DRIVE - 1 :][:SETTLING].sum()
    if min(starts, ends) <= AHEAD * most:
        return ""
    return f"with a twist that is {min(starts, ends) / most:.2f} s ahead of its poses when the command changes"


@check("contract", {"platform"}, "The clearance in the truth is that of the footprint, also from a moving obstacle.")
def true_clearance(bench: Bench) -> Iterator[Finding]:
    """For a simulated robot that drives towards walls, one that a cylinder passes, and one beside a turned box."""
    passing = Cylinder("walker", 1.5, -1.5, 0.4, waypoints=((0.0, 1.5, -1.5), (4.0, 1.5, 1.0)))
    board = Box("board", (0.0, 2.0), (-1.1, -1.0), (0.0, 2.4), yaw=0.7)
    turned = World("a board", (board,), bounds=(-5.0, -5.0, 5.0, 5.0))
    street = World("a walker", (passing,), bounds=(-5.0, -5.0, 5.0, 5.0))
    rooms = (
        ("a robot that drives towards walls", made_world(), (0.3, 0.1)),
        ("a stopped robot that a cylinder passes", street, (0.0, 0.0)),
        ("a stopped robot beside a board with a yaw of 0.7 rad", turned, (0.0, 0.0)),
    )  # fmt: skip
    for given, world, command in rooms:
        context = context_of(bench, (), world=world)
        outputs = outputs_of(bench, context, command, 80, world=world)
        errors = []
        for step, out in enumerate(outputs):
            if out.truth is None:
                raise NotRun("it gives no truth")
            pose = out.truth.pose
            gap, _ = clearance(context.robot.footprint, Place(pose.x, pose.y, pose.heading), world,
                               height=context.robot.height, time=step * PERIOD)  # fmt: skip
            if math.isinf(out.truth.clearance):
                raise NotRun("its truth knows no obstacles")
            errors.append((abs(out.truth.clearance - gap), out.truth.clearance, gap))
        if float(np.median([error[0] for error in errors])) > GAP:
            _, told, gap = max(errors)
            yield Finding(
                f"gives a truth with a clearance of {told:.2f} m where the footprint is {gap:.2f} m from the nearest "
                "obstacle", "the gap between the footprint's outline and the obstacle where it is at this time, m",
                given=given,
            )  # fmt: skip
            return


CHECKS = (aligned, odometry_twist, true_clearance)
