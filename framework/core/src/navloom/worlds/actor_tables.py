"""Reads an actor, a table `[[actor]]` of a world file or the `values` of an event:

```toml
[[actor]]
name = "nurse"
body = "legs"                        # or "disc" (default), "box", "trolley"
size = [0.44, 0.44]                  # length and width, m; default by the body
z = [0.0, 1.75]                      # m; default by the body
appears_at = 5.0                     # s; its course begins then
way = [[0.0, 3.0], [4.0, 3.0]]       # places that it goes to; or waypoints = [[time, x, y], ...]
speed = 1.2                          # m/s, or one for each piece of the way; default 1.2
waits = [2.0, 0.0]                   # s at each place of the way; default none
keys = "spline"                      # a curve through the points; default "linear"
loops = true                         # back to the first place of the way, and again
leaves = true                        # it is gone after the last point; default false: it stays there
phase = 3.0                          # s of its course that have passed when it appears
heading_deg = 90.0                   # it does not turn; default: it faces where it goes

[[actor]]
name = "visitor"                     # gives way to others: the distribution navloom-orca
body = "legs"
start = [0.0, 0.0]
goals = [[8.0, 0.0], [8.0, 5.0]]
speed = 1.3                          # m/s, if nothing is in the way
max_speed = 1.8
flows = true                         # after the last goal it leaves, and begins again; or loops = true: its goals again
entry = [0.0, -2.0]                  # where one that flows begins again, once nothing is near; default: its start
sees_robots = false                  # it does not give way to robots
```
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, get_args

from navloom.geometry.actors import Actor, Body, BodyKind, Course, Walk
from navloom.worlds.toml_table import FileTable

__all__ = ["ACTOR_KEYS", "actor_of", "way_points", "waypoints_of"]

_COURSE_KEYS = ("waypoints", "way", "speed", "waits", "keys", "loops", "leaves", "phase", "heading_deg")
_WALK_KEYS = ("start", "goals", "speed", "max_speed", "flows", "entry", "loops", "sees_robots")
ACTOR_KEYS = tuple(dict.fromkeys(("name", "body", "size", "z", "appears_at", *_COURSE_KEYS, *_WALK_KEYS)))
_SIZES: dict[BodyKind, tuple[tuple[float, float], float]] = {
    "disc": ((0.5, 0.5), 1.8), "box": ((0.6, 0.6), 1.0), "legs": ((0.44, 0.44), 1.75), "trolley": ((0.9, 0.55), 1.0),
}  # fmt: skip
"""Length and width, m, and height, m, of each body that the file does not size."""
_SPEED = 1.2
"""Speed of an actor whose table names none, m/s: a person who walks."""

Point = tuple[float, float, float]


def actor_of(table: FileTable, name: str, appears_at: float = 0.0) -> Actor:
    """An actor from its table.

    Args:
        table: The table.
        name: Its name if the table has none.
        appears_at: When it appears if the table does not say, s.

    Raises:
        WorldError: A key is missing or wrong, or two exclude each other.
    """
    kinds: tuple[BodyKind, ...] = get_args(BodyKind)
    kind = next(kind for kind in kinds if kind == table.choice("body", kinds))
    (length, width), height = _SIZES[kind]
    if "size" in table:
        length, width = table.numbers("size", "[length, width]")
        if not min(length, width) > 0.0:
            raise table.error(f"size = [{length:g}, {width:g}], expected lengths > 0 in metres")
        if kind in ("disc", "legs") and length != width:
            raise table.error(f'size = [{length:g}, {width:g}], expected twice the diameter of the round body "{kind}"')
    body = Body(kind, length, width, table.interval("z", (0.0, height)))
    appears_at = table.number("appears_at", appears_at, least=0.0)
    of_others = _WALK_KEYS if _is_scripted(table) else _COURSE_KEYS
    others = [key for key in of_others if key in table and key not in ("speed", "loops")]
    if others:
        known = "waypoints or way" if _is_scripted(table) else "goals"
        raise table.error(f"{others[0]} has no use beside {known}: leave it out")
    course = _course(table, appears_at) if _is_scripted(table) else _walk(table)
    return Actor(table.text("name", name), course, body, appears_at)


def _is_scripted(table: FileTable) -> bool:
    ways = [key for key in ("waypoints", "way", "goals") if key in table]
    if len(ways) != 1:
        raise table.error(f"{' and '.join(ways) or 'no course'}, expected one of waypoints, way and goals")
    return ways != ["goals"]


def _walk(table: FileTable) -> Walk:
    x, y = table.numbers("start", "[x, y]")
    speed = _positive(table, "speed", _SPEED)
    most = _positive(table, "max_speed", 1.5 * speed)
    if most < speed:
        raise table.error(f"max_speed = {most:g}, expected at least speed = {speed:g}")
    goals = tuple((a, b) for a, b in _rows(table, "goals", "[x, y]"))
    flows, loops, entry = table.flag("flows"), table.flag("loops"), None
    if flows and loops:
        raise table.error("flows and loops, expected one of them: it leaves after its last goal, or goes on")
    if "entry" in table:
        if not flows:
            raise table.error("entry has no use without flows = true: leave it out")
        a, b = table.numbers("entry", "[x, y]")
        entry = (a, b)
    return Walk((x, y), goals, speed, most, flows, table.flag("sees_robots", default=True), loops, entry)


def _course(table: FileTable, appears_at: float) -> Course:
    loops = table.flag("loops")
    if "way" in table:
        places = [(x, y) for x, y in _rows(table, "way", "[x, y]")]
        points = way_points(places, _speeds(table, len(places), loops), _waits(table, len(places)), loops)
    else:
        if beside := [key for key in ("speed", "waits") if key in table]:
            raise table.error(f"{beside[0]} has no use beside waypoints, which have times: leave it out, or give a way")
        points = waypoints_of(table)
    if loops and not points[-1][0] > 0.0:
        raise table.error("loops = true, expected a course that ends after 0 s beside it")
    keys = table.choice("keys", ("linear", "spline"))
    heading = table.heading("heading_deg") if "heading_deg" in table else None
    phase = table.number("phase", 0.0) - appears_at
    return Course(points, "spline" if keys == "spline" else "linear", loops, table.flag("leaves"), phase, heading)


def way_points(
    places: Sequence[tuple[float, float]], speeds: Sequence[float], waits: Sequence[float], loops: bool = False
) -> tuple[Point, ...]:
    """Points over time, s, x, y, m, of a way at speeds, m/s, one a piece, with waits, s, one a place."""
    places = [*places, places[0]] if loops else list(places)
    time, points = 0.0, [(0.0, *places[0])]
    for k, ((x0, y0), (x1, y1)) in enumerate(pairwise(places)):
        if waits[k] > 0.0:
            time += waits[k]
            points.append((time, x0, y0))
        length = math.hypot(x1 - x0, y1 - y0)
        if length > 0.0:
            time += length / speeds[k]
            points.append((time, x1, y1))
    if not loops and waits[-1] > 0.0:
        points.append((time + waits[-1], *places[-1]))
    return tuple(points)


def waypoints_of(table: FileTable) -> tuple[Point, ...]:
    """The key `waypoints` of a table: time, s, from 0 and rising, and x, y, m."""
    found: list[Point] = []
    for number, (time, x, y) in enumerate(_rows(table, "waypoints", "[time, x, y]"), start=1):
        if time < 0.0 or (found and time <= found[-1][0]):
            raise table.error(f"waypoint {number} at {time:g} s, expected times from 0 that rise")
        found.append((time, x, y))
    return tuple(found)


def _rows(table: FileTable, key: str, meaning: str) -> list[tuple[float, ...]]:
    rows = table.value(key)
    if not isinstance(rows, list) or not rows:
        raise table.error(f"{key}: expected [{meaning}, ...]")
    called = key.removesuffix("s") if key.endswith("s") else f"place of the {key}"
    places = [f"{table.place}, {called} {number}" for number in range(1, len(rows) + 1)]
    return [
        FileTable(table.path, place, {"point": row}, ("point",)).numbers("point", meaning)
        for place, row in zip(places, rows, strict=True)
    ]


def _speeds(table: FileTable, places: int, loops: bool) -> list[float]:
    pieces = places if loops else places - 1
    if "speed" in table and isinstance(table.value("speed"), list):
        speeds = _numbers(table, "speed", pieces, "one speed for each piece of the way")
        if speeds and not min(speeds) > 0.0:
            raise table.error(f"speed = {speeds}, expected speeds > 0, m/s")
        return speeds
    return [_positive(table, "speed", _SPEED)] * pieces


def _waits(table: FileTable, places: int) -> list[float]:
    waits = (
        _numbers(table, "waits", places, "one time for each place of the way") if "waits" in table else [0.0] * places
    )
    if not min(waits) >= 0.0:
        raise table.error(f"waits = {waits}, expected times >= 0, s")
    return waits


def _numbers(table: FileTable, key: str, count: int, meaning: str) -> list[float]:
    value: Any = table.value(key)
    if not isinstance(value, list) or len(value) != count:
        given = f"{len(value)} of them" if isinstance(value, list) else "no list"
        raise table.error(f"{key}: {given}, expected {meaning}: {count}")
    rows = [FileTable(table.path, table.place, {key: one}, (key,)) for one in value]
    return [row.number(key) for row in rows]


def _positive(table: FileTable, key: str, default: float) -> float:
    value = table.number(key, default)
    if not value > 0.0:
        raise table.error(f"{key} = {value:g}, expected a speed > 0, m/s")
    return value
