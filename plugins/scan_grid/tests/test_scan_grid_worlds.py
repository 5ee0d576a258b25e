"""Maps of known worlds compared with the truth: share of wrong cells, holes in walls, scans taken while turning."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from navloom import Box, World
from navloom.worlds.trial_worlds import clutter_world, corridor, doorway
from navloom_scan_grid.mapping import MapSettings, ScanMap
from scan_grid_scenes import PERIOD_NS, cast, centres, depth, holes, laser, mapped, ring, way, wrong

WORLDS = {"doorway": doorway(), "corridor": corridor(), "clutter": clutter_world("3", Path())}
CORNERS = {
    "doorway": ((0.0, 0.0), (2.0, 2.2), (2.0, 4.0), (0.0, 6.0)),
    "corridor": ((0.0, 0.0), (0.0, 8.0)),
    "clutter": ((0.0, -0.5), (0.0, 14.5)),
}


@pytest.mark.parametrize("name", WORLDS)
def test_a_laser_maps_a_world_with_hardly_a_wrong_cell(name: str) -> None:
    world, poses = WORLDS[name], way(*CORNERS[name], step=0.1)
    scan_map = mapped(world, poses)
    in_free, beside = wrong(scan_map, world)
    assert in_free < 0.001
    assert beside < 0.001
    assert holes(scan_map, world, poses[::10]) < 0.03


def test_walls_survive_being_grazed() -> None:
    """Beams pass the cells of a wall at a few degrees before they meet it: without the margin they wear it away."""
    world, poses = WORLDS["doorway"], way(*CORNERS["doorway"], step=0.1)
    worn = mapped(world, poses, weights=MapSettings().weights._replace(clear_margin=0.0))
    assert (worn.cells() == 100).sum() < 0.9 * (mapped(world, poses).cells() == 100).sum()


@pytest.mark.parametrize("name", ["doorway", "corridor"])
def test_a_ring_of_sonars_maps_free_space_that_is_free(name: str) -> None:
    """Its arcs mark free space as occupied, as a cone of 30° cannot do better; cells that it marks free are free."""
    world = WORLDS[name]
    in_free, beside = wrong(mapped(world, way(*CORNERS[name]), sensor=ring), world)
    assert in_free < 0.001
    assert 0.2 < beside < 0.85


def test_arcs_that_ignore_passed_cells_would_be_larger() -> None:
    """Without memory, with one scan for each map, the cells are those of the cone model alone."""
    world, poses = WORLDS["clutter"], way(*CORNERS["clutter"], step=0.1)
    together = mapped(world, poses, sensor=ring)
    arcs = np.zeros(together.grid.odds.shape, bool)
    b = together.grid.bounds
    for pose in poses:
        alone = mapped(world, pose[None], sensor=ring, occupied_from=0.2)
        cells = alone.cells() == 100
        row, column = alone.grid.bounds.row - b.row, alone.grid.bounds.column - b.column
        arcs[row : row + cells.shape[0], column : column + cells.shape[1]] |= cells
    assert (together.cells() == 100).sum() < 0.7 * arcs.sum()


def hall(length: float, width: float) -> World:
    """A hall without doors from (-1, 0) on, m, in the middle of which the robot begins."""
    x, y = length - 1.0, 0.5 * width
    return World("hall", (
        Box("left", (-1.2, x + 0.2), (y, y + 0.2)), Box("right", (-1.2, x + 0.2), (-y - 0.2, -y)),
        Box("rear", (-1.2, -1.0), (-y, y)), Box("front", (x, x + 0.2), (-y, y)),
    ))  # fmt: skip


HALLS = {
    "corridor": (hall(10.0, 2.0), way((0.0, 0.0), (8.0, 0.0), (8.0, 0.2))),
    "room": (hall(6.0, 6.0), way((0.0, -2.0), (4.0, -2.0), (4.0, 1.0), (2.0, 2.0), (0.0, 1.5), (0.0, -1.5))),
}
HALL = {"corridor": (-1.0, 9.0, 1.0), "room": (-1.0, 5.0, 3.0)}
"""Lowest and highest x and half the width, m."""


@pytest.mark.parametrize("name", HALLS)
@pytest.mark.parametrize("critical_deg", [90.0, 50.0, 25.0], ids=["rough", "plain", "smooth"])
def test_places_with_an_echo_of_a_sonar_do_not_end_up_free(name: str, critical_deg: float) -> None:
    """Of echoes below 2.5 m. On rough walls, the axes of oblique cones end in space that other cones see through."""
    (world, poses), stamps = HALLS[name], PERIOD_NS * np.arange(len(HALLS[name][1]))
    scan_map, rng, places = ScanMap(MapSettings()), np.random.default_rng(5), []
    for stamp, pose in zip(stamps.tolist(), poses, strict=True):
        seen = ring(world, pose, stamp, rng, critical_deg=critical_deg)
        scan_map.insert(seen, stamps, poses)
        near, (c, s) = seen.ranges < 2.5, (math.cos(pose[2]), math.sin(pose[2]))
        axes = seen.bearings[near] + pose[2]
        ends = seen.ranges[near, None] * np.column_stack([np.cos(axes), np.sin(axes)])
        places.append(pose[:2] + seen.origins[near] @ np.array([[c, s], [-s, c]]) + ends)
    ends = np.concatenate(places)
    column, row = np.floor((ends - scan_map.grid.origin) / scan_map.grid.cell).astype(int).T
    cells, is_at_wall = scan_map.cells(), np.abs(depth(world, ends)) < 0.15
    is_free = cells[row, column] == 0
    assert is_at_wall.sum() > 500 and is_free[is_at_wall].mean() < 0.01
    assert is_free.mean() < 0.15
    middle, (low, high, side) = centres(scan_map)[cells == 0], HALL[name]
    is_right = (middle[:, 0] > low) & (middle[:, 0] < high) & (np.abs(middle[:, 1]) < side)
    assert is_right.mean() > 0.99


def turning_scan(rate: float, deskewed: bool) -> ScanMap:
    """A room of 6 m by 6 m, seen in one scan of 0.1 s from its middle by a robot that turns."""
    walls = (
        Box("right", (3.0, 3.2), (-3.2, 3.2)),
        Box("left", (-3.2, -3.0), (-3.2, 3.2)),
        Box("front", (-3.2, 3.2), (3.0, 3.2)),
        Box("rear", (-3.2, 3.2), (-3.2, -3.0)),
    )
    world, beams = World("room", walls), 360
    bearings, offsets = np.radians(np.arange(-180.0, 180.0)), np.linspace(0.0, 0.1, beams)
    ranges = cast(world, np.zeros((beams, 2)), bearings + rate * offsets)
    scan = laser(world, np.zeros(3), 0, np.random.default_rng(0), beams=beams)
    scan = dataclasses.replace(
        scan, origins=np.zeros((beams, 2)), bearings=bearings, ranges=ranges, time_offsets=offsets * deskewed
    )
    stamps = np.array([0, 100_000_000])
    scan_map = ScanMap(MapSettings())
    scan_map.insert(scan, stamps, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1 * rate]]))
    in_free, beside = wrong(scan_map, world, slack=0.0)
    scan_map.counts["wrong"] = round(1e4 * (in_free + beside))
    return scan_map


def test_each_beam_is_placed_where_the_robot_was_when_it_was_taken() -> None:
    """At 120°/s a scan of 0.1 s is smeared over 12°: 0.6 m at 3 m."""
    rate = math.radians(120.0)
    assert turning_scan(rate, deskewed=True).counts["wrong"] == 0
    assert turning_scan(rate, deskewed=False).counts["wrong"] > 1000
