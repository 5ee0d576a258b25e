"""Scenes and measures of controllers: straights, bends to both sides, and turning in place at the end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from navloom.geometry.world import Place
from navloom.messages import Point2D, Pose2D, Reference, Trajectory
from navloom.roles import ControllerInput
from navloom.roles.claims import Claim
from navloom.roles.extra import Extras
from numpy.typing import NDArray

from navloom_check.behaviour.measurements import Behaviour, Line, Maker, Measured, robot_of
from navloom_check.behaviour.obstacle_scene import Scene
from navloom_check.behaviour.scene_drives import FinishedDrive, Pose, drive, estimate_at

__all__ = ["CONTROLLERS"]

Floats = NDArray[np.float64]

OFF = 0.08
"""Greatest distance of the robot from its trajectory once it has settled, m."""
SETTLED = 0.6
"""Share of the drive after which the robot must have settled."""
# The framework replans while it drives; a new number for the same way must not disturb a controller.
REPLANNED = 0.3
"""Share of the trajectory at which it is replaced by an equal one with a new path number."""
END = 0.2
"""Goal tolerance, m: within half of it, the robot has reached the end of its trajectory and turns in place."""
TURNED = 0.1
"""Greatest error of the heading after the turn in place, rad."""
SWINGS, SWINGING = 40, 0.2
"""Last ticks of a drive, and the mean turn rate in them from which a robot counts as swinging, rad/s."""
SAME = 0.02
"""Greatest difference of two commands that should be equal, as a share of the robot's limits."""


def samples_of(scene: Scene) -> Floats:
    """(n, 6) samples of the trajectory along the scene's way, as `Trajectory` has them."""
    gentle = replace(robot_of(scene), max_deceleration=0.5)
    # Here, as in `navloom_check.builders`.
    from navloom.navigation.trajectory import SpeedLimits, make_trajectory

    limits = SpeedLimits(gentle, 0.2, 0.4, 0.3)
    return make_trajectory(np.array(scene.way), limits).samples


def way_scene(seed: int) -> Scene:
    """A straight way, a bend to either side, or an S; the robot starts beside its beginning with another heading."""
    ways = (
        ((0.0, 0.0), (5.0, 0.0)),
        ((0.0, 0.0), (2.0, 0.0), (4.0, 2.0), (4.0, 4.0)),
        ((0.0, 0.0), (2.0, 0.0), (4.0, -2.0), (4.0, -4.0)),
        ((0.0, 0.0), (1.5, 0.0), (3.0, 1.5), (4.5, 1.5), (6.0, 0.0), (7.5, 0.0)),
    )
    stream = np.random.default_rng([seed, 7])
    way = ways[seed % len(ways)]
    off, turned = (0.0, 0.0) if seed == 0 else stream.uniform((-0.25, -0.5), (0.25, 0.5)).tolist()
    place = Place(*stream.uniform((-4.0, -4.0, -3.0), (4.0, 4.0, 3.0)).tolist()) if seed else Place(0.0, 0.0)
    return Scene(Place(0.0, off, turned), way[-1], way=way).moved(place)


class Referee:
    """Stands in for the reference node. On the way, it replaces the trajectory by an equal one with a new path number.

    Args:
        samples: (n, 6) samples of the trajectory.
        turn_to: Heading to turn to at its end, rad; None for none.
        extra: Makes the extra inputs of the controller, from stamp, pose and twist.
    """

    def __init__(self, samples: Floats, turn_to: float | None, extra: Callable[..., Extras]) -> None:
        self.samples, self.turn_to, self.extra, self.progress = samples, turn_to, extra, 0.0
        self.trajectory, self.later = Trajectory(1, samples), Trajectory(2, samples)
        self.stops_here = False

    def given(self, stamp_ns: int, pose: Pose, twist: tuple[float, float]) -> ControllerInput:
        from navloom.navigation.trajectory_projection import project, way_ahead

        at = project(self.samples, *pose, self.progress, 1.0)
        self.progress = at.progress
        self.cross_track = at.cross_track
        if at.progress > REPLANNED * float(self.samples[-1, 0]):
            self.trajectory = self.later
        reference = Reference(
            self.trajectory.path_id, at.progress, float(self.samples[-1, 0]) - at.progress,
            Pose2D(at.x, at.y, at.heading), at.speed,
            at.turn_rate, at.cross_track, Point2D(at.target_x, at.target_y), way_ahead(self.samples, at.progress, 1.0),
            0.4, self.turn_to if self.stops_here else None,
        )  # fmt: skip
        extra = self.extra(stamp_ns, pose, twist, samples=self.samples)
        return ControllerInput(stamp_ns, self.trajectory, reference, estimate_at(stamp_ns, pose, twist), extra)


def follow(make: Maker, scene: Scene, turn: float) -> tuple[FinishedDrive, list[float], Referee]:
    """Follow the scene's way to its end, then turn in place by an angle, rad.

    Returns:
        The drive, the cross-track error of each tick before the turn, m, and the referee.
    """
    samples = samples_of(scene)
    referee = Referee(samples, math.remainder(float(samples[-1, 3]) + turn, math.tau), partial(make.extra, scene))
    controller, beside = make(scene), list[float]()
    # Twice the time at the lower speed limit, and some for the turn.
    seconds = 2.0 * float(samples[-1, 0]) / 0.2 + 20.0

    def step(stamp_ns: int, pose: Pose, twist: tuple[float, float]) -> tuple[float, float] | str:
        end_x, end_y = samples[-1, 1:3].tolist()
        referee.stops_here |= math.hypot(pose[0] - end_x, pose[1] - end_y) < 0.5 * END
        given = referee.given(stamp_ns, pose, twist)
        if not referee.stops_here:
            beside.append(referee.cross_track)
        assert referee.turn_to is not None
        off = abs(math.remainder(referee.turn_to - pose[2], math.tau))
        if referee.stops_here and off < 0.5 * TURNED and abs(twist[1]) < 0.05:
            return "turned"
        answer = controller.control(given)
        return answer.twist.vx, answer.twist.wz

    return drive(scene, seconds, step), beside, referee


def settles(make: Maker, scene: Scene) -> Measured:
    done, beside, referee = follow(make, scene, 1.0 if scene.start.y >= 0.0 else -1.0)
    samples = referee.samples
    lines = (Line("reference", samples[:, 1:3]), done.line)
    left = float(samples[-1, 0]) - referee.progress
    late = np.abs(beside[round(SETTLED * len(beside)) :]).max(initial=0.0)
    if not referee.stops_here:
        return Measured(False, f"was {left:.2f} m from the end of its trajectory when the time was up", left, lines)
    if late > OFF:
        return Measured(False, f"was {late:.3f} m beside its trajectory after {SETTLED:.0%} of the way", late, lines)
    assert referee.turn_to is not None
    off = abs(math.remainder(referee.turn_to - float(done.poses[-1, 2]), math.tau))
    if off > TURNED:
        return Measured(False, f"was {off:.3f} rad from its goal heading after turning in place", float(late), lines)
    swings = float(np.abs(done.twists[-SWINGS:, 1]).mean())
    said = f"swung at {swings:.2f} rad/s about its goal heading at the end"
    # One that holds its heading, but never quite stands still, is good enough.
    return Measured(done.ended == "turned" or swings < SWINGING, said, float(late), lines)


def _answers(make: Maker, scene: Scene) -> tuple[float, float]:
    referee = Referee(samples_of(scene), None, partial(make.extra, scene))
    given = referee.given(0, (scene.start.x, scene.start.y, scene.start.heading), (0.2, 0.0))
    twist = make(scene).control(given).twist
    return twist.vx, twist.wz


def _alike(other_of: Callable[[Scene], Scene], sign: float) -> Callable[[Maker, Scene], Measured]:
    def measure(make: Maker, scene: Scene) -> Measured:
        other = other_of(scene)
        (v, w), (v2, w2) = _answers(make, scene), _answers(make, other)
        robot = robot_of(scene)
        off = max(abs(v - v2) / robot.max_linear, abs(w - sign * w2) / robot.max_angular)
        said = f"commanded {v:.3f} m/s, {w:.3f} rad/s, and {v2:.3f} m/s, {w2:.3f} rad/s in the other scene"
        lines = (
            Line("reference", samples_of(scene)[:, 1:3]),
            Line("reference, other scene", samples_of(other)[:, 1:3]),
        )
        return Measured(off <= SAME, said, off, lines, (scene, other))

    return measure


def look_scene(seed: int) -> Scene:
    """A way anywhere in the map, with the robot beside its beginning."""
    scene = way_scene(seed + 1)
    start = scene.start
    return replace(scene, start=Place(start.x, start.y, start.heading)).moved(Place(0.0, 0.0))


CONTROLLERS = (
    Behaviour("controller", Claim.SETTLES,
              f"to be at most {OFF} m beside it after {SETTLED:.0%} of the way, reach its end and turn in place there",
              way_scene, settles, 8),
    Behaviour("controller", Claim.TRANSLATION, f"the same within {SAME:.0%} of the limits", look_scene,
              _alike(lambda scene: scene.moved(Place(3.37, -1.81)), 1.0), 12),
    Behaviour("controller", Claim.ROTATION, f"the same within {SAME:.0%} of the limits", look_scene,
              _alike(lambda scene: scene.moved(Place(0.0, 0.0, 0.7)), 1.0), 12),
    Behaviour("controller", Claim.MIRROR, f"the mirror image within {SAME:.0%} of the limits", look_scene,
              _alike(Scene.mirrored, -1.0), 12),
)  # fmt: skip
