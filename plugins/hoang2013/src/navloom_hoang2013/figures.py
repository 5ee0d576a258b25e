"""Figures 6 to 9 of Hoang et al. 2013, drawn from a run: 3D image, union map, IPaBD map and planned path."""

from __future__ import annotations

from typing import Any, Literal, TypeGuard

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from navloom.geometry.solids import overlaps
from navloom.geometry.world import Box, Obstacle, World
from navloom.messages import OccupancyGrid
from navloom_study.report import GREY, OKABE_ITO, draw_cells, draw_outlines, new_figure, outline_of
from numpy.typing import NDArray

from navloom_hoang2013.cloud import Cloud
from navloom_hoang2013.runs import GATE_LINE, Drive, gates_of

__all__ = ["COLUMN", "cells_of", "cloud_figure", "draw_kinds", "draw_places", "draw_world", "grid_figure", "is_drawn",
           "legend_below", "map_figure", "plan_axes", "set_room", "union_figure"]  # fmt: skip

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Place = Literal["lower center", "outside lower center"]
BLUE, VERMILION, GREEN, PINK, ORANGE, SKY, BLACK, YELLOW = OKABE_ITO
COLUMN = 88.0
"""Width of one column of a journal, mm."""
ROOM = (-4.8, 7.4, -0.9, 9.6)
"""Lowest and highest x, lowest and highest y of the plans, m."""
FLOOR = "#B8B8B8"
CEILING = "#F5E6A8"
OBSTACLE = BLUE
KEPT = VERMILION
BELOW_CEILING = 2.35
"""Height that separates pixels of the ceiling, at 2.4 m with a noise of 1 cm, from the others, m."""
GROWN, OCCUPIED = "#CFCFCF", "#4D4D4D"
DOT = 1.1
BADGE = {"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": BLACK, "linewidth": 0.6}


def plan_axes(height_mm: float = 86.0) -> tuple[Figure, Any]:
    """A figure one column wide with the room in plan view, metres, equal axes."""
    figure, axes = new_figure(COLUMN, height_mm)
    set_room(axes)
    return figure, axes


def set_room(axes: Any) -> None:
    """Set up axes for the plan view of the room."""
    axes.set_aspect("equal")
    axes.set_xlim(*ROOM[:2])
    axes.set_ylim(*ROOM[2:])
    axes.set_xticks(range(-4, 8, 2))
    axes.set_yticks(range(0, 10, 2))
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def is_drawn(obstacle: Obstacle, shows_o: bool = False) -> TypeGuard[Box]:
    """Whether figures show an obstacle's outline: that of every box but the ceiling, and O only where asked for."""
    return isinstance(obstacle, Box) and obstacle.name != "ceiling" and (shows_o or not obstacle.appears_after_sweep)


def draw_world(axes: Any, world: World, height: float, shows_o: bool = False) -> None:
    """Draw the outlines of boxes in the room: solid if a box hinders a robot of `height`, m, dotted if it is above."""
    shown = [obstacle for obstacle in world.obstacles if is_drawn(obstacle, shows_o)]
    for hinders, linestyle in ((True, "-"), (False, (0, (1, 1)))):
        outlines = [outline_of(box) for box in shown if overlaps(box.z, (0.0, height)) == hinders]
        draw_outlines(axes, outlines, GREY, linewidths=0.6, linestyles=linestyle, zorder=1.5)


def draw_places(axes: Any, drive: Drive, gates_at: float = 4.72, beside: float = 0.0, size: float = 9.0) -> None:
    """Draw S, D and the letters of the gates.

    The letters are at y = `gates_at`, m. That of B is `beside`, m, to the right of its middle, clear of the path.
    """
    goal = drive.episode.system.goal
    assert goal is not None
    start = drive.episode.system.start
    for name, x, y, marker in (("S", start.x, start.y, "o"), ("D", goal.x, goal.y, "*")):
        axes.plot(x, y, marker, color=BLACK, markersize=4 if marker == "o" else 7, zorder=6, linestyle="none")
        axes.annotate(name, (x, y), (-12, -3), textcoords="offset points", fontsize=size, fontweight="bold", zorder=7)
    for gate in gates_of(drive.world):
        x = gate.middle + (beside if gate.name == "B" else 0.0)
        axes.text(x, gates_at, gate.name, ha="center", va="center", fontsize=size, fontweight="bold", zorder=7,
                  bbox=BADGE)  # fmt: skip


def draw_pixels(axes: Any, points: Floats, colour: str, label: str, size: float = DOT, order: float = 2.0) -> None:
    """Draw pixels as dots. They are rasterized, since an SVG would otherwise hold one element for each."""
    axes.scatter(points[:, 0], points[:, 1], s=size, c=colour, linewidths=0.0, label=label, zorder=order,
                 rasterized=True)  # fmt: skip


def legend_below(
    figure: Figure, axes: Any, columns: int = 2, markers: float = 2.5, place: Place = "outside lower center"
) -> None:
    """Draw the legend below the axes, clear of the data."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc=place, ncols=columns, fontsize=7, frameon=False,
                  handletextpad=0.5, columnspacing=1.2, markerscale=markers)  # fmt: skip


def cloud_figure(drive: Drive, cloud: Cloud, z_limit: float) -> Figure:
    """Fig. 6: the 3D image, seen from behind and above the robot."""
    figure, flat = new_figure(COLUMN, 58.0)
    flat.remove()
    figure.set_layout_engine("none")
    # A 3D view is drawn in a square and clipped at its edges. A square larger than the figure clips no content.
    axes: Any = figure.add_axes((-0.12, -0.40, 1.32, 1.32 * COLUMN / 58.0), projection="3d", computed_zorder=False)
    axes.set_proj_type("ortho")
    axes.view_init(elev=28.0, azim=-97.0)
    _frame(axes)
    _wires(axes, drive.world)
    robot = drive.episode.system.robot
    girders, ceiling = _overhead(cloud)
    for points, colour, label in (
        (cloud.of("floor"), FLOOR, "floor"),
        (ceiling, CEILING, "ceiling"),
        (cloud.of("behind", "kept"), OBSTACLE, f"up to {robot.height:g} m"),
        (girders, ORANGE, f"above {z_limit:g} m"),
    ):
        axes.scatter(
            *points.T, s=1.6, c=colour, linewidths=0.0, label=label, depthshade=False, rasterized=True, zorder=2
        )
    goal = drive.episode.system.goal
    assert goal is not None
    start = drive.episode.system.start
    for name, x, y, marker in (("S", start.x, start.y, "o"), ("D", goal.x, goal.y, "*")):
        axes.plot([x], [y], [0.0], marker, color=BLACK, markersize=4 if marker == "o" else 7, zorder=5)
        axes.text(x + 0.25, y, 0.1, name, fontsize=9, fontweight="bold", zorder=6)
    for gate in gates_of(drive.world):
        axes.text(gate.middle, 5.2, 0.35, gate.name, fontsize=8, fontweight="bold", ha="center", va="center", zorder=6,
                  bbox=BADGE)  # fmt: skip
    legend_below(figure, axes, 4, place="lower center")
    return figure


def _overhead(cloud: Cloud) -> tuple[Floats, Floats]:
    """Points above the robot: those below the ceiling, and those of it."""
    points = cloud.of("overhead")
    is_ceiling = points[:, 2] > BELOW_CEILING
    return points[~is_ceiling], points[is_ceiling]


def _frame(axes: Any) -> None:
    """Set ranges and ticks in metres, with the same scale on all axes."""
    axes.set_xlim(-4.6, 7.2)
    axes.set_ylim(-0.5, 9.4)
    axes.set_zlim(0.0, 2.6)
    axes.set_box_aspect((11.8, 9.9, 2.6), zoom=0.76)
    axes.set_xticks(range(-4, 8, 2))
    axes.set_yticks(range(0, 10, 2))
    axes.set_zticks([0, 1, 2])
    for axis, name in ((axes.xaxis, "x, m"), (axes.yaxis, "y, m"), (axes.zaxis, "z, m")):
        axis.set_label_text(name, fontsize=8)
        axis.set_tick_params(labelsize=7, pad=-2)
        axis.labelpad = -2
        axis.pane.set_visible(False)
    axes.grid(False)


def _wires(axes: Any, world: World) -> None:
    """Draw the edges of the true boxes."""
    for obstacle in world.obstacles:
        if is_drawn(obstacle):
            (x0, x1), (y0, y1), (z0, z1) = obstacle.x, obstacle.y, obstacle.z
            ring = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
            for z in (z0, z1):
                axes.plot(ring[:, 0], ring[:, 1], z, color=GREY, linewidth=0.4, zorder=1)
            for x, y in ring[:4]:
                axes.plot([x, x], [y, y], [z0, z1], color=GREY, linewidth=0.4, zorder=1)


def union_figure(drive: Drive, cloud: Cloud, z_limit: float) -> Figure:
    """Fig. 7: every pixel pressed onto the plane."""
    figure, axes = plan_axes(86.0)
    draw_world(axes, drive.world, drive.episode.system.robot.height)
    girders, ceiling = _overhead(cloud)
    for points, colour, label, order in (
        (ceiling, CEILING, "ceiling", 1.9),
        (cloud.of("floor"), FLOOR, "floor", 2.0),
        (girders, ORANGE, f"above {z_limit:g} m", 2.1),
        (cloud.of("behind", "kept"), OBSTACLE, f"up to {z_limit:g} m", 2.2),
    ):
        draw_pixels(axes, points, colour, label, order=order)
    draw_places(axes, drive)
    legend_below(figure, axes, 4)
    return figure


def map_figure(drive: Drive, cloud: Cloud) -> Figure:
    """Fig. 8: the pixels that IPaBD keeps, and the lines fitted to them."""
    assert drive.map is not None
    figure, axes = plan_axes(86.0)
    draw_world(axes, drive.world, drive.episode.system.robot.height)
    for number, segment in enumerate(drive.map.segments):
        axes.plot(segment[0::2], segment[1::2], color=BLUE, linewidth=2.2, solid_capstyle="butt", zorder=2.5,
                  label="fitted lines (step 4)" if number == 0 else None)  # fmt: skip
    draw_pixels(axes, cloud.of("kept"), KEPT, "nearest pixel of a bearing (step 2)", size=3.0, order=3.0)
    draw_places(axes, drive)
    legend_below(figure, axes, 2)
    return figure


def cells_of(grid: OccupancyGrid, other: OccupancyGrid) -> Bools:
    """(rows, columns) of `other`: True where `grid` is occupied. The cells of both grids must coincide."""
    assert abs(grid.resolution - other.resolution) < 1e-9
    shift = np.array([grid.origin.y - other.origin.y, grid.origin.x - other.origin.x]) / grid.resolution
    low = [round(float(cells)) for cells in shift]
    assert np.abs(shift - low).max() < 1e-6
    occupied = np.zeros(other.cells.shape, dtype=np.bool_)
    moved = np.argwhere(grid.cells >= 50) + low
    inside = moved[((moved >= 0) & (moved < occupied.shape)).all(axis=1)]
    occupied[inside[:, 0], inside[:, 1]] = True
    return occupied


def draw_kinds(axes: Any, grid: OccupancyGrid, occupied: Bools, grown: Bools) -> None:
    """Draw free, grown and occupied cells of a grid in white, grey and dark grey, as in Fig. 9."""
    kinds = np.where(occupied, 2, np.where(grown, 1, 0)).astype(np.uint8)
    draw_cells(axes, kinds, grid.origin, grid.resolution, ("#FFFFFF", GROWN, OCCUPIED))
    rows, columns = occupied.shape
    x = grid.origin.x + grid.resolution * np.arange(columns + 1)
    y = grid.origin.y + grid.resolution * np.arange(rows + 1)
    axes.vlines(x, y[0], y[-1], color="#E2E2E2", linewidth=0.3, zorder=1.1)
    axes.hlines(y, x[0], x[-1], color="#E2E2E2", linewidth=0.3, zorder=1.1)
    axes.grid(False)


def grid_figure(drive: Drive) -> Figure:
    """Fig. 9: the grid, its grown cells, and the path found by A*."""
    assert drive.map is not None and drive.path is not None and drive.path.traversable is not None
    assert drive.trajectory is not None
    figure, axes = plan_axes(90.0)
    grid = drive.path.traversable
    draw_kinds(axes, grid, cells_of(drive.map.grid, grid), grid.cells > 0)
    axes.plot(*drive.path.points.T, "o-", color=VERMILION, markersize=2.4, linewidth=1.2, zorder=4,
              label=f"A*, {drive.path.length:.2f} m")  # fmt: skip
    axes.plot(*drive.trajectory.samples[:, 1:3].T, color=BLUE, linewidth=1.3, zorder=5, label="rounded, as driven")
    draw_places(axes, drive, gates_at=GATE_LINE, beside=0.55)
    handles, _ = axes.get_legend_handles_labels()
    handles += [Patch(color=OCCUPIED, label="occupied"), Patch(color=GROWN, label="grown by 2 cells")]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=7, frameon=False)
    return figure
