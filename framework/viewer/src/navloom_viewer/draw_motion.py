"""Draws poses, paths and commands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from navloom.messages import (
    Bodies,
    Command,
    Hypotheses,
    Path,
    PlanFailure,
    PoseEstimate,
    Reference,
    TrackingCommand,
    Trajectory,
    Truth,
)
from numpy.typing import NDArray

from navloom_viewer.colours import PLAN, TRAJECTORY, WHITE, faded
from navloom_viewer.panels import Change, Drawn, Seen
from navloom_viewer.shapes import arc_of_twist, at_height, label, stripes

__all__ = [
    "bodies",
    "command",
    "hypotheses",
    "path",
    "plan_failure",
    "pose",
    "reference",
    "tracking_command",
    "trajectory",
    "truth",
]

MOVES = (255, 200, 160, 255)
"""Colour of what moves by itself."""
AHEAD = 2.0
"""Duration of driving for which a command is drawn, s."""
SHADOW = 0.5
"""Opacity of a shadow's drawings."""
REACH = 0.6
"""Length of an arrow of direction at rest beyond the robot's outline, m; it grows by the way of two seconds."""
HEAD = 0.6
"""Length of the arrow at a place where the robot may be, m; the likelier, the thicker."""
STOREY = 0.3
"""Difference in height between the arrows of two instances, m, so that their names do not overlap."""


def transform(x: float, y: float, heading: float, frame: str) -> Any:
    """Transform of a frame in the map frame."""
    import rerun as rr

    turn = rr.RotationAxisAngle([0.0, 0.0, 1.0], radians=heading)
    return rr.Transform3D(translation=[x, y, 0.0], rotation_axis_angle=turn, parent_frame="map", child_frame=frame)


def pose(message: PoseEstimate, seen: Seen) -> Drawn:
    """Draw the estimated pose and velocity, and log the localizer's state."""
    import rerun as rr

    at, twist, name = message.pose, message.twist, seen.actor.name
    if seen.actor.is_shadow:
        marker = at_height(np.array([(at.x, at.y)]), 0.1)
        yield seen.in_map("pose"), rr.Points3D(marker, radii=0.06, colors=faded(seen.actor.colour, SHADOW))
        return
    yield f"/tf/{name}", transform(at.x, at.y, at.heading, f"{name}/base")
    # Above the arrows of its shadows, and each robot higher than the one before: at the start they are in one place.
    height = seen.robot.height + 0.4 + STOREY * (len(seen.robot.shadows) + seen.stripe[0])
    seconds = math.floor(seen.time)
    named = label([(0.0, 0.0, height)], [f"{name}, {seconds} s"], WHITE)
    yield seen.in_base("name"), Change(str(seconds), named)
    yield f"/metrics/speed/{name}", rr.Scalars(twist.vx)
    yield f"/metrics/turn_rate/{name}", rr.Scalars(math.degrees(twist.wz))
    # Only changes are logged: an estimate comes with every tick.
    doubt = "" if message.state == "tracking" else message.state
    text = f"{name}: the localizer is {message.state}: {message.reason}"
    yield f"/log/{name}/localizer", Change(doubt, rr.TextLog(text, level="WARN") if doubt else None)


def hypotheses(message: Hypotheses, seen: Seen) -> Drawn:
    """Draw the places where a robot may be that does not know where it is; nothing where there is one only."""
    import rerun as rr

    poses, weights = (message.poses, message.weights) if len(message.poses) > 1 else (message.poses[:0], np.empty(0))
    headings = poses[:, 2]
    ahead = HEAD * np.stack([np.cos(headings), np.sin(headings), np.zeros(len(poses))], axis=1)
    colour = faded(seen.actor.colour, SHADOW) if seen.actor.is_shadow else _colour(seen, WHITE)
    arrows = rr.Arrows3D(
        vectors=ahead, origins=at_height(poses[:, :2], 0.12), radii=0.02 + 0.08 * weights, colors=[colour] * len(poses)
    )
    yield seen.in_map("hypotheses"), arrows


def bodies(message: Bodies, seen: Seen) -> Drawn:
    """Draw what moves beside the robots, with its names, where it is."""
    import rerun as rr

    others = len(message.names) - message.robots
    parts = message.parts[message.parts[:, 0] < others]
    style: dict[str, Any] = {"colors": [MOVES], "fill_mode": rr.components.FillMode.TransparentFillMajorWireframe}
    boxes, rounds = parts[parts[:, 4] > 0.0], parts[parts[:, 4] == 0.0]
    turns = [rr.RotationAxisAngle([0.0, 0.0, 1.0], radians=yaw) for yaw in boxes[:, 5].tolist()]
    halves = np.column_stack([boxes[:, 3:5], 0.5 * (boxes[:, 7] - boxes[:, 6])])
    yield (
        seen.in_map("bodies"),
        rr.Boxes3D(centers=_middles(boxes), half_sizes=halves, rotation_axis_angles=turns, radii=0.006, **style),
    )
    lengths, radii = rounds[:, 7] - rounds[:, 6], rounds[:, 3]
    yield (
        seen.in_map("bodies_round"),
        rr.Cylinders3D(lengths=lengths, radii=radii, centers=_middles(rounds), line_radii=0.006, **style),
    )
    heights = [parts[parts[:, 0] == number, 7].max() for number in range(others)]
    tops = [(x, y, top + 0.25) for (x, y, _), top in zip(message.poses[:others].tolist(), heights, strict=True)]
    yield seen.in_map("body_names"), label(tops, list(message.names[:others]), MOVES)


def _middles(parts: NDArray[np.float64]) -> NDArray[np.float64]:
    """(p, 3) middles of rows of `Bodies.parts`, m, map frame."""
    return np.column_stack([parts[:, 1:3], 0.5 * (parts[:, 6] + parts[:, 7])])


def truth(message: Truth, seen: Seen) -> Drawn:
    """Draw the true pose and the clearance, and log contacts."""
    import rerun as rr

    at, name = message.pose, seen.actor.name
    yield f"/tf/{name}_true", transform(at.x, at.y, at.heading, f"{name}/true")
    if math.isfinite(message.clearance):
        yield f"/metrics/clearance/{name}", rr.Scalars(message.clearance)
    if message.touching:
        text = f"{name}: touches {message.nearest}"
        yield f"/log/{name}/contact", Change(text, rr.TextLog(text, level="ERROR"))
    else:
        yield f"/log/{name}/contact", Change("", None)


def path(message: Path, seen: Seen) -> Drawn:
    """Draw the planned path."""
    yield seen.in_map("plan"), _line(message.points, seen, PLAN, 0.02, 0.04)


def plan_failure(message: PlanFailure, seen: Seen) -> Drawn:
    """Draw the place where planning failed, and log the reason."""
    import rerun as rr

    words = message.kind.replace("_", " ")
    place = at_height(np.array([(message.place.x, message.place.y)]), 0.1)
    yield seen.in_map("no_plan"), rr.Points3D(place, radii=0.12, colors=[(213, 94, 0, 255)], labels=[words])
    text = f"{seen.actor.name}: no plan, {words}: {message.detail}"
    yield f"/log/{seen.actor.name}/planner", rr.TextLog(text, level="WARN")


def trajectory(message: Trajectory, seen: Seen) -> Drawn:
    """Draw the trajectory that the controller follows."""
    yield seen.in_map("trajectory"), _line(message.samples[:, 1:3], seen, TRAJECTORY, 0.03, 0.06)


def reference(message: Reference, seen: Seen) -> Drawn:
    """Draw the target point and the cross-track error."""
    import rerun as rr

    if seen.actor.is_shadow:
        return
    at = at_height(np.array([(message.target.x, message.target.y)]), 0.1)
    yield seen.in_map("target"), rr.Points3D(at, radii=0.07, colors=[_colour(seen, TRAJECTORY)])
    yield f"/metrics/cross_track/{seen.actor.name}", rr.Scalars(message.cross_track)


def command(message: Command, seen: Seen) -> Drawn:
    """Draw the gate's command as the motion of the next two seconds; for a shadow, its own command."""
    return _command(message.twist.vx, message.twist.wz, seen)


def tracking_command(message: TrackingCommand, seen: Seen) -> Drawn:
    """Draw a shadow controller's command; for the active one the gate's command is drawn instead."""
    return _command(message.twist.vx, message.twist.wz, seen)


def _command(vx: float, wz: float, seen: Seen) -> Drawn:
    import rerun as rr

    shadow, name = seen.actor.is_shadow, seen.actor.name
    if shadow or any(role == seen.role for role, _ in seen.robot.shadows):
        yield seen.in_base(f"direction_{seen.role}"), _direction(vx, wz, seen)
    if not shadow and seen.role != "gate":
        return
    colour = faded(seen.actor.colour, SHADOW) if shadow else _colour(seen, WHITE)
    way = arc_of_twist(vx, wz, AHEAD, seen.robot.height + 0.05)
    yield seen.in_base("command"), rr.LineStrips3D([way], radii=0.015 if shadow else 0.03, colors=[colour])
    if shadow:
        yield f"/metrics/speed/{name}", rr.Scalars(vx)
        yield f"/metrics/turn_rate/{name}", rr.Scalars(math.degrees(wz))
    elif seen.is_alone:
        yield f"/metrics/speed/{name}_command", rr.Scalars(vx)
        yield f"/metrics/turn_rate/{name}_command", rr.Scalars(math.degrees(wz))


def _direction(vx: float, wz: float, seen: Seen) -> Any:
    """An arrow to where a command leads, for a shadow with its name; its command to stop is a name without an arrow.

    It has the direction of the chord of the driven arc, and of a turn on the spot half its angle.
    """
    import rerun as rr

    # Clamped: beyond half a turn the arrow would point to the wrong side.
    turned = max(-math.pi, min(math.pi, 0.5 * wz * AHEAD))
    length = float(np.hypot(*seen.robot.footprint.T).max()) + REACH + AHEAD * abs(vx)
    length = math.copysign(length, vx) if vx or wz else 0.0
    way = [[length * math.cos(turned), length * math.sin(turned), 0.0]]
    place = (seen.role, seen.instance)
    level = 1 + seen.robot.shadows.index(place) if place in seen.robot.shadows else 0  # labels do not overlap
    origin = [[0.0, 0.0, seen.robot.height + 0.1 + STOREY * level]]
    colour = seen.actor.colour if seen.actor.is_shadow else _colour(seen, WHITE)
    labels = [seen.instance if length else f"{seen.instance}: stop"] if seen.actor.is_shadow else []
    return rr.Arrows3D(vectors=way, origins=origin, radii=0.04, colors=[colour], labels=labels, show_labels=True)


def _colour(seen: Seen, alone: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """The object's own colour if there is a single robot, else the robot's colour."""
    return alone if seen.is_alone else seen.actor.colour


def _line(points: Any, seen: Seen, alone: tuple[int, int, int, int], radius: float, z: float) -> Any:
    import rerun as rr

    if seen.actor.is_shadow:
        colour, radius = faded(seen.actor.colour, SHADOW), 0.5 * radius
    else:
        colour = _colour(seen, alone) if seen.is_alone else faded(seen.actor.colour, 0.6)
        radius = radius if seen.is_alone else 0.6 * radius
    share = (0, 1) if seen.actor.is_shadow else seen.stripe
    pieces = stripes(points, *share) if len(points) > 1 else []
    return rr.LineStrips3D([at_height(piece, z) for piece in pieces], radii=radius, colors=[colour])
