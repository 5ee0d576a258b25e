"""The plugin that publishes the given map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from navloom import Context, MapperInput, OccupancyGrid, Pose2D, PoseTrack, Registry, RobotSpec
from navloom_known_map import navloom_register
from navloom_known_map.adapter import KnownMap

GRID = OccupancyGrid(np.array([[0, 100, -1]], dtype=np.int8), 0.05, Pose2D(1.0, 2.0, 0.5))
BOX = np.array([(0.4, 0.4), (-0.4, 0.4), (-0.4, -0.4), (0.4, -0.4)])
CONTEXT = Context(
    "main",
    0.05,
    RobotSpec(BOX, 1.2, 0.05, 0.3, 0.5, 0.4, 0.5, 1.0),
    np.random.default_rng,
    Pose2D(0.0, 0.0, 0.0),
    map=GRID,
)


def tick(number: int, clear: bool = False) -> MapperInput:
    track = PoseTrack(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    return MapperInput(50_000_000 * number, (), (), track, clear)


def test_it_registers_as_known_map() -> None:
    registry = Registry()
    navloom_register(registry)
    assert registry.roles == {("mapper", "known_map"): KnownMap}
    assert KnownMap.needs_map and KnownMap.accepts == ()


def test_the_map_is_published_once() -> None:
    mapper = KnownMap(KnownMap.Params(), CONTEXT)
    first = mapper.update(tick(3))
    assert first.grid is GRID
    assert (first.stamp_ns, first.segments.shape, first.counts) == (150_000_000, (0, 4), ())
    assert [mapper.update(tick(number)) for number in (4, 5)] == [None, None]


def test_it_is_published_again_after_a_clear_request_and_after_a_reset() -> None:
    mapper = KnownMap(KnownMap.Params(), CONTEXT)
    mapper.update(tick(0))
    assert mapper.update(tick(1, clear=True)).stamp_ns == 50_000_000
    assert mapper.update(tick(2)) is None
    mapper.reset()
    assert mapper.update(tick(3)).grid is GRID
    assert mapper.update(tick(4)) is None


def test_without_a_map_it_is_refused() -> None:
    with pytest.raises(ValueError, match="known_map: got no map, expected one"):
        KnownMap(KnownMap.Params(), replace(CONTEXT, map=None))
