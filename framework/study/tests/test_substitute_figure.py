"""The picture of a substitute plugin: its texts overlap neither each other nor the curves."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from navloom.runs.shadow_comparison import Disagreement
from navloom_recording.substitutes import Substitute
from navloom_study.report.substitute_figure import substitute_figure


def test_tick_labels_of_a_run_of_days_and_the_legend_hide_nothing() -> None:
    found = Disagreement("avoider", "vff")
    times = 123_456.0 + 0.05 * np.arange(90)
    for tick, time in enumerate(times.tolist()):
        found.add(tick, time, "improved_vfh", {"vx": 0.3, "wz": -0.2})
    way = [(tick, 5_432.0 + 0.01 * tick, 0.0) for tick in range(90)]
    figure = substitute_figure(Substitute(found, way=way), "improved_vfh")
    figure.draw_without_rendering()
    for axes in figure.axes:
        labels = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
        assert len(labels) > 2
        assert not any(one.overlaps(other) for one, other in combinations(labels, 2))
        legend = axes.get_legend()
        assert legend is not None
        box = legend.get_window_extent()
        assert not box.overlaps(axes.get_window_extent())
        assert not box.overlaps(axes.xaxis.label.get_window_extent())
        assert box.y0 >= 0.0
        assert box.x0 >= 0.0
        assert box.x1 <= figure.bbox.x1
