"""Metrics of robots among people: how near they come, and how well they track them. Definitions: docs/metrics.md."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.collision import gaps_to_points
from navloom.geometry.footprints import circumscribed_radius
from navloom.geometry.frames import inverse, transform
from navloom.runs.episode_trail import Trail
from navloom.runs.metric import NOT_NEGATIVE, Metric

__all__ = ["INTIMATE", "PEOPLE_METRICS", "PERSONAL"]

Floats = NDArray[np.float64]

INTIMATE, PERSONAL = 0.45, 1.2
"""Ends of the intimate and of the personal space round a person, m: Hall, "The hidden dimension" (1966)."""

FINE, FAR = 0.01, 100.0
"""Step in which distances are interpolated, s; and a distance that stands for no person, m."""


def person_distance_min(trail: Trail) -> float | None:
    """Least distance between the robot's footprint and the centre of a body that moves, m."""
    near = _nearest(trail)
    return None if near is None else float(near.min())


def intimate_time(trail: Trail) -> float | None:
    """Time in the intimate space of the nearest person, s."""
    return _time_within(trail, 0.0, INTIMATE)


def personal_time(trail: Trail) -> float | None:
    """Time in the personal space of the nearest person, s."""
    return _time_within(trail, INTIMATE, PERSONAL)


def intimate_depth(trail: Trail) -> float | None:
    """Mean depth in the intimate space over the time in it, m; 0 for a robot that never was."""
    return _depth(trail, 0.0, INTIMATE)


def personal_depth(trail: Trail) -> float | None:
    """Mean depth in the personal space over the time in it, m; 0 for a robot that never was."""
    return _depth(trail, INTIMATE, PERSONAL)


def time_to_collision_min(trail: Trail) -> float | None:
    """Least time until the discs of robot and person would touch if both kept their velocities, s."""
    bodies = trail.bodies
    if not bodies.are_there or not trail.footprint.size:
        return None
    away = bodies.places - np.stack([trail.x, trail.y], 1)[:, None]
    own = trail.vx[:, None] * np.stack([np.cos(trail.heading), np.sin(trail.heading)], 1)
    speed = bodies.velocities - own[:, None]
    reach = bodies.radii + circumscribed_radius(trail.footprint)
    a, b = (speed**2).sum(axis=2), (away * speed).sum(axis=2)
    c = (away**2).sum(axis=2) - reach**2
    root = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where((root >= 0.0) & (b < 0.0), (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
    times = np.where(c <= 0.0, 0.0, times)[np.isfinite(away[..., 0]) & np.isfinite(a)]
    least = float(times.min()) if times.size else math.inf
    return least if math.isfinite(least) else None


def speed_near_people(trail: Trail) -> float | None:
    """Mean speed of the robot while it is in the personal or intimate space of a person, m/s."""
    near = _finely(trail)
    if near is None or not (near < PERSONAL).any():
        return None
    return float(np.interp(_fine_times(trail), trail.time, np.abs(trail.vx))[near < PERSONAL].mean())


def track_ospa(trail: Trail) -> float | None:
    """Mean OSPA distance of the tracks, m."""
    return _mean_distance(trail, 0)


def track_ospa_location(trail: Trail) -> float | None:
    """Mean location part of it, m."""
    return _mean_distance(trail, 1)


def track_ospa_cardinality(trail: Trail) -> float | None:
    """Mean cardinality part of it, m."""
    return _mean_distance(trail, 2)


def false_tracks(trail: Trail) -> float | None:
    """Tracks of nothing that moves, 1/min."""
    tracking = trail.tracking
    if not tracking.has_truth or not tracking.duration:
        return None
    return 60.0 * tracking.false_tracks / tracking.duration


def track_speed_rms(trail: Trail) -> float | None:
    """Root mean square of the difference between the velocities of tracks and of their bodies, m/s."""
    errors = trail.tracking.speed_errors
    return float(np.sqrt((errors**2).mean())) if errors.size else None


def track_latency(trail: Trail) -> float | None:
    """Mean time in view of a body before its first track, s."""
    waits = trail.tracking.latencies
    return float(np.mean(waits)) if waits else None


def _nearest(trail: Trail) -> Floats | None:
    """(n,) distance between the footprint and the centre of the nearest body, m, +inf for none; None without people."""
    places = trail.bodies.places
    if not trail.bodies.are_there or not trail.footprint.size:
        return None
    in_base = transform(inverse(np.stack([trail.x, trail.y, trail.heading], 1)), places)
    gaps = gaps_to_points(trail.footprint, in_base.reshape(-1, 2)).reshape(places.shape[:2])
    return np.asarray(np.where(np.isfinite(gaps), gaps, np.inf).min(axis=1))


def _fine_times(trail: Trail) -> Floats:
    return np.arange(trail.time[0], trail.time[-1], FINE)


def _finely(trail: Trail) -> Floats | None:
    """The distances of `_nearest` at each `FINE`, so that the period of the trail matters little."""
    near = _nearest(trail)
    return None if near is None else np.interp(_fine_times(trail), trail.time, np.minimum(near, FAR))


def _time_within(trail: Trail, low: float, high: float) -> float | None:
    near = _finely(trail)
    return None if near is None else float(((near >= low) & (near < high)).sum() * FINE)


def _depth(trail: Trail, low: float, high: float) -> float | None:
    near = _finely(trail)
    if near is None:
        return None
    within = near[(near >= low) & (near < high)]
    return float((high - within).mean()) if within.size else 0.0


def _mean_distance(trail: Trail, part: int) -> float | None:
    known = trail.tracking
    if not trail.bodies.are_there or not len(known.distances):
        return None
    return float(known.distances[:, part].mean())


READS = (("node", "tracks"),)

PEOPLE_METRICS = (
    Metric(
        "person_distance_min", "m", "higher", person_distance_min,
        "Least distance between the footprint and the centre of a body that moves. Undefined without such a body.",
        NOT_NEGATIVE,
    ),
    Metric(
        "intimate_time", "s", "lower", intimate_time,
        "Time in which that distance was below 0.45 m. Undefined as `person_distance_min`.",
        NOT_NEGATIVE,
    ),
    Metric(
        "intimate_depth", "m", "lower", intimate_depth,
        "Mean of 0.45 m less that distance over that time; 0 without such a time. Undefined as `person_distance_min`.",
        (0.0, INTIMATE), is_detail=True,
    ),
    Metric(
        "personal_time", "s", "lower", personal_time,
        "Time in which that distance was 0.45 to 1.2 m. Undefined as `person_distance_min`.",
        NOT_NEGATIVE,
    ),
    Metric(
        "personal_depth", "m", "lower", personal_depth,
        "Mean of 1.2 m less that distance over that time; 0 without such a time. Undefined as `person_distance_min`.",
        (0.0, PERSONAL), is_detail=True,
    ),
    Metric(
        "time_to_collision_min", "s", "higher", time_to_collision_min,
        "Least time until the discs of robot and body would touch at constant velocities; 0 if they did. Undefined "
        "if they were never on such a course, or as `person_distance_min`.",
        NOT_NEGATIVE,
    ),
    Metric(
        "speed_near_people", "m/s", "lower", speed_near_people,
        "Mean speed while that distance was below 1.2 m. Undefined without such a time, or as `person_distance_min`.",
        NOT_NEGATIVE, is_detail=True,
    ),
    Metric(
        "track_ospa", "m", "lower", track_ospa,
        "Mean OSPA distance (order 1, cut-off 1 m) between the tracks and the moving bodies in view within 8 m. "
        "Undefined without a tracker, or as `person_distance_min`.",
        (0.0, 1.0), reads=READS, is_detail=True,
    ),
    Metric(
        "track_ospa_location", "m", "lower", track_ospa_location,
        "Part of it for the places. Undefined as `track_ospa`.",
        (0.0, 1.0), reads=READS, is_detail=True,
    ),
    Metric(
        "track_ospa_cardinality", "m", "lower", track_ospa_cardinality,
        "Part of it for missing and false tracks. Undefined as `track_ospa`.",
        (0.0, 1.0), reads=READS, is_detail=True,
    ),
    Metric(
        "false_tracks", "1/min", "lower", false_tracks,
        "Tracks that were never within 1 m of a moving body in view, by time. Undefined without a tracker or ground "
        "truth.",
        NOT_NEGATIVE, reads=READS, is_detail=True,
    ),
    Metric(
        "track_speed_rms", "m/s", "lower", track_speed_rms,
        "Root mean square of the difference between the velocities of tracks and of their bodies. Undefined if none "
        "was tracked.",
        NOT_NEGATIVE, reads=READS, is_detail=True,
    ),
    Metric(
        "track_latency", "s", "lower", track_latency,
        "Mean time in view of a body before its first track. Undefined as `track_ospa`.",
        NOT_NEGATIVE, reads=READS, is_detail=True,
    ),
)  # fmt: skip
