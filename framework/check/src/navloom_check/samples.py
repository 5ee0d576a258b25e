"""Messages that a plugin is given: those of a drive, unusual scans, and those of any class by its declaration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np
from navloom.messages import Message, OccupancyGrid, RangeScan
from navloom.messages.kinds import Array, Kind
from numpy.typing import NDArray

from navloom_check import messages, scenes
from navloom_check.drive_streams import Moment, framework_message

__all__ = ["PERIOD", "again", "message_in_drive", "odd_scans", "sample", "walk"]

M = TypeVar("M", bound=Message)

PERIOD = 0.05
"""Control tick of every scene, s."""


def sample(cls: type[M], rng: np.random.Generator, stamp_ns: int = 0) -> M:
    """A message whose fields hold ordinary values within their declared bounds.

    Args:
        cls: Class of the message.
        rng: Source of the values.
        stamp_ns: Value of its fields of the kind `Stamp`, ns.
    """
    sizes: dict[str, int] = {}
    return cls(*(_value(kind, rng, stamp_ns, sizes) for kind in cls.kinds.values()))


def _value(kind: Kind, rng: np.random.Generator, stamp_ns: int, sizes: dict[str, int]) -> Any:
    if kind.optional and rng.random() < 0.25:
        return None
    if kind.choices:
        return kind.choices[int(rng.integers(len(kind.choices)))]
    if kind.form == "float":
        return _number(kind.rule, rng)
    if kind.form == "int":
        return stamp_ns if kind.rule == "stamp" else int(rng.integers(0, 100))
    if kind.form == "bool":
        return bool(rng.integers(2))
    if kind.form == "str":
        return "sample"[: kind.most or None]
    if kind.form == "message":
        assert kind.message is not None
        return sample(kind.message, rng, stamp_ns)
    if kind.form == "tuple":
        assert kind.item is not None
        return tuple(_value(kind.item, rng, stamp_ns, {}) for _ in range(min(kind.most, int(rng.integers(0, 4)))))
    assert kind.array is not None
    return _array(kind.array, rng, sizes)


def _number(rule: str, rng: np.random.Generator) -> float:
    if rule == "heading":
        return float(rng.uniform(-3.0, 3.0))
    return float(rng.uniform(0.1, 2.0)) if rule in ("positive", "not_negative") else float(rng.normal())


def _array(spec: Array, rng: np.random.Generator, sizes: dict[str, int]) -> Any:
    shape = [size if isinstance(size, int) else sizes.setdefault(size, int(rng.integers(2, 6))) for size in spec.shape]
    dtype = np.dtype(spec.dtype)
    low = 0.0 if spec.at_least is None else spec.at_least
    high = low + 2.0 if spec.at_most is None else spec.at_most
    if dtype.kind == "b":
        return rng.integers(2, size=shape).astype(dtype)
    values = rng.uniform(low, high, shape)
    return (np.round(values) if dtype.kind in "iu" else values).astype(dtype)


def message_in_drive(
    cls: type[M], rng: np.random.Generator, stamp_ns: int, at: messages.Place, samples: NDArray[np.float64]
) -> M:
    """A message of the framework as in a drive through a room along a trajectory, (n, 6); else a sample."""
    x, y, heading = (*at, 0.0)[:3]
    now = Moment(stamp_ns, (x, y, heading), (0.2, 0.0), samples, _room_map)
    return framework_message(cls, now) or sample(cls, rng, stamp_ns)


@cache
def _room_map() -> OccupancyGrid:
    return scenes.grid(scenes.room(), 0.1)


def odd_scans() -> Iterator[tuple[str, str, tuple[RangeScan, ...]]]:
    """Name, topic and scans of unusual readings, which real sensors give now and then."""
    yield "no scan in this tick", "empty", ()
    yield "a scan without beams", "empty", (messages.scan(np.empty(0)),)
    yield "no beam has an echo", "infinite", (messages.scan(math.inf),)
    yield "one beam without echo", "single_beam", (messages.scan(math.inf, beams=1),)
    yield "one beam that reads 1 m", "single_beam", (messages.scan(1.0, beams=1),)
    yield "one sonar that reads 1 m", "single_beam", (messages.scan(1.0, beams=1, half_angle=0.26, range_max=4.0),)
    yield "every beam reads range_min", "nearest", (messages.scan(0.05),)
    yield "every beam reads 0 m", "nearest", (messages.scan(0.0, range_min=0.0),)


def again(scans: Sequence[RangeScan], stamp: float) -> tuple[RangeScan, ...]:
    """The same scans with a new stamp."""
    return tuple(
        RangeScan(messages.ns(stamp), scan.origins, scan.bearings, scan.half_angles, scan.time_offsets, scan.ranges,
                  scan.range_min, scan.range_max)
        for scan in scans
    )  # fmt: skip


def walk(start: messages.Place, speed: float, turn_rate: float, steps: int = 40) -> list[tuple[float, float, float]]:
    """Poses of a robot that drives with a constant velocity (m/s, rad/s), one a tick."""
    x, y, heading = (*start, 0.0)[:3]
    poses = []
    for _ in range(steps):
        poses.append((x, y, math.remainder(heading, math.tau)))
        middle = heading + 0.5 * turn_rate * PERIOD
        x, y = x + speed * PERIOD * math.cos(middle), y + speed * PERIOD * math.sin(middle)
        heading += turn_rate * PERIOD
    return poses
