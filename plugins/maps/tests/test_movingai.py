import gzip
from pathlib import Path

import pytest
from navloom.geometry.world import Place
from navloom.worlds import WorldError
from navloom_maps.movingai import movingai_world, read_movingai, scenario_place

MAP = b"type octile\nheight 2\nwidth 4\nmap\n.GS.\n@OTW\n"


def written(folder: Path, content: bytes, name: str = "m.map") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize(
    ("name", "content"),
    [("m.map", MAP), ("m.map.gz", gzip.compress(MAP, mtime=0)), ("m.map", MAP.replace(b"\n", b"\r\n"))],
)
def test_the_first_row_of_the_file_has_the_highest_y(tmp_path: Path, name: str, content: bytes) -> None:
    grid = read_movingai(written(tmp_path, content, name), 0.5)
    assert grid.cells.tolist() == [[100, 100, 100, 100], [0, 0, 0, 0]]
    assert (grid.resolution, grid.origin) == (0.5, Place(0.0, 0.0))


def test_a_scenario_s_cell_is_counted_from_the_top() -> None:
    assert scenario_place(3, 0, 2) == Place(3.5, 1.5)
    assert scenario_place(3, 0, 2, 0.5) == Place(1.75, 0.75)


def test_the_edge_of_a_cell_is_an_option(tmp_path: Path) -> None:
    written(tmp_path, MAP)
    assert movingai_world("m.map", tmp_path).bounds == (0.0, 0.0, 4.0, 2.0)
    world = movingai_world("m.map?cell=0.25&height=1.0", tmp_path)
    assert world.bounds == (0.0, 0.0, 1.0, 0.5)
    assert world.raster is not None
    assert world.raster.z == (0.0, 1.0)
    assert world.name == "movingai:m.map?cell=0.25&height=1.0"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "line 1: b'', expected 'type octile'"),
        (b"type tile\n", "line 1: .*expected 'type octile'"),
        (MAP.replace(b"height 2", b"height two"), "line 2: .*expected 'height' or 'width'"),
        (MAP.replace(b"height 2", b"width 2"), "expected the lines 'height', 'width' and 'map'"),
        (MAP.replace(b"height 2", b"height 999999999"), "expected 1 to 64000000 cells"),
        (MAP.replace(b"height 2", b"height 0"), "4 x 0 cells"),
        (MAP.replace(b"height 2", b"height 3"), "truncated: 2 rows, expected 3"),
        (MAP.replace(b".GS.", b".GS"), "line 5: 3 cells, expected 4"),
        (MAP.replace(b"TW", b"xW"), "line 6, cell 3: 'x', expected one of"),
        (gzip.compress(MAP, mtime=0)[:-12], "damaged gzip file"),
        (gzip.compress(MAP, mtime=0)[:12] + b"\xff" * 30, "damaged gzip file"),
    ],
)
def test_a_damaged_map_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(WorldError, match=f"m.map.*{message}"):
        read_movingai(written(tmp_path, content))


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("n.map", "there is no such file; did you mean 'm.map'"),
        ("m.map?cell=0", "cell=0: expected a length"),
        ("m.map?cell=big", "cell=big"),
        ("m.map?cel=1", "did you mean 'cell'"),
    ],
)
def test_a_wrong_reference_is_explained(tmp_path: Path, argument: str, message: str) -> None:
    written(tmp_path, MAP)
    with pytest.raises(WorldError, match=message):
        movingai_world(argument, tmp_path)
