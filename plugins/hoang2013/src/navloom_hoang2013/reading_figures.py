"""Figures of whole drives by reading: path shape, turn in place, the avoider printed and robust, its range, wheels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from navloom_study.report import GREY, OKABE_ITO, draw_outlines, new_figure, outline_of

from navloom_hoang2013.drive_readings import IN_PLACE, OFFS, DriveReadings
from navloom_hoang2013.figures import (
    BLACK,
    BLUE,
    COLUMN,
    GREEN,
    ORANGE,
    PINK,
    SKY,
    VERMILION,
    draw_world,
    set_room,
)
from navloom_hoang2013.runs import Choice, Drive, box
from navloom_hoang2013.seeds import LEVELS, Calibration, Tally

__all__ = ["avoiders_figure", "calibration_figure", "range_figure", "shapes_figure", "turns_figure"]

AROUND_O = (-0.3, 2.9, 0.3, 4.3)
"""Lowest and highest x, lowest and highest y of the view of O, m."""


def shapes_figure(readings: DriveReadings) -> Figure:
    """The drive without O along the rounded path, and along the planned cells."""
    figure, panels = new_figure(COLUMN, 66.0, 1, 2)
    for axes, variant, title in zip(panels, readings.shapes, ("a: rounded", "b: along cells"), strict=True):
        run = variant.drive
        assert run.trajectory is not None
        set_room(axes)
        axes.set_xlim(-1.6, 4.4)
        draw_world(axes, run.world, run.episode.system.robot.height)
        axes.plot(*run.trajectory.samples[:, 1:3].T, color=BLUE, linewidth=2.4, alpha=0.55, label="designed")
        axes.plot(*run.episode.recorder.driven.T, color=VERMILION, linewidth=1.0, label="real")
        summary = run.episode.summary()
        plans = len(run.episode.recorder.plans)
        axes.set_title(f"{title}, {plans} plan{'s' if plans > 1 else ''}\nat most "
                       f"{100.0 * summary['cross_track_max_m']:.0f} cm off, "
                       f"{summary['sim_time_s']:.0f} s", fontsize=7.5, loc="left")  # fmt: skip
        goal, start = run.episode.system.goal, run.episode.system.start
        assert goal is not None
        axes.plot([start.x, goal.x], [start.y, goal.y], linestyle="none", marker="o", markersize=3, color=BLACK)
    panels[1].set_ylabel("")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=7, frameon=False)
    return figure


def turns_figure(readings: DriveReadings) -> Figure:
    """Tracks from starts off the first leg, with a turn in place above 60°, and without."""
    figure, panels = new_figure(COLUMN, 66.0, 1, 2)
    colours = (SKY, BLUE, GREEN, ORANGE, PINK, VERMILION)
    for axes, (above, title) in zip(panels, IN_PLACE, strict=True):
        for off, colour in zip(OFFS, colours, strict=True):
            (turn,) = (turn for turn in readings.turns if (turn.off, turn.above) == (off, above))
            summary, way = turn.drive.episode.summary(), turn.drive.episode.recorder.driven
            axes.plot(100.0 * way[:, 0], way[:, 1], color=colour, linewidth=1.2, label=f"{off}° off")
            if not summary["truly_reached"]:
                axes.plot(100.0 * way[-1, 0], way[-1, 1], "x", color=colour, markersize=5)
        axes.plot([], [], "x", color=GREY, markersize=5, label="stuck")
        axes.set_title(title, fontsize=7.5, loc="left")
        axes.set_xlim(-40.0, 40.0)
        axes.set_ylim(-0.2, 7.8)
        axes.set_xlabel("beside the line, cm")
    panels[0].set_ylabel("along the line, m")
    handles, labels = panels[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=7, frameon=False, columnspacing=1.0)
    return figure


def avoiders_figure(readings: DriveReadings) -> Figure:
    """Printed beside robust: tracks of 20 seeds, histogram at the first turn away, and clearance."""
    figure, panels = new_figure(COLUMN, 138.0, 3, 2)
    panels[0, 0].get_gridspec().set_height_ratios([2.2, 1.0, 1.0])
    for column, (variant, tally) in enumerate(zip(readings.avoiders, readings.tallies, strict=True)):
        track, bars, clearance = panels[:, column]
        _draw_tracks(track, variant.drive, tally)
        track.set_title(f"{'ab'[column]}: {variant.name}", fontsize=8, loc="left")
        if variant.drive.choice is not None:
            _draw_histogram(bars, variant.drive.choice)
        _draw_clearance(clearance, tally)
    for axes in panels[:, 1]:
        axes.set_ylabel("")
    for axes in panels[2]:
        axes.set_ylim(0.0, 2.2)
    return figure


def _draw_tracks(axes: Any, run: Drive, tally: Tally) -> None:
    axes.set_aspect("equal")
    axes.set_xlim(*AROUND_O[:2])
    axes.set_ylim(*AROUND_O[2:])
    outline = outline_of(box(run.world, "obstacle O"))
    draw_outlines(axes, [outline], BLACK, facecolors=BLACK, linewidths=0.0, zorder=3)
    assert run.trajectory is not None
    axes.plot(*run.trajectory.samples[:, 1:3].T, color=GREY, linewidth=1.0, linestyle=(0, (4, 2)))
    for result in tally.results:
        axes.plot(result.track[:, 1], result.track[:, 2], color=BLUE, linewidth=0.5, alpha=0.6)
    for part in run.driven_by("avoider"):
        axes.plot(*part.T, color=VERMILION, linewidth=1.3, zorder=4)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _draw_histogram(axes: Any, choice: Choice) -> None:
    """Draw the density over the angle from the heading, with the threshold and the chosen direction."""
    shown, heading = choice.diagnostics, choice.pose.heading
    count = len(shown.histogram)
    edges = np.linspace(-180.0, 180.0, count + 1)
    middle = np.radians(0.5 * (edges[1:] + edges[:-1])) + heading
    density = shown.histogram[np.floor(middle / (2.0 * np.pi / count)).astype(np.int64) % count]
    axes.stairs(density, edges, fill=True, color=SKY)
    axes.axhline(shown.threshold, color=BLACK, linewidth=0.8, linestyle=":")
    assert shown.chosen is not None
    for angle, colour in ((choice.to_target, GREEN), (shown.chosen, VERMILION)):
        axes.axvline(
            np.degrees(np.remainder(angle - heading + np.pi, 2.0 * np.pi) - np.pi), color=colour, linewidth=1.2
        )
    axes.set_xlim(120.0, -120.0)
    axes.set_xticks([90, 0, -90])
    axes.set_xlabel("left of heading, °")
    axes.set_ylabel("density")
    axes.set_title(f"{choice.time:.2f} s: first turn away", fontsize=7, loc="left")


def _draw_clearance(axes: Any, tally: Tally) -> None:
    for result in tally.results:
        axes.plot(result.track[:, 0], result.track[:, 3], color=BLUE, linewidth=0.5, alpha=0.6)
    axes.set_xlabel("time, s")
    axes.set_ylabel("clearance, m")
    axes.set_title(f"at least {min(result.clearance for result in tally.results):.2f} m", fontsize=7, loc="left")


def range_figure(readings: DriveReadings) -> Figure:
    """Density of the sector towards O over the distance of the robot's centre, by reading, with the thresholds."""
    figure, axes = new_figure(COLUMN, 66.0)
    for reach, colour in zip(readings.ranges, (VERMILION, BLUE, GREEN), strict=True):
        acts = "never" if reach.acts_from is None else f"acts from {reach.acts_from:.2f} m"
        axes.plot(reach.distances, reach.densities, color=colour, label=f"{reach.name}: {acts}")
        axes.axhline(reach.threshold, color=colour, linewidth=0.8, linestyle=":")
        if reach.acts_from is not None:
            axes.axvline(reach.acts_from, color=colour, linewidth=0.8, linestyle="--")
    axes.axvspan(0.3, 4.0, color=GREY, alpha=0.15, linewidth=0.0, label="paper: 0.3 to 4 m")
    axes.set_xlim(4.5, 0.0)
    axes.set_ylim(0.0, None)
    axes.set_xlabel("distance of the robot's centre from O, m")
    axes.set_ylabel("density towards O")
    figure.legend(loc="outside lower center", ncols=1, fontsize=7, frameon=False)
    return figure


def calibration_figure(calibrations: Sequence[Calibration]) -> Figure:
    """Drives that truly reach D, of 20, by the error of wheel radius and half track, with and without true odometry."""
    figure, panels = new_figure(COLUMN, 100.0, 2, 1)
    reached, error = panels
    for parameter, colour in (("wheel radius", BLUE), ("half track", VERMILION)):
        for knows, style in ((False, "-"), (True, ":")):
            rows = [entry for entry in calibrations if (entry.parameter, entry.knows) == (parameter, knows)]
            percent = [100.0 * entry.error for entry in rows]
            label = f"{parameter.split()[-1]}, odometry {'right' if knows else 'wrong'}"
            drives = [entry.tally.reached for entry in rows]
            reached.plot(percent, drives, style, color=colour, marker="o", markersize=3, label=label)
            error.plot(percent, [entry.tally.median("goal_error") for entry in rows], style, color=colour, marker="o",
                       markersize=3)  # fmt: skip
    error.axhline(0.3, color=OKABE_ITO[6], linewidth=0.8, linestyle="--")
    reached.set_ylabel("truly reach D, of 20")
    reached.set_ylim(-0.5, 20.5)
    error.set_ylabel("from D, median, m")
    error.set_ylim(0.0, None)
    error.set_xlabel("true value against the one the robot assumes, %")
    for axes in panels:
        axes.set_xticks([100.0 * level for level in LEVELS if abs(level) != 0.01])
    handles, labels = reached.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=7, frameon=False)
    return figure
