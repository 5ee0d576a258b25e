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
EVERY = 4  # steps between two poses that the critics of path and goal look at, as in Nav2


@njit(cache=True, nogil=True)
def knots_of(steps: int, hold: int) -> int:
    """Number of knots between which noise is interpolated: one every `hold` steps, and one at the end."""
    return -(-steps // hold) + 1


@njit(cache=True, nogil=True)
def roll_out(
    plan: Floats,
    noise: NDArray[np.float32],
    sigma: tuple[float, float],
    hold: int,
    start: State,
    m: Motion,
    scene: Scene,
    parts: Floats,
    ends: Floats,
    track: Floats,
) -> None:
    """Roll out the plan with the noise of each sample, and the plan itself.

    Samples 2 i and 2 i + 1 have the same noise of the speed, and opposite noise of the turn rate: a mirrored scene has
    mirrored roll-outs.

    Args:
        plan: (steps, 2) commanded speed, m/s, and turn rate, rad/s.
        noise: (n, knots, 2) standard normal numbers, see knots_of().
        sigma: Standard deviations of speed, m/s, and turn rate, rad/s, at a knot.
        hold: Steps between two knots.
        start: From motion.after_dead_time(). m: The robot. scene: Surroundings of the robot.
        parts: (2 n + 1, critics), filled in: cost of each roll-out by each critic, without weights; last, the plan's.
        ends: (2 n + 1,), filled in: bearing of the last pose, rad.
        track: (steps, 3), filled in: x, y, m, heading, rad, of the plan.
    """
    steps, last = plan.shape[0], parts.shape[0] - 1
    share, looks = 1.0 / steps, 1.0 / (steps // EVERY)
    for k in range(last + 1):
        x, y, heading, v, w, sent_v, sent_w = start
        c, s = math.cos(heading), math.sin(heading)
        parts[k, :] = 0.0
        part = parts[k]
        scale_v = sigma[0] if k < last else 0.0
        scale_w = (sigma[1] if k % 2 == 0 else -sigma[1]) if k < last else 0.0
        i = min(k // 2, noise.shape[0] - 1)
        off_v, off_w, rate_v, rate_w = 0.0, 0.0, 0.0, 0.0
        for t in range(steps):
            if t % hold == 0:
                j = t // hold
                off_v, off_w = scale_v * noise[i, j, 0], scale_w * noise[i, j, 1]
                rate_v = (scale_v * noise[i, j + 1, 0] - off_v) / hold
                rate_w = (scale_w * noise[i, j + 1, 1] - off_w) / hold
            asked_v, asked_w = plan[t, 0] + off_v, plan[t, 1] + off_w
            if k < last:
                part[of.CONTROL] += plan[t, 0] * off_v / sigma[0] ** 2 + plan[t, 1] * off_w / sigma[1] ** 2
            off_v, off_w = off_v + rate_v, off_w + rate_w
            part[of.CONSTRAINT] += of.constraint(asked_v, asked_w, m.slowest, m.fastest, m.turn)
            before = v
            v, w, sent_v, sent_w = follow(v, w, sent_v, sent_w, asked_v, asked_w, m)
            turn = w * m.step
            # Cosine and sine of a small angle: the error is below 1e-6 up to 0.2 rad.
            square = turn * turn
            dc, ds = 1.0 - square * (0.5 - square / 24.0), turn * (1.0 - square / 6.0)
            next_c, next_s = c * dc - s * ds, s * dc + c * ds
            way = 0.25 * (before + v) * m.step
            x, y, heading = x + way * (c + next_c), y + way * (s + next_s), heading + turn
            c, s = next_c, next_s
            part[of.PREFER_FORWARD] += of.prefer_forward(v, m.fastest)
            part[of.TWIRLING] += of.twirling(w, m.turn)
            beyond = of.clearance(scene, x, y, c, s)
            if k == last:
                track[t, 0], track[t, 1], track[t, 2] = x, y, heading
            if beyond < 0.0:
                part[of.COLLISION] = of.collision(t, steps)
                break
            part[of.OBSTACLE] += of.obstacle(beyond, scene.soft)
            if t % EVERY == EVERY - 1:
                look(scene, x, y, heading, part, looks)
        ends[k] = math.atan2(y, x)
        if not scene.is_near_goal:
            part[of.PATH_FOLLOW] = of.path_follow(scene, x, y)
        for column in (of.CONSTRAINT, of.OBSTACLE, of.PREFER_FORWARD, of.TWIRLING):
            part[column] *= share


@njit(cache=True, nogil=True)
def look(scene: Scene, x: float, y: float, heading: float, part: Floats, share: float) -> None:
    """Add a pose to the critics of path and goal: its share of their mean."""
    if scene.is_near_goal:
        part[of.GOAL] += share * of.goal(scene, x, y)
    elif scene.is_path_free:
        part[of.PATH_ALIGN] += share * of.path_align(scene, x, y)
    if scene.turns_away:
        part[of.PATH_ANGLE] += share * of.path_angle(scene, x, y, heading)
    if not math.isnan(scene.turn_to):
        part[of.GOAL_ANGLE] += share * of.goal_angle(scene, heading)
