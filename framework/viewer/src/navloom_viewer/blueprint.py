"""Layout of the viewer: 3D view, state timeline below it, time series, polar histogram, log and legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from navloom_viewer.panels import Panel
from navloom_viewer.picture_setup import LANES, Facts, actors_of

__all__ = ["TIMELINE", "blueprint", "camera", "states"]

TIMELINE = "run_time"


def blueprint(facts: Facts, panels: Sequence[Panel] = ()) -> Any:
    """The layout for one or several robots; plugin panels with their own view are tabs beside the log."""
    import rerun.blueprint as rrb

    left = rrb.Vertical(_scene(facts), states(facts), row_shares=[4, 1 + 0.15 * min(len(actors_of(facts)), 6)])
    right = rrb.Vertical(
        rrb.Tabs(_series("speed", "Speed, m/s"), _series("turn_rate", "Turn rate, deg/s, left +")),
        _series("clearance", "Clearance, m: gap between robot and nearest obstacle"),
        _series("cross_track", "Cross-track error, m, left +"),
        _histograms(facts),
        rrb.Tabs(
            rrb.TextLogView(origin="/log", name="Log: stops, take-overs, results"),
            rrb.TextDocumentView(origin="/legend", name="Legend"),
            rrb.TextDocumentView(origin="/critics", name="Critics"),
            *(panel.view() for panel in panels if panel.view is not None),
        ),
        row_shares=[3, 3, 3, 3, 4],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _scene(facts: Facts) -> Any:
    """The 3D view of the map frame, seen from behind and above the start, with the track driven so far."""
    import rerun.blueprint as rrb

    overrides: dict[Any, Any] = {}
    whole = rrb.VisibleTimeRange(
        TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    for variant in facts.variants:
        overrides[f"/run/{variant.name}/driven"] = rrb.VisibleTimeRanges([whole])
    eye, target = camera(facts)
    return rrb.Spatial3DView(
        origin="/",
        contents=["+ /world/**", "+ /run/**", "+ /tf/**"],
        name="Map frame, m",
        overrides=overrides,
        spatial_information=rrb.SpatialInformation(target_frame="map"),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=[0.0, 0.0, 1.0]),
        background=[18, 20, 26],
        line_grid=rrb.LineGrid3D(visible=True, spacing=1.0, color=[255, 255, 255, 14]),
    )


def states(facts: Facts) -> Any:
    """Lanes of one robot and its shadows; for several robots only the driver lane of each, so that they fit."""
    import rerun.blueprint as rrb

    is_alone = len(facts.variants) == 1
    actors = actors_of(facts).values() if is_alone else [a for a in actors_of(facts).values() if not a.is_shadow]
    lanes = [
        actor.lane(lane, is_alone)
        for actor in actors
        for lane in (LANES[-1:] if actor.is_shadow else LANES if is_alone else ("driver",))
    ]
    name = "States: goal, driver, avoider" if is_alone else "Who drives"
    return rrb.StateTimelineView(contents=[f"+ {lane}" for lane in lanes], name=name)


def _histograms(facts: Facts) -> Any:
    """A tab for each avoider, since bars of several in one chart would hide each other."""
    import rerun.blueprint as rrb

    about = "obstacle density by bearing, deg, right +; above 1 is blocked"
    no_legend = rrb.PlotLegend(visible=False)  # it would name the entity's path
    names = [a.name for key, a in actors_of(facts).items() if key[1] in ("", "avoider")]
    if len(names) == 1:
        return rrb.BarChartView(origin="/histogram", name=about.capitalize(), plot_legend=no_legend)
    charts = [
        rrb.BarChartView(origin=f"/histogram/{name}", name=f"Density, {name}", plot_legend=no_legend) for name in names
    ]
    return rrb.Tabs(*charts)


def camera(facts: Facts) -> tuple[list[float], list[float]]:
    """Eye and target of the camera, m: behind the first start, with all starts and goals in view."""
    first = facts.variants[0]
    points = [(v.start.x, v.start.y) for v in facts.variants]
    points += [v.goal for v in facts.variants if v.goal is not None]
    low, high = np.min(points, axis=0) - 2.0, np.max(points, axis=0) + 2.0
    if facts.world is not None:
        low = np.maximum(low - 1.0, facts.world.bounds[:2])
        high = np.minimum(high + 1.0, facts.world.bounds[2:])
    centre, span = 0.5 * (low + high), float(np.max(high - low))
    behind = np.array([np.cos(first.start.heading), np.sin(first.start.heading)])
    eye = centre - 0.62 * span * behind
    return [*eye.tolist(), 0.68 * span], [*(centre - 0.07 * span * behind).tolist(), 0.0]


def _series(metric: str, name: str) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=f"/metrics/{metric}", name=name, plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    )
