"""Figure 12 of Hoang et al. 2013 as a strip of moments, and the speeds that occur."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from navloom.geometry.frames import transform
from navloom_study.report import GREY, draw_outlines, new_figure, outline_of
from numpy.typing import NDArray

from navloom_hoang2013.figures import BLACK, BLUE, COLUMN, ORANGE, SKY, VERMILION, draw_world
from navloom_hoang2013.runs import Drive, box, moving_speeds

__all__ = ["FRAMES", "moments_of", "speeds_figure", "strip_figure"]

Floats = NDArray[np.float64]
FRAMES = 8
"""Number of moments of the strip."""
PAPER_SPEEDS = (0.2, 0.4)
"""Speeds that IV.C states, m/s."""
VIEW = (-1.9, 4.3, -0.7, 8.4)
"""Lowest and highest x, lowest and highest y of a frame, m: the way through gate B."""


def moments_of(drive: Drive) -> Floats:
    """(8, 6) rows of the truth, time, s, x, y, m, heading, rad, speed, m/s, clearance, m: from start to end, evenly."""
    truth = np.array(drive.episode.recorder.truth)
    rows: Floats = truth[np.linspace(0, len(truth) - 1, FRAMES).round().astype(np.int64)]
    return rows


def strip_figure(drive: Drive) -> Figure:
    """Fig. 12: the robot at eight moments, with the track so far, coloured by who drives."""
    figure, panels = new_figure(COLUMN, 78.0, 2, 4)
    for number, (axes, row) in enumerate(zip(panels.ravel(), moments_of(drive), strict=True)):
        _draw_moment(axes, drive, row)
        axes.set_title(f"{row[0]:.1f} s", fontsize=7)
        if number % 4:
            axes.set_yticklabels([])
        if number < 4:
            axes.set_xticklabels([])
    panels[1, 0].set_xlabel("x, m", fontsize=7)
    panels[1, 0].set_ylabel("y, m", fontsize=7)
    handles, labels = panels[1, 2].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    return figure


def _draw_moment(axes: Any, drive: Drive, row: Floats) -> None:
    """Draw the room, O once it is there, the robot, and its track up to the time of the row."""
    time, x, y, heading = row[:4]
    axes.set_aspect("equal")
    axes.set_xlim(*VIEW[:2])
    axes.set_ylim(*VIEW[2:])
    axes.set_xticks([0, 2, 4])
    axes.set_yticks([0, 4, 8])
    axes.tick_params(labelsize=6)
    robot = drive.episode.system.robot
    draw_world(axes, drive.world, robot.height)
    if time >= drive.sweep.frame_times[-1]:
        outline = outline_of(box(drive.world, "obstacle O"))
        draw_outlines(axes, [outline], BLACK, facecolors=BLACK, linewidths=0.0, zorder=3)
    for source, colour, label in (("controller", BLUE, "law (6) drives"), ("avoider", VERMILION, "avoider drives")):
        for number, part in enumerate(drive.driven_by(source)):
            until = _until(part, drive, time)
            axes.plot(*until.T, color=colour, linewidth=1.1, zorder=4, label=label if number == 0 else None)
    corners = transform(np.array([x, y, heading]), robot.footprint)
    axes.fill(*corners.T, facecolor=SKY, edgecolor=BLACK, linewidth=0.6, zorder=5, label="robot")
    front = np.array([(x, y), (x + 0.4 * np.cos(heading), y + 0.4 * np.sin(heading))])
    axes.plot(*front.T, color=BLACK, linewidth=0.8, zorder=6)
    goal = drive.episode.system.goal
    assert goal is not None
    axes.plot(goal.x, goal.y, "*", color=ORANGE, markersize=4, zorder=3.5)


def _until(part: Floats, drive: Drive, time: float) -> Floats:
    """The points of a part of the track that the robot has passed by a time, s."""
    truth = np.array(drive.episode.recorder.truth)
    passed = {tuple(point) for point in truth[truth[:, 0] <= time + 1e-9, 1:3]}
    return part[[tuple(point) in passed for point in part]]


def speeds_figure(free: Drive, run: Drive) -> Figure:
    """Share of the driving time by true speed, without and with O, over the range that the paper states."""
    figure, axes = new_figure(COLUMN, 58.0)
    axes.axvspan(*PAPER_SPEEDS, color=GREY, alpha=0.25, linewidth=0.0, label="paper: around 0.2 to 0.4")
    edges = np.arange(0.0, 0.56, 0.025) - 0.0125
    for drive, colour, label in ((free, BLUE, "without O"), (run, VERMILION, "with O")):
        speeds = moving_speeds(drive)
        share, _ = np.histogram(speeds, edges)
        axes.stairs(100.0 * share / len(speeds), edges, color=colour, linewidth=1.3, label=label)
    axes.set_xlim(0.0, 0.55)
    axes.set_xlabel("true forward speed while it moves, m/s")
    axes.set_ylabel("share of the time, %")
    figure.legend(loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    return figure
