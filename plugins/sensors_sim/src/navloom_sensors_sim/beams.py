"""Kernels of the planar laser and of the ring of cone sonars: from true pose to noisy ranges in one call each."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_sensors_sim.casting import NOTHING, cast_block, cast_fan, to_map
from navloom_sensors_sim.incidence import cosine_of_incidence

__all__ = ["cone_rays", "fan", "fan_step", "read_cones", "read_laser", "ring_mounts"]

Floats = NDArray[np.float64]

_P3DX_PLACES = np.radians([63.1, 46.2, 27.8, 9.2, -9.2, -27.8, -46.2, -63.1])
"""Directions from the centre of a Pioneer P3-DX to its front sonars, rad (positions from its parameter file)."""
_P3DX_BEARINGS = np.radians([90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0])


def fan(count: int, field_of_view: float, heading: float) -> Floats:
    """(n,) bearings, rad, evenly over the field of view, right to left about `heading`; a full circle omits its end."""
    spread = np.linspace(-0.5, 0.5, count, endpoint=not _is_full_circle(field_of_view)) if count > 1 else np.zeros(1)
    return (heading + field_of_view * spread + math.pi) % (2.0 * math.pi) - math.pi


def fan_step(count: int, field_of_view: float) -> float:
    """Bearing from each beam of a `fan` to the next, rad, > 0; a full turn for a single beam."""
    if count == 1:
        return 2.0 * math.pi
    # Never 0, because kernels divide by it. Over 10,000 beams the lower bound adds up to 1e-8 rad.
    return max(field_of_view / (count if _is_full_circle(field_of_view) else count - 1), 1e-12)


def _is_full_circle(field_of_view: float) -> bool:
    return field_of_view >= 2.0 * math.pi - 1e-9


def ring_mounts(layout: str, footprint: Floats) -> tuple[Floats, Floats, bool]:
    """Positions and bearings of the sonars of a ring.

    Args:
        layout: "p3dx": ±90, ±50, ±30, ±10°, left to right. "pairs": two on each side, perpendicular to it,
            counter-clockwise from the right one at the front.
        footprint: (n, 2) convex polygon, m, base frame, with the base's origin inside.

    Returns:
        (8, 2) positions on the rim, m, base frame; (8,) bearings, rad; whether the last is a neighbour of the first.
    """
    if layout == "p3dx":
        places, bearings = _P3DX_PLACES, _P3DX_BEARINGS
    else:
        low, high = footprint.min(axis=0), footprint.max(axis=0)
        sides = np.array([[high[0], 0.0], [0.0, high[1]], [low[0], 0.0], [0.0, low[1]]])
        along = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]]) * (high - low) / 4.0
        spots = np.stack([sides - along, sides + along], axis=1).reshape(8, 2)
        places = np.arctan2(spots[:, 1], spots[:, 0])
        bearings = np.repeat([0.0, 0.5 * np.pi, -np.pi, -0.5 * np.pi], 2)
    return np.array([_on_rim(place, footprint) for place in places]), bearings.copy(), layout == "pairs"


def _on_rim(direction: float, footprint: Floats) -> Floats:
    """(2,) point, m, where a ray from the origin of the base leaves the footprint."""
    ray = np.array([math.cos(direction), math.sin(direction)])
    edges = np.roll(footprint, -1, axis=0) - footprint
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    speed = outward @ ray
    reach = np.einsum("ij,ij->i", outward, footprint)
    return float(np.min(reach[speed > 0.0] / speed[speed > 0.0])) * ray


def cone_rays(
    places: Floats, bearings: Floats, height: float, half_angle: float, columns: int, rows: int
) -> tuple[Floats, Floats]:
    """Rays that fill the cones of a ring.

    Args:
        places: (n, 2) positions of the sonars, m, base frame. height: Of the sonars above the floor, m.
        bearings: (n,) directions of the cone axes, rad. half_angle: Half the opening of each cone, rad.
        columns, rows: Rays over the width and the height of a cone. With several rows, rays in the corners, outside
            the cone, are left out.

    Returns:
        (3, n k) origins, m, and (3, n k) unit directions, base frame; the k rays of a cone lie side by side.
    """
    wide = np.linspace(-half_angle, half_angle, columns)
    high = np.linspace(-half_angle, half_angle, rows) if rows > 1 else np.zeros(1)
    azimuth, elevation = (grid.ravel() for grid in np.meshgrid(wide, high))
    # Rounding must not drop rays on the rim.
    inside = np.hypot(azimuth, elevation) <= half_angle * (1.0 + 1e-9)
    azimuth, elevation = azimuth[inside], elevation[inside]
    turn = (bearings[:, None] + azimuth).ravel()
    tilt = np.tile(elevation, len(bearings))
    directions = np.stack([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)])
    starts = np.repeat(places, len(azimuth), axis=0)
    return np.stack([starts[:, 0], starts[:, 1], np.full(len(starts), height)]), np.ascontiguousarray(directions)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _reading(true, error, low, high):  # type: ignore[no-untyped-def]
    """Reported range, m: with the error and at least `low`; +inf if it or the true range is `high` or more."""
    # Written so that NaN is no echo.
    if not true < high:
        return np.inf
    measured = max(true + error, low)
    return measured if measured < high else np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def read_laser(base, origins, directions, obstacles, options, normals, ranges):  # type: ignore[no-untyped-def]
    """Ranges of a planar laser.

    Args:
        base: (3 or more,) true x, y, m, and heading, rad, of the base in the map frame.
        origins, directions: (3, n) beams, base frame: level, from one place, evenly spaced as by `fan`.
        obstacles: What can be hit.
        options: (5,) lowest and highest range, m; standard deviation, m; bearing of the first beam in the base frame,
            rad; bearing from each beam to the next, rad, see `fan_step`.
        normals: (n,) standard normal draws.
        ranges: (n,) filled: m, +inf for no echo.
    """
    count = directions.shape[1]
    starts, ways, hits = np.empty((3, count)), np.empty((3, count)), np.empty(count, np.int64)
    to_map(base[0], base[1], base[2], origins, np.bool_(True), starts)
    to_map(base[0], base[1], base[2], directions, np.bool_(False), ways)
    cast_fan(starts, ways, base[2] + options[3], options[4], obstacles, options[1], ranges, hits)
    for i in range(count):
        # Every beam has its draw, hit or not: random numbers must not depend on the scene.
        ranges[i] = _reading(ranges[i], options[2] * normals[i], options[0], options[1])


@njit(cache=True, nogil=True, error_model="numpy")
def read_cones(base, origins, directions, obstacles, options, closed, normals, uniforms, ranges):  # type: ignore[no-untyped-def]
    """Ranges of a ring of cone sonars: for each cone, the nearest echo of its rays.

    Args:
        base: (3 or more,) true x, y, m, and heading, rad, of the base in the map frame.
        origins, directions: (3, n k) rays, base frame; the k rays of a cone lie side by side.
        obstacles: What can be hit.
        options: (6,) lowest and highest range, m; standard deviation, m; cosine of the critical angle of incidence
            beyond which a ray gives no echo (negative: none); probability of crosstalk between two neighbours; 1 if
            the floor echoes.
        closed: Whether the last sonar and the first are neighbours.
        normals: (n,) standard normal draws.
        uniforms: (n, 3) draws in [0, 1): whether sonar i and the next have crosstalk; which of the two reads shorter;
            how much of its reading remains.
        ranges: (n,) filled: m, +inf for no echo.
    """
    count = ranges.shape[0]
    total = directions.shape[1]
    per_cone = total // count
    starts, ways, hits = np.empty((3, total)), np.empty((3, total)), np.empty(total, np.int64)
    found = np.empty(total)
    to_map(base[0], base[1], base[2], origins, np.bool_(True), starts)
    to_map(base[0], base[1], base[2], directions, np.bool_(False), ways)
    cast_block(starts, ways, obstacles, options[5] != 0.0, options[1], found, hits)
    for i in range(count):
        nearest = np.inf
        for k in range(i * per_cone, (i + 1) * per_cone):
            if hits[k] == NOTHING or found[k] >= nearest:
                continue
            oblique = options[3] > 0.0 and found[k] > 0.0
            if oblique and cosine_of_incidence(starts, ways, k, found[k], hits[k], obstacles) < options[3]:
                continue
            nearest = found[k]
        ranges[i] = _reading(nearest, options[2] * normals[i], options[0], options[1])
    for i in range(count if closed else count - 1):
        if uniforms[i, 0] < options[4]:
            victim = i if uniforms[i, 1] < 0.5 else (i + 1) % count
            reach = min(ranges[victim], options[1])
            ranges[victim] = options[0] + uniforms[i, 2] * (reach - options[0])
