"""Turns messages into drawings for sinks: limits rates, sets frames, and draws tracks and the changing world."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from navloom.messages import Message, PoseEstimate, Sweep, Truth
from numpy.typing import NDArray

from navloom_viewer.builtin_panels import BUILT_IN
from navloom_viewer.colours import DRIVEN
from navloom_viewer.draw_motion import transform
from navloom_viewer.panels import Change, Panel, Seen
from navloom_viewer.picture_setup import Actor, Facts, actors_of, swappable_actors
from navloom_viewer.world_drawing import (
    bodies,
    changing,
    legend,
    obstacles,
    present,
    series_styles,
    standing,
    state_styles,
)

__all__ = ["Drawing", "Shown", "Sink"]

DRIVEN_EVERY = 0.2
"""Interval of the points of a driven track, s."""
WORLD_EVERY = 0.1
"""Interval of drawing moving obstacles, s."""
TRACK = 4096
"""Number of poses that are kept to place sweeps, which take a while to measure."""


class Shown(NamedTuple):
    """One message to be drawn.

    Attributes:
        variant: Name of the robot in the picture.
        role, instance, port: The stream that it was published on.
        active: Whether its instance is active.
        message: The message.
        tick, stamp_ns: Tick and stamp of its envelope.
    """

    variant: str
    role: str
    instance: str
    active: bool
    port: str
    message: Message
    tick: int
    stamp_ns: int


class Sink(Protocol):
    """Receiver of drawings: a file or a viewer."""

    def layout(self, blueprint: Any) -> None:
        """Set the layout."""

    def log(self, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
        """Log shapes of an entity at a time; tick None means all times."""

    def series(
        self, path: str, ticks: NDArray[np.int64], stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Add values to a time series, (n,) each."""

    def close(self) -> None:
        """Finish the output."""


class _Robot:
    """State of one robot in the picture."""

    def __init__(self) -> None:
        self.pose: Any = None
        self.track: deque[tuple[float, float, float, float]] = deque(maxlen=TRACK)
        self.drawn_to: tuple[float, float, float] | None = None


class Drawing:
    """Draws the messages of one or several robots.

    Args:
        facts: The robots in the picture.
        sinks: Receivers of the drawings.
        panels: Panels of plugins, in addition to the built-in ones.
    """

    def __init__(self, facts: Facts, sinks: Sequence[Sink], panels: Sequence[Panel] = ()) -> None:
        self.facts, self.sinks = facts, sinks
        self.added = list(panels)
        self.broken: dict[str, str] = {}
        self._panels: dict[type[Message], list[Panel]] = {}
        self._variants = {variant.name: variant for variant in facts.variants}
        self._actors = {**swappable_actors(facts), **actors_of(facts)}
        self._robots = {name: _Robot() for name in self._variants}
        self._last: dict[tuple[str, str, str, str], int] = {}
        self._keys: dict[str, str] = {}
        # A frame is static, so it is sent once per path, before the first shape.
        self._framed: set[str] = set()
        self._hidden: set[str] = set()
        self._series: dict[str, list[tuple[int, int, float]]] = {}
        self._changing = changing(facts)
        self._sweep_ended = self._is_placed = False
        self._world_drawn: tuple[float, list[str]] = (-math.inf, [])

    def begin(self) -> None:
        """Send the layout and everything that does not change."""
        import rerun as rr

        from navloom_viewer.blueprint import blueprint

        for sink in self.sinks:
            sink.layout(blueprint(self.facts, self.added))
        for path, shape in standing(self.facts):
            self._static(path, shape, rr.CoordinateFrame("map"))
        for path, frame, shape in bodies(self.facts):
            self._static(path, shape, rr.CoordinateFrame(frame))
        for path, style in [*series_styles(self.facts), *state_styles(self.facts)]:
            self._static(path, style)
        self._static("/legend", rr.TextDocument(legend(self.facts), media_type="text/markdown"))

    def take(self, shown: Shown) -> None:
        """Draw one message."""
        robot = self._robots.get(shown.variant)
        if robot is None:
            return
        if not self._is_placed:
            self._place_at_start(shown)
        actor = self._actor(shown)
        if actor is None:
            return
        time = shown.stamp_ns * 1e-9
        if isinstance(shown.message, PoseEstimate) and shown.active:
            at = shown.message.pose
            robot.pose = at
            # Poses are interpolated by time, which must rise.
            if not robot.track or time > robot.track[-1][0]:
                robot.track.append((time, at.x, at.y, at.heading))
        self._drive_on(shown, robot, actor, time)
        self._draw_world(shown, time)
        seen: Seen | None = None
        for panel in self._panels_for(type(shown.message)):
            if self._is_due(panel, shown):
                seen = seen or self._seen(shown, robot, actor, time)
                self._draw(panel, shown, seen)

    def flush(self) -> None:
        """Send the collected values of the time series."""
        for path, rows in self._series.items():
            ticks, stamps, values = zip(*rows, strict=True)
            for sink in self.sinks:
                sink.series(path, np.array(ticks), np.array(stamps), np.array(values, dtype=np.float64))
        self._series.clear()

    def close(self) -> None:
        """Send the remaining values and close the sinks."""
        self.flush()
        for sink in self.sinks:
            sink.close()

    def say(self, text: str, level: str, shown: Shown) -> None:
        """Log a message of the viewer itself."""
        import rerun as rr

        self._log("/log/viewer", (rr.TextLog(text, level=level),), shown.tick, shown.stamp_ns)

    def _place_at_start(self, shown: Shown) -> None:
        """Place every robot at its start at the time of the first message: a live one may have been up for hours."""
        self._is_placed = True
        for variant in self.facts.variants:
            start = variant.start
            for path, frame in ((f"/tf/{variant.name}", "base"), (f"/tf/{variant.name}_true", "true")):
                place = transform(start.x, start.y, start.heading, f"{variant.name}/{frame}")
                self._log(path, (place,), shown.tick, shown.stamp_ns)

    def _actor(self, shown: Shown) -> Actor | None:
        """The actor whose colour a message gets; None for a waiting instance, which is not drawn."""
        own = self._actors.get((shown.variant, shown.role, shown.instance))
        if not shown.active:
            self._hidden.discard("" if own is None else own.name)
            return own
        if own is not None and own.name not in self._hidden:
            self._hidden.add(own.name)
            self._hide(own, shown)
        return self._actors[(shown.variant, "", "")]

    def _hide(self, actor: Actor, shown: Shown) -> None:
        """Remove the newest command of a shadow that has become active."""
        import rerun as rr

        for name in ("command", f"direction_{shown.role}"):
            path = f"/run/{actor.name}/base/{name}"
            if path in self._framed:
                self._log(path, (rr.Clear(recursive=False),), shown.tick, shown.stamp_ns)

    def _seen(self, shown: Shown, robot: _Robot, actor: Actor, time: float) -> Seen:
        # Convert the long track to an array only for sweeps, which need it.
        track = np.array(robot.track, dtype=np.float64).reshape(-1, 4) if isinstance(shown.message, Sweep) else None
        newest = np.array(list(robot.track)[-1:], dtype=np.float64).reshape(-1, 4) if track is None else track
        return Seen(
            actor, self._variants[shown.variant], shown.role, shown.instance, shown.port, robot.pose, newest,
            len(self._variants) == 1, time, (list(self._variants).index(shown.variant), len(self._variants)),
        )  # fmt: skip

    def _panels_for(self, kind: type[Message]) -> Iterable[Panel]:
        if kind not in self._panels:
            self._panels[kind] = [panel for panel in (*BUILT_IN, *self.added) if issubclass(kind, panel.message)]
        return self._panels[kind]

    def _is_due(self, panel: Panel, shown: Shown) -> bool:
        if panel.name in self.broken:
            return False
        if math.isinf(panel.max_hz):
            return True
        key = (panel.name, shown.variant, f"{shown.role}/{shown.instance}", shown.port)
        last = self._last.get(key)
        # Slightly early messages pass, so that 10 Hz of a 20 Hz stream is every second message despite rounding.
        if last is not None and 0 <= shown.stamp_ns - last < 0.99e9 / panel.max_hz:
            return False
        self._last[key] = shown.stamp_ns
        return True

    def _draw(self, panel: Panel, shown: Shown, seen: Seen) -> None:
        try:
            for path, archetype in panel.to_rerun(shown.message, seen):
                self._one(path, archetype, seen.actor, shown)
        except Exception as error:
            # A failing panel is no longer drawn; the others and the run continue.
            self.broken[panel.name] = f"panel {panel.name} failed: {type(error).__name__}: {error}"
            self.say(self.broken[panel.name], "ERROR", shown)

    def _one(self, path: str, archetype: Any, actor: Actor, shown: Shown) -> None:
        import rerun as rr

        if isinstance(archetype, Change):
            if self._keys.get(path, "") == archetype.key:
                return
            self._keys[path] = archetype.key
            archetype = archetype.archetype
            if archetype is None:
                return
        if isinstance(archetype, rr.Scalars):
            value = float(archetype.as_component_batches()[0].as_arrow_array()[0].as_py())
            self._series.setdefault(path, []).append((shown.tick, shown.stamp_ns, value))
            return
        if path.startswith("/run/") and path not in self._framed:
            self._framed.add(path)
            frame = f"{actor.variant}/base" if path.startswith(f"/run/{actor.name}/base/") else "map"
            self._static(path, rr.CoordinateFrame(frame))
        self._log(path, (archetype,), shown.tick, shown.stamp_ns)

    def _drive_on(self, shown: Shown, robot: _Robot, actor: Actor, time: float) -> None:
        """Extend the driven track by one piece, from the ground truth if there is one."""
        import rerun as rr

        has_truth = self._variants[shown.variant].has_truth
        if not shown.active or not isinstance(shown.message, Truth if has_truth else PoseEstimate):
            return
        at = shown.message.pose
        last = robot.drawn_to
        if last is None:
            robot.drawn_to = (time, at.x, at.y)
        # 1e-9 s for the rounding of stamps to seconds. A standing robot adds no pieces.
        elif time - last[0] >= DRIVEN_EVERY - 1e-9 and math.hypot(at.x - last[1], at.y - last[2]) > 1e-3:
            robot.drawn_to = (time, at.x, at.y)
            colour = DRIVEN if len(self._variants) == 1 else actor.colour
            piece = [[(last[1], last[2], 0.1), (at.x, at.y, 0.1)]]
            shape = rr.LineStrips3D(piece, radii=0.035, colors=[colour])
            self._one(f"/run/{actor.name}/driven", shape, actor, shown)

    def _draw_world(self, shown: Shown, time: float) -> None:
        """Draw obstacles that move or appear, at the first robot's time."""
        if isinstance(shown.message, Sweep) and shown.message.request_id > 0:
            self._sweep_ended = True
        before, names = self._world_drawn
        if not self._changing or time - before < WORLD_EVERY:
            return
        here = present(self._changing, time, self._sweep_ended)
        now = [o.name for o in here]
        if now == names and not any(o.waypoints for o in here):
            return
        self._world_drawn = time, now
        import rerun as rr

        for path, shape in obstacles(self.facts, here, time, "_later"):
            if path not in self._framed:
                self._framed.add(path)
                self._static(path, rr.CoordinateFrame("map"))
            self._log(path, (shape,), shown.tick, shown.stamp_ns)

    def _static(self, path: str, *shapes: Any) -> None:
        self._log(path, shapes, None, 0)

    def _log(self, path: str, shapes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
        for sink in self.sinks:
            sink.log(path, shapes, tick, stamp_ns)
