"""Figures of a study's report: outcomes, differences between methods, and distributions of metrics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from navloom.messages import OUTCOMES
from navloom.palette import GREY, OKABE_ITO
from navloom.runs.episode_trail import FALSE_SUCCESS
from navloom.runs.metrics import Metric

from navloom_study.report.plotting import new_figure, styled
from navloom_study.report.study_files import StudyFiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["difference_figure", "distribution_figure", "line_of", "outcome_figure", "success_figures"]

WIDTH = 180.0
"""Width of a figure, mm: the text width of an A4 page."""
COLOURS = {
    "succeeded": "#009E73", "collision": "#D55E00", "stuck": "#E69F00", "timeout": "#F0E442", "no_path": "#56B4E9",
    "rejected": "#0072B2", "error": "#333333", "stopped": "#CC79A7", "lost": "#117733", "cancelled": "#B5B5B5",
    FALSE_SUCCESS: "#882255",
}  # fmt: skip
SPREAD = ("spl", "time", "clearance_min", "cross_track_rms", "turning", "jerk")
DIFFERENCES = (
    "success", "spl", "time", "clearance_min", "danger_share", "cross_track_rms", "turning", "steering_flips", "jerk",
)  # fmt: skip
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


def outcome_figure(study: StudyFiles) -> Figure:
    """Stacked bars with the share of each outcome, by method."""
    counts, methods = study.comparison.outcomes, study.methods
    figure, axes = new_figure(WIDTH, 26.0 + 6.5 * len(methods))
    with styled():
        left = np.zeros(len(methods))
        totals = np.array([max(1, sum(counts[method].values())) for method in methods], dtype=np.float64)
        for kind in (*OUTCOMES, FALSE_SUCCESS):
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
        axes.set_xlabel("share of the episodes (numbers: episodes)")
        axes.grid(False)
        figure.legend(loc="outside upper center", ncols=5)
    return figure


def success_figures(study: StudyFiles) -> list[Figure]:
    """Successes of each method in each world, at most `ROWS` worlds a figure."""
    figures = math.ceil(len(study.worlds) / ROWS)
    each = math.ceil(len(study.worlds) / figures)
    return [_success(study, study.worlds[first : first + each]) for first in range(0, len(study.worlds), each)]


def _success(study: StudyFiles, worlds: Sequence[str]) -> Figure:
    methods = study.methods
    width = min(WIDTH, 55.0 + 21.0 * len(methods))
    figure, axes = new_figure(width, 22.0 + 4.7 * max(len(worlds), 2))
    with styled():
        from matplotlib import colormaps
        from matplotlib.patches import Rectangle

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


def difference_figure(study: StudyFiles) -> Figure | None:
    """Differences from the baseline with their intervals, one panel a metric; None if nothing is compared."""
    others = [method for method in study.methods if method != study.baseline]
    shown = [
        metric for metric in map(study.metric, DIFFERENCES) if metric is not None and _is_told(study, metric, others)
    ]
    if not others or not shown:
        return None
    columns = min(3, len(shown))
    rows = math.ceil(len(shown) / columns)
    figure, axes = new_figure(WIDTH, rows * (15.0 + 5.0 * len(others)) + 12.0, rows, columns)
    panels = np.atleast_1d(axes).ravel()
    with styled():
        for number, (panel, metric) in enumerate(zip(panels, shown, strict=False)):
            _difference_panel(panel, study, metric, others)
            if number % columns:
                panel.tick_params(labelleft=False)
        for panel in panels[len(shown) :]:
            panel.set_visible(False)
        _difference_legend(figure)
    return figure


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
        sure = one.p_holm is not None and one.p_holm < 0.05
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


def _difference_legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], color=OKABE_ITO[0], marker="o", label="better (p Holm < 0.05)"),
        Line2D([], [], color=OKABE_ITO[1], marker="o", label="worse (p Holm < 0.05)"),
        Line2D([], [], color=GREY, marker="o", markerfacecolor="white", label="not told apart"),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=3)


def distribution_figure(study: StudyFiles) -> Figure | None:
    """Empirical distributions over all episodes, one panel a metric; None if no metric is defined in any episode."""
    shown = [
        metric
        for metric in map(study.metric, SPREAD)
        if metric is not None and any(study.values(metric.name, method).size for method in study.methods)
    ]
    if not shown:
        return None
    columns = min(3, len(shown))
    rows = math.ceil(len(shown) / columns)
    legend = 6.0 * math.ceil(len(study.methods) / 5)
    figure, axes = new_figure(WIDTH, 52.0 * rows + legend, rows, columns)
    panels = np.atleast_1d(axes).ravel()
    with styled():
        for number, (panel, metric) in enumerate(zip(panels, shown, strict=False)):
            told = [np.sort(study.values(metric.name, method)) for method in study.methods]
            low, high = min(v[0] for v in told if v.size), max(v[-1] for v in told if v.size)
            edge = 0.04 * (high - low) or 0.05 * abs(high) or 1.0
            for k, values in enumerate(told):
                if values.size:
                    steps = np.array([0.0, *(np.arange(values.size + 1) / values.size), 1.0])
                    places = np.array([low - edge, values[0], *values, high + edge])
                    panel.step(places, steps, where="post", linewidth=1.2, **line_of(k))
            panel.set_xlim(low - edge, high + edge)
            better = {"higher": ", more is better", "lower": ", less is better", None: ""}[metric.better]
            panel.set_title(f"{metric.name}{better}", loc="left")
            panel.set_xlabel(metric.unit if metric.unit != "1" else "")
            panel.set_ylim(0.0, 1.02)
            panel.locator_params(axis="x", nbins=5)
            if number % columns == 0:
                panel.set_ylabel("share of episodes")
            else:
                panel.tick_params(labelleft=False)
        for panel in panels[len(shown) :]:
            panel.set_visible(False)
        handles = _handles(study.methods)
        figure.legend(handles=handles, loc="outside lower center", ncols=min(5, len(handles)))
    return figure


def _handles(methods: Sequence[str]) -> list[Any]:
    """Legend entries of all methods, including those without a line in some panel."""
    from matplotlib.lines import Line2D

    return [Line2D([], [], label=shortened(name), **line_of(k)) for k, name in enumerate(methods)]
