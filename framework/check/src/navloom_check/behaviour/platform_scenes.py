"""Scenes and measures of platforms, which follow commands, and of recoveries, which start at a wall."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from navloom.geometry.frames import compose, inverse
from navloom.geometry.world import Cylinder, Place, World
from navloom.messages import RangeScan, Twist2D
from navloom.roles import Platform, PlatformInput, RecoveryInput
from navloom.roles.claims import Claim

from navloom_check.behaviour.avoider_scenes import place_in_map
from navloom_check.behaviour.measurements import PERIOD, PERIOD_NS, Behaviour, Line, Maker, Measured, Unfit, full_scan
from navloom_check.behaviour.obstacle_scene import Scene, post, wall
from navloom_check.behaviour.scene_drives import FinishedDrive, Pose, drive, estimate_at

__all__ = ["PLATFORMS", "RECOVERIES"]

LEG = 3.0
"""Time for which a command is held, s."""
SLACK, SHARE = 0.08, 0.25
"""Greatest error of a leg: m or rad, plus a share of the commanded distance or angle."""
FOLLOWED = 6
"""Seed of the first scene in which something has stepped behind the robot."""
LONGEST = 120.0
"""Longest time that a recovery may take, s."""


def empty_scene(seed: int) -> Scene:
    """An empty floor; the seed chooses the robot's start."""
    stream = np.random.default_rng([seed, 9])
    place = Place(*stream.uniform((-4.0, -4.0, -3.0), (4.0, 4.0, 3.0)).tolist()) if seed else Place(0.0, 0.0)
    return Scene(Place(0.0, 0.0), (3.0, 0.0)).moved(place)


def drives_as_told(make: Maker, scene: Scene) -> Measured:
    cls = make.cls
    if not (issubclass(cls, Platform) and cls.is_simulated):
        raise Unfit("it is no simulation (is_simulated): a real robot is not moved by a check")
    platform = make(scene, world=World("check", start=scene.start))
    poses, true, legs = [], [], ((0.3, 0.0), (0.0, 0.5), (0.0, -0.5), (-0.2, 0.0), (0.25, 0.3))
    worst, said, tick = 0.0, "followed its commands", 0
    out = platform.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 0))
    first = out.odometry.pose
    if max(abs(first.x), abs(first.y), abs(first.heading)) > SLACK:
        worst = math.inf
        said = f"started its odometry at ({first.x:.2f}, {first.y:.2f}) m, {first.heading:.2f} rad, not at 0"
    for v, w in ((0.0, 0.0), *legs):
        before = out.odometry.pose
        # A platform must move by the time that passed, not by the number of its calls.
        ticks = 1 if v >= 0.0 and w == 0.0 else 2  # on other legs it advances every second tick
        for _ in range(round(LEG / PERIOD / ticks)):
            tick += ticks
            out = platform.advance(PlatformInput(Twist2D(v, 0.0, w), None, tick * PERIOD_NS))
            poses.append((out.odometry.pose.x, out.odometry.pose.y, out.odometry.pose.heading))
            if out.truth is not None:
                true.append((out.truth.pose.x, out.truth.pose.y, out.truth.pose.heading))
        off, how = _off(before, out.odometry.pose, out.odometry.twist, v, w)
        if off > worst:
            worst, said = off, how
    odometry = np.array(poses)
    in_map = compose(np.array([scene.start.x, scene.start.y, scene.start.heading]), odometry)
    lines = [Line("odometry, from the start", in_map, is_robot=True)]
    if true:
        lines.append(Line("truth", np.array(true)))
        apart = float(np.hypot(*(np.array(true) - in_map)[:, :2].T).max())
        if apart > 3.0 * SLACK and worst <= 1.0:
            worst, said = apart / SLACK, f"gave a truth {apart:.2f} m from its odometry, seen from the start"
    return Measured(worst <= 1.0, said, worst, tuple(lines))


def _off(before: object, after: object, twist: Twist2D, v: float, w: float) -> tuple[float, str]:
    """Error of one leg, where 1 is the greatest allowed, and the error in words."""
    a, b = ([getattr(p, key) for key in ("x", "y", "heading")] for p in (before, after))
    ahead, left, turn = compose(inverse(np.array(a)), np.array(b)).tolist()
    asked_turn = w * LEG
    asked = (v * LEG, 0.0) if w == 0.0 else (v / w * math.sin(asked_turn), v / w * (1.0 - math.cos(asked_turn)))
    way_off = math.hypot(ahead - asked[0], left - asked[1]) / (SLACK + SHARE * math.hypot(*asked))
    turn_off = abs(math.remainder(turn - asked_turn, math.tau)) / (SLACK + SHARE * abs(asked_turn))
    twist_off = max(abs(twist.vx - v), abs(twist.wz - w)) / (SLACK + SHARE * max(abs(v), abs(w)))
    when = f"when commanded {v:g} m/s and {w:g} rad/s for {LEG:g} s"
    if twist_off > max(way_off, turn_off):
        return twist_off, f"gave odometry with a twist of {twist.vx:.3f} m/s and {twist.wz:.3f} rad/s {when}"
    return max(way_off, turn_off), f"gave odometry that moved ({ahead:.3f}, {left:.3f}) m and {turn:.3f} rad {when}"


def stuck_scene(seed: int) -> Scene:
    """A robot close to a wall or at the end of a corridor, which drove there 1.2 m, or 0.3 m from a wall behind it.

    From the seventh scene on, something has stepped behind it since.
    """
    scene = Scene(Place(0.0, 0.0), (3.0, 0.0), obstacles=(wall(0.45, -2.0, 0.45, 2.0),), came=1.2)
    if seed % 2:
        scene = replace(scene, obstacles=(*scene.obstacles, wall(-3.0, 0.5, 0.45, 0.5), wall(-3.0, -0.5, 0.45, -0.5)))
    if seed % 3 == 2:
        scene = replace(scene, obstacles=(*scene.obstacles, wall(-0.65, -1.0, -0.65, 1.0)), came=0.3)
    if seed >= FOLLOWED:
        scene = replace(scene, obstacles=(*scene.obstacles, post(-0.52, 0.0, 0.1)), came=1.2)
    return scene.moved(place_in_map(seed))


def drive_recovery(make: Maker, scene: Scene) -> tuple[FinishedDrive, str]:
    """Let a recovery drive for two attempts. Gives the drive and the last state of the recovery."""
    recovery, start = make(scene), np.array([scene.start.x, scene.start.y, scene.start.heading])
    trail = compose(start, np.stack([np.linspace(-scene.came, 0.0, 25), np.zeros(25), np.zeros(25)], axis=1))
    attempt, is_first, state = 1, True, "running"
    sees = make.sees(RangeScan)

    def step(stamp_ns: int, pose: Pose, twist: tuple[float, float]) -> tuple[float, float] | str:
        nonlocal attempt, is_first, state
        if state != "running" and attempt == 2:
            return state
        if state != "running":
            attempt, is_first = 2, True
        given = RecoveryInput(
            stamp_ns, (full_scan(scene, pose, stamp_ns),) * sees, estimate_at(stamp_ns, pose, twist), attempt,
            "no progress", is_first, trail, sensors=("laser",) * sees, extra=make.extra(scene, stamp_ns, pose, twist),
        )  # fmt: skip
        answer = recovery.recover(given)
        is_first, state = False, answer.state
        return answer.twist.vx, answer.twist.wz

    return drive(scene, LONGEST, step, may_stand=True), state


def recovery_no_contact(make: Maker, scene: Scene) -> Measured:
    if any(isinstance(one, Cylinder) for one in scene.obstacles) and not make.sees(RangeScan):
        return Measured(True, "was not asked, since it sees nothing", math.inf)
    done, _ = drive_recovery(make, scene)
    how = "touched something" if done.gap <= 0.0 else f"kept {done.gap:.3f} m away"
    return Measured(done.gap > 0.0, how, done.gap, (done.line,))


def recovery_ends(make: Maker, scene: Scene) -> Measured:
    done, state = drive_recovery(make, scene)
    seconds = PERIOD * (len(done.poses) - 1)
    return Measured(state != "running", f"was {state} after {seconds:.1f} s", seconds, (done.line,))


PLATFORMS = (
    Behaviour("platform", Claim.DRIVES_AS_TOLD,
              f"to follow its commands within {SLACK} m or rad plus {SHARE:.0%}", empty_scene, drives_as_told, 2),
)  # fmt: skip
RECOVERIES = (
    Behaviour("recovery", Claim.NO_CONTACT, "to touch nothing", stuck_scene, recovery_no_contact, 8),
    Behaviour("recovery", Claim.ENDS, f"done or failed in both attempts, within {LONGEST:g} s", stuck_scene,
              recovery_ends, 3),
)  # fmt: skip
