"""Who drove into whom, in made cases whose answer is worked out by hand.

The robot is 0.5 m square and begins at the origin heading +x; people are discs of 0.25 m radius unless told. So a
person ahead is touched at 0.5 m, and one beside the robot's front corner at less. Ticks are 0.05 s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from navloom.geometry.actors import Actor, Body, Course
from navloom.geometry.collision import clearance
from navloom.geometry.frames import transform
from navloom.geometry.moving_world import Mover, MovingWorld, RobotBody
from navloom.geometry.nearest_points import nearest_points
from navloom.geometry.world import Box, Place, World
from navloom.runs.contacts import Evidence, Touch, _moved, touches_of

PERIOD = 0.05
SQUARE = np.array([[-0.25, -0.25], [0.25, -0.25], [0.25, 0.25], [-0.25, 0.25]])
Leg = tuple[float, float, float]
"""From a time on, s: forward speed, m/s, and turn rate, rad/s."""
STILL: tuple[Leg, ...] = ((0.0, 0.0, 0.0),)
DISC = Body("disc", 0.5, 0.5, (0.0, 1.8))
LEGS = Body("legs", 0.44, 0.44, (0.0, 1.75))


@dataclass
class Case:
    name: str
    is_own: bool
    points: tuple[tuple[float, float, float], ...] = ()
    legs: Sequence[Leg] = STILL
    body: Body = DISC
    loops: bool = False
    appears_at: float = 0.0
    height: float = 0.6
    boxes: tuple[Box, ...] = ()


def driven(v: float, w: float = 0.0) -> tuple[Leg, ...]:
    return ((0.0, v, w),)


def straight(x0: float, y0: float, vx: float, vy: float) -> tuple[tuple[float, float, float], ...]:
    """Way points of a person at (x0, y0) at 0 s who walks at a velocity, m/s."""
    return ((0.0, x0, y0), (10.0, x0 + 10.0 * vx, y0 + 10.0 * vy))


def stands(x: float, y: float) -> tuple[tuple[float, float, float], ...]:
    return ((0.0, x, y),)


def turned(pose: np.ndarray, v: float, w: float) -> np.ndarray:
    x, y, heading = pose
    mean = heading + 0.5 * w * PERIOD
    return np.array([x + v * PERIOD * math.cos(mean), y + v * PERIOD * math.sin(mean), heading + w * PERIOD])


def run(case: Case, others: Sequence[tuple[Mover, float]] = (), ticks: int = 120) -> tuple[Touch, ...]:
    """The touches of a case. As in the simulator, the robot stays where the tick of a contact begins; there it ends.

    `others` are robots, each with its speed ahead, m/s.
    """
    actors = (Actor("it", Course(case.points, loops=case.loops), case.body, case.appears_at),) if case.points else ()
    world = World("made", case.boxes, actors=actors)
    robots = [RobotBody(f"r{k}", SQUARE, case.height) for k in range(2, 2 + len(others))]
    moving = MovingWorld(world, robots, PERIOD)
    pose, rows, seen, contacts = np.zeros(3), [], [], []
    for tick in range(ticks):
        time = tick * PERIOD
        at = [
            Mover(m.x + speed * time * math.cos(m.heading), m.y + speed * time * math.sin(m.heading), m.heading, speed)
            for m, speed in others
        ]
        bodies = moving.advance(round(time * 1e9), at)
        _, v, w = [leg for leg in case.legs if leg[0] <= time + 1e-9][-1]
        wanted = turned(pose, v, w) if tick else pose
        outline = transform(wanted, SQUARE)
        gaps = [
            (nearest_points(outline, part)[0], bodies.names[int(part[0])])
            for part in bodies.parts.tolist() if part[6] < case.height
        ]  # fmt: skip
        for box in case.boxes:
            alone = World("one", (box,))
            gaps.append((clearance(SQUARE, Place(*wanted), alone, height=case.height, time=time)[0], box.name))
        seen.append(bodies)
        touched = [name for gap, name in gaps if gap <= 0.0]
        if touched:
            rows.append((time, *pose, 0.0, 0.0, 0.0))
            contacts.append((tick, touched[0]))
            break
        pose = wanted
        rows.append((time, *pose, v, w, 0.0))
    assert contacts, "the case has no contact"
    return touches_of(Evidence(np.array(rows), SQUARE, case.height, seen, world), contacts)


SLIDING = Body("box", 1.0, 0.1, (0.0, 2.0))
TROLLEY = Body("trolley", 1.0, 0.6, (0.0, 0.9))
WALL = Box("wall", (1.0, 1.2), (-2.0, 2.0))

CASES = [
    # The robot stands: whatever comes is the other's.
    Case("a person walks at its front", False, straight(2.0, 0.0, -1.0, 0.0)),
    Case("a person walks at its back", False, straight(-2.0, 0.0, 1.0, 0.0)),
    Case("a person walks at its side", False, straight(0.0, 2.0, 0.0, -1.0)),
    Case("a person grazes it: 0.45 m beside its middle", False, straight(2.0, 0.45, -1.0, 0.0)),
    Case("a person walks at its corner", False, straight(2.0, 2.0, -1.0, -1.0)),
    Case("a person comes very slowly", False, straight(0.6, 0.0, -0.03, 0.0)),
    Case("a cart comes at 3 m/s", False, straight(6.0, 0.0, -3.0, 0.0), body=Body("box", 1.0, 0.6, (0.0, 1.0))),
    Case("a body begins its course again on it", False, ((0.0, 0.4, 0.0), (2.0, 8.0, 0.0)), loops=True, appears_at=1.0),
    Case("a person appears on it", False, stands(0.3, 0.0), appears_at=2.0),
    Case("legs walk at it", False, straight(2.0, 0.11, -1.0, 0.0), body=LEGS),
    Case("a trunk above a tall robot's side meets it", False, straight(2.0, 0.0, -1.0, 0.0), body=LEGS, height=1.2),
    Case("a trolley's posts are pushed at it", False, straight(2.0, 0.1, -0.5, 0.0), body=TROLLEY, height=0.4),
    Case("a trolley's deck is pushed over a tall one", False, straight(2.0, 0.0, -0.5, 0.0), body=TROLLEY, height=0.7),
    Case("a door slides at it", False, ((0.0, 0.0, 2.0), (4.0, 0.0, -2.0)), body=SLIDING),
    Case("a person comes in its first 0.3 s", False, straight(0.75, 0.0, -1.0, 0.0)),
    Case("a box appears on it", False, boxes=(Box("box", (0.1, 0.5), (-0.2, 0.2), appears_at=2.0),)),
    # It drives into what rests: its own.
    Case("it drives at a person", True, stands(2.0, 0.0), driven(0.5)),
    Case("it backs into a person", True, stands(-2.0, 0.0), driven(-0.5)),
    Case("it creeps at 0.04 m/s into a person, slower than the limit", True, stands(0.55, 0.0), driven(0.04)),
    Case("its side grazes a person beside its way", True, stands(2.0, 0.45), driven(0.5)),
    Case("it starts in the last tick, 1 cm before a person", True, stands(0.51, 0.0),
         ((0.0, 0.0, 0.0), (3.0, 0.5, 0.0))),
    Case("it drives into a post of a trolley", True, stands(2.0, 0.24), driven(0.5), body=TROLLEY, height=0.4),
    Case("it drives into a leg", True, stands(2.0, 0.0), driven(0.5), body=LEGS),
    Case("it drives into a wall", True, legs=driven(0.5), boxes=(WALL,)),
    Case("it backs into a wall", True, legs=driven(-0.5), boxes=(Box("wall", (-1.2, -1.0), (-2.0, 2.0)),)),
    Case("it drives into a box that appeared ahead", True, legs=driven(0.5),
         boxes=(Box("box", (1.5, 1.9), (-0.2, 0.2), appears_at=1.0),)),
    # At 2 s its middle is at 1.0 m, and was at 0.5 m: 0.15 m before the box that appears on it.
    Case("a box appears on it where it was not a second ago", True, legs=driven(0.5),
         boxes=(Box("box", (0.9, 1.3), (-0.2, 0.2), appears_at=2.0),)),
    # Turned by a, its side is 0.55 cos(a) - 0.25 m from the person's middle: 0.25 m at 0.43 rad, and there that point
    # of the side, 0.23 m from its middle, moves at 0.115 m/s along the normal.
    Case("it turns its side into a person", True, stands(0.55, 0.0), driven(0.0, 0.5)),
    # It touches at 0.14 rad, where that point is 0.07 m from the middle of the side: 0.004 m/s, but a person who rests
    # would not have been touched.
    Case("it turns its side slowly into a person", True, stands(0.505, 0.0), driven(0.0, 0.05)),
    Case("it turns slowly while a person walks at it", False, straight(2.0, 0.0, -1.0, 0.0), driven(0.0, 0.05)),
    # Both move along the line between them.
    Case("both drive head-on", True, straight(4.0, 0.0, -1.0, 0.0), driven(0.5)),
    Case("head-on at 0.04 m/s: a person would have come 0.04 m further", False, straight(3.0, 0.0, -1.0, 0.0),
         driven(0.04)),
    Case("head-on at 0.06 m/s, faster than the limit", True, straight(3.0, 0.0, -1.0, 0.0), driven(0.06)),
    Case("it flees ahead at 0.3 m/s from a person at 1 m/s", False, straight(-2.0, 0.0, 1.0, 0.0), driven(0.3)),
    Case("it backs away at 0.3 m/s from a person at 1 m/s", False, straight(2.0, 0.0, -1.0, 0.0), driven(-0.3)),
    # At 1.5 s it is at 0.75 m and stops; the person at 3.25 - t comes to 1.25 m at 2 s. Had it stood at 0.5 m since
    # 1 s, the person would have been there at 2.25 s.
    Case("it has stopped 0.5 s before a person comes", False, straight(3.25, 0.0, -1.0, 0.0),
         ((0.0, 0.5, 0.0), (1.5, 0.0, 0.0))),
    Case("it drives up behind a slower person", True, straight(1.0, 0.0, 0.1, 0.0), driven(0.5)),
    Case("a person comes past, cuts in and stops", True, ((0.0, -1.0, 0.8), (1.5, 1.6, 0.8), (2.0, 1.7, 0.0)),
         driven(0.5)),
    # A person crosses; at 2 s the robot's middle is at 1.0 m, and was at 0.5 m: from 0.25 to 0.75 m.
    Case("it drove 0.5 m into the way of one who crosses at 1.2 m", True, straight(1.2, 2.5, 0.0, -1.0), driven(0.5)),
    Case("one who crosses at 0.9 m would have met it anyway", False, straight(0.9, 2.5, 0.0, -1.0), driven(0.5)),
    Case("one who crosses behind its middle at 0.7 m", False, straight(0.7, 2.48, 0.0, -1.0), driven(0.5)),
    # At 2 s its middle is at 0.2 m, and was at 0.1 m: from -0.15 to 0.35 m; the person reaches from 0.05 m.
    Case("it creeps across the way of one who would meet it anyway", False, straight(0.3, 2.5, 0.0, -1.0),
         driven(0.1)),
    # It has stood for half a second; a second ago it reached to 1.75 m, and the person's way begins at 1.95 m.
    Case("it stops in the way of one who crosses", True, straight(2.2, 3.0, 0.0, -1.0),
         ((0.0, 1.0, 0.0), (2.0, 0.0, 0.0))),
    # It has stood there for more than a second.
    Case("it has long stopped in the way of one who crosses", False, straight(1.2, 4.5, 0.0, -1.0),
         ((0.0, 0.5, 0.0), (2.0, 0.0, 0.0))),
    Case("it turns into one who walks beside it", True, straight(0.0, 0.8, 0.5, 0.0), driven(0.5, 0.5)),
    # A second ago it was 0.5 m behind: the person passes 0.35 m from its corner there.
    Case("one who walks beside it turns into it", True, straight(0.0, 1.5, 0.5, -0.5), driven(0.5)),
    # The door closes at 2 s across 0.9 to 1.1 m; a second ago the robot reached to 0.75 m.
    Case("it drives into a door that closes", True, ((0.0, 1.0, 2.75), (4.0, 1.0, -1.25)), driven(0.5),
         body=Body("box", 1.0, 0.2, (0.0, 2.0))),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_contact_is_its_own_or_the_other_s(case: Case) -> None:
    (touch,) = run(case)
    assert touch.is_own == case.is_own


def test_there_are_forty_cases() -> None:
    assert len(CASES) >= 40 and len({case.name for case in CASES}) == len(CASES)


@pytest.mark.parametrize(
    ("own", "other", "is_own"),
    [(0.0, 0.5, False), (0.5, 0.0, True), (0.5, 0.5, True), (-0.2, 0.5, False)],
    ids=["it stands", "the other stands", "head-on", "it backs away"],
)
def test_between_two_robots_each_is_judged_for_itself(own: float, other: float, is_own: bool) -> None:
    (touch,) = run(Case("robots", is_own, legs=driven(own)), [(Mover(2.0, 0.0, math.pi), other)])
    assert (touch.name, touch.is_own) == ("r2", is_own)


def test_a_contact_has_its_time_and_place() -> None:
    """A person at 2 - t touches the front, at 0.25 m, at 1.5 s."""
    (touch,) = run(CASES[0])
    assert (touch.time, touch.x, touch.y) == (pytest.approx(1.5), pytest.approx(0.25), pytest.approx(0.0, abs=1e-3))


def test_a_contact_that_goes_on_began_once() -> None:
    truth = np.array([(k * PERIOD, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(9)])
    evidence = Evidence(truth, SQUARE, 0.6)
    found = touches_of(evidence, [(2, "wall"), (3, "wall"), (4, "post"), (7, "wall")])
    assert [touch.time for touch in found] == pytest.approx([0.1, 0.35])


def test_a_robot_that_drives_sideways_is_taken_to_go_on_sideways() -> None:
    """0.5 m/s to the left and half a turn in 2 s: half a circle of 0.318 m radius behind it."""
    pose = _moved(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5 * math.pi, 0.5]), 2.0)
    assert pose == pytest.approx([-2.0 / math.pi, 0.0, math.pi])
