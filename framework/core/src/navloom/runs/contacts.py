"""Who drove into whom: each contact of a robot is its own or the other's."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.collision import clearance, overlap_depth
from navloom.geometry.frames import transform
from navloom.geometry.nearest_points import nearest_points
from navloom.geometry.world import Place, World
from navloom.messages import Bodies

__all__ = ["APPROACH", "STOOD", "Evidence", "Touch", "signed_clearance", "touches_of"]

Floats = NDArray[np.float64]
APPROACH = 0.05
"""Speed along the normal of the contact above which the robot's own point drives into it, m/s."""
STOOD = 1.0
"""How long before a contact the robot is taken to have stood, s; what moves then is followed as long after it."""
_NEAR = 1e-4
"""Gap up to which the moment of a contact is searched, m: its normal is still well defined."""
_JUMP = 0.5
"""A part that goes this much farther in a tick than its body's speed says begins its course again elsewhere, m."""


@dataclass(frozen=True)
class Touch:
    """A contact that began.

    Attributes:
        time: Run time, s.
        name: What the robot touched.
        x, y: Where, m, map frame.
        is_own: The robot drove into it, or it would not have happened had the robot stood for the last second.
    """

    time: float
    name: str
    x: float
    y: float
    is_own: bool


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is judged.

    Attributes:
        truth: (n, 7) time, s, x, y, m, heading, rad, map frame, forward speed, m/s, turn rate, rad/s, and speed to the
            left, m/s, in each tick.
        footprint: (k, 2) corners of the robot's convex outline, counter-clockwise, m, base frame.
        height: Of the robot, m.
        bodies: What moved, by increasing stamp; empty where nothing but the robot moves.
        world: The world, of which only what stands is looked at; None where it is not known.
    """

    truth: Floats
    footprint: Floats
    height: float
    bodies: Sequence[Bodies] = ()
    world: World | None = None


def touches_of(drive: Evidence, contacts: Sequence[tuple[int, str]]) -> tuple[Touch, ...]:
    """The contacts that began, each judged.

    Args:
        drive: The drive.
        contacts: Row of `drive.truth`, and name of what is touched, of each tick with contact, in order.
    """
    rows = [row for row, _ in contacts]
    began = [(row, name) for k, (row, name) in enumerate(contacts) if k == 0 or rows[k - 1] != row - 1]
    times = [bodies.stamp_ns * 1e-9 for bodies in drive.bodies]
    return tuple(_touch(drive, times, row, name) for row, name in began)


def signed_clearance(drive: Evidence, gaps: Floats, contacts: Sequence[tuple[int, str]]) -> Floats:
    """(n,) clearances, m; minus the depth of the overlap where the simulator reports contact.

    Args:
        drive: The drive.
        gaps: (n,) clearances as the simulator gives them, m.
        contacts: As for `touches_of`.
    """
    signed, times = gaps.copy(), [bodies.stamp_ns * 1e-9 for bodies in drive.bodies]
    for row, name in contacts:
        time, *pose = drive.truth[row, :4].tolist()
        depth, place = 0.0, bisect_left(times, time - 1e-6)
        if place < len(times) and name in drive.bodies[place].names:
            outline = transform(np.array(pose), drive.footprint)
            parts = _parts_of(drive.bodies[place], name, drive.height)
            depth = max([0.0, *(-nearest_points(outline, part)[0] for part in parts.tolist())])
        elif drive.world is not None:
            depth = overlap_depth(drive.footprint, Place(*pose), drive.world, name, time)
        else:
            continue
        signed[row] = -depth if depth > 0.0 else 0.0
    return signed


def _touch(drive: Evidence, times: Sequence[float], row: int, name: str) -> Touch:
    time = float(drive.truth[row, 0])
    place = bisect_left(times, time - 1e-6)
    is_body = place < len(times) and name in drive.bodies[place].names
    if not is_body:
        return _touch_of_standing(drive, row, name)
    point, normal, speed = _meeting(drive, place, row, name)
    is_own = float(speed @ normal) > APPROACH or not _would_touch(drive, times, place, row, name)
    return Touch(time, name, float(point[0]), float(point[1]), is_own)


def _touch_of_standing(drive: Evidence, row: int, name: str) -> Touch:
    """The contact with what stands: the other's only if it appeared where the robot stood."""
    time, x, y = drive.truth[row, :3].tolist()
    stood = _row_before(drive, time - STOOD)
    is_own = True
    if drive.world is not None:
        obstacles = tuple(o for o in drive.world.obstacles if o.name == name)
        raster = drive.world.raster if drive.world.raster is not None and drive.world.raster.name == name else None
        alone = replace(drive.world, obstacles=obstacles, raster=raster, actors=())
        at = Place(*drive.truth[stood, 1:4].tolist())
        is_own = clearance(drive.footprint, at, alone, height=drive.height, time=time, sweep_ended=True)[0] > 0.0
    return Touch(time, name, x, y, is_own)


def _parts_of(bodies: Bodies, name: str, height: float) -> Floats:
    """(p, 9) parts of a body that a robot of this height can touch."""
    parts = bodies.parts[bodies.parts[:, 0] == bodies.names.index(name)] if name in bodies.names else bodies.parts[:0]
    touched: Floats = parts[(parts[:, 6] < height) & (parts[:, 7] > 0.0)]
    return touched


def _row_before(drive: Evidence, time: float) -> int:
    """The last row at or before a time, s; the first one if there is none."""
    return max(int(np.searchsorted(drive.truth[:, 0], time + 1e-6)) - 1, 0)


def _meeting(drive: Evidence, place: int, row: int, name: str) -> tuple[Floats, Floats, Floats]:
    """Point, normal, and velocity of the robot's point there, of a contact that began within the tick before a row.

    The robot is taken to go on through the tick as it moved at its beginning: a simulator stops it where it touches.
    """
    before = drive.truth[max(row - 1, 0)]
    length = float(drive.truth[row, 0] - before[0])
    ends = _parts_of(drive.bodies[place], name, drive.height)
    begins = _parts_of(drive.bodies[place - 1], name, drive.height) if place else ends
    speed = float(np.hypot(*drive.bodies[place].velocities[drive.bodies[place].names.index(name), :2]))
    gone = np.hypot(*(ends[:, 1:3] - begins[:, 1:3]).T) if len(begins) == len(ends) else np.full(len(ends), np.inf)
    # The foot of a walking person swings at twice the speed of the body.
    is_jump = len(begins) != len(ends) or bool((gone > 2.0 * speed * length + _JUMP).any())
    begins = ends if is_jump else begins

    def look(share: float) -> tuple[float, Floats, Floats]:
        outline = transform(_moved(before, share * length), drive.footprint)
        parts = begins.copy()
        parts[:, 1:3] += share * (ends[:, 1:3] - begins[:, 1:3])
        return min((nearest_points(outline, part) for part in parts.tolist()), key=lambda found: found[0])

    low, high, share = 0.0, 1.0, 1.0
    if not is_jump and look(0.0)[0] > 0.0:
        while True:
            gap = look(share)[0]
            if 0.0 < gap <= _NEAR or (share == 1.0 and gap > 0.0) or high - low < 1e-9:
                break
            low, high = (share, high) if gap > 0.0 else (low, share)
            share = 0.5 * (low + high)
    _, point, normal = look(share)
    x, y, heading = _moved(before, share * length).tolist()
    forward, turn, left = before[4:].tolist()
    velocity = transform(np.array([0.0, 0.0, heading]), np.array([[forward, left]]))[0]
    return point, normal, velocity + turn * np.array([y - point[1], point[0] - x])


def _moved(before: Floats, time: float) -> Floats:
    """(3,) pose after a time, s, at the velocity of a row."""
    _, x, y, heading, forward, turn, left = before.tolist()
    half = 0.5 * turn * time
    share = time * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    mean = np.array([x, y, heading + half])
    return np.array([*transform(mean, np.array([[share * forward, share * left]]))[0], heading + turn * time])


def _would_touch(drive: Evidence, times: Sequence[float], place: int, row: int, name: str) -> bool:
    """Whether a body would have touched the robot had it stood for the last second, up to a second later."""
    time = float(drive.truth[row, 0])
    stood = drive.truth[_row_before(drive, time - STOOD)]
    outline = transform(stood[1:4], drive.footprint)

    def touches(parts: Floats) -> bool:
        return any(nearest_points(outline, part)[0] <= 0.0 for part in parts.tolist())

    first, last = bisect_left(times, float(stood[0]) - 1e-6), bisect_left(times, time + STOOD + 1e-6)
    if any(touches(_parts_of(bodies, name, drive.height)) for bodies in drive.bodies[first:last]):
        return True
    # A robot that this one blocks stays where its tick began; it would have gone on, at most at twice its speed.
    at, tick = drive.bodies[place], time - float(drive.truth[max(row - 1, 0), 0])
    number = at.names.index(name)
    if number >= len(at.names) - at.robots:
        parts = _parts_of(at, name, drive.height).copy()
        parts[:, 1:3] += 2.0 * tick * at.velocities[number, :2]
        if touches(parts):
            return True
    # Where the run ended with the contact, the body goes on as it did.
    end = drive.bodies[last - 1]
    if name not in end.names or times[last - 1] >= time + STOOD - 1e-6:
        return False
    velocity = end.velocities[end.names.index(name), :2]
    left = time + STOOD - times[last - 1]
    for later in np.linspace(0.0, left, max(2, math.ceil(left / 0.02) + 1)):
        parts = _parts_of(end, name, drive.height).copy()
        parts[:, 1:3] += later * velocity
        if touches(parts):
            return True
    return False
