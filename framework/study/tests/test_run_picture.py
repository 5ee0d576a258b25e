"""The picture of a run: its legend names what is drawn, and its texts do not overlap."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from navloom.geometry.world import Box, World
from navloom.messages import MapUpdate, OccupancyGrid, Pose2D
from navloom.runs.episode import Episode, run_episode
from navloom_study.report.plan_view import add_legend, draw_cells, draw_lines, draw_outlines, plan_figure, write_beside
from navloom_study.report.plotting import png_of
from navloom_study.report.run_picture import (
    BLACK,
    BLUE,
    DRIVERS,
    FREE,
    UNKNOWN,
    VERMILION,
    draw_map_update,
    draw_poses,
    draw_run,
)
from toys import discovery, toy_config

WALL, GIRDER = Box("wall", (-1.0, 5.0), (1.4, 1.5)), Box("girder", (1.0, 1.2), (-1.5, 1.4), (1.5, 1.7))
FAR_GIRDER = Box("far girder", (50.0, 51.0), (0.0, 1.0), (1.5, 1.7))
SQUARE = (0.0, 0.0, 4.0, 4.0)


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    """A run of the toys, 3 m straight ahead."""
    return run_episode(toy_config(tmp_path_factory.mktemp("toy")), discovery=discovery())


def pixels_of(figure: Figure) -> np.ndarray[Any, Any]:
    """(rows, columns, 3) colours of the figure's pixels, 0 to 1, from the top."""
    figure.set_dpi(200)  # as the file has them
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3] / 255.0


def is_near(pixels: np.ndarray[Any, Any], colour: str) -> np.ndarray[Any, Any]:
    return np.asarray(np.abs(pixels - to_rgb(colour)).max(axis=-1) < 0.15)


def pixel_at(figure: Figure, x: float, y: float) -> np.ndarray[Any, Any]:
    """Colour at a point of the map frame, m."""
    pixels = pixels_of(figure)
    u, v = figure.axes[0].transData.transform((x, y))
    return np.asarray(pixels[len(pixels) - 1 - int(v), int(u)])


def texts_of(figure: Figure) -> list[tuple[str, Bbox]]:
    """Each text that is drawn, with its place, pixels."""
    pixels_of(figure)  # places them
    (axes,) = figure.axes
    texts = [*axes.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        texts += [
            axis.label,
            axis.get_offset_text(),
            *(tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high),
        ]
    return [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text()]


def names_in(figure: Figure) -> set[str]:
    return {name for name, _ in texts_of(figure)}


def overlapping(texts: list[tuple[str, Bbox]]) -> list[tuple[str, str]]:
    return [(a, b) for (a, here), (b, there) in combinations(texts, 2) if here.overlaps(there)]


def beyond(texts: list[tuple[str, Bbox]], room: Bbox) -> list[str]:
    """Texts that are not wholly within the room."""
    return [name for name, box in texts if not (room.contains(*box.min) and room.contains(*box.max))]


def changed(episode: Episode, *obstacles: Box, segments: int = 0, goal: tuple[float, float] | None = None) -> Episode:
    """The episode with another world, map and goal."""
    grid = OccupancyGrid(np.full((4, 4), 100, np.int8), 0.2, Pose2D(1.0, 0.6, 0.0))
    lines = np.tile([1.0, 1.3, 1.8, 1.3], (segments, 1))
    recorder = replace(episode.recorder, map=MapUpdate(0, grid, lines, ()))
    system = replace(episode.system, world=World("gate", obstacles, bounds=(-1.0, -1.6, 5.0, 1.6)))
    if goal is not None:
        assert system.goal is not None
        system.goal = system.goal.model_copy(update={"x": goal[0], "y": goal[1]})
    return replace(episode, recorder=recorder, system=system)


def test_the_legend_names_cells_outlines_and_obstacles_above_the_robot(toy: Episode) -> None:
    legend = {"outlines in the map", "occupied cells of the map", "true obstacles", "above the robot", "plan",
              "trajectory", "driven by the controller", "robot every 2 s", "unknown"}  # fmt: skip
    assert legend <= names_in(draw_run(changed(toy, WALL, GIRDER, segments=1)))


def test_the_legend_names_only_drawn_objects(toy: Episode) -> None:
    names = names_in(draw_run(changed(toy, WALL, FAR_GIRDER)))
    assert "occupied cells of the map" in names
    assert names.isdisjoint({"outlines in the map", "above the robot"})


def test_glass_and_what_is_not_on_the_map_have_colours_of_their_own(toy: Episode) -> None:
    panes = (replace(WALL, name="pane", material="glass"), replace(WALL, name="new", y=(1.0, 1.2), is_mapped=False))
    collections = draw_run(changed(toy, *panes)).axes[0].collections
    faces = {drawn.get_label(): tuple(drawn.get_facecolor()[0]) for drawn in collections if len(drawn.get_facecolor())}
    assert {"glass", "not on the map"} <= faces.keys()
    assert faces["glass"] != faces["not on the map"]


def test_a_displacement_is_drawn_apart_from_the_track(toy: Episode) -> None:
    episode = changed(toy)
    episode.trail = replace(toy.trail, carried=np.arange(len(toy.trail.time)) == 20)
    lines = {drawn.get_label(): drawn for drawn in draw_run(episode).axes[0].collections}
    (jump,) = lines["displaced"].get_segments()
    np.testing.assert_array_equal(jump, toy.recorder.driven[19:21])
    assert len(lines["driven by the controller"].get_segments()[0]) <= 20


def test_what_is_above_the_robot_is_dashed(toy: Episode) -> None:
    figure = draw_run(changed(toy, WALL, GIRDER))
    dashes = {drawn.get_label(): drawn.get_linestyle()[0][1] for drawn in figure.axes[0].collections}
    assert dashes["true obstacles"] is None and dashes["above the robot"] is not None


def test_no_text_of_a_run_hides_another_and_none_is_cut_off(toy: Episode) -> None:
    figure = draw_run(changed(toy, WALL, GIRDER, segments=1, goal=(0.1, 0.0)))
    texts = texts_of(figure)
    assert {"start", "goal", "x, m", "y, m"} <= {name for name, _ in texts}
    assert overlapping(texts) == []
    assert beyond(texts, figure.bbox) == []


@pytest.mark.parametrize(("x", "y"), [(0.0, 2.0), (3.99, 2.0), (2.0, 0.0), (2.0, 4.0)])
def test_a_text_is_inside_the_frame(x: float, y: float) -> None:
    _, axes = plan_figure(100.0, SQUARE)
    write_beside(axes, [(x, y, "a place", 0.1)])
    assert beyond([(note.get_text(), note.get_window_extent()) for note in axes.texts], axes.get_window_extent()) == []


def test_a_text_is_beside_a_line_where_there_is_room() -> None:
    _, axes = plan_figure(100.0, SQUARE)
    draw_lines(axes, [np.array([[2.0, 2.0], [4.0, 2.0]])], "black", "a line", 3.0)
    write_beside(axes, [(2.0, 2.0, "a place", 0.0)])
    assert axes.texts[0].get_window_extent().x1 < axes.transData.transform((2.0, 2.0))[0]


def test_a_text_on_grey_has_a_white_rim() -> None:
    figure, axes = plan_figure(100.0, SQUARE)
    draw_outlines(axes, [np.array([(0, 0), (4, 0), (4, 4), (0, 4)], float)], "#808080", facecolors="#808080")
    write_beside(axes, [(2.0, 2.0, "I", 0.0)])
    pixels = pixels_of(figure)
    box = axes.texts[0].get_window_extent().padded(10.0)
    middle = pixels[len(pixels) - int(0.5 * (box.y0 + box.y1)), int(box.x0) : int(box.x1)].mean(axis=1)
    kinds = np.digitize(middle, [0.3, 0.8])  # letter, ground, rim
    assert kinds[np.concatenate([[True], np.diff(kinds) != 0])].tolist() in ([1, 2, 0, 2, 1], [1, 2, 1, 0, 1, 2, 1])


def test_a_long_legend_has_rows_inside_a_narrow_picture() -> None:
    figure, axes = plan_figure(60.0, (0.0, 0.0, 1.0, 5.0))
    for number in range(5):
        draw_lines(axes, [np.zeros((2, 2))], "black", f"what number {number} means")
    _, before = figure.get_size_inches()
    add_legend(figure, axes)
    texts = texts_of(figure)
    assert len([name for name, _ in texts if name.startswith("what")]) == 5
    assert overlapping(texts) == [] and beyond(texts, figure.bbox) == []
    assert figure.get_size_inches()[1] > before  # the axes are as large as without it


@pytest.mark.parametrize("corner", [-5_000.0, -123_456.0, 5_400_000.0])
@pytest.mark.parametrize("cells", [4, 4000])
def test_no_label_of_a_map_far_from_its_origin_is_cut_off(corner: float, cells: int) -> None:
    grid = OccupancyGrid(np.zeros((cells, cells), np.int8), 0.1, Pose2D(corner, corner, 0.0))
    figure = draw_map_update(MapUpdate(0, grid, np.zeros((0, 4)), ()))
    texts = texts_of(figure)
    assert overlapping(texts) == [] and beyond(texts, figure.bbox) == []


def test_a_map_of_cells_alone_has_them_black() -> None:
    grid = OccupancyGrid(np.full((4, 4), 100, np.int8), 0.5, Pose2D(-1.0, -1.0, 0.0))
    figure = draw_map_update(MapUpdate(0, grid, np.zeros((0, 4)), ()))
    names = names_in(figure)
    assert {"occupied cells of the map", "sensor"} <= names and "outlines in the map" not in names
    assert is_near(pixel_at(figure, 0.6, 0.6), BLACK)


def test_the_poses_of_a_localizer_are_drawn_on_the_edges_of_its_map() -> None:
    cells = np.full((40, 40), 100, np.int8)
    cells[10:30, 10:30] = 0  # a room of 4 m from (1, 1) to (5, 5), and solid space round it
    poses = np.zeros((9, 7))
    poses[:, 1], poses[:, 2] = np.linspace(2.0, 20.0, 9), 3.0  # odometry leaves the map
    poses[:, 4], poses[:, 5] = 2.0, np.linspace(2.0, 4.0, 9)
    is_tracking = np.ones(9, dtype=np.bool_)
    figure = draw_poses(poses, OccupancyGrid(cells, 0.2, Pose2D(-1.0, -1.0, 0.0)), is_tracking)
    assert {"odometry", "localizer", "edges of the map's occupied space"} <= names_in(figure)
    shown = {(x, y): pixel_at(figure, x, y) for x, y in ((0.9, 3.0), (0.5, 3.0), (3.0, 2.0), (3.5, 3.0), (2.0, 3.5))}
    is_black = [is_near(colour, BLACK) for colour in shown.values()]
    assert is_black == [True, False, False, False, False]  # the edge of one cell alone
    assert is_near(shown[3.5, 3.0], BLUE) and is_near(shown[2.0, 3.5], VERMILION)
    names = names_in(draw_poses(poses, None, is_tracking))
    assert {"odometry", "localizer"} <= names and "edges of the map's occupied space" not in names
    assert "localizer while not tracking" not in names
    is_tracking[5:] = False
    assert "localizer while not tracking" in names_in(draw_poses(poses, None, is_tracking))


def test_the_track_shows_who_drove_and_when(toy: Episode) -> None:
    recorder = replace(toy.recorder, drivers=[(0.0, "controller"), (2.0, "avoider"), (4.0, "controller")])
    end = recorder.truth[-1][0]
    figure = draw_run(replace(changed(toy, WALL), recorder=recorder))
    names = names_in(figure)
    assert {"driven by the controller", "by the avoider"} <= names and "by the recovery" not in names
    row = {round(row[0], 3): row for row in recorder.truth}
    for time, driver in ((1.5, "controller"), (3.0, "avoider"), (4.5, "controller")):
        assert is_near(pixel_at(figure, *row[time][1:3]), DRIVERS[driver][1]), time
    times = [float(name.removesuffix(" s")) for name in names if name.endswith(" s") and name[0].isdigit()]
    assert max(times) == pytest.approx(end, abs=0.5) and 3 <= len(times) <= 10


def test_a_run_without_ground_truth_has_a_picture_of_the_rest(toy: Episode) -> None:
    recorder = replace(toy.recorder, truth=[])
    names = names_in(draw_run(replace(changed(toy, WALL), recorder=recorder)))
    assert {"start", "goal", "plan", "trajectory"} <= names
    assert names.isdisjoint({"driven by the controller", "robot every 2 s"})


def test_poses_of_one_tick_without_a_map_are_no_error() -> None:
    assert names_in(draw_poses(np.zeros((1, 7)), None, np.ones(1, dtype=np.bool_))) >= {"x, m", "y, m"}


def test_free_unknown_and_occupied_cells_differ() -> None:
    cells = np.full((10, 10), -1, np.int8)
    cells[:, :5], cells[:, 0] = 0, 100
    figure = draw_map_update(MapUpdate(0, OccupancyGrid(cells, 1.0, Pose2D(0.0, 0.0, 0.0)), np.zeros((0, 4)), ()))
    shown = [pixel_at(figure, x, 5.0).tolist() for x in (0.5, 2.5, 7.5)]
    assert shown == [pytest.approx(to_rgb(colour), abs=0.01) for colour in (BLACK, FREE, UNKNOWN)]


def test_a_turned_map_is_painted_where_its_cells_are() -> None:
    cells = np.zeros((4, 8), np.uint8)
    cells[1, 6] = 1  # its middle is (6.5, 1.5) in the map's frame: (-1.5, 6.5) after a quarter turn
    figure, axes = plan_figure(100.0, (-5.0, 0.0, 5.0, 10.0))
    draw_cells(axes, cells, Pose2D(0.0, 0.0, np.pi / 2), 1.0, ("white", BLACK))
    assert is_near(pixel_at(figure, -1.5, 6.5), BLACK) and is_near(pixel_at(figure, -1.5, 7.6), "white")


@pytest.mark.parametrize("heading", [0.0, 0.3])
def test_a_wall_of_one_cell_has_no_gaps_on_a_map_with_more_cells_than_pixels(heading: float) -> None:
    cells = np.zeros((4000, 4000), np.uint8)
    cells[:, 2001] = 1
    figure, axes = plan_figure(100.0, (0.0, 0.0, 200.0, 200.0))
    draw_cells(axes, cells, Pose2D(0.0, 0.0, heading), 0.05, ("white", BLACK))
    pixels = pixels_of(figure)
    (left, low), (right, high) = axes.transData.transform([(1.0, 40.0), (199.0, 180.0)]).astype(int)
    inside = pixels[len(pixels) - high : len(pixels) - low, left:right]
    assert is_near(inside, BLACK).any(axis=1).all()


def test_matplotlib_is_imported_only_to_draw() -> None:
    used = "navloom_study.picture_observer, navloom_study.commands, navloom_study.compare"
    code = f"import sys; import {used}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "navloom_study.compare" in loaded and "matplotlib" not in loaded


def test_a_picture_has_reproducible_bytes(toy: Episode) -> None:
    assert png_of(draw_run(changed(toy, WALL, GIRDER))) == png_of(draw_run(changed(toy, WALL, GIRDER)))
