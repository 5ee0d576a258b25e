"""Tables and figures of a study's open-loop episodes, in which methods answer the same inputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from navloom.engine.difference_units import TOLERANCES, UNITS
from numpy.typing import NDArray

from navloom_study.openloop import METHOD
from navloom_study.report.figures import WIDTH, line_of, shortened
from navloom_study.report.plotting import new_figure, styled
from navloom_study.report.report_tables import NONE, TextTable, decimals, number
from navloom_study.report.study_files import StudyFiles
from navloom_study.study_folder import Compared, OpenLoopLine
from navloom_study.tracks import StoredWay

__all__ = ["OpenLoopData", "open_loop_data", "over_time_figure", "shadow_summary", "spread_figure"]

Floats = NDArray[np.float64]
BIN = 0.5
"""Time over which differences are averaged to one drawn value, s."""
WORLDS = 5
"""Most worlds drawn over time: those with the largest differences."""


@dataclass(frozen=True, eq=False)
class OpenLoopData:
    """Stored data of the open-loop episodes.

    Attributes:
        baseline: The method that drove.
        shadows: Methods that ran in shadow.
        quantities: Names of the differences that are not 0 everywhere.
        tracks: Tracks by world, one a seed.
        values: By (method, quantity, world), pairs of times (n,), s, and differences (n,), one a seed.
        changed: Number of episodes whose trace differs from that of the baseline alone; must be 0, since shadows are
            leaves.
        compared: Number of episodes with a trace to compare.
    """

    baseline: str
    shadows: tuple[str, ...]
    quantities: tuple[str, ...]
    tracks: dict[str, list[StoredWay]]
    values: dict[tuple[str, str, str], list[tuple[Floats, Floats]]]
    changed: int
    compared: int

    def pooled(self, method: str, quantity: str) -> Floats:
        """(n,) absolute differences of all ticks in all worlds."""
        told = [
            np.abs(values)
            for (m, q, _), pairs in self.values.items()
            if (m, q) == (method, quantity)
            for _, values in pairs
        ]
        return np.concatenate(told) if told else np.empty(0)


def open_loop_data(study: StudyFiles) -> OpenLoopData | None:
    """The stored open-loop data; None for a study without any."""
    told = study.request.get("open_loop")
    if not told:
        return None
    tracks: dict[str, list[StoredWay]] = {}
    values: dict[tuple[str, str, str], list[tuple[Floats, Floats]]] = {}
    for world in study.worlds:
        for seed in study.seeds:
            track = study.track(METHOD, world, seed)
            if track is None:
                continue
            tracks.setdefault(world, []).append(track)
            for name, found in track.shadow.items():
                instance, quantity = name.split(" ")
                key = (told["shadows"].get(instance, instance), quantity, world)
                values.setdefault(key, []).append((track.shadow_time[name], found))
    quantities = tuple(name for name in UNITS if any(key[1] == name for key in values))
    alone = {
        (row.key.world, row.key.seed): row.trace_sha256 for row in study.rows if row.key.method == told["baseline"]
    }
    beside = {(line.world, line.seed): line.trace_sha256 for line in study.open_loop}
    both = [key for key in beside if beside[key] and alone.get(key)]
    changed = sum(alone[key] != beside[key] for key in both)
    return OpenLoopData(
        told["baseline"], tuple(told["shadows"].values()), quantities, tracks, values, changed, len(both)
    )


def shadow_summary(study: StudyFiles, data: OpenLoopData) -> TextTable:
    """Ticks, share of differing ticks, and differences by method and quantity; for avoiders also while they drove."""
    rows = []
    for method in data.shadows:
        told = [line for line in study.open_loop if line.method == method]
        episodes = list({(line.world, line.seed): line for line in told}.values())
        spans: list[tuple[str, Callable[[OpenLoopLine], Compared]]] = [("all ticks", lambda line: line.all_ticks)]
        if any(line.driving_ticks is not None for line in episodes):
            spans.append(("while the avoider drove", lambda line: line.while_driving))
        for n, (span, of) in enumerate(spans):
            ticks, share = _pooled_share([of(line) for line in episodes])
            quantities = [name for name in data.quantities if any(line.quantity == name for line in told)]
            for k, quantity in enumerate(quantities or [""]):
                rms, most = _pooled_sizes([of(line) for line in told if line.quantity == quantity])
                digits = decimals([most])
                named = [method if n == 0 else "", span, str(ticks), share] if not k else [""] * 4
                unit = f"{quantity}, {UNITS[quantity]}" if quantity else NONE
                rows.append([*named, unit, number(rms, digits), number(most, digits)])
    silent = sum(line.unanswered for line in study.open_loop)
    limits = ", ".join(f"{name} {TOLERANCES[name]:g} {UNITS[name]}" for name in data.quantities)
    caption = f"Ticks differ where any difference is beyond {limits}." if limits else "No tick differs at all."
    if silent:
        caption += (
            f" In {silent} ticks only one of two gave an answer; they are not counted (open_loop.csv says where)."
        )
    return TextTable(["method", "", "ticks", "differing", "quantity", "RMS", "greatest"], rows, caption, (0, 1, 4))


def _pooled_share(episodes: Sequence[Compared]) -> tuple[int, str]:
    ticks = sum(episode.ticks or 0 for episode in episodes)
    differing = sum((episode.ticks or 0) * (episode.differing_share or 0.0) for episode in episodes)
    return ticks, f"{100.0 * differing / ticks:.1f} %" if ticks else NONE


def _pooled_sizes(lines: Sequence[Compared]) -> tuple[float | None, float | None]:
    """RMS and maximum over the ticks of all episodes."""
    known = [(line.ticks or 0, line.rms, line.max or 0.0) for line in lines if line.rms is not None]
    count = sum(ticks for ticks, _, _ in known)
    if not count:
        return None, None
    square = sum(rms**2 * ticks for ticks, rms, _ in known)
    return math.sqrt(square / count), max(most for _, _, most in known)


@styled()
def over_time_figure(study: StudyFiles, data: OpenLoopData) -> tuple[Figure, list[str]] | None:
    """Figure of the RMS difference over seeds at each time, and the worlds drawn; None if nothing differs."""
    worlds = [world for world in study.worlds if any(key[2] == world for key in data.values)]
    worlds.sort(key=lambda world: -_overall(data, world))
    worlds = sorted(worlds[:WORLDS], key=study.worlds.index)
    if not worlds:
        return None
    columns = len(data.quantities)
    height = 34.0 * len(worlds) + 14.0 + 5.0 * math.ceil((len(data.shadows) + 1) / 5)
    figure, axes = new_figure(WIDTH, height, len(worlds), columns)
    panels = np.atleast_1d(axes).reshape(len(worlds), columns)
    for row, world in enumerate(worlds):
        for column, quantity in enumerate(data.quantities):
            panel = panels[row, column]
            _over_time(panel, study, data, world, quantity)
            panel.set_title(f"{shortened(world)}: {quantity}, {UNITS[quantity]}", loc="left")
            if row == len(worlds) - 1:
                panel.set_xlabel("run time, s")
    handles = _handles(study, data)
    figure.legend(handles=handles, loc="outside lower center", ncols=min(5, len(handles)))
    return figure, worlds


def _overall(data: OpenLoopData, world: str) -> float:
    told = [values for key, pairs in data.values.items() if key[2] == world for _, values in pairs]
    return float((np.concatenate(told) ** 2).mean()) if told else 0.0


def _over_time(axes: Any, study: StudyFiles, data: OpenLoopData, world: str, quantity: str) -> None:
    tracks = data.tracks[world]
    end = max(float(track.time[-1]) for track in tracks)
    edges = np.arange(0.0, end + BIN, BIN)
    top = 0.0
    for method in data.shadows:
        pairs = data.values.get((method, quantity, world))
        if not pairs:
            continue
        times, squares = np.concatenate([t for t, _ in pairs]), np.concatenate([v for _, v in pairs]) ** 2
        at = np.floor(times / BIN).astype(np.int64)
        count = np.bincount(at, minlength=len(edges)).astype(np.float64)
        told = np.where(count > 0, np.sqrt(np.bincount(at, squares, len(edges)) / np.maximum(count, 1.0)), np.nan)
        axes.plot(edges + 0.5 * BIN, told[: len(edges)], linewidth=1.0, **line_of(study.methods.index(method)))
        top = max(top, float(np.nanmax(told)))
    shares = [np.interp(edges, track.time, track.engaged.astype(np.float64)) for track in tracks]
    axes.fill_between(edges, np.mean(shares, axis=0) * (top or 1.0), color="#E4E4E4", linewidth=0.0, zorder=0)
    axes.set_xlim(0.0, end)
    axes.set_ylim(0.0, 1.05 * (top or 1.0))
    axes.locator_params(axis="y", nbins=4)


def _handles(study: StudyFiles, data: OpenLoopData) -> list[Any]:
    lines: list[Any] = [Line2D([], [], label=shortened(m), **line_of(study.methods.index(m))) for m in data.shadows]
    return [*lines, Patch(color="#E4E4E4", label="share of seeds in which the avoider drove")]


@styled()
def spread_figure(study: StudyFiles, data: OpenLoopData) -> Figure | None:
    """Figure of each method's differences from the baseline over all ticks, on a log scale; None if nothing differs."""
    shown = [name for name in data.quantities if any(data.pooled(method, name).size for method in data.shadows)]
    if not shown:
        return None
    figure, axes = new_figure(WIDTH, 24.0 + 6.0 * len(data.shadows), 1, len(shown))
    panels = np.atleast_1d(axes).tolist()
    for number_of, (panel, quantity) in enumerate(zip(panels, shown, strict=True)):
        least = TOLERANCES[quantity] / 10.0
        for k, method in enumerate(data.shadows):
            values = data.pooled(method, quantity)
            if not values.size:
                continue
            marks = np.maximum(np.percentile(values, [5, 25, 50, 75, 95]), least)
            colour = line_of(study.methods.index(method))["color"]
            panel.plot(marks[[0, 4]], [k, k], color=colour, linewidth=1.0)
            panel.plot(marks[[1, 3]], [k, k], color=colour, linewidth=4.0, solid_capstyle="butt")
            panel.plot([marks[2]], [k], "o", color="white", markeredgecolor=colour, markersize=4.5)
        panel.axvline(TOLERANCES[quantity], color="black", linewidth=0.7, linestyle=":")
        panel.set_xscale("log")
        panel.set_xlim(left=0.8 * least)
        panel.set_yticks(range(len(data.shadows)), [shortened(name, 20) for name in data.shadows])
        panel.set_ylim(len(data.shadows) - 0.5, -0.5)
        panel.tick_params(labelleft=number_of == 0)
        panel.set_title(f"|difference| of {quantity}, {UNITS[quantity]}", loc="left")
        panel.grid(axis="y", visible=False)
    return figure
