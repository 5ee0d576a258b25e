"""How much two instances of a role differ on the same inputs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.engine.difference_units import TOLERANCES
from navloom.geometry.angles import wrap
from navloom.geometry.frames import compose, inverse, transform
from navloom.geometry.polylines import hausdorff_distance
from navloom.messages import (
    Avoidance,
    Command,
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    Path,
    PlanFailure,
    Pose2D,
    PoseEstimate,
    RecoveryStep,
    TrackingCommand,
    Twist2D,
)
from navloom.navigation.blocked_trajectory import OCCUPIED_FROM
from navloom.roles import ROLES, answers_of

__all__ = ["differences", "is_differing", "would_stop"]


def differences(role: str, ours: Message, theirs: Message) -> dict[str, float]:
    """Compare the answers of two instances to the same inputs.

    Args:
        role: Role of both, for the error.
        ours: Message of the active instance.
        theirs: Message of the other instance.

    Returns:
        Differences by name. For
        velocities (avoider, controller, recovery): `vx`, `vy`, m/s, and `wz`, rad/s, theirs minus ours;
        answers of planners: `found`, 1 if only one of them found a path; for two paths `length`, m, the planned length,
        theirs minus ours, and `hausdorff`, m, the Hausdorff distance between the paths;
        maps: `cells`, the share of our cells that differ in being free, occupied or unknown, and `occupied`, the same
        share among the cells that are occupied in either map (cells beyond our grid are ignored, cells that theirs
        lacks are unknown);
        poses (localizer, platform): `distance`, m, and `angle`, rad, both ≥ 0;
        other messages of node plugins, and answers of other roles: `unequal`, 1 if any field except the stamp differs.
        Empty for messages that are not compared.

    Raises:
        TypeError: The two messages are of different types.
    """
    # Before the check of types: a path and a failure are both answers of a planner.
    if isinstance(ours, (Path, PlanFailure)) and isinstance(theirs, (Path, PlanFailure)):
        return _of_answers(ours, theirs)
    if type(ours) is not type(theirs):
        kinds = f"{type(ours).__name__} and {type(theirs).__name__}"
        raise TypeError(f"differences of role {role}: {kinds}, expected messages of one kind")
    if isinstance(ours, MapUpdate) and isinstance(theirs, MapUpdate):
        return _of_maps(ours.grid, theirs.grid)
    our_twist, their_twist = _twist(ours), _twist(theirs)
    if our_twist is not None and their_twist is not None:
        return {name: getattr(their_twist, name) - getattr(our_twist, name) for name in ("vx", "vy", "wz")}
    our_pose, their_pose = _pose(ours), _pose(theirs)
    if our_pose is not None and their_pose is not None:
        turned = abs(float(wrap(np.asarray(their_pose.heading - our_pose.heading))))
        return {"distance": math.hypot(their_pose.x - our_pose.x, their_pose.y - our_pose.y), "angle": turned}
    # Of a role only the answer is compared, not what else its node publishes; nodes of strangers always are.
    is_compared = role not in ROLES or isinstance(ours, answers_of(role))
    return {"unequal": float(not _is_same(ours, theirs))} if is_compared else {}


def is_differing(found: dict[str, float]) -> bool:
    """Whether any difference is beyond its tolerance."""
    return any(abs(value) > TOLERANCES[name] for name, value in found.items())


def would_stop(ours: Message, theirs: Message) -> bool:
    """Whether the other instance commands no motion where the active one commands motion; False without velocities."""
    our_twist, their_twist = _twist(ours), _twist(theirs)
    return our_twist is not None and their_twist is not None and _moves(our_twist) and not _moves(their_twist)


def _moves(twist: Twist2D) -> bool:
    return any(abs(getattr(twist, name)) > TOLERANCES[name] for name in ("vx", "vy", "wz"))


def _twist(message: Message) -> Twist2D | None:
    if isinstance(message, Twist2D):
        return message
    return message.twist if isinstance(message, (Command, TrackingCommand, Avoidance, RecoveryStep)) else None


def _pose(message: Message) -> Pose2D | None:
    if isinstance(message, Pose2D):
        return message
    return message.pose if isinstance(message, (PoseEstimate, Odometry)) else None


def _is_same(ours: Any, theirs: Any) -> bool:
    """Whether two field values are equal, ignoring stamps."""
    if isinstance(ours, Message) and type(ours) is type(theirs):
        names = (name for name in type(ours).kinds if name != "stamp_ns")
        return all(_is_same(getattr(ours, name), getattr(theirs, name)) for name in names)
    if isinstance(ours, tuple) and isinstance(theirs, tuple):
        return len(ours) == len(theirs) and all(map(_is_same, ours, theirs))
    # Also for scalars; `==` of two arrays would be an array.
    return bool(np.array_equal(ours, theirs))


def _of_answers(ours: Path | PlanFailure, theirs: Path | PlanFailure) -> dict[str, float]:
    if isinstance(ours, Path) and isinstance(theirs, Path):
        apart = hausdorff_distance(ours.points, theirs.points)
        return {"found": 0.0, "length": theirs.length - ours.length, "hausdorff": apart}
    return {"found": float(isinstance(ours, Path) != isinstance(theirs, Path))}


def _of_maps(ours: OccupancyGrid, theirs: OccupancyGrid) -> dict[str, float]:
    mine, other = _kinds(ours.cells), _kinds(_seen_from(ours, theirs))
    differing = mine != other
    either = (mine == 1) | (other == 1)
    return {
        "cells": float(differing.mean()) if differing.size else 0.0,
        "occupied": float(differing[either].mean()) if either.any() else 0.0,
    }


def _kinds(cells: NDArray[np.int8]) -> NDArray[np.int8]:
    """-1 unknown, 0 free, 1 occupied."""
    return np.where(cells < 0, -1, cells >= OCCUPIED_FROM).astype(np.int8)


def _seen_from(ours: OccupancyGrid, theirs: OccupancyGrid) -> NDArray[np.int8]:
    """Their value at the centre of each of our cells; -1 outside their grid."""
    # The usual case, without the rounding of a transformation.
    if ours.cells.shape == theirs.cells.shape and (ours.resolution, ours.origin) == (theirs.resolution, theirs.origin):
        return theirs.cells
    rows, cols = np.indices(ours.cells.shape)
    centres = np.column_stack([cols.ravel() + 0.5, rows.ravel() + 0.5]) * ours.resolution
    ours_to_theirs = compose(inverse(_motion(theirs.origin)), _motion(ours.origin))
    at = np.floor(transform(ours_to_theirs, centres) / theirs.resolution).astype(np.int64)
    inside = ((at >= 0) & (at < theirs.cells.shape[::-1])).all(axis=1)
    seen = np.full(len(at), -1, dtype=np.int8)
    seen[inside] = theirs.cells[at[inside, 1], at[inside, 0]]
    return seen.reshape(ours.cells.shape)


def _motion(origin: Pose2D) -> NDArray[np.float64]:
    return np.array([origin.x, origin.y, origin.heading])
