"""Pictures of scenes: the obstacles, and what the plugin did."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from navloom.geometry.frames import transform
from navloom.geometry.world import Box
from navloom.palette import GREY, OKABE_ITO
from navloom.parts import part

from navloom_check.behaviour.measurements import Line, Measured
from navloom_check.behaviour.obstacle_scene import Scene, ends_of

__all__ = ["draw"]

WIDTH = 88.0
"""Width of the picture of one scene, mm."""
OUTLINES = 8
"""Footprints drawn along a line."""


def draw(path: Path, title: str, scene: Scene, seen: Measured) -> None:
    """Draw a scene, or the two that were compared side by side, into a PNG file."""
    scenes = seen.scenes or (scene,)
    plotting = part("navloom_study.report.plotting")
    figure, axes = plotting.new_figure(WIDTH * len(scenes), 84.0, 1, len(scenes))
    with plotting.styled():
        figure.suptitle(title, fontsize=8.5)
        for k, (axis, shown) in enumerate(zip(np.atleast_1d(axes), scenes, strict=True)):
            _draw_scene(axis, shown)
            for number, line in enumerate(seen.lines[k :: len(scenes)]):
                _draw_line(axis, line, shown, OKABE_ITO[number])
            axis.set_aspect("equal", "datalim")
            axis.margins(0.08)
            axis.set_xlabel("x, m")
            axis.set_ylabel("y, m")
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(plotting.png_of(figure))


def _draw_scene(axis: Any, scene: Scene) -> None:
    turns = np.linspace(0.0, math.tau, 48)
    for one in scene.obstacles:
        if isinstance(one, Box):
            axis.plot(*ends_of(one).T, color=GREY, linewidth=2.4, solid_capstyle="butt")
        else:
            axis.fill(one.x + one.radius * np.cos(turns), one.y + one.radius * np.sin(turns), color=GREY, linewidth=0.0)
    axis.plot(*scene.target, marker="x", color="black", linestyle="none", label="target")
    _draw_outline(axis, scene, (scene.start.x, scene.start.y, scene.start.heading), "black")


def _draw_line(axis: Any, line: Line, scene: Scene, colour: str) -> None:
    if not len(line.points):
        return
    style = {"marker": ".", "markersize": 2.5, "linestyle": "none"} if line.is_dots else {}
    axis.plot(line.points[:, 0], line.points[:, 1], color=colour, label=line.name, **style)
    if line.is_robot:
        for k in np.unique(np.linspace(0, len(line.points) - 1, OUTLINES).astype(int)).tolist():
            _draw_outline(axis, scene, line.points[k].tolist(), colour)


def _draw_outline(axis: Any, scene: Scene, pose: Any, colour: str) -> None:
    """Draw the footprint, and a line from its middle to its front."""
    apart, ahead = [(np.nan, np.nan)], [(0.0, 0.0), (0.5 * scene.length, 0.0)]
    drawn = np.vstack([scene.outline, scene.outline[:1], apart, ahead])
    axis.plot(*transform(np.array(pose), drawn).T, color=colour, linewidth=0.7)
