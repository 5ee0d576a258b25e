"""Drives through a room of straight walls, with a scanner whose beams are measured one after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from navloom_calibration.laser_track import Beams, Way

CORNERS = [[(-4.0, -3.0), (5.0, -3.0), (5.0, 4.0), (-4.0, 4.0)], [(2.0, 1.0), (3.2, 1.0), (3.2, 2.0), (2.0, 2.0)],
           [(-2.6, -1.6), (-1.8, -1.4), (-2.0, -0.8), (-2.8, -1.0)]]  # fmt: skip
WALLS = np.array([(a, b) for loop in CORNERS for a, b in zip(loop, loop[1:] + loop[:1], strict=True)])
"""(n, 2, 2) ends of the walls of the room, a cupboard and a chest, m."""
STEP = 0.005
"""Step of the drive, s."""
MIXED = ((0.3, 0.0, 2.0), (0.0, 0.8, 1.5), (0.3, 0.0, 1.5), (0.0, -0.9, 2.2), (0.2, 0.4, 2.0), (0.0, 0.0, 1.0))
STRAIGHT = ((0.25, 0.0, 6.0), (-0.25, 0.0, 6.0))
"""Speeds, m/s, turn rates, rad/s, and how long they are driven, s; again and again."""
Legs = Sequence[tuple[float, float, float]]


def driven(seconds: float, legs: Legs = MIXED) -> tuple[np.ndarray, np.ndarray]:
    """Times, (n,) s, and true poses, (n, 3) m, rad; with 0.6 m/s² and 3 rad/s²."""
    times = np.arange(0.0, seconds, STEP)
    poses, twist = np.zeros((len(times), 3)), np.zeros(2)
    ends = np.cumsum([leg[2] for leg in legs])
    for k in range(1, len(times)):
        wanted = legs[int(np.searchsorted(ends, times[k] % ends[-1], side="right")) % len(legs)][:2]
        twist += np.clip(np.array(wanted) - twist, [-0.6 * STEP, -3.0 * STEP], [0.6 * STEP, 3.0 * STEP])
        x, y, heading = poses[k - 1]
        poses[k] = (
            x + twist[0] * STEP * math.cos(heading),
            y + twist[0] * STEP * math.sin(heading),
            (heading + twist[1] * STEP),
        )
    return times, poses


def cast(places: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(n,) distance from places, (n, 2), along directions, (n,) rad, to the walls."""
    rays = np.stack([np.cos(ways), np.sin(ways)], axis=1)[:, None]
    along, to = (WALLS[:, 1] - WALLS[:, 0])[None], WALLS[None, :, 0] - places[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        size = rays[..., 0] * along[..., 1] - rays[..., 1] * along[..., 0]
        length = (to[..., 0] * along[..., 1] - to[..., 1] * along[..., 0]) / size
        share = (to[..., 0] * rays[..., 1] - to[..., 1] * rays[..., 0]) / size
    return np.where((length > 0.0) & (share >= 0.0) & (share <= 1.0), length, np.inf).min(axis=1)


def recorded(
    seconds: float = 60.0,
    legs: Legs = MIXED,
    *,
    late: float = 0.0,
    sweep: float = 0.0,
    yaw: float = 0.0,
    scale: float = 1.0,
    slip: float = 0.002,
    seed: int = 0,
) -> tuple[list[Beams], Way]:
    """Scans at 10 Hz and odometry at 20 Hz.

    Args:
        seconds, legs: The drive.
        late: What the stamps are more than the time of the first beam, s.
        sweep: From the first beam to the last, s.
        yaw: How the laser is turned on its mount at (0.2, 0.1) m, rad, which the scans do not know.
        scale: Turn that odometry reports of each turn.
        slip: Noise of the heading of odometry after a turn of 1 rad, or after 0.5 m, rad.
        seed: Of the noise.
    """
    rng = np.random.default_rng(seed)
    times, poses = driven(seconds, legs)
    turned = np.abs(np.diff(poses[:, 2])) + 2.0 * np.hypot(*np.diff(poses[:, :2], axis=0).T)
    slips = np.concatenate(([0.0], np.cumsum(slip * np.sqrt(turned) * rng.standard_normal(len(turned)))))
    said = np.column_stack([poses[:, :2], scale * (poses[:, 2] + slips)])
    # The way that was driven, along the heading that odometry believes.
    steps = np.diff(poses[:, :2] @ [1.0, 1j]) * np.exp(1j * (said[:-1, 2] - poses[:-1, 2]))
    said[1:, 0], said[1:, 1] = np.cumsum(steps.real), np.cumsum(steps.imag)
    bearings, place = np.linspace(-math.pi, math.pi, 240, endpoint=False), np.array([0.2, 0.1])
    offsets = np.linspace(0.0, sweep, len(bearings))
    scans = []
    for begin in np.arange(0.5, seconds - 1.0, 0.1):
        at = np.stack([np.interp(begin + offsets, times, poses[:, k]) for k in range(3)], axis=1)
        c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
        places = at[:, :2] + np.stack([c * place[0] - s * place[1], s * place[0] + c * place[1]], axis=1)
        ranges = cast(places, at[:, 2] + yaw + bearings) + 0.01 * rng.standard_normal(len(bearings))
        scans.append(Beams(begin + late, np.tile(place, (len(bearings), 1)), bearings, np.zeros(len(bearings)),
                           offsets, ranges, 0.05, 12.0))  # fmt: skip
    return scans, Way(times[::10], said[::10])


PLACE = np.array([0.2, 0.1])
"""Of the laser, m."""
