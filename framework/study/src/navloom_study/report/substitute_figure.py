"""Figure of a substitute compared with the recorded plugin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from navloom.engine.difference_units import UNITS
from navloom.palette import GREY, OKABE_ITO
from navloom_recording.substitutes import Substitute

from navloom_study.report.plan_view import draw_lines
from navloom_study.report.plotting import new_figure, png_of, styled

__all__ = ["draw_substitute", "substitute_figure"]

TICKS = 5
"""Most ticks on an x axis; their labels have many digits for a robot that has run for days."""
LARGE = 1e6
"""Number above which axis labels are shown relative to a common offset."""


def draw_substitute(result: Substitute, what: str) -> bytes:
    """PNG of `substitute_figure`."""
    return png_of(substitute_figure(result, what))


@styled()
def substitute_figure(result: Substitute, what: str) -> Figure:
    """Figure of the places on the track where the answers differ, and of the differences over time.

    Args:
        result: Result of the comparison.
        what: Name of the recorded plugin, for the legend.
    """
    found = result.found
    names = [name for name in found.values if np.nanmax(np.abs(found.values[name]), initial=0.0) > 0.0][:3]
    figure, axes = new_figure(180.0, 100.0, 1, 2)
    _draw_way(axes[0], result, what)
    _draw_series(axes[1], result, names)
    figure.suptitle(f"{found.role} {found.instance} on the recorded inputs of {what}", fontsize=9.0)
    for axis in axes:
        axis.xaxis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 2.5, 5, 10]))
        axis.ticklabel_format(axis="x", useOffset=axis.get_xlim()[1] > LARGE)
        handles, labels = axis.get_legend_handles_labels()
        if handles:  # below the axes, where it hides nothing that is drawn
            axis.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=len(handles))
    return figure


def _draw_way(axes: Any, result: Substitute, what: str) -> None:
    found = result.found
    update = result.recorded_map
    way = np.array(result.way, dtype=np.float64).reshape(-1, 3)
    if update is not None:
        draw_lines(axes, update.segments.reshape(-1, 2, 2), GREY, "", 2.0)
    axes.plot(way[:, 1], way[:, 2], color=OKABE_ITO[5], lw=5.0, solid_capstyle="round", label=f"driven by {what}")
    differing = {tick for tick, differs in zip(found.ticks, found.differing, strict=True) if differs}
    at = way[np.isin(way[:, 0], sorted(differing))]
    told = f"{found.instance} differs ({len(differing)} ticks)"
    axes.plot(at[:, 1], at[:, 2], ".", color=OKABE_ITO[1], ms=3.0, label=told)
    if len(way):
        axes.plot(*way[0, 1:], "o", color=OKABE_ITO[2], ms=6.0, label="start")
        low, high = way[:, 1:].min(axis=0) - 1.5, way[:, 1:].max(axis=0) + 1.5
        middle, half = (low + high) / 2.0, float((high - low).max()) / 2.0
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _draw_series(axes: Any, result: Substitute, names: Sequence[str]) -> None:
    found = result.found
    for number, name in enumerate(names):
        unit = UNITS[name]
        label = name if unit == "1" else f"{name}, {unit}"
        axes.plot(found.times, found.values[name], color=OKABE_ITO[number + 1], lw=1.0, label=label)
    axes.axhline(0.0, color=GREY, lw=0.6)
    axes.set_xlabel("run time, s")
    axes.set_ylabel("difference, its answer less the recorded one")
    if not names:
        axes.set_yticks([0.0])
        axes.text(0.5, 0.6, "no difference in any tick", transform=axes.transAxes, ha="center", color=GREY)
