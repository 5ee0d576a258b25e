"""The picture of a run: its legend names what is drawn, and its texts do not overlap."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from navloom.geometry.world import Box, World
from navloom.messages import MapUpdate, OccupancyGrid, Pose2D
from navloom.runs.episode import Episode, run_episode
from navloom_study.report.canvas import BLACK, BLUE, OVERSAMPLING, UNKNOWN, VERMILION, Canvas, Key
from navloom_study.report.run_picture import CELLS, DRIVERS, draw_map_update, draw_poses, draw_run
from PIL import ImageDraw
from toys import discovery, toy_config

WALL, GIRDER = Box("wall", (-1.0, 5.0), (1.4, 1.5)), Box("girder", (1.0, 1.2), (-1.5, 1.4), (1.5, 1.7))
FAR_GIRDER = Box("far girder", (50.0, 51.0), (0.0, 1.0), (1.5, 1.7))
Rectangle = tuple[float, float, float, float]


@pytest.fixture
def texts(monkeypatch: pytest.MonkeyPatch) -> dict[str, Rectangle]:
    """Place of each text in the pictures of a test, pixels."""
    places: dict[str, Rectangle] = {}
    write = ImageDraw.ImageDraw.text

    def noted(pen: ImageDraw.ImageDraw, xy, text, fill=None, font=None, anchor=None, **rest) -> None:  # type: ignore[no-untyped-def]  # Pillow's own signature
        places[text] = pen.textbbox(xy, text, font, anchor)
        write(pen, xy, text, fill, font, anchor, **rest)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", noted)
    return places


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    """A run of the toys, 3 m straight ahead."""
    return run_episode(toy_config(tmp_path_factory.mktemp("toy")), discovery=discovery())


def overlapping(places: Iterable[Rectangle]) -> list[tuple[Rectangle, Rectangle]]:
    return [
        (a, b) for a, b in combinations(places, 2) if a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
    ]  # fmt: skip


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


def test_the_legend_names_cells_outlines_and_obstacles_above_the_robot(
    toy: Episode, texts: dict[str, Rectangle]
) -> None:
    draw_run(changed(toy, WALL, GIRDER, segments=1))
    legend = {"outlines in the map", "occupied cells of the map", "true obstacles", "above the robot", "plan",
              "trajectory", "driven by the controller", "robot every 2 s", "unknown"}  # fmt: skip
    assert legend <= set(texts)


def test_the_legend_names_only_drawn_objects(toy: Episode, texts: dict[str, Rectangle]) -> None:
    draw_run(changed(toy, WALL, FAR_GIRDER))
    assert "occupied cells of the map" in texts
    assert texts.keys().isdisjoint({"outlines in the map", "above the robot"})


def test_no_text_of_a_run_hides_another_and_none_is_cut_off(toy: Episode, texts: dict[str, Rectangle]) -> None:
    image = draw_run(changed(toy, WALL, GIRDER, segments=1, goal=(0.1, 0.0)))
    assert {"start", "goal"} <= set(texts)
    assert overlapping(texts.values()) == []
    right, low = OVERSAMPLING * image.width, OVERSAMPLING * image.height
    outside = [name for name, (u0, v0, u1, v1) in texts.items() if u0 < 0 or v0 < 0 or u1 > right or v1 > low]
    assert outside == []


@pytest.mark.parametrize(("x", "y"), [(0.0, 2.0), (3.99, 2.0), (2.0, 0.0), (2.0, 4.0)])
def test_a_text_is_inside_the_frame(x: float, y: float, texts: dict[str, Rectangle]) -> None:
    canvas = Canvas((0.0, 0.0, 4.0, 4.0), ())
    canvas.text(x, y, "a place", 0.1)
    (left, top), (right, low) = canvas.pixels(np.array([(0.0, 4.0), (4.0, 0.0)]))
    box = texts["a place"]
    assert left <= box[0] < box[2] <= right
    assert top <= box[1] < box[3] <= low


def test_a_text_is_beside_a_line_where_there_is_room(texts: dict[str, Rectangle]) -> None:
    canvas = Canvas((0.0, 0.0, 4.0, 4.0), ())
    canvas.line(np.array([[2.0, 2.0], [4.0, 2.0]]), (0, 0, 0), 3.0)
    canvas.text(2.0, 2.0, "a place")
    ((u, _),) = canvas.pixels(np.array([[2.0, 2.0]]))
    assert texts["a place"][2] < u


def test_a_text_on_grey_has_a_white_rim() -> None:
    canvas = Canvas((0.0, 0.0, 4.0, 4.0), ())
    canvas.polygon(np.array([(0, 0), (4, 0), (4, 4), (0, 4)]), CELLS, CELLS)
    canvas.text(2.0, 2.0, "I")
    ((u, v),) = canvas.pixels(np.array([[2.0, 2.0]]))
    row = np.asarray(canvas.image)[round(v), round(u) : round(u) + 60].sum(axis=1)
    ground, white, letter = 3 * CELLS[0], 3 * 255, 3 * 30
    pure = row[np.isin(row, (ground, white, letter))]  # without blended pixels at the edges
    runs = pure[np.concatenate([[True], np.diff(pure) != 0])].tolist()
    assert runs == [ground, white, letter, white, ground]


def test_a_long_legend_has_rows_inside_a_narrow_picture(texts: dict[str, Rectangle]) -> None:
    keys = [Key(f"what number {number} means", (0, 0, 0)) for number in range(5)]
    canvas = Canvas((0.0, 0.0, 1.0, 5.0), keys)
    canvas.frame()
    assert max(texts[key.name][2] for key in keys) <= canvas.image.width
    assert overlapping(texts.values()) == []


def test_a_map_of_cells_alone_has_them_black(texts: dict[str, Rectangle]) -> None:
    grid = OccupancyGrid(np.full((4, 4), 100, np.int8), 0.5, Pose2D(-1.0, -1.0, 0.0))
    draw_map_update(MapUpdate(0, grid, np.zeros((0, 4)), ()))
    assert {"occupied cells of the map", "sensor"} <= set(texts)
    assert "outlines in the map" not in texts


def test_the_poses_of_a_localizer_are_drawn_on_the_edges_of_its_map(texts: dict[str, Rectangle]) -> None:
    cells = np.full((40, 40), 100, np.int8)
    cells[10:30, 10:30] = 0  # a room of 4 m from (1, 1) to (5, 5), and solid space round it
    poses = np.zeros((9, 7))
    poses[:, 1], poses[:, 2] = np.linspace(2.0, 20.0, 9), 3.0  # odometry leaves the map
    poses[:, 4], poses[:, 5] = 2.0, np.linspace(2.0, 4.0, 9)
    is_tracking = np.ones(9, dtype=np.bool_)
    picture = np.asarray(draw_poses(poses, OccupancyGrid(cells, 0.2, Pose2D(-1.0, -1.0, 0.0)), is_tracking))
    assert {"odometry", "localizer", "edges of the map's occupied space"} <= set(texts)
    height, width = picture.shape[:2]
    room = picture[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4].reshape(-1, 3).astype(int)
    blue, vermilion, black = ((np.abs(room - colour).max(axis=1) < 80).any() for colour in (BLUE, VERMILION, BLACK))
    assert blue and vermilion and not black
    share = (picture == BLACK).all(axis=2).mean()
    assert 0.01 < share < 0.2  # an edge of one cell, and the legend
    texts.clear()
    draw_poses(poses, None, is_tracking)
    assert {"odometry", "localizer"} <= set(texts) and "edges of the map's occupied space" not in texts
    assert "localizer while not tracking" not in texts
    is_tracking[5:] = False
    draw_poses(poses, None, is_tracking)
    assert "localizer while not tracking" in texts


def test_the_track_shows_who_drove_and_when(toy: Episode, texts: dict[str, Rectangle]) -> None:
    recorder = replace(toy.recorder, drivers=[(0.0, "controller"), (2.0, "avoider"), (4.0, "controller")])
    end = recorder.truth[-1][0]
    picture = np.asarray(draw_run(replace(changed(toy, WALL), recorder=recorder)))
    assert {"driven by the controller", "by the avoider"} <= set(texts) and "by the recovery" not in texts
    for driver in ("controller", "avoider"):
        near = np.abs(picture.astype(int) - DRIVERS[driver].colour).max(axis=2) < 40
        assert near[100:].sum() > 100, driver
    times = [float(text.removesuffix(" s")) for text in texts if text.endswith(" s") and text[0].isdigit()]
    assert max(times) == pytest.approx(end, abs=0.5) and 3 <= len(times) <= 10


def test_free_and_unknown_cells_differ() -> None:
    cells = np.full((10, 10), -1, np.int8)
    cells[:, :5], cells[:, 0] = 0, 100
    canvas = Canvas((0.0, 0.0, 10.0, 10.0), ())
    canvas.grid(OccupancyGrid(cells, 1.0, Pose2D(0.0, 0.0, 0.0)), BLACK)
    shown = [canvas.image.getpixel((round(u), round(v)))
             for u, v in canvas.pixels(np.array([(0.5, 5.0), (2.5, 5.0), (7.5, 5.0)]))]  # fmt: skip
    assert shown == [BLACK, (255, 255, 255), UNKNOWN]


def test_a_turned_map_is_painted_where_its_cells_are() -> None:
    cells = np.zeros((4, 8), np.int8)
    cells[1, 6] = 100  # its middle is (6.5, 1.5) in the map's frame: (-1.5, 6.5) after a quarter turn
    canvas = Canvas((-5.0, 0.0, 5.0, 10.0), ())
    canvas.grid(OccupancyGrid(cells, 1.0, Pose2D(0.0, 0.0, np.pi / 2)), BLACK)
    ((u, v), (other_u, other_v)) = canvas.pixels(np.array([(-1.5, 6.5), (-1.5, 7.6)]))
    assert canvas.image.getpixel((round(u), round(v))) == BLACK
    assert canvas.image.getpixel((round(other_u), round(other_v))) == (255, 255, 255)
