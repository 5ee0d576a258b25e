"""Scenes and measures of avoiders."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from navloom.geometry.world import Box, Cylinder, Place
from navloom.messages import Point2D, RangeScan, Twist2D
from navloom.roles import AvoiderInput
from navloom.roles.claims import Claim

from navloom_check.behaviour.measurements import (
    PERIOD,
    PERIOD_NS,
    Behaviour,
    Line,
    Maker,
    Measured,
    Unfit,
    robot_of,
    scan_from,
)
from navloom_check.behaviour.obstacle_scene import (
    ALL_ROUND,
    SHORT_SONARS,
    SONARS,
    TWO_LASERS,
    WIDE_SONARS,
    Scene,
    post,
    wall,
)
from navloom_check.behaviour.scene_drives import FinishedDrive, Pose, drive, estimate_at, towards

__all__ = ["AVOIDERS", "place_in_map"]

NEAR = 0.3
"""Distance from its target at which an avoider has reached it, m."""
BESIDE = 1.2
"""Distance of a wall from the way beside it, m."""
SAME = 0.02
"""Greatest difference of two commands that should be equal, as a share of the robot's limits."""
MOST_TURNS, MOST_WEAVES = 2.0 * math.tau, 4.0 * math.tau
"""Most turning on the way to a target in the open, and beside a wall, rad; turns to both sides add up."""
TRAPPED = 40
"""Consecutive trapped ticks after which a drive is over, since a recovery would start."""
# Methods with a memory, as histograms, need several scans before their command settles.
LOOKS = 30
"""Ticks for which a stopped robot is shown a scene before its commands are compared."""
MOST_STILL = 0.02
"""Greatest speed at which a robot counts as stopped, m/s."""


def _given(make: Maker, scene: Scene, stamp_ns: int, pose: Pose, twist: tuple[float, float]) -> AvoiderInput:
    wanted = towards(pose, scene.target)
    return AvoiderInput(
        stamp_ns, tuple(scan_from(scene, laser, pose, stamp_ns) for laser in scene.lasers),
        estimate_at(stamp_ns, pose, twist),
        Point2D(*scene.target), 0.5 * scene.width + 0.1, Twist2D(wanted[0], 0.0, wanted[1]), 0.0,
        sensors=tuple(laser.name for laser in scene.lasers),
        extra=make.extra(scene, stamp_ns, pose, twist, desired=wanted, corridor=0.5 * scene.width + 0.1),
    )  # fmt: skip


def drive_avoider(make: Maker, scene: Scene, seconds: float) -> FinishedDrive:
    """Drive to the target until it is reached, the robot is in contact, trapped or stopped, or the time is up."""
    if not make.sees(RangeScan) and scene.obstacles:
        # Not a failure: the claim may hold with the sensors that it does read.
        raise Unfit("it takes no RangeScan: it sees nothing of the scenes")
    avoider = make(scene)
    trapped = 0

    def step(stamp_ns: int, pose: Pose, twist: tuple[float, float]) -> tuple[float, float] | str:
        nonlocal trapped
        if math.hypot(pose[0] - scene.target[0], pose[1] - scene.target[1]) < NEAR:
            return "reached"
        answer = avoider.avoid(_given(make, scene, stamp_ns, pose, twist))
        trapped = trapped + 1 if answer.status == "trapped" else 0
        return "trapped" if trapped > TRAPPED else (answer.twist.vx, answer.twist.wz)

    return drive(scene, seconds, step)


def _ended(done: FinishedDrive) -> str:
    return done.ended or f"still driving after {0.05 * (len(done.poses) - 1):.0f} s"


# --- scenes -----------------------------------------------------------------------------------------------------------


def open_scene(seed: int) -> Scene:
    """An open floor with a target 3 m away, in another direction for each seed.

    In the last four of twelve scenes, the robot has sonars alone, and the target is ahead, beside a wall; in two of
    these, the sonars reach 1 m only, so that most hear nothing.
    """
    if seed % 12 >= 8:
        side = 1.0 if seed % 2 else -1.0
        beside = wall(-1.0, side * BESIDE, 4.0, side * BESIDE)
        scene = Scene(Place(0.0, 0.0, side * (0.4, -0.4)[seed % 4 // 2]), (3.0, 0.0), (beside,), lasers=SONARS)
        if seed % 12 >= 10:
            scene = replace(scene, lasers=SHORT_SONARS)
        return scene.moved(place_in_map(seed))
    # Both sides and behind: a method that is good at one side only must not pass by luck of the seed.
    bearing = (0.0, 0.9, -0.9, 1.7, -1.7, 2.6, -2.6, 0.3)[seed % 12]
    place = place_in_map(seed)
    return Scene(Place(0.0, 0.0), (3.0 * math.cos(bearing), 3.0 * math.sin(bearing))).moved(place)


def blocked_scene(seed: int) -> Scene:
    """Obstacles between the robot and its target: a wall, a post, posts, a dead end, a wall beside the way.

    In every fourth scene the robot points away from its target; from the seventh on, it has two lasers, fore and aft.
    In three scenes, a small robot begins in front of a wall. In the last 11 of 26, it has sonars alone; in four of
    these, a wall is behind it, or the sonars are few and their cones wide.
    """
    number = seed % 26
    if 12 <= number < 15:
        return near_scene(seed)
    if number >= 24:
        return wide_scene(seed)
    if number >= 22:
        return leaving_scene(seed)
    stream = np.random.default_rng([seed, 1])
    side, off = float(stream.choice([-1.0, 1.0])), float(stream.uniform(-0.25, 0.25))
    plain = Scene(Place(0.0, 0.0), (5.0, 0.0))
    kinds = (
        replace(plain, obstacles=(wall(2.0, -3.0, 2.0, 3.0),)),
        replace(plain, obstacles=(post(1.8, off, 0.2),)),
        replace(plain, obstacles=(wall(1.2, -1.5 + off, 3.0, 1.5 + off),)).moved(Place(0.0, 0.0)),
        replace(plain, obstacles=_posts(stream)),
        replace(plain, obstacles=(wall(-0.5, 0.8, 3.5, 0.8), wall(-0.5, -0.8, 3.5, -0.8), wall(3.5, -0.8, 3.5, 0.8))),
        replace(plain, obstacles=(post(3.0, side * -1.0, 0.3), wall(1.5, side * -0.3, 1.5, side * 3.0))),
        replace(plain, target=(3.0, side * 2.0), obstacles=(wall(-1.0, side * 0.7, 6.0, side * 0.7),)),
        # Seen from one side alone, as a mirror image or not at all on that side.
        replace(plain, obstacles=(wall(1.5, 0.1, 1.5, 3.0),)),
        replace(plain, obstacles=(wall(1.5, -0.1, 1.5, -3.0),)),
    )
    scene = kinds[number % 7 if number < 20 else number - 13]
    if seed % 4 == 3:
        scene = replace(scene, start=Place(0.0, 0.0, side * 2.7))
    sensors = ALL_ROUND if number < 6 else TWO_LASERS if number < 12 else SONARS
    return replace(scene, lasers=sensors).moved(place_in_map(seed))


def near_scene(seed: int) -> Scene:
    """A wall 6 cm ahead of the circle in which a small robot turns, so that echoes are near from the first step on."""
    side = (0.3, 0.2, 0.4)[seed % 3]
    ahead, slant = math.hypot(0.5 * side, 0.5 * side) + 0.06, (0.0, 0.3, -0.3)[seed % 3]
    obstacles = (wall(ahead, -3.0, ahead, 3.0),)
    scene = Scene(Place(0.0, 0.0, slant), (4.0, 0.0), obstacles, length=side, width=side)
    return scene.moved(place_in_map(seed))


def leaving_scene(seed: int) -> Scene:
    """A wall 4 cm behind a robot, which its rear would touch if it turned in place to its target.

    Only sonars that look back see the wall; ahead and on both sides, the floor is free.
    """
    side = 1.0 if seed % 2 else -1.0
    plain = Scene(Place(0.0, 0.0), (-3.0, side * 3.0), lasers=SONARS)
    behind = -0.5 * plain.length - 0.04
    return replace(plain, obstacles=(wall(behind, -1.0, behind, 1.0),)).moved(place_in_map(seed))


def wide_scene(seed: int) -> Scene:
    """Posts that one of few sonars sees alone, or on the flanks of their wide cones, where no axis leads to them."""
    ahead = (post(1.1, 0.0, 0.1), post(1.8, 0.1, 0.1))
    aside = (post(1.1, 0.15, 0.1), post(1.8, -0.15, 0.1))
    posts = aside if seed % 2 else ahead
    return Scene(Place(0.0, 0.0), (4.0, 0.0), posts, lasers=WIDE_SONARS).moved(place_in_map(seed))


def tight_scene(seed: int) -> Scene:
    """Blocked scenes with long and wide robots, and a wall with a gap that is too narrow for the robot.

    In the last four of sixteen scenes, the robot has sonars alone.
    """
    stream = np.random.default_rng([seed, 2])
    length, width = ((1.2, 0.4), (0.5, 1.0), (1.0, 0.8))[seed % 3]
    sensors = SONARS if seed % 16 >= 12 else ()
    if seed % 2:
        scene = blocked_scene(seed // 2 % 12)
        return replace(scene, length=length, width=width, lasers=sensors or scene.lasers)
    half = 0.5 * width + float(stream.choice([-0.15, -0.05]))
    walls = (wall(1.8, half, 1.8, 3.0), wall(1.8, -3.0, 1.8, -half))
    scene = Scene(Place(0.0, 0.0), (4.0, 0.0), walls, length=length, width=width, lasers=sensors or ALL_ROUND)
    return scene.moved(place_in_map(seed))


def closed_scene(seed: int) -> Scene:
    """A robot that is closed in by a ring of posts or by a box."""
    reach = 0.36 + 0.02 * (seed % 4)
    target = (4.0 * math.cos(seed), 4.0 * math.sin(seed))
    if seed % 2:
        box = (wall(-reach, -reach, reach, -reach), wall(reach, -reach, reach, reach),
               wall(reach, reach, -reach, reach), wall(-reach, reach, -reach, -reach))  # fmt: skip
        return Scene(Place(0.0, 0.0), target, box).moved(place_in_map(seed))
    ring = [(math.cos(math.tau * k / 24), math.sin(math.tau * k / 24)) for k in range(24)]
    posts = tuple(post((reach + 0.1) * x, (reach + 0.1) * y, 0.1) for x, y in ring)
    return Scene(Place(0.0, 0.0), target, posts).moved(place_in_map(seed))


def look_scene(seed: int) -> Scene:
    """A stopped robot at the origin, with a few posts and at times a wall at random places around it."""
    stream = np.random.default_rng([seed, 3])
    posts = _posts(stream, count=int(stream.integers(1, 5)))
    beside = wall(*stream.uniform(-1.0, 4.0, 2).tolist(), *stream.uniform(1.5, 4.0, 2).tolist())
    # A wall too close leaves only commands to stop, and comparing those shows nothing.
    walls = (beside,) if seed % 2 and _away(beside) > 0.9 else ()
    bearing = float(stream.uniform(-1.0, 1.0))
    return Scene(Place(0.0, 0.0), (4.0 * math.cos(bearing), 4.0 * math.sin(bearing)), (*posts, *walls))


def _away(beside: Box) -> float:
    return Scene(Place(0.0, 0.0), (1.0, 0.0), (beside,), length=0.02, width=0.02).gap(0.0, 0.0, 0.0)


def _posts(stream: np.random.Generator, count: int = 5) -> tuple[Cylinder, ...]:
    """Posts ahead; their centres are over 1.2 m from the start, 1 m from the target and 1.6 m from each other."""
    found: list[Cylinder] = []
    for x, y, r in stream.uniform((0.8, -2.0, 0.1), (4.2, 2.0, 0.3), (200, 3)).tolist():
        others = [(p.x, p.y) for p in found]
        is_far = math.hypot(x, y) > 1.2 and math.hypot(x - 5.0, y) > 1.0
        if is_far and all(math.hypot(x - a, y - b) > 1.6 for a, b in others):
            found.append(post(x, y, r))
        if len(found) == count:
            break
    return tuple(found)


def place_in_map(seed: int) -> Place:
    """Place of a scene in the map: the origin for seed 0, a random one for others."""
    stream = np.random.default_rng([seed, 4])
    # At the origin alone, a method that confuses the map and base frames would pass.
    x, y, heading = stream.uniform((-4.0, -4.0, -3.0), (4.0, 4.0, 3.0)).tolist()
    return Place(0.0, 0.0) if seed == 0 else Place(x, y, heading)


# --- measures ---------------------------------------------------------------------------------------------------------


def reaches(make: Maker, scene: Scene) -> Measured:
    done = drive_avoider(make, scene, 45.0)
    x, y, _ = done.poses[-1].tolist()
    left = math.hypot(x - scene.target[0], y - scene.target[1])
    turned = float(np.abs(done.twists[:, 1]).sum()) * PERIOD
    said = f"ended {left:.2f} m from its target ({_ended(done)}), after {turned / math.tau:.1f} full turns"
    most = MOST_WEAVES if scene.walls else MOST_TURNS
    return Measured(done.ended == "reached" and turned <= most, said, left, (done.line,))


def no_contact(make: Maker, scene: Scene) -> Measured:
    done = drive_avoider(make, scene, 20.0)
    speed = abs(done.twists[-1, 0])
    how = f"touched something at {speed:.2f} m/s" if done.gap <= 0.0 else f"kept {done.gap:.3f} m away"
    return Measured(done.gap > 0.0, how, done.gap, (done.line,))


def stops_when_closed(make: Maker, scene: Scene) -> Measured:
    done = drive_avoider(make, scene, 6.0)
    # The first half is for looking around and braking.
    late = np.abs(done.twists[len(done.twists) // 2 :, 0])
    speed = float(late.max(initial=0.0))
    if done.gap <= 0.0:
        return Measured(False, "touched the obstacles around it", 0.0, (done.line,))
    return Measured(speed <= MOST_STILL, f"drove at {speed:.3f} m/s", speed, (done.line,))


def _answers(make: Maker, scene: Scene) -> tuple[float, float]:
    """Command to a stopped robot after it was shown a scene for a while: speed, m/s, and turn rate, rad/s."""
    avoider, pose = make(scene), (scene.start.x, scene.start.y, scene.start.heading)
    twist = Twist2D(0.0, 0.0, 0.0)
    for tick in range(LOOKS):
        twist = avoider.avoid(_given(make, scene, tick * PERIOD_NS, pose, (0.0, 0.0))).twist
    return twist.vx, twist.wz


def _alike(make: Maker, scene: Scene, other: Scene, sign: float) -> Measured:
    """Compare the commands in two scenes; `sign` is -1 if the second scene must give the opposite turn rate."""
    (v, w), (v2, w2) = _answers(make, scene), _answers(make, other)
    robot = robot_of(scene)
    off = max(abs(v - v2) / robot.max_linear, abs(w - sign * w2) / robot.max_angular)
    said = f"commanded {v:.3f} m/s, {w:.3f} rad/s, and {v2:.3f} m/s, {w2:.3f} rad/s in the other scene"
    pairs = (_arrow("here", scene, v, w), _arrow("other scene", other, v2, w2))
    return Measured(off <= SAME, said, off, pairs, (scene, other))


def _arrow(name: str, scene: Scene, v: float, w: float) -> Line:
    """Track of a robot that follows a command for 3 s."""
    s, points = scene.start, []
    for t in np.linspace(0.0, 3.0, 20).tolist():
        turn = w * t
        ahead, left = (v * t, 0.0) if abs(w) < 1e-6 else (v / w * math.sin(turn), v / w * (1.0 - math.cos(turn)))
        cos, sin = math.cos(s.heading), math.sin(s.heading)
        points.append((s.x + cos * ahead - sin * left, s.y + sin * ahead + cos * left, s.heading + turn))
    return Line(name, np.array(points))


def translation(make: Maker, scene: Scene) -> Measured:
    return _alike(make, scene, scene.moved(Place(3.37, -1.81)), 1.0)


def rotation(make: Maker, scene: Scene) -> Measured:
    return _alike(make, scene, scene.moved(Place(0.0, 0.0, 0.7)), 1.0)


def mirror(make: Maker, scene: Scene) -> Measured:
    return _alike(make, scene, scene.mirrored(), -1.0)


AVOIDERS = (
    Behaviour("avoider", Claim.REACHES,
              f"to come within {NEAR} m in 45 s and at most two full turns, four beside a wall",
              open_scene, reaches, 12),
    Behaviour("avoider", Claim.NO_CONTACT, "to touch nothing in 20 s", blocked_scene, no_contact, 26),
    Behaviour("avoider", Claim.FOOTPRINT, "to touch nothing in 20 s", tight_scene, no_contact, 16),
    Behaviour("avoider", Claim.STOPS_WHEN_CLOSED, f"at most {MOST_STILL} m/s after 3 s", closed_scene,
              stops_when_closed, 4, False),
    Behaviour("avoider", Claim.TRANSLATION, f"the same within {SAME:.0%} of the limits", look_scene, translation, 12),
    Behaviour("avoider", Claim.ROTATION, f"the same within {SAME:.0%} of the limits", look_scene, rotation, 12),
    Behaviour("avoider", Claim.MIRROR, f"the mirror image within {SAME:.0%} of the limits", look_scene, mirror, 12),
)  # fmt: skip
