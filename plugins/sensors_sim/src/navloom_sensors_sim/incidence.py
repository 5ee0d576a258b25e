"""Angle of incidence of a ray, for sonars: smooth surfaces reflect the sound away at oblique incidence."""

from __future__ import annotations

import math

from numba import njit

from navloom_sensors_sim.casting import FLOOR

__all__ = ["cosine_of_incidence"]


@njit(cache=True, nogil=True, error_model="numpy")
def cosine_of_incidence(origins, directions, i, distance, hit, obstacles):  # type: ignore[no-untyped-def]
    """Cosine of the angle between ray i and the normal of the surface it hits at `distance`; 1 is head on.

    Args:
        origins, directions: (3, n) rays, map frame.
        i, distance, hit: Index of the ray, its range, m, and its hit index (not NOTHING).
        obstacles: The obstacles that the ray was cast against.
    """
    dx, dy, dz = directions[0, i], directions[1, i], directions[2, i]
    if hit == FLOOR:
        return abs(dz)
    x, y, z = origins[0, i] + distance * dx, origins[1, i] + distance * dy, origins[2, i] + distance * dz
    boxes, cylinders = obstacles.boxes.shape[0], obstacles.cylinders.shape[0]
    if hit < boxes:
        return _on_box(x, y, z, dx, dy, dz, obstacles.boxes[hit])
    if hit < boxes + cylinders:
        return _on_cylinder(x, y, z, dx, dy, dz, obstacles.cylinders[hit - boxes])
    return _on_raster(x, y, dx, dy, obstacles.raster)


@njit(cache=True, nogil=True, error_model="numpy")
def _on_box(x, y, z, dx, dy, dz, box):  # type: ignore[no-untyped-def]
    """Cosine of incidence on a box; the hit face is the one whose plane is nearest to the point."""
    c, s = box[6], box[7]
    off_x = abs(abs(c * (x - box[0]) + s * (y - box[1])) - box[2])
    off_y = abs(abs(c * (y - box[1]) - s * (x - box[0])) - box[3])
    off_z = min(abs(z - box[4]), abs(z - box[5]))
    if off_z < off_x and off_z < off_y:
        return abs(dz)
    return abs(c * dx + s * dy) if off_x < off_y else abs(c * dy - s * dx)


@njit(cache=True, nogil=True, error_model="numpy")
def _on_cylinder(x, y, z, dx, dy, dz, cylinder):  # type: ignore[no-untyped-def]
    """Cosine of incidence on a cylinder; the normal is vertical on an end face and radial on the side."""
    rx, ry = x - cylinder[0], y - cylinder[1]
    reach = math.hypot(rx, ry)
    off_z = min(abs(z - cylinder[3]), abs(z - cylinder[4]))
    if off_z < abs(reach - cylinder[2]):
        return abs(dz)
    return abs(rx * dx + ry * dy) / reach


@njit(cache=True, nogil=True, error_model="numpy")
def _on_raster(x, y, dx, dy, frame):  # type: ignore[no-untyped-def]
    """Cosine of incidence on a raster; on a side of a cell, one of the point's coordinates, in cells, is whole."""
    c, s, cell = frame[2], frame[3], frame[4]
    column = (c * (x - frame[0]) + s * (y - frame[1])) / cell
    row = (c * (y - frame[1]) - s * (x - frame[0])) / cell
    along_x = abs(column - round(column)) < abs(row - round(row))
    return abs(c * dx + s * dy) if along_x else abs(c * dy - s * dx)
