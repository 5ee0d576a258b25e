"""Pictures of a typical and of the worst drive of each method in a suite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from navloom.geometry.world import World
from navloom.palette import OKABE_ITO
from navloom.plugins import PluginError
from navloom.runs.metrics import all_metrics

from navloom_study.episode_key import EpisodeKey
from navloom_study.report.extent import extent_of
from navloom_study.report.figures import PANEL
from navloom_study.report.plan_view import plan_figure
from navloom_study.report.plotting import png_of, styled
from navloom_study.report.track_figures import draw_world
from navloom_study.study_worlds import CachedDiscovery
from navloom_study.suites.result_file import ResultRow, SuiteResult
from navloom_study.suites.results_store import stem_of
from navloom_study.suites.suite_run import SuitePlan, folder_of
from navloom_study.tracks import StoredWay, read_track

__all__ = ["pictures_of", "typical_and_worst"]

AROUND = 1.0
"""Margin around the track, m."""
DPI = 80
"""A picture is about 270 pixels wide: it stands in a table."""


def typical_and_worst(rows: Sequence[ResultRow], is_higher_better: bool) -> tuple[ResultRow, ResultRow]:
    """The episodes with the median and with the worst primary metric; where several share it, the first."""
    order = sorted(rows, key=lambda row: (row.values[0] or 0.0) * (1.0 if is_higher_better else -1.0))
    middle = order[len(order) // 2].values[0]
    return next(row for row in rows if row.values[0] == middle), order[0]


def pictures_of(folder: Path, plan: SuitePlan, result: SuiteResult) -> Mapping[str, bytes]:
    """PNG files by name, `METHOD-typical.png` and `METHOD-worst.png`, of the drives whose tracks are in the folder.

    Args:
        folder: The `--out` of the suite.
        plan: The suite with its studies.
        result: Its result.
    """
    discovery = CachedDiscovery()
    primary = next(metric for metric in all_metrics(discovery)[0] if metric.name == result.primary)
    found: dict[str, bytes] = {}
    for method in result.methods:
        rows = [row for row in result.rows if row.method == method]
        chosen = zip(("typical", "worst"), typical_and_worst(rows, primary.better != "lower"), strict=True)
        for name, row in chosen:
            track = read_track(folder / folder_of(row.part), EpisodeKey(method, row.world, row.seed))
            if track is None or not len(track.points):
                continue
            try:
                world = discovery.world(row.world, plan.suite.base)
            except (PluginError, ValueError, OSError):
                continue
            height = plan.studies[row.part].held_equal.get("robot.height") or 2.0
            found[f"{stem_of(method)}-{name}.png"] = png_of(_drive(track, world, height, row.outcome), DPI)
    return found


@styled()
def _drive(track: StoredWay, world: World, height: float, outcome: str) -> Figure:
    goals = [] if track.goal is None else [track.goal[None]]
    figure, axes = plan_figure(PANEL, extent_of(np.concatenate([track.points, *goals]), world, AROUND))
    draw_world(axes, world, height)
    axes.plot(*track.points.T, color=OKABE_ITO[0], linewidth=1.6, zorder=5)
    axes.plot(*track.points[0], "o", color="black", markersize=5, zorder=7)
    for goal in goals:
        axes.plot(*goal[0], "*", color="black", markersize=9, markeredgecolor="white", zorder=7)
    if outcome != "succeeded":
        axes.plot(*track.points[-1], "X", color=OKABE_ITO[1], markersize=8, markeredgecolor="white", zorder=8)
    axes.set_title(outcome, loc="left")
    return figure
