"""Metrics, panels, worlds, schemes, messages and nodes with a fault each."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from navloom import (
    Box,
    Cylinder,
    Latest,
    Message,
    Metric,
    NodePlugin,
    Params,
    Place,
    PoseEstimate,
    Publishes,
    Raster,
    Stamp,
    Tick,
    World,
    message,
)
from navloom_viewer import Panel
from pydantic import Field

from planted import Entries

ENTRIES = Entries()


# --- metrics ----------------------------------------------------------------------------------------------------------


def metric(name: str, caught_by: str, compute: Any, **changes: Any) -> None:
    made = Metric(name, "m", "lower", compute, "A number of an episode; it is always defined.")
    ENTRIES.plant(name, caught_by, "metric")(replace(made, **changes))


def writes_trail(trail: Any) -> float:
    trail.x.flags.writeable = True
    trail.x[:] = 0.0
    return 0.0


metric("of_no_ticks", "metric_values", lambda trail: float(np.diff(trail.x)[0]))
metric("is_nan", "metric_values", lambda trail: float(np.mean(trail.cross_track)))
metric("is_text", "metric_values", lambda trail: "far")
metric("below_bound", "metric_values", lambda trail: -1.0, bounds=(0.0, None))
metric("half_a_share", "metric_values", lambda trail: 0.5, is_share=True)
metric("by_chance", "metric_repeats", lambda trail: random.random())
metric("writes_trail", "metric_untouched", writes_trail)
metric("by_wall_time", "metric_repeats", lambda trail: float(trail.tick_ns.sum()))


# --- panels -----------------------------------------------------------------------------------------------------------


def no_paths(given: Any, seen: Any) -> Any:
    return [given]


def fails_without_pose(given: Any, seen: Any) -> Any:
    yield seen.in_map("here"), seen.pose.x


def none_drawn(given: Any, seen: Any) -> Any:
    return None


for name, draws in (("no_paths", no_paths), ("without_pose", fails_without_pose), ("draws_none", none_drawn)):
    ENTRIES.plant(name, "panel_draws", "panel")(Panel(name, PoseEstimate, draws))


# --- worlds and schemes -----------------------------------------------------------------------------------------------

UP = Place(0.0, 0.0, 1.57)


@ENTRIES.plant("start_in_wall", "world_usable", "world")
def start_in_wall() -> World:
    return World("start_in_wall", (Box("wall", (-1.0, 1.0), (-1.0, 1.0)),), start=UP, goal=Place(0.0, 6.0))


@ENTRIES.plant("random_world", "world_repeats", "world")
def random_world() -> World:
    posts = (Cylinder("post", 3.0 * random.random() + 1.0, 3.0, 0.1),)
    return World("random_world", posts, start=UP, goal=Place(0.0, 6.0))


@ENTRIES.plant("no_world", "world_usable", "world")
def no_world() -> World:
    return None  # type: ignore[return-value]


@ENTRIES.plant("nan_world", "world_usable", "world")
def nan_world() -> World:
    return World("nan_world", (Cylinder("post", float("nan"), 3.0, 0.1),), start=UP, goal=Place(0.0, 6.0))


@ENTRIES.plant("start_outside", "world_usable", "world")
def start_outside() -> World:
    raster = Raster("room", np.zeros((10, 10), np.bool_), 0.1)
    return World("start_outside", (), raster, Place(50.0, 50.0), Place(60.0, 60.0), bounds=(0.0, 0.0, 1.0, 1.0))


@ENTRIES.plant("fails_at_junk", "scheme_refuses", "scheme")
def fails_at_junk(argument: str, base: Path) -> World:
    return World(f"fails_at_junk:{argument}", (), start=UP, goal=Place(0.0, [6.0][int(argument)]))


@ENTRIES.plant("takes_anything", "scheme_refuses", "scheme")
def takes_anything(argument: str, base: Path) -> World:
    (base / argument).parent.mkdir(parents=True, exist_ok=True)
    return World("takes_anything", (), start=UP, goal=Place(0.0, 6.0))


# --- messages ---------------------------------------------------------------------------------------------------------


@ENTRIES.plant("Bare", "registers", "message")
class Bare(Message):
    """Not declared with @message."""

    stamp_ns: Stamp
    x: float


@ENTRIES.plant("OtherName", "registers", "message")
@message
class Named(Message):
    """Its entry point has another name."""

    stamp_ns: Stamp
    x: float


@ENTRIES.plant("Wordless", "documented", "message")
@message
class Wordless(Message):
    """A number."""

    stamp_ns: Stamp
    x: float


# --- nodes ------------------------------------------------------------------------------------------------------------


@message
class Number(Message):
    stamp_ns: Stamp
    value: float


class NodeParams(Params):
    gain: float = Field(1.0, ge=0.0, le=10.0, description="No unit.")


class Counter(NodePlugin):
    """Sound: how far the robot is along x."""

    name = "counter"
    Params = NodeParams
    pose = Latest(PoseEstimate, triggers=True)
    numbers = Publishes(Number)

    def value(self) -> float:
        assert self.pose.value is not None
        return self.pose.value.pose.x

    def step(self, tick: Tick) -> None:
        if self.pose.value is not None:
            self.numbers.put(Number(tick.time_ns, self.value()))


@ENTRIES.plant("random_node", "global_random")
class RandomNode(Counter):
    name = "random_node"

    def value(self) -> float:
        return random.random()


@ENTRIES.plant("other_message", "answers")
class OtherMessage(Counter):
    name = "other_message"

    def step(self, tick: Tick) -> None:
        self.numbers.put(self.pose.value)  # type: ignore[arg-type]


@ENTRIES.plant("counting_node", "reset_as_new")
class CountingNode(Counter):
    name = "counting_node"
    steps = 0

    def value(self) -> float:
        self.steps += 1
        return float(self.steps)


@ENTRIES.plant("node_with_shared_count", "episodes")
class NodeWithSharedCount(Counter):
    name = "node_with_shared_count"
    counts: list[int] = []

    def value(self) -> float:
        self.counts.append(1)
        return float(len(self.counts))


class LateParams(Params):
    gain: float = Field(20.0, ge=0.0, le=10.0, description="No unit.")


@ENTRIES.plant("node_outside_bounds", "defaults_within_bounds")
class NodeOutsideBounds(Counter):
    name = "node_outside_bounds"
    Params = LateParams  # type: ignore[assignment]
