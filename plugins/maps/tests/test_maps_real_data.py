"""Worlds of real maps; needs the folder that NAVLOOM_DATA names."""

import os
from pathlib import Path

import numpy as np
import pytest
from navloom.files import write_each
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import rectangle
from navloom.geometry.world import Place
from navloom.runs.map_files import rosmap_files
from navloom_maps import SCHEMES
from navloom_maps.movingai import scenario_place
from navloom_maps.rosmap import read_rosmap
from navloom_optimal.shortest_path import optimal_length

DATA = Path(os.environ.get("NAVLOOM_DATA", ""))
pytestmark = pytest.mark.skipif("NAVLOOM_DATA" not in os.environ, reason="NAVLOOM_DATA names no folder of real data")


@pytest.mark.parametrize("name", ["turtlebot3_world", "aws_small_house", "nav2_depot", "willow_full_0.1"])
def test_a_map_has_the_pixels_of_its_image_and_comes_back_from_saving(name: str, tmp_path: Path) -> None:
    grid = read_rosmap(DATA / "rosmaps" / f"{name}.yaml")
    pixels = np.frombuffer((DATA / "rosmaps" / f"{name}.pgm").read_bytes()[-grid.cells.size :], dtype=np.uint8)
    # 1 - 89 / 255 = 0.651, 1 - 90 / 255 = 0.647; all four have occupied_thresh 0.65.
    assert np.array_equal(grid.cells == 100, pixels.reshape(grid.cells.shape)[::-1] <= 89)
    assert (grid.cells == 100).any()
    write_each(tmp_path, rosmap_files(grid, "m"))
    back = read_rosmap(tmp_path / "m.yaml")
    assert np.array_equal(back.cells, grid.cells)
    assert (back.origin, back.resolution) == (grid.origin, grid.resolution)


def test_a_way_through_the_office() -> None:
    world = SCHEMES["rosmap"]("willow_full_0.1.yaml", DATA / "rosmaps")
    start, goal = Place(46.85, 42.05), Place(14.25, 31.95)
    assert clearance(rectangle(0.6, 0.6), start, world, height=1.2)[0] > 0.0
    length = optimal_length(world, start, goal, 0.3, 1.2)
    assert length is not None
    # The straight line is 34.13 m.
    assert 34.13 < length < 37.5


@pytest.mark.parametrize("name", ["dao__arena2", "rooms__32room_000", "cities__Berlin_0_512"])
def test_the_way_of_a_small_disc_is_at_most_as_long_as_the_octile_optimum(name: str) -> None:
    """An octile path without corner cutting keeps 0.5 m off obstacles; an any-angle path is at best cos 22.5° of it."""
    world = SCHEMES["movingai"](f"{name}.map.gz", DATA / "movingai")
    assert world.raster is not None
    rows = len(world.raster.occupied)
    for line in (DATA / "movingai" / f"{name}.map.scen").read_text().splitlines()[1::24]:
        x0, y0, x1, y1 = (int(word) for word in line.split()[4:8])
        octile = float(line.split()[8])
        length = optimal_length(world, scenario_place(x0, y0, rows), scenario_place(x1, y1, rows), 0.3, 1.2)
        assert length is not None
        # The files give six digits, some rounded down.
        assert 0.9 * octile < length < octile + 0.01


def test_barn_is_shorter_at_any_angle_than_by_grid() -> None:
    numbers = np.load(DATA / "barn" / "barn_dev.npz")
    for k in (0, 25, 49):
        world = SCHEMES["barn"](f"barn_dev.npz#{numbers['world'][k]}", DATA / "barn")
        assert world.start is not None
        assert world.goal is not None
        for radius, by_grid in zip(numbers["feas_radii"][::2], numbers["astar_len_m"][k][::2], strict=True):
            length = optimal_length(world, world.start, world.goal, float(radius), 1.2)
            if np.isfinite(by_grid):
                assert length is not None
                assert 10.0 <= length <= by_grid + 1e-3
