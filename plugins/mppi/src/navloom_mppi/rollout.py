"""Roll-outs of one tick and what each costs by each critic: Williams et al. 2017, Algorithm 2."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_mppi import critics as of
from navloom_mppi.critics import Scene
from navloom_mppi.motion import Motion, State, follow

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def knots_of(steps: int, hold: int) -> int:
    """Number of knots between which noise is interpolated: one every `hold` steps, and one at the end."""
    return -(-steps // hold) + 1


@njit(cache=True, nogil=True)
def drive(
    plan: Floats, noise: NDArray[np.float32], pace: float, sigma: tuple[float, float], hold: int, start: State,
    m: Motion, part: Floats, track: Floats,
) -> None:  # fmt: skip
    """Drive one roll-out, and fill in the costs of its controls.

    Args:
        plan: (steps, 2) commanded speed, m/s, and turn rate, rad/s. pace: Factor of the plan.
        noise: (knots, 2) in standard deviations, see knots_of(); linear in between.
        sigma: Standard deviations of speed, m/s, and turn rate, rad/s. hold: Steps between two knots.
        start: From motion.after_dead_time(). m: The robot.
        part: (critics,), filled in: the critics of velocities and controls.
        track: (steps, 5), filled in: x, y, m, heading, rad, its cosine and sine.
    """
    steps, per_hold = plan.shape[0], 1.0 / hold
    per_v, per_w = 1.0 / max(sigma[0] ** 2, 1.0e-9), 1.0 / max(sigma[1] ** 2, 1.0e-9)
    x, y, heading, v, w, sent_v, sent_w = start
    c, s = math.cos(heading), math.sin(heading)
    off_v, off_w, rate_v, rate_w, j, until = 0.0, 0.0, 0.0, 0.0, -1, 0
    beyond, backwards, turning, control = 0.0, 0.0, 0.0, 0.0
    for t in range(steps):
        if t == until:
            j, until = j + 1, until + hold
            off_v, off_w = sigma[0] * noise[j, 0], sigma[1] * noise[j, 1]
            rate_v = (sigma[0] * noise[j + 1, 0] - off_v) * per_hold
            rate_w = (sigma[1] * noise[j + 1, 1] - off_w) * per_hold
        base_v, base_w = pace * plan[t, 0], pace * plan[t, 1]
        asked_v, asked_w = base_v + off_v, base_w + off_w
        control += base_v * off_v * per_v + base_w * off_w * per_w
        off_v, off_w = off_v + rate_v, off_w + rate_w
        beyond += of.constraint(asked_v, asked_w, m.slowest, m.fastest, m.turn)
        before = v
        v, w, sent_v, sent_w = follow(v, w, sent_v, sent_w, asked_v, asked_w, m)
        turn = w * m.step
        # Cosine and sine of a small angle: the error is below 1e-6 up to 0.2 rad.
        square = turn * turn
        dc, ds = 1.0 - square * (0.5 - square * (1.0 / 24.0)), turn * (1.0 - square * (1.0 / 6.0))
        next_c, next_s = c * dc - s * ds, s * dc + c * ds
        way = 0.25 * (before + v) * m.step
        x, y, heading = x + way * (c + next_c), y + way * (s + next_s), heading + turn
        c, s = next_c, next_s
        track[t, 0], track[t, 1], track[t, 2], track[t, 3], track[t, 4] = x, y, heading, c, s
        backwards += of.prefer_forward(v)
        turning += of.twirling(w)
    part[of.CONSTRAINT], part[of.CONTROL] = beyond / steps, control
    part[of.PREFER_FORWARD], part[of.TWIRLING] = backwards / steps, turning / steps


@njit(cache=True, nogil=True)
def judge(scene: Scene, part: Floats, track: Floats) -> int:
    """Fill in the costs of a roll-out by the critics of its poses; return the last step before a collision.

    Args:
        scene: Surroundings. part: (critics,), filled in. track: (steps, 5) from drive().
    """
    steps = track.shape[0]
    until, part[of.OBSTACLE] = of.obstacles(scene, track)
    part[of.COLLISION] = of.collision(until, steps)
    last = min(until, steps - 1)
    if scene.is_near_goal:
        part[of.GOAL] = of.goal(scene, track, until)
    else:
        part[of.PATH_FOLLOW] = of.path_follow(scene, track[last, 0], track[last, 1], track[last, 3], track[last, 4])
        if scene.is_path_free:
            part[of.PATH_ALIGN] = of.path_align(scene, track, until)
    if scene.turns_away:
        part[of.PATH_ANGLE] = of.path_angle(scene, track, until)
    if not math.isnan(scene.turn_to):
        part[of.GOAL_ANGLE] = of.goal_angle(scene, track, until)
    return int(last)


@njit(cache=True, nogil=True)
def roll_out(
    plan: Floats, noise: NDArray[np.float32], paces: Floats, sigma: tuple[float, float], hold: int, start: State,
    m: Motion, scene: Scene, parts: Floats, ends: Floats,
) -> None:  # fmt: skip
    """Roll out the plan with the noise of each sample.

    Samples 2 i and 2 i + 1 have the same noise of the speed, and opposite noise of the turn rate: a mirrored scene has
    mirrored roll-outs.

    Args:
        plan, sigma, hold, start, m: As for drive(). scene: Surroundings of the robot.
        noise: (n, knots, 2) in standard deviations. paces: (n,) factor of the plan: 1, or 0 to start from standing.
        parts: (2 n, critics), filled in: cost of each roll-out by each critic, without weights.
        ends: (2 n,), filled in: bearing of its last pose, rad.
    """
    track = np.empty((plan.shape[0], 5))
    for k in range(parts.shape[0]):
        i, side = k // 2, 1.0 - 2.0 * (k % 2)
        parts[k, :] = 0.0
        drive(plan, noise[i], paces[i], (sigma[0], side * sigma[1]), hold, start, m, parts[k], track)
        last = judge(scene, parts[k], track)
        ends[k] = math.atan2(track[last, 1], track[last, 0])


@njit(cache=True, nogil=True)
def draw(
    plan: Floats, noise: NDArray[np.float32], paces: Floats, sigma: tuple[float, float], hold: int, start: State,
    m: Motion, which: NDArray[np.int64], every: int, ends: NDArray[np.int64], points: Floats,
) -> None:  # fmt: skip
    """Repeat some roll-outs of roll_out(), for a picture.

    Args:
        plan, noise, paces, sigma, hold, start, m: As for roll_out().
        which: (n,) numbers of the roll-outs. every: Steps between two points.
        ends: (n,) last step of each: later points stay there.
        points: (n, points, 2), filled in: x, y, m, base frame.
    """
    part, track = np.zeros(len(of.CRITICS)), np.empty((plan.shape[0], 5))
    for k in range(which.shape[0]):
        i, side = which[k] // 2, 1.0 - 2.0 * (which[k] % 2)
        drive(plan, noise[i], paces[i], (sigma[0], side * sigma[1]), hold, start, m, part, track)
        for j in range(points.shape[1]):
            t = min(j * every, ends[k])
            points[k, j, 0], points[k, j, 1] = track[t, 0], track[t, 1]


@njit(cache=True, nogil=True)
def roll_out_plan(plan: Floats, start: State, m: Motion, scene: Scene, track: Floats) -> Floats:
    """Roll out the plan itself; track (steps, 5) is filled in. Return its cost by each critic (critics,)."""
    part = np.zeros(len(of.CRITICS))
    drive(plan, np.zeros((2, 2), np.float32), 1.0, (0.0, 0.0), plan.shape[0], start, m, part, track)
    judge(scene, part, track)
    return part
