"""Checks of plugins that are not classes with a verb: metrics, worlds, schemes, panels and messages."""

from __future__ import annotations

import math
import re
import traceback
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import rectangle
from navloom.geometry.world import Box, Obstacle, World
from navloom.messages import SCHEMAS, Message, Pose2D, RangeScan
from navloom.messages.codec import decode, encode, schema_label
from navloom.runs.episode_trail import Trail
from navloom.runs.metrics import Metric, measure
from numpy.typing import NDArray

from navloom_check import messages
from navloom_check.check_bench import Bench, alike
from navloom_check.checks import check
from navloom_check.contract.panel_side_effects import views
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import NOWHERE, bytes_of
from navloom_check.process_state import PROCESS_STATE
from navloom_check.samples import sample
from navloom_check.side_effects import GUARD

__all__ = ["CHECKS", "own_line"]

OTHER_SEEDS = 4711
JUNK = (
    "",
    " ",
    "no such thing",
    "-1",
    "1e999",
    "nan",
    "999999999999999999999",
    "../../nothing",
    "a\0b",
    "x" * 5000,
    "ä",
)
"""Arguments that no scheme can use, as people and scripts may give them."""
OF_TICKS = re.compile(r"^ticks?\b|\b(number|count|counts|how many)\b[^.;]*\bticks?\b", re.IGNORECASE)
"""Unit and description of a metric that counts ticks."""
TICK_RATIO = 1.5
"""Greatest ratio of a metric's numbers for the same drive with ticks half as long."""
ENOUGH = 20
"""Samples that are made of a message class."""


def _problem(bench: Bench, act: Callable[[], Any]) -> tuple[Any, Finding | None]:
    """The answer of a call to the plugin, or a finding for the error that it raises."""
    try:
        with GUARD.within("the call"):
            return act(), None
    # A plugin that calls sys.exit() must not end the check.
    except (Exception, SystemExit) as error:
        return None, Finding(f"raises {type(error).__name__}: {error}", "an answer", own_line(bench, error))


def own_line(bench: Bench, error: BaseException) -> str:
    """The innermost line of the plugin in the traceback of an error."""
    places = [
        f"{PurePath(frame.f_code.co_filename).name}:{line}"
        for frame, line in traceback.walk_tb(error.__traceback__)
        if bench.subject.is_own(str(frame.f_globals.get("__name__", "")))
    ]
    return places[-1] if places else ""


# --- metrics ----------------------------------------------------------------------------------------------------------


def _trail(ticks: int, period: float = 0.05, **changes: Any) -> Trail:
    """An episode of a robot that drives a bend past an obstacle; the period of a tick in s."""
    time = period * np.arange(ticks, dtype=np.float64)
    turn: NDArray[np.float64] = 0.3 * time
    v, w = 0.3 + 0.02 * np.sin(3.0 * time), 0.3 + 0.02 * np.cos(2.0 * time)
    none = np.zeros(ticks, dtype=np.bool_)
    made = Trail(
        time, np.sin(turn), 1.0 - np.cos(turn), turn, v, w, 1.0 + 0.2 * np.sin(time), 0.05 * np.cos(time), v.copy(),
        w.copy(), none, none,
        "succeeded", "", 0, 0, 0, period, 1.2, 0.1, 120.0, 0.5, 1.0, 0.1, np.full(ticks, 1_000_000),
        0, 1.3,
    )  # fmt: skip
    return replace(made, **changes)


def _trails() -> dict[str, Trail]:
    """Episodes of all kinds that occur in a study."""
    drive = _trail(200)
    none = np.zeros(200)
    unknown = np.full(200, math.nan)
    return {
        "a drive to the goal": drive,
        "a collision": _trail(200, outcome="collision", clearance=drive.clearance - 1.1, touches=2),
        "a drive without a goal and with unknown values": _trail(
            200, cross_track=unknown, clearance=unknown, optimal=None, goal_distance=None,
            reference=None, outcome="no_path",
        ),
        "an open floor": _trail(200, clearance=np.full(200, math.inf)),
        "one tick": _trail(1, outcome="timeout"),
        "no tick": _trail(0, outcome="error"),
        "a robot that backs up": _trail(200, vx=np.full(200, -0.2), wz=np.full(200, -0.3)),
        "a stopped robot": _trail(200, x=none, y=none, heading=none, vx=none, wz=none, command_vx=none,
                                  command_wz=none, outcome="stuck"),
    }  # fmt: skip


@check("contract", {"metric"}, "It gives a finite number within its bounds, or None, for every kind of episode.")
def metric_values(bench: Bench) -> Iterator[Finding]:
    """Episodes may have failed, have no tick, or lack most values."""
    metric = _metric(bench)
    if not (isinstance(metric.bounds, tuple) and len(metric.bounds) == 2):
        yield Finding(f"has bounds = {metric.bounds!r}", "(lowest, highest), each a number or None")
        return
    for name, trail in _trails().items():
        # As a default, which is bound now: the loop's variable changes.
        found, problem = _problem(bench, lambda trail=trail: measure(trail, [metric])[metric.name])  # type: ignore[misc]
        if problem is not None:
            yield replace(problem, expected="a number, or None where it is not defined", given=f"episode: {name}")
            return
        low, high = metric.bounds
        if found is not None and not (
            (-math.inf if low is None else low) <= found <= (math.inf if high is None else high)
        ):
            yield Finding(f"gives {found:g}", f"a number within its bounds {metric.bounds}", given=f"episode: {name}")
            return


@check("contract", {"metric"}, "It gives the same number with any seeds, clock and speed of the computer.")
def metric_repeats(bench: Bench) -> Iterator[Finding]:
    """`tick_ns` and `tick_cpu_ns` are times of the computer, which no run repeats."""
    metric = _metric(bench)
    for name, trail in _trails().items():
        slower = replace(trail, tick_ns=3 * trail.tick_ns, tick_cpu_ns=3 * trail.tick_ns)
        plays = ((trail, 1, 0.0), (trail, OTHER_SEEDS, 3e6), (slower, 1, 0.0))
        given = []
        for one, seeds, later in plays:
            with alike(seeds, (1_700_000_000.0 + later, 0.001)):
                given.append(_problem(bench, lambda one=one: metric.compute(one))[0])  # type: ignore[misc]
        for other, why in ((given[1], "with other seeds and another clock"), (given[2], "on a slower computer")):
            # NaN both times is the same answer.
            if other != given[0] and not (other != other and given[0] != given[0]):
                yield Finding(f"gives {given[0]!r}, and {other!r} {why}", "the same number", given=f"episode: {name}")
                return


@check("contract", {"metric"}, "It gives almost the same number for the same drive with ticks half as long.")
def metric_tick_rate(bench: Bench) -> Iterator[Finding]:
    """A count or a sum of ticks doubles. A metric whose unit or description says that it counts ticks may."""
    metric = _metric(bench)
    if OF_TICKS.search(f"{metric.unit}; {metric.about}"):
        raise NotRun("it says that it counts ticks")
    for slow in (_trail(200), _trail(200, engaged=np.arange(200) % 40 < 20)):
        engaged = np.repeat(slow.engaged, 2)
        fast = _trail(400, 0.5 * slow.period, engaged=engaged)
        one = _problem(bench, lambda slow=slow: metric.compute(slow))[0]  # type: ignore[misc]
        other = _problem(bench, lambda fast=fast: metric.compute(fast))[0]  # type: ignore[misc]
        if one and other and not 1.0 / TICK_RATIO < other / one < TICK_RATIO:
            yield Finding(
                f"gives {one:.4g} for a drive with ticks of 0.05 s, and {other:.4g} for the same with ticks of 0.025 s",
                "sums times trail.period, means, or differences of trail.time", given="episode: a drive to the goal",
            )  # fmt: skip
            return


@check("contract", {"metric"}, "It does not change its episode.")
def metric_untouched(bench: Bench) -> Iterator[Finding]:
    """Other metrics are computed from the same episode."""
    metric = _metric(bench)
    for name, trail in _trails().items():
        before = {one.name: np.array(getattr(trail, one.name)) for one in fields(trail)}
        _problem(bench, lambda trail=trail: metric.compute(trail))  # type: ignore[misc]
        for field, value in before.items():
            if not np.array_equal(value, np.array(getattr(trail, field)), equal_nan=value.dtype.kind == "f"):
                yield Finding(f"changes {field} of the episode", "a copy, np.array(…)", given=f"episode: {name}")
                return


def _metric(bench: Bench) -> Metric:
    if not isinstance(bench.subject.thing, Metric):
        raise NotRun(f"{bench.subject.thing!r} is not a navloom.Metric: see the check `registers`")
    return bench.subject.thing


# --- worlds and schemes -----------------------------------------------------------------------------------------------


@check("contract", {"world"}, "It is a World of finite numbers, whose start and goal are within its bounds and free.")
def world_usable(bench: Bench) -> Iterator[Finding]:
    """Free means free for a robot of 0.4 m x 0.4 m."""
    GUARD.deeds.clear()
    world, problem = _problem(bench, bench.subject.thing)
    if deed := next((one for one in GUARD.deeds if one.kind in ("file", "process", "socket", "thread")), None):
        yield Finding(f"does this: {deed.text[:80]}", "to read only", deed.place)
        return
    if problem is not None:
        yield problem
        return
    if not isinstance(world, World):
        yield Finding(f"gives {type(world).__name__}", "a navloom.World")
        return
    if wrong := _not_finite(world, "world"):
        yield Finding(f"has {wrong}", "finite numbers")
        return
    if wrong := next((said for obstacle in world.obstacles if (said := _misshapen(obstacle))), ""):
        yield Finding(f"has {wrong}", "intervals from the lower to the higher end, and a radius above 0, m")
        return
    left, low, right, high = world.bounds
    for name, place in (("start", world.start), ("goal", world.goal)):
        if place is None:
            continue
        if abs(place.heading) > math.tau:
            yield Finding(f"has its {name} at a heading of {place.heading:g} rad", "rad, not degrees")
            return
        if not (left <= place.x <= right and low <= place.y <= high):
            yield Finding(f"has its {name} at ({place.x:g}, {place.y:g})", f"a place within its bounds {world.bounds}")
            return
        gap, nearest = clearance(rectangle(0.4, 0.4), place, world, height=1.0)
        if gap <= 0.0:
            yield Finding(f"has its {name} at ({place.x:g}, {place.y:g}) in {nearest!r}", "a free place")
            return


def _misshapen(obstacle: Obstacle) -> str:
    """An obstacle that covers nothing, in words; empty for others."""
    if not isinstance(obstacle, Box):
        return "" if obstacle.radius > 0.0 else f"{obstacle.name!r} with a radius of {obstacle.radius:g} m"
    spans = {"x": obstacle.x, "y": obstacle.y, "z": obstacle.z}
    wrong = next((axis for axis, (low, high) in spans.items() if low > high), "")
    return f"{obstacle.name!r} with {wrong} from {spans[wrong][0]:g} to {spans[wrong][1]:g} m" if wrong else ""


@check("contract", {"world"}, "It is the same world each time.")
def world_repeats(bench: Bench) -> Iterator[Finding]:
    """Global seeds and the clock are changed in between."""
    made = []
    for seeds, clock in ((1, 1.7e9), (OTHER_SEEDS, 1.9e9)):
        with alike(seeds, (clock, 0.001)):
            made.append(_problem(bench, bench.subject.thing)[0])
    if bytes_of(made[0]) != bytes_of(made[1]):
        yield Finding("gives another world the second time", "the same world; give a scheme its seed: door:3")


@check("contract", {"scheme"}, "It refuses bad arguments with a ValueError, and it writes nothing.")
def scheme_refuses(bench: Bench) -> Iterator[Finding]:
    """`navloom.worlds.WorldError` is such an error; it names what was given and what was expected."""
    for text in JUNK:
        GUARD.deeds.clear()
        try:
            with TemporaryDirectory() as folder, GUARD.within("the scheme"):
                world = bench.subject.thing(text, Path(folder))
        except ValueError:
            if deed := _scheme_deed(text):
                yield deed
                return
            continue
        except (Exception, SystemExit) as error:
            said = f"raises {type(error).__name__}: {error}"
            yield Finding(said, "ValueError, with what was given and what was expected", own_line(bench, error),
                          f"argument {text[:40]!r}")  # fmt: skip
            return
        if deed := _scheme_deed(text):
            yield deed
            return
        if not isinstance(world, World):
            yield Finding(f"gives {type(world).__name__}", "a World or ValueError", given=f"argument {text[:40]!r}")
            return
        if wrong := _not_finite(world, "world"):
            yield Finding(f"gives a world with {wrong}", "ValueError", given=f"argument {text[:40]!r}")
            return


def _scheme_deed(text: str) -> Finding | None:
    """Finding for the first side effect of a scheme; it may only read files below its base folder."""
    deed = next((one for one in GUARD.deeds if one.kind != "read"), None)
    if deed is None:
        return None
    expected = (
        "paths relative to the folder that it is given: base / argument"
        if deed.kind == "environment"
        else "to read only"
    )
    return Finding(f"does this: {deed.text[:80]}", expected, deed.place, f"argument {text[:40]!r}")


def _not_finite(value: Any, path: str) -> str:
    """The first number of a value that is not finite, in words; empty for none."""
    if isinstance(value, bool | str | np.ndarray) or value is None:
        return ""
    if isinstance(value, int | float):
        return "" if math.isfinite(value) else f"{path} = {value}"
    if isinstance(value, tuple | list):
        return next((wrong for k, one in enumerate(value) if (wrong := _not_finite(one, f"{path}[{k}]"))), "")
    if is_dataclass(value):
        inner = ((field.name, getattr(value, field.name)) for field in fields(value))
        return next((wrong for name, one in inner if (wrong := _not_finite(one, f"{path}.{name}"))), "")
    return f"{path} of {type(value).__name__}"


# --- panels and messages ----------------------------------------------------------------------------------------------


@check("contract", {"panel"}, "Its module imports rerun in functions only: hosts without the viewer load it too.")
def viewer_imported_late(bench: Bench) -> Iterator[Finding]:
    """When the plugin is imported, not when it draws."""
    if PROCESS_STATE.imported_viewer:
        yield Finding("imports rerun when it is imported", "import rerun in the functions that draw")


@check(
    "contract",
    {"panel"},
    "It turns each message into pairs of entity path and archetype, also before the first pose.",
)
def panel_draws(bench: Bench) -> Iterator[Finding]:
    """It draws generated messages of its class."""
    view = views()
    panel = bench.subject.thing
    known = [cls for cls in SCHEMAS.values() if issubclass(cls, panel.message)]
    rng = np.random.default_rng(bench.seed)
    for cls in known or [panel.message]:
        for pose, track in ((None, np.empty((0, 4))), (Pose2D(1.0, 2.0, 0.5), np.array([[0.0, 1.0, 2.0, 0.5]]))):
            seen = view(pose, track)
            for what, given in _messages(cls, rng):
                when = f"{cls.__name__}{what}, {'before the first pose' if pose is None else 'with a pose'}"
                draw: Callable[[], list[Any]] = lambda given=given, seen=seen: list(panel.to_rerun(given, seen))  # type: ignore[misc]  # noqa: E731
                drawn, problem = _problem(bench, draw)
                if problem is not None:
                    yield replace(problem, expected="pairs of entity path and archetype, or none", given=when)
                    return
                wrong = next((said for one in drawn if (said := _undrawable(one))), "")
                if wrong:
                    yield Finding(
                        f"gives {wrong}", "(entity path, rerun archetype), without infinite numbers", given=when
                    )
                    return


def _messages(cls: type[Message], rng: np.random.Generator) -> Iterator[tuple[str, Message]]:
    """Messages of a class, each after a phrase for what is unusual about it."""
    yield "", sample(cls, rng)
    if cls is RangeScan:
        yield " without an echo", messages.scan(math.inf)
        yield " without beams", messages.scan(np.empty(0))
        yield " with echoes in some beams", messages.scan([math.inf, 1.0, math.inf, 2.0])


def _undrawable(one: Any) -> str:
    """Why the viewer cannot log an object, in words; empty if it can."""
    if not (isinstance(one, tuple) and len(one) == 2 and isinstance(one[0], str) and one[0]):
        return repr(one)[:100]
    if not hasattr(one[1], "as_component_batches"):
        return f"{one[0]!r} with {one[1]!r}"[:100]
    for batch in one[1].as_component_batches():
        values = batch.as_arrow_array()
        while hasattr(values, "flatten") and str(values.type).startswith(("fixed_size_list", "list")):
            values = values.flatten()
        if str(values.type) in ("float", "double") and np.isinf(values.to_numpy(zero_copy_only=False)).any():
            return f"{one[0]!r} with infinite numbers"
    return ""


@check("contract", {"message"}, "It is the same after encoding and decoding.")
def message_codec(bench: Bench) -> Iterator[Finding]:
    """Messages are encoded between processes and in recordings."""
    cls: type[Message] = bench.subject.thing
    rng = np.random.default_rng(bench.seed)
    for number in range(ENOUGH):
        made, problem = _problem(bench, lambda: sample(cls, rng, number))  # noqa: B023
        if problem is not None:
            yield replace(problem, expected="a message of values within the declared bounds")
            return
        again, problem = _problem(bench, lambda made=made: decode(encode(made, NOWHERE), schema_label(cls))[0])  # type: ignore[misc]
        if problem is not None or bytes_of(made) != bytes_of(again):
            yield problem or Finding(f"is {again!r} after encoding and decoding", f"{made!r}")
            return


CHECKS = (
    metric_values, metric_repeats, metric_tick_rate, metric_untouched, world_usable, world_repeats, scheme_refuses,
    viewer_imported_late, panel_draws, message_codec,
)  # fmt: skip
