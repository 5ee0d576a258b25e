"""Roll-out of a robot that follows a command for one period and then brakes to standstill, and what it touches.

The robot is modelled as dead time plus first-order lag: a command acts `dead_time` after it was given, and linear and
turn speed then approach it with the time constant `lag`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.roles import RobotSpec

__all__ = [
    "ESCAPE",
    "HEADWAY",
    "MOST_POSES",
    "STANDS",
    "distance_to_outline",
    "escapes",
    "first_meeting",
    "first_touch",
    "margins",
    "stopping_way",
    "ways_on",
    "within",
]

Floats = NDArray[np.float64]

MOST_POSES = 512
"""Most poses of a roll-out."""
STEP = 0.01
"""Step of the roll-out, s."""
LONGEST = 12.0
"""Longest roll-out, s: a robot that has not stopped by then has almost no deceleration."""
FINE = 0.02
"""Largest motion of any point of the footprint between two poses of a roll-out, m."""
NEARER = 1e-5
"""Smallest approach to a point that counts as moving into it, m; less is rounding."""
DOUBT, MOST_DOUBT = 0.1, 0.03
"""Margin per speed of the footprint beside an obstacle, s, and at most, m: when it gets there is not known better."""
STANDSTILL = 1e-3
"""Speed of a robot that counts as stopped, m/s or rad/s."""
BETWEEN = 0.05
"""Largest time between two poses at which moving obstacles are looked at, s, and distance between two places, m, where
one may be then: at 2 m/s it moves 10 cm, and the margin before it is wider than 3 cm only for a fast robot."""
HEADWAY = 0.2
"""Time for which the robot must already stand when a moving obstacle reaches it, s: the error of the prediction."""
ESCAPE = 1.5
"""Time for which a robot that goes on must not meet what would meet it if it braked, s."""
STANDS = 2.0
"""Time for which a robot that stopped would have to stand untouched, s: else stopping is no way out."""
MISJUDGED = 0.1
"""Error of the velocity of a moving obstacle, m/s: where its visible part changes, as beside a corner of the robot."""
HARDEST, MOST_GAIN = 3.0, 0.25
"""Deceleration of a moving obstacle that stops, m/s², and the way that it needs at least, at most, m."""


@njit(cache=True, nogil=True, error_model="numpy")
def stopping_way(twist, in_flight, age, command, motor, radius, poses, times):  # type: ignore[no-untyped-def]
    """Poses from the last odometry to standstill: commands in flight, then the command for one period, then braking.

    Braking keeps the curvature of the command. Steered wheels turn towards its angle at their rate, and keep it while
    the robot is told to stand.

    Args:
        twist: (3,) measured forward speed, m/s, turn rate, rad/s, and speed to the left, m/s.
        in_flight: (k, 4) commands given before this one, oldest first: time given, s after the odometry (mostly
            negative); m/s; rad/s; m/s. The first one acts from the beginning of the roll-out.
        age: Age of the odometry when the command is given, s.
        command: (3,) m/s, rad/s and m/s.
        motor: (5,) period of the commands, s; deceleration, m/s²; turn deceleration, rad/s²; lag, s; dead time, s. (8,)
            for steered wheels: wheelbase, m; steering rate, rad/s; steering angle, rad, at the odometry.
        radius: Largest distance of a point of the footprint from the base, m.
        poses: (MOST_POSES, 3) output: x, y, m, heading, rad, in the base frame of the odometry; the first pose is the
            robot's at that time.
        times: (MOST_POSES,) output: their times, s after the odometry.

        Returns:
            Number of filled rows of `poses`.
    """
    period, deceleration, turn_deceleration, lag, dead_time = motor[0], motor[1], motor[2], motor[3], motor[4]
    # The exact step of a first-order lag, so that the result does not depend on STEP.
    blend = 1.0 - math.exp(-STEP / lag) if lag > 0.0 else 1.0
    x, y, heading, v, w = 0.0, 0.0, 0.0, twist[0], twist[1]
    side, goal_side, pace, steers = twist[2], 0.0, math.hypot(command[0], command[2]), motor.shape[0] > 5
    steering, swing = (motor[7], motor[6] * STEP) if steers else (0.0, 0.0)
    poses[0, 0], poses[0, 1], poses[0, 2], times[0] = 0.0, 0.0, 0.0, 0.0
    count, way, flying = 1, 0.0, 0
    starts = age + dead_time
    time = 0.0
    while time < LONGEST:
        # Times are sums of STEP: rounding must not shift a command by a whole step.
        if time < starts - 1e-9:
            while flying + 1 < in_flight.shape[0] and in_flight[flying + 1, 0] + dead_time <= time + 1e-9:
                flying += 1
            goal_v, goal_w = (in_flight[flying, 1], in_flight[flying, 2]) if in_flight.shape[0] else (0.0, 0.0)
            goal_side = in_flight[flying, 3] if in_flight.shape[0] else 0.0
        else:
            braked = max(0.0, math.floor((time - starts) / period + 1e-6)) * period
            share = _share(pace, command[1], braked, deceleration, turn_deceleration)
            goal_v, goal_w, goal_side = command[0] * share, command[1] * share, command[2] * share
            is_told = goal_v == 0.0 and goal_w == 0.0 and goal_side == 0.0
            if is_told and abs(v) < STANDSTILL and abs(w) < STANDSTILL and abs(side) < STANDSTILL:
                break
        v += blend * (goal_v - v)
        if steers:
            if goal_v != 0.0:
                steering += min(max(math.atan(motor[5] * goal_w / goal_v) - steering, -swing), swing)
            w = v * math.tan(steering) / motor[5]
        else:
            w += blend * (goal_w - w)
        # The heading in the middle of the step: the end of each arc is exact to second order.
        middle = heading + 0.5 * w * STEP
        x, y, heading = x + v * STEP * math.cos(middle), y + v * STEP * math.sin(middle), heading + w * STEP
        side += blend * (goal_side - side)
        if side != 0.0:
            x, y = x - side * STEP * math.sin(middle), y + side * STEP * math.cos(middle)
        way += (math.hypot(v, side) + radius * abs(w)) * STEP
        time += STEP
        # By distance, not by time: a fast robot needs more poses, and a stopped one none. One row is left for the last
        # pose.
        if way >= FINE and count < MOST_POSES - 1:
            poses[count, 0], poses[count, 1], poses[count, 2], times[count] = x, y, heading, time
            count, way = count + 1, 0.0
    # The place of standstill counts, even if it is nearer than FINE to the pose before.
    poses[count, 0], poses[count, 1], poses[count, 2], times[count] = x, y, heading, time
    return count + 1


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _share(pace, turn, time, deceleration, turn_deceleration):  # type: ignore[no-untyped-def]
    """Share of a command that is left after braking for a time, s: its speeds decrease in proportion."""
    if pace != 0.0:
        return max(0.0, 1.0 - deceleration * time / pace)
    if turn != 0.0:
        return max(0.0, 1.0 - turn_deceleration * time / abs(turn))
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def distance_to_outline(px, py, outline):  # type: ignore[no-untyped-def]
    """Distance of a point from a convex polygon (n, 2), m, counter-clockwise; negative inside.

    Near a corner it is the distance from an edge's line, which is less than the distance from the corner.
    """
    best = -math.inf
    for k in range(outline.shape[0]):
        following = k + 1 if k + 1 < outline.shape[0] else 0
        ex, ey = outline[following, 0] - outline[k, 0], outline[following, 1] - outline[k, 1]
        distance = (ey * (px - outline[k, 0]) - ex * (py - outline[k, 1])) / math.hypot(ex, ey)
        # Exact along edges and too small at corners, which errs on the safe side and saves the case.
        best = max(best, distance)
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def margins(points, v, w, side, least):  # type: ignore[no-untyped-def]
    """(k,) distance from the footprint that counts as touching, m, for each point.

    The error of an echo and what lies beyond it are independent: their sum would hold a robot 2 cm beside a wall.

    Args:
        points: (k, 3) x, y, base frame, and how far the obstacle may reach beyond, m.
        v, w, side: The command: forward, m/s, turn rate, rad/s, and to the left, m/s.
        least: Margin to a known place, m, for a robot that does not move.
    """
    wide = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        # The speed of the footprint beside that point: the tip of a long body is fast while its base stands.
        speed = math.hypot(v - w * points[i, 1], side + w * points[i, 0])
        wide[i] = max(math.hypot(least, points[i, 2]), least + min(MOST_DOUBT, DOUBT * speed))
    return wide


@njit(cache=True, nogil=True, error_model="numpy")
def first_touch(poses, count, outline, points, margin, slope=0.0):  # type: ignore[no-untyped-def]
    """Index of the first point that a footprint touches on its way; -1 for none.

    A point that is too near from the beginning counts only if the footprint comes nearer to it, by more than the slope.

    Args:
        poses: (count or more, 3) poses of the base: x, y, m, heading, rad, in the frame of the points.
        outline: (n, 2) footprint, m, base frame.
        points: (k, 2 or more) m.
        margin: (k,) distance from the footprint that counts as touching, m.
        slope: Largest approach per distance from the first pose that does not count.
    """
    edges = np.empty((outline.shape[0], 3))
    for k in range(outline.shape[0]):
        following = k + 1 if k + 1 < outline.shape[0] else 0
        ex, ey = outline[following, 0] - outline[k, 0], outline[following, 1] - outline[k, 1]
        edges[k, 0], edges[k, 1], edges[k, 2] = ex, ey, math.hypot(ex, ey)
    # The first pose is what the others are compared with.
    for place in range(1, count):
        x, y = poses[place, 0], poses[place, 1]
        cos, sin = math.cos(poses[place, 2]), math.sin(poses[place, 2])
        nearer = NEARER + slope * math.hypot(x - poses[0, 0], y - poses[0, 1])
        for i in range(points.shape[0]):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            px, py, best = cos * dx + sin * dy, cos * dy - sin * dx, -math.inf
            # `distance_to_outline`; most points are known to be far enough away after one edge or two.
            for k in range(outline.shape[0]):
                distance = (edges[k, 1] * (px - outline[k, 0]) - edges[k, 0] * (py - outline[k, 1])) / edges[k, 2]
                best = max(best, distance)
                if best >= margin[i]:
                    break
            # Compared with the same point, not with the nearest of all: a robot beside a wall must be able to turn away
            # from another wall.
            if best < margin[i] and best < _at_first(points[i, 0], points[i, 1], poses, outline) - nearer:
                return i
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def _at_first(x, y, poses, outline):  # type: ignore[no-untyped-def]
    """Distance of a point from the footprint at the first pose, m."""
    dx, dy, cos, sin = x - poses[0, 0], y - poses[0, 1], math.cos(poses[0, 2]), math.sin(poses[0, 2])
    return distance_to_outline(cos * dx + sin * dy, cos * dy - sin * dx, outline)


@njit(cache=True, nogil=True, error_model="numpy")
def first_meeting(  # type: ignore[no-untyped-def]
    poses, times, count, headway, outline, radius, moving, margin, may_brake=True
):
    """Index of the first moving point that a footprint meets on its way or shortly after it, whether it would not meet
    it, or later, if the robot stayed at its first pose, and when, s; -1 and inf for none. Such points come first.

    At each time a point may be anywhere between where it is if it goes on as it does and, if it may brake, where it is
    if it brakes with HARDEST, or its leg swings. One that is too near from the beginning counts only if the robot comes
    nearer to it than if it stayed.

    Args:
        poses, times, count: Of `stopping_way`, in the frame of the points.
        headway: Time at the last pose that counts, s.
        outline: (n, 2) footprint, m, base frame.
        radius: Largest distance of a point of the footprint from the base, m.
        moving: (k, 7) x, y, m, how far it may reach beyond, m, velocity, m/s, how far a leg may swing ahead of that, m,
            and age of the place at time 0, s.
        margin: (k,) distance from the footprint that counts as touching, m.
    """
    anyway, when, has_met, meets_anyway = (
        -1,
        math.inf,
        within(moving, outline, margin),
        np.zeros(moving.shape[0], np.bool_),
    )
    for place in range(count):
        last = place == count - 1
        following = place if last else place + 1
        passed = headway if last else times[following] - times[place]
        steps = max(1, math.ceil(passed / BETWEEN - 1e-9))
        for step in range(1, steps + 1):
            share = step / steps
            x = poses[place, 0] + share * (poses[following, 0] - poses[place, 0])
            y = poses[place, 1] + share * (poses[following, 1] - poses[place, 1])
            heading = poses[place, 2] + share * (poses[following, 2] - poses[place, 2])
            cos, sin, time = math.cos(heading), math.sin(heading), times[place] + share * passed
            for i in range(moving.shape[0]):
                speed = math.hypot(moving[i, 3], moving[i, 4])
                least, most = _ways(speed, time + moving[i, 6], moving[i, 5])
                if not may_brake:
                    least = most = speed * (time + moving[i, 6])
                px, py = moving[i, 0] - x, moving[i, 1] - y
                # Most points are too far away to be met.
                close = margin[i] + MISJUDGED * (time + moving[i, 6])
                if min(math.hypot(px, py), math.hypot(px + x, py + y)) > radius + close + most:
                    continue
                parts = max(1, math.ceil((most - least) / BETWEEN))
                for part in range(parts + 1):
                    way = (least + (most - least) * part / parts) / speed
                    dx, dy = px + way * moving[i, 3], py + way * moving[i, 4]
                    distance = distance_to_outline(cos * dx + sin * dy, cos * dy - sin * dx, outline)
                    # The first pose is the frame of the points, so that there the outline needs no transformation.
                    stays = distance_to_outline(dx + x, dy + y, outline)
                    meets_anyway[i] = meets_anyway[i] or stays < close
                    if distance >= close:
                        continue
                    if has_met[i] or not meets_anyway[i]:
                        if distance < stays - NEARER:
                            return i, True, time
                    elif anyway < 0:
                        anyway, when = i, time
    return anyway, False, when


@njit(cache=True, nogil=True, error_model="numpy")
def escapes(  # type: ignore[no-untyped-def]
    poses, times, count, outline, radius, moving, margin, hit, may_brake=True
):
    """Whether a robot meets nothing on its way, and a point, `hit`, is past it in the end: at least as far away as at
    first, or farther with every step.

    The other arguments are those of `first_meeting`.
    """
    if first_meeting(poses, times, count, 0.0, outline, radius, moving, margin, may_brake)[0] >= 0:
        return False
    after = _distance_at(poses, times, count - 1, outline, moving, hit)
    if after >= distance_to_outline(moving[hit, 0], moving[hit, 1], outline):
        return True
    return count > 1 and after > _distance_at(poses, times, count - 2, outline, moving, hit)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _distance_at(poses, times, place, outline, moving, hit):  # type: ignore[no-untyped-def]
    """Distance of a moving point from the outline in one pose of a way, m."""
    cos, sin, passed = math.cos(poses[place, 2]), math.sin(poses[place, 2]), times[place]
    dx = moving[hit, 0] + passed * moving[hit, 3] - poses[place, 0]
    dy = moving[hit, 1] + passed * moving[hit, 4] - poses[place, 1]
    return distance_to_outline(cos * dx + sin * dy, cos * dy - sin * dx, outline)


def ways_on(command: Floats, accelerates: bool, robot: RobotSpec, period: float) -> list[Floats]:
    """Commands, each (n, 3), one a period, of a robot that goes on for ESCAPE: as commanded, or straight on; if it
    accelerates, also with its highest acceleration along the command's arc or straight.

    Args:
        command: (3,) forward speed, m/s, turn rate, rad/s, and speed to the left, m/s.
        accelerates: Only what it does already counts: a robot that could get away by accelerating may not do so.
        period: s.
    """
    after = np.arange(math.ceil(ESCAPE / period)) * period
    pace = math.hypot(command[0], command[2])
    shares = [np.ones(len(after))]
    if pace != 0.0 and accelerates:
        shares.append(np.minimum(pace + robot.max_acceleration * after, max(robot.max_linear, pace)) / pace)
    turn, ways = max(robot.max_angular, abs(command[1])), []
    for share in shares:
        ways.append(np.column_stack([command[0] * share, np.clip(command[1] * share, -turn, turn), command[2] * share]))
        if command[1] and pace != 0.0:
            ways.append(np.column_stack([command[0] * share, np.where(after, 0.0, command[1]), command[2] * share]))
    return ways


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _ways(speed, time, swing):  # type: ignore[no-untyped-def]
    """Least and greatest way of a point after a time, s: it brakes at once, or goes on, as a leg at twice the speed."""
    if swing > 0.0:  # a foot rests on the floor while its walker goes on
        return 0.0, speed * time + min(swing, speed * time)
    braking = min(time, speed / HARDEST)
    return min(speed * braking - 0.5 * HARDEST * braking * braking, MOST_GAIN), speed * time


@njit(cache=True, nogil=True, error_model="numpy")
def within(points, outline, margin):  # type: ignore[no-untyped-def]
    """(k,) bool: which points (k, 2 or more), m, base frame, are nearer to the footprint than their margin (k,), m."""
    near = np.empty(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        near[i] = distance_to_outline(points[i, 0], points[i, 1], outline) < margin[i]
    return near
