"""Figures of a study's report: outcomes, differences between methods, and distributions of metrics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from navloom.messages import OUTCOMES
from navloom.palette import GREY, OKABE_ITO
from navloom.runs.episode_trail import FALSE_SUCCESS, STRUCK
from navloom.runs.metrics import Metric

from navloom_study.episode_rows import Row
from navloom_study.report import html_page
from navloom_study.report.plotting import new_figure, styled
from navloom_study.report.study_files import StudyFiles

__all__ = ["difference_figures", "distribution_figures", "line_of", "method_keys", "nested_width", "outcome_figure",
           "scatter_figure", "success_figures", "world_figures"]  # fmt: skip

WIDTH = 180.0
"""Width of a figure, mm: the text width of an A4 page."""
COLOURS = {
    "succeeded": "#009E73", "collision": "#D55E00", "stuck": "#E69F00", "timeout": "#F0E442", "no_path": "#56B4E9",
    "rejected": "#0072B2", "error": "#333333", "stopped": "#CC79A7", "lost": "#117733", "cancelled": "#B5B5B5",
    FALSE_SUCCESS: "#882255", STRUCK: "#F0A27A",
}  # fmt: skip
SPREAD = ("spl", "time", "clearance_min", "cross_track_rms", "turning", "jerk")
DIFFERENCES = (
    "success", "spl", "time", "clearance_min", "danger_share", "cross_track_rms", "turning", "steering_flips", "jerk",
)  # fmt: skip
PANEL, PAIR = 85.0, 105.0
"""Width of a figure beside two or one others, mm."""
BY_WORLD = ("spl", "time", "clearance_min")
ROWS = 45
"""Most worlds in one figure of successes."""
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1.2)))


def line_of(number: int) -> dict[str, Any]:
    """Colour and dashes of the method with this number; 24 combinations are distinct."""
    return {
        "color": OKABE_ITO[number % len(OKABE_ITO)],
        "linestyle": DASHES[number // len(OKABE_ITO) % len(DASHES)],
    }


def shortened(name: str, most: int = 26) -> str:
    """The end of a long name, since file names differ there."""
    return name if len(name) <= most else "…" + name[1 - most :]


@styled()
def outcome_figure(study: StudyFiles) -> Figure:
    """Stacked bars with the share of each outcome, by method."""
    counts, methods = study.comparison.outcomes, study.methods
    figure, axes = new_figure(PAIR, 30.0 + 6.5 * len(methods))
    left = np.zeros(len(methods))
    totals = np.array([max(1, sum(counts[method].values())) for method in methods], dtype=np.float64)
    for kind in (*OUTCOMES, FALSE_SUCCESS, STRUCK):
        share = np.array([counts[method].get(kind, 0) for method in methods]) / totals
        if not share.any():
            continue
        axes.barh(methods, share, left=left, color=COLOURS[kind], label=kind, edgecolor="white", linewidth=0.6)
        for k, method in enumerate(methods):
            if share[k] > 0.03:
                dark = kind in ("succeeded", "collision", "rejected", "error", FALSE_SUCCESS)
                axes.text(
                    left[k] + 0.5 * share[k], k, str(counts[method][kind]), ha="center", va="center", fontsize=7,
                    color="white" if dark else "black",
                )  # fmt: skip
        left += share
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the episodes")
    axes.grid(False)
    figure.legend(loc="outside upper center", ncols=4)
    return figure


def success_figures(study: StudyFiles) -> list[Figure]:
    """Successes of each method in each world, at most `ROWS` worlds a figure."""
    figures = math.ceil(len(study.worlds) / ROWS)
    each = math.ceil(len(study.worlds) / figures)
    return [_success(study, study.worlds[first : first + each]) for first in range(0, len(study.worlds), each)]


@styled()
def _success(study: StudyFiles, worlds: Sequence[str]) -> Figure:
    methods = study.methods
    width = max(PAIR, min(WIDTH, 55.0 + 21.0 * len(methods)))
    figure, axes = new_figure(width, 22.0 + 4.7 * max(len(worlds), 2))
    colours = colormaps["Blues"]
    for row, world in enumerate(worlds):
        for column, method in enumerate(methods):
            ends = study.outcomes.get((method, world), [])
            wins = sum(end == "succeeded" for end in ends)
            share = wins / len(ends) if ends else 0.0
            axes.add_patch(Rectangle((column, row), 1, 1, facecolor=colours(0.08 + 0.8 * share), edgecolor="white"))
            axes.text(
                column + 0.5, row + 0.5, f"{wins}/{len(ends)}", ha="center", va="center", fontsize=7,
                color="white" if share > 0.55 else "black",
            )  # fmt: skip
    axes.set_xlim(0, len(methods))
    axes.set_ylim(len(worlds), 0)
    turned = len(methods) > 6 or max(map(len, methods)) > 16
    axes.set_xticks(
        np.arange(len(methods)) + 0.5, [shortened(name) for name in methods], rotation=40 if turned else 0,
        ha="left" if turned else "center", rotation_mode="anchor",
    )  # fmt: skip
    axes.xaxis.tick_top()
    axes.set_yticks(np.arange(len(worlds)) + 0.5, [shortened(world) for world in worlds])
    axes.tick_params(length=0)
    axes.grid(False)
    for side in axes.spines.values():
        side.set_visible(False)
    return figure


@styled()
def difference_figures(study: StudyFiles) -> list[Figure]:
    """Differences from the baseline with their intervals, one figure a metric."""
    others = [method for method in study.methods if method != study.baseline]
    shown = [
        metric for metric in map(study.metric, DIFFERENCES) if metric is not None and _is_told(study, metric, others)
    ]
    figures = []
    for metric in shown:
        figure, axes = new_figure(PANEL, 17.0 + 5.5 * len(others))
        _difference_panel(axes, study, metric, others)
        figures.append(figure)
    return figures


def _is_told(study: StudyFiles, metric: Metric, others: Sequence[str]) -> bool:
    return any(study.comparison.difference(method, metric.name).estimate.mean is not None for method in others)


def _difference_panel(axes: Any, study: StudyFiles, metric: Metric, others: Sequence[str]) -> None:
    axes.axvline(0.0, color=GREY, linewidth=0.9)
    for k, method in enumerate(others):
        one = study.comparison.difference(method, metric.name)
        mean, low, high = one.estimate.mean, one.estimate.low, one.estimate.high
        if mean is None:
            axes.text(0.0, k, " not defined", va="center", fontsize=6.5, color=GREY)
            continue
        sure = one.is_shown
        good = {"higher": mean > 0.0, "lower": mean < 0.0, None: None}[metric.better]
        colour = GREY if not sure or good is None else OKABE_ITO[0] if good else OKABE_ITO[1]
        if low is not None:
            axes.plot([low, high], [k, k], color=colour, linewidth=1.8, solid_capstyle="butt")
        axes.plot([mean], [k], "o", color=colour, markersize=4.5, markerfacecolor=colour if sure else "white")
    axes.set_yticks(range(len(others)), [shortened(method, 18) for method in others])
    axes.set_ylim(len(others) - 0.4, -0.6)
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, -1e-3), max(high, 1e-3))
    axes.locator_params(axis="x", nbins=4)
    unit = "" if metric.unit == "1" else f" [{metric.unit}]"
    better = {"higher": "  better →", "lower": "← better  ", None: ""}[metric.better]
    axes.set_title(f"{metric.name}{unit}", loc="left")
    axes.set_xlabel(better, loc="right" if metric.better == "higher" else "left", color=GREY, labelpad=1)
    axes.grid(axis="y", visible=False)


@styled()
def distribution_figures(study: StudyFiles) -> list[Figure]:
    """Empirical distributions over all episodes, one figure a metric that is defined in any episode."""
    figures = []
    for metric in map(study.metric, SPREAD):
        if metric is None or not any(study.values(metric.name, method).size for method in study.methods):
            continue
        told = [np.sort(study.values(metric.name, method)) for method in study.methods]
        low, high = min(v[0] for v in told if v.size), max(v[-1] for v in told if v.size)
        edge = 0.04 * (high - low) or 0.05 * abs(high) or 1.0
        figure, axes = new_figure(PANEL, 52.0)
        for k, values in enumerate(told):
            if values.size:
                steps = np.array([0.0, *(np.arange(values.size + 1) / values.size), 1.0])
                places = np.array([low - edge, values[0], *values, high + edge])
                axes.step(places, steps, where="post", linewidth=nested_width(k, len(told)), **line_of(k))
        axes.set_xlim(low - edge, high + edge)
        axes.set_title(_title(metric), loc="left")
        axes.set_ylim(0.0, 1.02)
        axes.locator_params(axis="x", nbins=5)
        axes.set_ylabel("share of episodes")
        figures.append(figure)
    return figures


@styled()
def world_figures(study: StudyFiles) -> list[Figure]:
    """Means of the chief metrics by world and method, one figure a metric, at most `ROWS` worlds each."""
    figures = []
    for metric in map(study.metric, BY_WORLD):
        means = {} if metric is None else study.by_world(metric.name)
        if metric is None or not means:
            continue
        for first in range(0, len(study.worlds), ROWS):
            worlds = study.worlds[first : first + ROWS]
            figure, axes = new_figure(PANEL, 18.0 + (2.5 + 1.6 * len(study.methods)) * len(worlds))
            _world_panel(axes, study, metric, worlds, means)
            figures.append(figure)
    return figures


def _world_panel(
    axes: Any, study: StudyFiles, metric: Metric, worlds: Sequence[str], means: Mapping[tuple[str, str], float]
) -> None:
    between = 0.7 / max(1, len(study.methods) - 1)
    for row, world in enumerate(worlds):
        axes.axhspan(row - 0.5, row + 0.5, color="#F4F6F8" if row % 2 else "white", zorder=0)
        for k, method in enumerate(study.methods):
            if (method, world) in means:
                height = row + (k * between - 0.35 if len(study.methods) > 1 else 0.0)
                axes.plot(means[method, world], height, marker_of(k), color=line_of(k)["color"], markersize=4.5)
    axes.set_yticks(range(len(worlds)), [shortened(world, 16) for world in worlds])
    axes.set_ylim(len(worlds) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.locator_params(axis="x", nbins=5)
    axes.set_title(_title(metric), loc="left")


@styled()
def scatter_figure(study: StudyFiles) -> Figure | None:
    """Success against the time of the successful episodes: each method, and small, each method in each world."""
    if study.metric("time") is None or study.metric("success") is None:
        return None
    figure, axes = new_figure(PANEL, 62.0)
    shown = False
    for k, method in enumerate(study.methods):
        style = {"color": line_of(k)["color"], "linestyle": "none", "marker": marker_of(k)}
        rows = [row for row in study.tested if row.key.method == method]
        for world in (None, *study.worlds):
            at = _success_and_time([row for row in rows if world in (None, row.key.world)])
            if at is not None:
                size, alpha = (9.0, 1.0) if world is None else (3.5, 0.45)
                axes.plot(at[1], at[0], markersize=size, alpha=alpha, markeredgecolor="white", **style)
                shown = True
    axes.set_ylim(-0.04, 1.06)
    axes.margins(x=0.12)
    axes.set_title("success against time, top left is best", loc="left")
    axes.set_xlabel("time of successes, s")
    axes.set_ylabel("share of successes")
    return figure if shown else None


def _success_and_time(rows: Sequence[Row]) -> tuple[float, float] | None:
    times = [time for row in rows if row.metrics["success"] and (time := row.metrics["time"]) is not None]
    return (len(times) / len(rows), float(np.mean(times))) if times else None


def _title(metric: Metric) -> str:
    unit = f", {metric.unit}" if metric.unit != "1" else ""
    better = {"higher": " (more is better)", "lower": " (less is better)", None: ""}[metric.better]
    return f"{metric.name}{unit}{better}"


def marker_of(number: int) -> str:
    """Marker of the method with this number, so that colour is not the only difference."""
    return "osD^vP<>"[number % 8]


def nested_width(number: int, methods: int) -> float:
    """Line width, points: earlier methods are wider, so that a later one on the same line does not hide them."""
    return 1.1 if methods < 2 else 1.1 + 2.4 * (methods - 1 - number) / (methods - 1)


def method_keys(methods: Sequence[str]) -> str:
    """Legend of the methods, HTML."""
    dashes = ("", "4 1.5", "1 1.2")
    return html_page.legend(
        [
            (shortened(name), line_of(k)["color"], dashes[k // len(OKABE_ITO) % len(dashes)])
            for k, name in enumerate(methods)
        ]
    )
