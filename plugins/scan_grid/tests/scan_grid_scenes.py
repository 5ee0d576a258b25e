"""Worlds seen by a ray caster independent of the simulator, and comparison of maps with the truth."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from navloom import Box, World
from navloom_scan_grid.mapping import Beams, MapSettings, ScanMap
from numpy.typing import NDArray

Floats = NDArray[np.float64]
PERIOD_NS = 50_000_000


def cast(world: World, origins: Floats, angles: Floats) -> Floats:
    """(n,) distance from (n, 2) origins along (n,) angles to upright boxes and cylinders, m; +inf for none."""
    way = np.column_stack([np.cos(angles), np.sin(angles)])
    best = np.full(len(angles), np.inf)
    for solid in world.obstacles:
        if isinstance(solid, Box):
            with np.errstate(divide="ignore"):
                low = (np.array([solid.x[0], solid.y[0]]) - origins) / way
                high = (np.array([solid.x[1], solid.y[1]]) - origins) / way
            enter, leave = np.minimum(low, high).max(axis=1), np.maximum(low, high).min(axis=1)
        else:
            to = np.array([solid.x, solid.y]) - origins
            along, square = (to * way).sum(axis=1), (to**2).sum(axis=1)
            half = np.sqrt(np.maximum(solid.radius**2 - square + along**2, -1.0).clip(min=0.0))
            meets = square - along**2 < solid.radius**2
            enter, leave = np.where(meets, along - half, np.inf), np.where(meets, along + half, -np.inf)
        best = np.where((enter <= leave) & (enter > 0.0) & (enter < best), enter, best)
    return best


def depth(world: World, points: Floats) -> Floats:
    """(n,) distance of (n, 2) points, m, from the nearest obstacle; negative within one."""
    best = np.full(len(points), np.inf)
    for solid in world.obstacles:
        if isinstance(solid, Box):
            low, high = np.array([solid.x[0], solid.y[0]]), np.array([solid.x[1], solid.y[1]])
            gap = np.maximum(low - points, points - high)
            value = np.hypot(*np.maximum(gap, 0.0).T) + np.minimum(gap.max(axis=1), 0.0)
        else:
            value = np.hypot(points[:, 0] - solid.x, points[:, 1] - solid.y) - solid.radius
        best = np.minimum(best, value)
    return best


def way(*corners: tuple[float, float], step: float = 0.02) -> Floats:
    """(n, 3) poses on straight legs, m, rad, turning in place by 3° per pose; 0.02 m per pose is 0.4 m/s at 20 Hz."""
    poses: list[tuple[float, float, float]] = []
    heading = math.atan2(corners[1][1] - corners[0][1], corners[1][0] - corners[0][0])
    for (ax, ay), (bx, by) in pairwise(corners):
        wanted = math.atan2(by - ay, bx - ax)
        turn = math.remainder(wanted - heading, math.tau)
        for share in np.linspace(0.0, 1.0, max(2, math.ceil(abs(turn) / math.radians(3.0))))[1:]:
            poses.append((ax, ay, heading + share * turn))
        heading = wanted
        for share in np.linspace(0.0, 1.0, math.ceil(math.hypot(bx - ax, by - ay) / step)):
            poses.append((ax + share * (bx - ax), ay + share * (by - ay), heading))
    return np.array(poses)


def laser(
    world: World, pose: Floats, stamp_ns: int, rng: np.random.Generator, sigma: float = 0.01, beams: int = 181
) -> Beams:
    """A scan of 270° from 0.15 m before base, range 0.05 to 10 m."""
    bearings = np.radians(np.linspace(-135.0, 135.0, beams))
    mount = np.tile([0.15, 0.0], (beams, 1))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    origin = pose[:2] + 0.15 * np.array([c, s])
    true = cast(world, np.tile(origin, (beams, 1)), bearings + pose[2])
    ranges = np.clip(true + sigma * rng.standard_normal(beams), 0.05, None)
    ranges[~(ranges <= 10.0)] = np.inf
    return Beams(stamp_ns, mount, bearings, np.zeros(beams), np.zeros(beams), ranges, 0.05, 10.0)


RING = np.radians([90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0])
HALF = math.radians(15.0)


def ring(
    world: World, pose: Floats, stamp_ns: int, rng: np.random.Generator, sigma: float = 0.01, critical_deg: float = 90.0
) -> Beams:
    """Eight sonars on a circle of 0.2 m, nearest of 13 rays over 30°, range 0.3 to 4 m.

    Args:
        critical_deg: A ray that meets a surface at a larger angle of incidence gives no echo: smooth walls.
    """
    mounts = 0.2 * np.column_stack([np.cos(RING), np.sin(RING)])
    c, s = math.cos(pose[2]), math.sin(pose[2])
    origins = pose[:2] + mounts @ np.array([[c, s], [-s, c]])
    fan = np.linspace(-HALF, HALF, 13)
    starts, angles, small = np.repeat(origins, 13, axis=0), (RING[:, None] + fan).ravel() + pose[2], 1e-4
    true = cast(world, starts, angles)
    with np.errstate(invalid="ignore"):
        incidence = np.abs(np.arctan2(cast(world, starts, angles + small) - true, true * small))
    true = np.where(np.degrees(incidence) > critical_deg, np.inf, true).reshape(8, 13).min(1)
    ranges = np.clip(true + sigma * rng.standard_normal(8), 0.3, None)
    ranges[~(ranges <= 4.0)] = np.inf
    return Beams(stamp_ns, mounts, RING, np.full(8, HALF), np.zeros(8), ranges, 0.3, 4.0)


def mapped(world: World, poses: Floats, sensor: object = laser, seed: int = 1, **changes: object) -> ScanMap:
    """The map after one scan at each pose; the poses are exact."""
    rng = np.random.default_rng(seed)
    scan_map = ScanMap(MapSettings(**changes))
    stamps = PERIOD_NS * np.arange(len(poses))
    for stamp, pose in zip(stamps.tolist(), poses, strict=True):
        scan_map.insert(sensor(world, pose, stamp, rng), stamps, poses)
    return scan_map


def centres(scan_map: ScanMap) -> Floats:
    """(rows, columns, 2) centres of the cells, m, map frame."""
    rows, columns = scan_map.grid.odds.shape
    x, y = scan_map.grid.origin
    row, column = np.mgrid[:rows, :columns]
    return np.stack([x + (column + 0.5) * scan_map.grid.cell, y + (row + 0.5) * scan_map.grid.cell], axis=-1)


def wrong(scan_map: ScanMap, world: World, slack: float = 0.03) -> tuple[float, float]:
    """Share of the cells called free whose centre is in an obstacle, and of those called occupied that hold none.

    Args:
        slack: An occupied cell may be this far from an obstacle, m: three times the noise of the range.
    """
    cells = scan_map.cells()
    gap = depth(world, centres(scan_map).reshape(-1, 2)).reshape(cells.shape)
    in_free, beside = (cells == 0) & (gap < 0.0), (cells == 100) & (gap > scan_map.grid.cell / math.sqrt(2.0) + slack)
    return float(in_free.sum() / (cells == 0).sum()), float(beside.sum() / (cells == 100).sum())


def holes(scan_map: ScanMap, world: World, poses: Iterable[Floats]) -> float:
    """Share of the points that an exact laser sees of obstacles, within 5 m of the poses, without an occupied cell.

    An occupied cell counts if it is the point's own or one of the eight round it.
    """
    cells = np.pad(scan_map.cells() == 100, 1)
    near = np.zeros((cells.shape[0] - 2, cells.shape[1] - 2), bool)
    for i in range(3):
        for k in range(3):
            near |= cells[i : i + near.shape[0], k : k + near.shape[1]]
    missed = seen = 0
    angles = np.radians(np.arange(0.0, 360.0, 1.5))
    for pose in poses:
        ranges = cast(world, np.tile(pose[:2], (angles.size, 1)), angles)
        ok = ranges < 5.0
        points = pose[:2] + (ranges[ok, None] + 1e-6) * np.column_stack([np.cos(angles[ok]), np.sin(angles[ok])])
        column, row = np.floor((points - scan_map.grid.origin) / scan_map.grid.cell).astype(int).T
        inside = (row >= 0) & (row < near.shape[0]) & (column >= 0) & (column < near.shape[1])
        hit = np.zeros(len(points), bool)
        hit[inside] = near[row[inside], column[inside]]
        missed, seen = missed + int((~hit).sum()), seen + len(points)
    return missed / seen
