"""Figures 10 and 11 of Hoang et al. 2013, drawn from runs: tracking and the unexpected obstacle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from navloom.geometry.frames import transform
from navloom.messages import Pose2D
from navloom_study.report import GREY, draw_footprints, draw_outlines, new_figure, outline_of
from numpy.typing import NDArray

from navloom_hoang2013.figures import (
    BLACK,
    BLUE,
    COLUMN,
    GREEN,
    ORANGE,
    PINK,
    VERMILION,
    draw_places,
    draw_world,
    legend_below,
    plan_axes,
    set_room,
)
from navloom_hoang2013.runs import GATE_LINE, Choice, Drive, box

__all__ = ["avoiding_figure", "choice_figure", "tracking_figure"]

Floats = NDArray[np.float64]
PALE = "#BBD6E8"
"""Colour of sectors that are not blocked."""
FILL = "#F3D9C6"
"""Fill colour of the obstacle that only the sonars see."""
RING = (0.62, 0.26)
"""Inner radius of the histogram's ring, and length of its highest bar, m."""
VIEW = 1.75
"""Half the side of the close-up, m."""
ARROWS = ((BLACK, 3.0, "heading θ"), (GREEN, 1.3, "to the target θt"), (VERMILION, 1.6, "chosen θd"))
"""Colour, line width and label of each direction. The first is the widest, since the second may cover it."""


def tracking_figure(drive: Drive) -> Figure:
    """Fig. 10: the real trajectory over the designed one, and the errors of eq. (4) and the speed over time."""
    assert drive.trajectory is not None
    figure, (plan, position, heading, speed) = new_figure(COLUMN, 152.0, 4)
    grid = plan.get_gridspec()
    grid.set_height_ratios([5.0, 1.25, 1.0, 1.0])
    set_room(plan)
    robot = drive.episode.system.robot
    draw_world(plan, drive.world, robot.height)
    plan.plot(*drive.trajectory.samples[:, 1:3].T, color=BLUE, linewidth=2.6, alpha=0.55, label="designed", zorder=3)
    plan.plot(*drive.episode.recorder.driven.T, color=VERMILION, linewidth=1.0, label="real", zorder=4)
    draw_places(plan, drive, gates_at=GATE_LINE, beside=0.6)
    plan.legend(loc="upper left", bbox_to_anchor=(0.0, 1.12), ncols=2, fontsize=7, frameon=False)
    time, e1, e2, e3 = drive.errors.T
    position.plot(time, 100.0 * e1, color=GREEN, label="e₁, ahead")
    position.plot(time, 100.0 * e2, color=PINK, label="e₂, to the left")
    position.set_ylabel("error, cm")
    heading.plot(time, np.degrees(e3), color=BLUE, label="e₃, heading")
    heading.set_ylabel("error, °")
    truth = np.array(drive.episode.recorder.truth)
    speed.plot(truth[:, 0], truth[:, 4], color=VERMILION, label="real")
    recorder = drive.episode.recorder
    speed.plot(recorder.reference_times, recorder.speeds, color=BLUE, linewidth=0.9, linestyle="--", label="reference")
    speed.axhspan(0.2, 0.4, color=BLUE, alpha=0.10, linewidth=0.0, label="paper: 0.2 to 0.4")
    speed.set_ylabel("speed, m/s")
    speed.set_ylim(0.0, 0.5)
    speed.set_xlabel("time since the run began, s")
    for axes in (position, heading, speed):
        axes.set_xlim(0.0, math.ceil(truth[-1, 0]))
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, 1.30), ncols=3, fontsize=7, frameon=False, borderpad=0.0)
    return figure


def avoiding_figure(drive: Drive) -> Figure:
    """Fig. 11: the track around the obstacle O and back to the trajectory, coloured by active source."""
    assert drive.trajectory is not None
    figure, axes = plan_axes(90.0)
    draw_world(axes, drive.world, drive.episode.system.robot.height)
    _draw_o(axes, drive)
    _draw_outlines(axes, drive)
    axes.plot(*drive.trajectory.samples[:, 1:3].T, color=GREY, linewidth=1.2, linestyle=(0, (4, 2)), label="designed",
              zorder=2.6)  # fmt: skip
    for source, colour, label in (
        ("controller", BLUE, "law (6) drives"),
        ("avoider", VERMILION, "Improved VFH drives"),
    ):
        for number, part in enumerate(drive.driven_by(source)):
            axes.plot(*part.T, color=colour, linewidth=1.8, zorder=4, label=label if number == 0 else None)
    if drive.choice is not None:
        pose = drive.choice.pose
        axes.plot(
            pose.x, pose.y, "D", color=BLACK, markersize=3.5, zorder=6, linestyle="none", label="first turns away"
        )
    draw_places(axes, drive, gates_at=GATE_LINE, beside=0.8)
    legend_below(figure, axes, 2, 1.0)
    return figure


def _draw_o(axes: Any, drive: Drive) -> None:
    obstacle = box(drive.world, "obstacle O")
    draw_outlines(axes, [outline_of(obstacle)], BLACK, facecolors=FILL, zorder=3)
    axes.annotate("O", (obstacle.x[0], obstacle.y[1]), (-3, 1), textcoords="offset points", ha="right", fontsize=9,
                  fontweight="bold", zorder=7)  # fmt: skip


def _draw_outlines(axes: Any, drive: Drive) -> None:
    """Draw the robot's outline every two seconds."""
    poses = [row[1:4] for row in drive.episode.recorder.truth[:: round(2.0 / drive.episode.system.config.run.period)]]
    draw_footprints(axes, poses, drive.episode.system.robot.footprint, GREEN, "robot, every 2 s")


def choice_figure(drive: Drive) -> Figure:
    """Fig. 11, the moment of decision: sonar echoes, certainty window and polar histogram."""
    choice = drive.choice
    assert choice is not None
    figure, (plan, bars) = new_figure(COLUMN, 148.0, 2)
    plan.get_gridspec().set_height_ratios([2.6, 1.0])
    _draw_view(plan, drive, choice)
    _draw_bars(bars, choice)
    return figure


def _draw_view(axes: Any, drive: Drive, choice: Choice) -> None:
    """Draw the robot, the sonar cones, the cells and the ring around the robot, map frame."""
    axes.set_aspect("equal")
    middle = (choice.pose.x + 0.35, choice.pose.y + 0.45)
    axes.set_xlim(middle[0] - VIEW, middle[0] + VIEW)
    axes.set_ylim(middle[1] - VIEW, middle[1] + VIEW)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    _draw_cones(axes, choice)
    _draw_window(axes, choice)
    _draw_o(axes, drive)
    pose = np.array([choice.pose.x, choice.pose.y, choice.pose.heading])
    axes.fill(*transform(pose, drive.episode.system.robot.footprint).T, facecolor="white", edgecolor=BLACK,
              linewidth=0.9, zorder=3)  # fmt: skip
    _draw_ring(axes, choice)
    chosen = choice.diagnostics.chosen
    assert chosen is not None
    for angle, (colour, width, label) in zip((choice.pose.heading, choice.to_target, chosen), ARROWS, strict=True):
        _draw_arrow(axes, choice.pose, angle, colour, width, label)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.05, 1.0), ncols=3, fontsize=7, frameon=False, handletextpad=0.5,
                columnspacing=1.0, handlelength=1.4)  # fmt: skip


def _draw_arrow(axes: Any, pose: Pose2D, angle: float, colour: str, width: float, label: str) -> None:
    reach = sum(RING) + 0.45
    tip = (pose.x + reach * math.cos(angle), pose.y + reach * math.sin(angle))
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": width, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tip, (pose.x, pose.y), zorder=6, arrowprops=style)
    axes.plot([], [], color=colour, linewidth=width, label=label)


def _draw_cones(axes: Any, choice: Choice) -> None:
    """Draw each sonar's cone up to its echo, or faintly up to its maximum range if there is none."""
    scan, pose = choice.scan, choice.pose
    base = np.array([pose.x, pose.y, pose.heading])
    named = set()
    for origin, bearing, half, distance in zip(scan.origins, scan.bearings, scan.half_angles, scan.ranges, strict=True):
        seen = math.isfinite(distance)
        arc = np.linspace(bearing - half, bearing + half, 15)
        reach = float(distance) if seen else scan.range_max
        rim = origin + reach * np.column_stack((np.cos(arc), np.sin(arc)))
        corners = transform(base, np.vstack((origin, rim)))
        label = ("sonar, echo" if seen else "sonar, no echo") if seen not in named else None
        named.add(seen)
        axes.fill(*corners.T, facecolor=ORANGE if seen else GREY, alpha=0.28 if seen else 0.10, linewidth=0.0,
                  zorder=1.2, label=label)  # fmt: skip
        if seen:
            axes.plot(*corners[1:].T, color=ORANGE, linewidth=1.6, zorder=2.6)


def _draw_window(axes: Any, choice: Choice) -> None:
    """Draw the cells with a certainty: 3 on an acoustic axis, 2 on the rest of an arc."""
    shown = choice.diagnostics
    for value, colour in ((2, "#7A7A7A"), (3, BLACK)):
        rows, columns = np.nonzero(shown.window == value)
        x = shown.window_x + (columns + 0.5) * shown.window_resolution
        y = shown.window_y + (rows + 0.5) * shown.window_resolution
        axes.scatter(x, y, marker="s", s=11, facecolors=colour, linewidths=0.0, zorder=2.8, label=f"certainty {value}")


def _draw_ring(axes: Any, choice: Choice) -> None:
    """Draw the histogram as a ring around the robot, with blocked sectors in a darker colour."""
    shown, pose = choice.diagnostics, choice.pose
    width = math.tau / len(shown.histogram)
    highest = max(float(shown.histogram.max()), shown.threshold)
    for number, density in enumerate(shown.histogram):
        colour = BLUE if density > shown.threshold else PALE
        reach = RING[0] + RING[1] * max(float(density) / highest, 0.02)
        turn = np.linspace(number * width, (number + 1) * width, 4)
        ray = np.column_stack((np.cos(turn), np.sin(turn)))
        ring = np.vstack((RING[0] * ray, reach * ray[::-1])) + (pose.x, pose.y)
        axes.fill(*ring.T, facecolor=colour, edgecolor=colour, linewidth=0.3, zorder=3.5)


def _draw_bars(axes: Any, choice: Choice) -> None:
    """Draw the histogram over the angle from the heading, with the threshold."""
    shown, heading = choice.diagnostics, choice.pose.heading
    count = len(shown.histogram)
    edges = np.linspace(-180.0, 180.0, count + 1)
    sector = np.floor((np.radians(0.5 * (edges[1:] + edges[:-1])) + heading) / (math.tau / count)).astype(np.int64)
    density = shown.histogram[sector % count]
    axes.axvspan(-100.0, 100.0, color=GREY, alpha=0.10, linewidth=0.0, label="within 100° of θ")
    axes.stairs(density, edges, fill=True, color=PALE)
    axes.stairs(np.where(density > shown.threshold, density, 0.0), edges, fill=True, color=BLUE, label="blocked")
    axes.axhline(shown.threshold, color=BLACK, linewidth=0.8, linestyle=":", label="threshold")
    assert shown.chosen is not None
    for angle, (colour, line, _) in zip((heading, choice.to_target, shown.chosen), ARROWS, strict=True):
        axes.axvline(math.degrees(math.remainder(angle - heading, math.tau)), color=colour, linewidth=line)
    axes.set_xlim(180.0, -180.0)
    axes.set_xticks(range(-180, 181, 60))
    axes.set_xlabel("direction from the heading θ, left positive, °")
    axes.set_ylabel("density")
    axes.locator_params(axis="y", nbins=3)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=3, fontsize=7, frameon=False)
