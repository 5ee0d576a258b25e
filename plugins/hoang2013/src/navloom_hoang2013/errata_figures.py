"""Figures of what the errata of Hoang et al. 2013 change in maps, grids, plans and settling."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from navloom_study.report import GREY, OKABE_ITO, new_figure

from navloom_hoang2013.cloud import Cloud
from navloom_hoang2013.errata import Errata, Variant, grown, length_of
from navloom_hoang2013.figures import (
    BLACK,
    BLUE,
    COLUMN,
    GREEN,
    PINK,
    SKY,
    VERMILION,
    draw_kinds,
    draw_places,
    draw_world,
    set_room,
)
from navloom_hoang2013.law import BAND
from navloom_hoang2013.runs import box

__all__ = ["anchor_figure", "gain_figure", "geometry_figure", "grid_rules_figure", "height_figure", "order_figure"]

SHOWN_GRIDS = (
    ("0.40 m, distance to the line", "a: 0.40 m, by distance"),
    ("0.267 m, distance to the line", "b: 0.267 m, by distance"),
    ("0.40 m, the printed test", "c: 0.40 m, printed test"),
)
"""Grids that are drawn, grown by 2 cells, and their titles. The last one is also drawn without growth."""


def order_figure(errata: Errata) -> Figure:
    """The map and the plan with the filters before the minimum, and with the printed order."""
    return _maps_figure(errata.orders, ("a: filters first", "b: as printed"))


def height_figure(errata: Errata) -> Figure:
    """The map and the plan with heights from the floor, and with z of eq. (1), which is 0 at the sensor."""
    return _maps_figure(errata.heights, ("a: z from the floor", "b: as printed"))


def _maps_figure(variants: Sequence[Variant], titles: Sequence[str]) -> Figure:
    """Maps as lines, and plans, side by side."""
    figure, panels = new_figure(COLUMN, 62.0, 1, 2)
    for axes, variant, title in zip(panels, variants, titles, strict=True):
        run = variant.drive
        assert run.map is not None
        _small_room(axes, f"{title}\n{length_of(run)}")
        draw_world(axes, run.world, run.episode.system.robot.height)
        for number, segment in enumerate(run.map.segments):
            axes.plot(segment[0::2], segment[1::2], color=BLUE, linewidth=2.0, zorder=2.5,
                      label="mapped" if number == 0 else None)  # fmt: skip
        if run.path is not None:
            axes.plot(*run.path.points.T, color=VERMILION, linewidth=1.2, zorder=4, label="A*")
        draw_places(axes, run, gates_at=3.9, beside=0.9, size=7)
    panels[1].set_ylabel("")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=7, frameon=False)
    return figure


def _small_room(axes: Any, title: str) -> None:
    set_room(axes)
    axes.set_xticks([-4, 0, 4])
    axes.set_yticks([0, 4, 8])
    axes.set_title(title, fontsize=7.5, loc="left")


def geometry_figure(errata: Errata, z_limit: float) -> Figure:
    """Heights of the pixels of one sweep by bearing, computed with its true geometry and with eq. (1)."""
    figure, panels = new_figure(COLUMN, 108.0, 2, 1)
    run = errata.geometries[0].drive
    bearings = np.degrees(run.sweep.bearings) + 90.0
    for axes, cloud, title in zip(
        panels,
        errata.clouds,
        ("a: x = R cosβ, y = R sinβ cosα, z = R sinβ sinα", "b: eq. (1), z = R sinα"),
        strict=True,
    ):
        _draw_heights(axes, bearings, cloud, errata.parts)
        axes.axhline(z_limit, color=BLACK, linewidth=0.9, linestyle="--", label="robot's height")
        axes.set_title(title, fontsize=7.5, loc="left")
        for name, colour in (("girder A", VERMILION), ("girder B", SKY)):
            low, high = box(run.world, name).z
            axes.axhspan(low, high, color=colour, alpha=0.22, linewidth=0.0)
    panels[0].set_xlabel("")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=7, frameon=False, markerscale=2.5,
                  columnspacing=1.0, handletextpad=0.4)  # fmt: skip
    return figure


def _draw_heights(axes: Any, bearings: Any, cloud: Cloud, parts: Any) -> None:
    """Scatter of height over β for the pixels that are truly on the floor and on the girders."""
    columns = np.broadcast_to(bearings, cloud.classes.shape)
    for part, colour, label in zip(parts, (GREY, VERMILION, SKY), ("floor", "girder A", "girder B"), strict=True):
        axes.scatter(columns[part], cloud.points[part][:, 2], s=1.6, c=colour, linewidths=0.0, label=label,
                     rasterized=True)  # fmt: skip
    axes.set_xlim(140.0, 40.0)
    axes.set_ylim(-0.4, 2.0)
    axes.set_xticks(range(40, 141, 20))
    axes.set_xlabel("bearing β, °")
    axes.set_ylabel("height, m")


def grid_rules_figure(errata: Errata) -> Figure:
    """Occupied and grown cells, and the plan, by cell size and raster method."""
    figure, panels = new_figure(COLUMN, 98.0, 2, 2)
    by_name = {variant.name: variant for variant in errata.grids}
    chosen = [(f"{name}, grown by 2 cells", f"{name}, not grown", title) for name, title in SHOWN_GRIDS]
    alone = chosen[-1][1]
    for axes, (name, bare, title), growth in zip(
        panels.ravel(), [*chosen, (alone, alone, "d: printed test alone")], (2, 2, 2, 0), strict=True
    ):
        _draw_grid(axes, by_name[name], by_name[bare], growth)
        axes.set_title(f"{title}\n{length_of(by_name[name].drive)}", fontsize=7.5, loc="left")
    for axes in panels[0]:
        axes.set_xlabel("")
    for axes in panels[:, 1]:
        axes.set_ylabel("")
    return figure


def _draw_grid(axes: Any, variant: Variant, bare: Variant, growth: int) -> None:
    """Draw a planning grid. `bare` is the variant without growth; its plan shows which cells are occupied."""
    _small_room(axes, "")
    run, plan = variant.drive, bare.drive.path
    assert plan is not None and plan.traversable is not None
    occupied = plan.traversable.cells > 0
    draw_kinds(axes, plan.traversable, occupied, grown(occupied, growth))
    if run.path is not None:
        axes.plot(*run.path.points.T, color=VERMILION, linewidth=1.4, zorder=4)
    draw_places(axes, run, gates_at=3.4, beside=1.0, size=7)


def anchor_figure(errata: Errata) -> Figure:
    """Grown cells counted from S and from the lowest outline, the lines that they were drawn from, and the plans."""
    figure, panels = new_figure(COLUMN, 62.0, 1, 2)
    for axes, variant, title in zip(panels, errata.anchors, ("a: cells from S", "b: as printed"), strict=True):
        run, plan = variant.drive, variant.drive.path
        assert run.map is not None and plan is not None and plan.traversable is not None
        _small_room(axes, f"{title}\n{length_of(run)}")
        grid = plan.traversable
        draw_kinds(axes, grid, np.zeros(grid.cells.shape, dtype=np.bool_), grid.cells > 0)
        for segment in run.map.segments:
            axes.plot(segment[0::2], segment[1::2], color=BLUE, linewidth=1.5, zorder=2.5)
        axes.plot(*plan.points.T, color=VERMILION, linewidth=1.2, zorder=4)
        draw_places(axes, run, gates_at=3.4, beside=1.0, size=7)
    panels[1].set_ylabel("")
    return figure


def gain_figure(errata: Errata) -> Figure:
    """Distance from a line over time, starting 0.3 m beside it, by k3 and by law."""
    figure, axes = new_figure(COLUMN, 72.0)
    colours = (SKY, BLUE, GREEN, PINK, VERMILION)
    own = [settling for settling in errata.laws if settling.law.plugin == "lyapunov_tracker"]
    for settling, colour in zip(own, colours, strict=True):
        k3 = settling.law.params["k3"]
        axes.plot(settling.times[::20], 100.0 * settling.lateral[::20], color=colour, label=f"k₃ = {k3:g}")
    (other,) = (settling for settling in errata.laws if settling.law.plugin == "ramsete")
    axes.plot(other.times[::5], 100.0 * other.lateral[::5], color=OKABE_ITO[6], linestyle=":", label="RAMSETE")
    axes.axhspan(
        -100.0 * BAND, 100.0 * BAND, color=GREY, alpha=0.25, linewidth=0.0, label=f"within {100.0 * BAND:g} cm"
    )
    axes.set_xlim(0.0, 60.0)
    axes.set_xlabel("time, s")
    axes.set_ylabel("lateral error e₂, cm")
    figure.legend(loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    return figure
