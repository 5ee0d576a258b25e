"""Draws decisions: an avoider's histogram and choice, the source that drives, stops with reasons, and goals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from navloom.geometry.angles import wrap
from navloom.messages import (
    AvoiderDiagnostics,
    AvoiderStatus,
    Feedback,
    GateStatus,
    GoalResult,
    HandOver,
    RecoveryRequest,
    Rollouts,
    Selection,
)
from navloom.navigation.status_words import what_limits, who_drives, why_stopped

from navloom_viewer.colours import BLOCKED, FREE, VERMILION, WHITE, cost_colours, faded
from navloom_viewer.draw_sensing import BLENDED
from navloom_viewer.panels import Change, Drawn, Seen
from navloom_viewer.shapes import at_height, rgba_cells, ring_bars, slot_arcs

__all__ = ["avoider_status", "feedback", "gate_status", "goal_result", "handover", "recovery_request",
           "rollouts", "selection"]  # fmt: skip

RING_UNIT, RING_MOST = 0.30, 2.0
"""Length of a ring bar at the threshold, m, and the density, in units of the threshold, at which bars are cut."""
LEVELS = {"succeeded": "INFO", "cancelled": "INFO"}


def avoider_status(message: AvoiderStatus, seen: Seen) -> Drawn:
    """Draw an avoider's decision: state and bars of a shadow, the choice too of robots side by side, else everything.

    In ticks without diagnostics the last ones stay visible.
    """
    import rerun as rr

    name, what = seen.actor.name, message.diagnostics
    yield seen.lane("avoider"), Change(message.status, rr.StateChange(state=message.status))
    if what is None:
        if message.status != "trapped":
            yield f"/log/{name}/avoider", Change("", None)
        return
    if message.status == "trapped":
        text = f"{name}: {what.why}"
        yield f"/log/{name}/avoider", Change(text, rr.TextLog(text, level="WARN"))
    else:
        yield f"/log/{name}/avoider", Change("", None)
    if len(what.histogram) and seen.pose is not None:
        yield f"/histogram/{name}", _bars(what, seen)
    if seen.actor.is_shadow or seen.pose is None:
        return
    if seen.is_alone:
        yield from _window(what, seen)
        yield from _ring(what, seen)
    yield seen.in_map("choice"), _choice(what, seen)


def _bars(what: AvoiderDiagnostics, seen: Seen) -> Any:
    """Densities in units of the threshold, by direction from the robot, deg, positive to the right.

    The chart's axis increases to the right, so that the robot's left is at the left of the chart.
    """
    import rerun as rr

    assert seen.pose is not None
    sectors = len(what.histogram)
    directions = np.arange(sectors, dtype=np.float64) * (math.tau / sectors) - seen.pose.heading
    degrees = np.degrees(wrap(-directions))
    order = np.argsort(degrees)
    values = what.histogram[order] / (what.threshold or 1.0)
    widths = np.full(sectors, 0.85 * 360.0 / sectors)
    return rr.BarChart(values, abscissa=degrees[order], widths=widths, color=seen.actor.colour)


def _window(what: AvoiderDiagnostics, seen: Seen) -> Drawn:
    """The certainty window; higher certainty is redder."""
    import rerun as rr

    if not what.window.size:
        return
    share = what.window / max(1, int(what.window.max()))
    colours = np.zeros((*what.window.shape, 4), dtype=np.uint8)
    colours[..., 0], colours[..., 1] = 230, np.round(170 * (1.0 - share))
    colours[..., 3] = np.where(what.window > 0, 90 + np.round(150 * share), 0)
    image, cols, rows = rgba_cells(colours)
    layout = rr.components.ImageFormat(width=cols, height=rows, color_model="RGBA", channel_datatype="U8")
    corner = [what.window_x, what.window_y, 0.02]
    resolution = what.window_resolution
    yield (
        seen.in_map("window"),
        rr.GridMap(data=image, format=layout, cell_size=resolution, translation=corner, opacity=BLENDED),
    )
    wide, high = cols * resolution, rows * resolution
    edge = np.array([(0, 0), (wide, 0), (wide, high), (0, high), (0, 0)]) + corner[:2]
    yield seen.in_map("window_edge"), rr.LineStrips3D([at_height(edge, 0.03)], radii=0.008, colors=[(230, 170, 0, 160)])


def _ring(what: AvoiderDiagnostics, seen: Seen) -> Drawn:
    """Histogram and slots around the robot."""
    import rerun as rr

    assert seen.pose is not None
    radius = float(np.hypot(*seen.robot.footprint.T).max()) + 0.1
    if len(what.histogram):
        densities = what.histogram / (what.threshold or 1.0)
        bars = ring_bars(seen.pose, densities, radius, RING_UNIT, RING_MOST, 0.12)
        blocked = densities > 1.0
        colours = np.where(blocked[:, None], np.array(BLOCKED), np.array(faded(FREE, 0.8))).astype(np.uint8)
        yield seen.in_map("histogram"), rr.LineStrips3D(bars.astype(np.float32), radii=0.02, colors=colours)
    arcs = slot_arcs(seen.pose, what.slots, radius - 0.05, 0.12)
    yield seen.in_map("slots"), rr.LineStrips3D(arcs.astype(np.float32), radii=0.015, colors=[faded(FREE, 0.9)])


def _choice(what: AvoiderDiagnostics, seen: Seen) -> Any:
    """An arrow in the chosen direction; none if no direction is chosen."""
    import rerun as rr

    assert seen.pose is not None
    radius = float(np.hypot(*seen.robot.footprint.T).max()) + 0.1
    way = [] if what.chosen is None else [(math.cos(what.chosen), math.sin(what.chosen), 0.0)]
    arrow = (np.array(way) * (radius + 0.5)).reshape(-1, 3)
    origin = np.array([[seen.pose.x, seen.pose.y, seen.robot.height + 0.02]] * len(way)).reshape(-1, 3)
    colour = (255, 255, 255, 255) if seen.is_alone else seen.actor.colour
    return rr.Arrows3D(vectors=arrow, origins=origin, radii=0.025, colors=[colour])


def rollouts(message: Rollouts, seen: Seen) -> Drawn:
    """Draw motions that the avoider rolled out, and what the chosen one costs by each critic.

    Roll-outs are green, cheap, to red, dear; those that collide are grey up to the collision, the chosen one is white.
    Not those of shadows and of robots side by side, which would hide each other.
    """
    import rerun as rr

    if seen.actor.is_shadow or not seen.is_alone:
        return
    height = seen.robot.height + 0.02
    lines = [at_height(points, height) for points in message.points.astype(np.float64)]
    yield seen.in_map("rollouts"), rr.LineStrips3D(lines, radii=0.006, colors=cost_colours(message.costs))
    chosen = at_height(message.chosen.astype(np.float64), height + 0.01)
    yield seen.in_map("rollout_chosen"), rr.LineStrips3D([chosen], radii=0.015, colors=[WHITE])
    order = np.argsort(-message.critic_costs, kind="stable")
    rows = "".join(f"| {message.critics[k].replace('_', ' ')} | {message.critic_costs[k]:.3f} |\n" for k in order)
    table = f"| critic | cost of the chosen motion |\n|---|---:|\n{rows}"
    yield "/critics", rr.TextDocument(table, media_type="text/markdown")


def handover(message: HandOver, seen: Seen) -> Drawn:
    """Log when the avoider takes over and when it hands back."""
    import rerun as rr

    name = seen.actor.name
    would = "would take over" if seen.actor.is_shadow else "takes over"
    back = "would hand back" if seen.actor.is_shadow else "hands back"
    if message.engaged:
        near = f": something {message.nearest:.2f} m ahead" if math.isfinite(message.nearest) else ""
        text, key = f"{name}: avoider {would}{near}", "engaged"
    else:
        text, key = f"{name}: avoider {back}", ""
    yield f"/log/{name}/handover", Change(key, rr.TextLog(text, level="INFO"))


def gate_status(message: GateStatus, seen: Seen) -> Drawn:
    """Draw the source that drives; log a stop with its reason in words and the remedy."""
    import rerun as rr

    name = seen.actor.name
    state: str = message.source if message.source != "none" else "braking"
    if message.stopped:
        state = "stopped" if message.interrupts else "standing"
    yield seen.lane("driver"), Change(state, rr.StateChange(state=state))
    why, remedy = why_stopped(message)
    key = message.reason if message.stopped else ""
    level = "INFO" if state == "standing" else "WARN"
    text = f"{name}: gate stops the robot: {why}" + (f"; {remedy}" if remedy and state == "stopped" else "")
    if state == "standing":
        text = f"{name}: is stopped, {why}"
    yield f"/log/{name}/gate", Change(key, rr.TextLog(text, level=level) if key else None)
    slowed = f"{name}: gate slows the robot: {what_limits(message)}"
    if message.limit == "overridden":
        slowed = f"{name}: {who_drives(message)}"
    told = message.limit if not message.stopped else ""
    yield f"/log/{name}/monitor", Change(told, rr.TextLog(slowed, level="INFO") if told else None)
    places = [] if message.place is None else [(message.place.x, message.place.y, 0.1)]
    yield seen.in_base("limit"), Change(str(places), rr.Points3D(places, radii=0.06, colors=[VERMILION]))


def feedback(message: Feedback, seen: Seen) -> Drawn:
    """Draw the state of the goal."""
    import rerun as rr

    yield seen.lane("goal"), Change(message.state, rr.StateChange(state=message.state))


def goal_result(message: GoalResult, seen: Seen) -> Drawn:
    """Log the result of a goal."""
    import rerun as rr

    place = f"({message.place.x:.2f}, {message.place.y:.2f})"
    text = f"{seen.actor.name}: goal {message.outcome} at {place}: {message.reason}"
    yield f"/log/{seen.actor.name}/goal", rr.TextLog(text, level=LEVELS.get(message.outcome, "ERROR"))


def recovery_request(message: RecoveryRequest, seen: Seen) -> Drawn:
    """Log the start of a recovery."""
    import rerun as rr

    name = seen.actor.name
    text = f"{name}: recovery {message.attempt}: {message.reason}"
    key = f"{message.attempt} {message.reason}" if message.active else ""
    yield f"/log/{name}/recovery", Change(key, rr.TextLog(text, level="WARN") if message.active else None)


def selection(message: Selection, seen: Seen) -> Drawn:
    """Log a swap."""
    import rerun as rr

    if message.epoch:
        text = f"{seen.actor.name}: active from tick {message.from_tick}: {', '.join(message.instances)}"
        yield f"/log/{seen.actor.name}/selection", Change(text, rr.TextLog(text, level="INFO"))
