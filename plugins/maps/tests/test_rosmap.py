import logging
import math
import shutil
from collections.abc import Callable, Iterator
from logging.handlers import BufferingHandler
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from navloom.files import write_each
from navloom.geometry.grid import GridMap
from navloom.geometry.world import Place
from navloom.runs.map_files import rosmap_files
from navloom.worlds import WorldError
from navloom_maps.rosmap import load_raster, read_rosmap, rosmap_world
from PIL import Image

KEYS = {
    "image": "m.pgm",
    "resolution": "0.05",
    "origin": "[1.0, 2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
PIXELS = [[0, 100, 205], [254, 255, 206]]


def written(folder: Path, content: bytes | None = None, **keys: str | None) -> Path:
    """A map of two rows and three columns; a key that is None is left out."""
    pixels = b"P5\n3 2\n255\n" + bytes(p for row in PIXELS for p in row)
    (folder / "m.pgm").write_bytes(pixels if content is None else content)
    lines = [f"{key}: {value}" for key, value in {**KEYS, **keys}.items() if value is not None]
    (folder / "m.yaml").write_text("\n".join(lines))
    return folder / "m.yaml"


def test_the_top_row_of_the_image_has_the_highest_y(tmp_path: Path) -> None:
    grid = read_rosmap(written(tmp_path))
    # p = 1, 0.608, 0.19608 above, 0.004, 0, 0.192 below.
    assert grid.cells.tolist() == [[0, 0, 0], [100, -1, -1]]
    assert (grid.resolution, grid.origin) == (0.05, Place(1.0, 2.0, 0.0))


def test_negate_makes_white_occupied(tmp_path: Path) -> None:
    assert read_rosmap(written(tmp_path, negate="1")).cells.tolist() == [[100, 100, 100], [0, -1, 100]]


def test_scale_goes_from_0_to_100_between_the_thresholds(tmp_path: Path) -> None:
    # p = 0.608: 100 (0.608 - 0.196) / (0.65 - 0.196) = 90.7; p = 0.19608: 0.02.
    assert read_rosmap(written(tmp_path, mode="scale")).cells.tolist() == [[0, 0, 0], [100, 91, 0]]


def test_raw_takes_levels_up_to_100_as_they_are(tmp_path: Path) -> None:
    assert read_rosmap(written(tmp_path, mode="raw")).cells.tolist() == [[-1, -1, -1], [0, 100, -1]]


@pytest.mark.parametrize(
    "image",
    [
        b"P2\n# made by hand\n3 2\n255\n0 100 205\n254 # here too\n255 206\n",
        b"P2 3 2 255 0 100 205 254 255 206",
        b"P5 3 2 # comment\n255\n" + bytes(p for row in PIXELS for p in row),
        b"P5\n3 2\n65535\n" + np.array(PIXELS, dtype=">u2").__mul__(257).astype(">u2").tobytes(),
    ],
)
def test_all_kinds_of_pgm_give_the_same_map(tmp_path: Path, image: bytes) -> None:
    assert read_rosmap(written(tmp_path, image)).cells.tolist() == [[0, 0, 0], [100, -1, -1]]


@pytest.mark.parametrize(
    ("header", "trailer"),
    [
        (b"P5\r\n3 2\r\n255\r\n", b""),
        (b"P5\r\n3 2\r\n255\r\n", b"\r\n"),
        (b"P5\n3 2\n255\n# by a script, floor 2\n", b""),
        (b"P5\r\n3 2\r\n255\r\n# by\r\n# a script\r\n", b""),
        (b"P5 3 2 255 # by a script\n", b""),
        (b"P5\n3 2\n255\n\n", b""),
        (b"P5\n3 2\n255\n", b"\n"),
    ],
)
@pytest.mark.parametrize("last", [0, 206])
def test_a_pgm_whose_header_or_end_is_longer_than_the_format_says_is_not_shifted(
    tmp_path: Path, header: bytes, trailer: bytes, last: int
) -> None:
    path = written(tmp_path, header + bytes([0, 100, 205, 254, 255, last]) + trailer)
    assert read_rosmap(path).cells.tolist() == [[0, 0, 100 if last == 0 else 0], [100, -1, -1]]


def test_pixels_that_are_white_space_begin_after_one_white_space(tmp_path: Path) -> None:
    # Levels 10, 13 and 32 are black enough; the file has the length that the format demands.
    assert read_rosmap(written(tmp_path, b"P5\n3 1\n255\n\n\r ")).cells.tolist() == [[100, 100, 100]]


def png(folder: Path, image: Image.Image, **keys: str) -> list[list[int]]:
    image.save(folder / "m.png")
    keys["image"] = "m.png"
    cells: list[list[int]] = read_rosmap(written(folder, **keys)).cells.tolist()
    return cells


def test_png_of_every_mode(tmp_path: Path) -> None:
    grey = np.array(PIXELS, dtype=np.uint8)
    expected = [[0, 0, 0], [100, -1, -1]]
    assert png(tmp_path, Image.fromarray(grey)) == expected
    assert png(tmp_path, Image.fromarray(np.stack([grey] * 3, axis=-1))) == expected
    assert png(tmp_path, Image.fromarray(grey.astype(np.uint16) * 257)) == expected
    palette = Image.fromarray(np.arange(6, dtype=np.uint8).reshape(2, 3), mode="P")
    palette.putpalette([level for row in PIXELS for p in row for level in (p, p, p)])
    assert png(tmp_path, palette) == expected
    assert png(tmp_path, Image.fromarray(grey > 127).convert("1")) == [[0, 0, 0], [100, 100, 0]]


def test_the_mean_of_the_colours_counts(tmp_path: Path) -> None:
    # (255 + 0 + 0) / 765: p = 0.667; (255 + 255 + 0) / 765: p = 0.333.
    pixels = np.array([[(255, 0, 0), (255, 255, 0)]], dtype=np.uint8)
    assert png(tmp_path, Image.fromarray(pixels)) == [[100, -1]]


def test_transparency_is_a_fourth_colour_in_trinary_and_unknown_in_scale(tmp_path: Path) -> None:
    # White, opaque or not, and black, opaque or not: p = 0, 0.25, 0.75, 1 in trinary.
    pixels = np.array([[(255, 255), (255, 0), (0, 255), (0, 0)]], dtype=np.uint8)
    assert png(tmp_path, Image.fromarray(pixels, mode="LA")) == [[0, -1, 100, 100]]
    assert png(tmp_path, Image.fromarray(pixels, mode="LA"), mode="scale") == [[0, -1, 100, -1]]


def test_a_world_takes_unknown_for_occupied_unless_told_otherwise(tmp_path: Path) -> None:
    written(tmp_path)
    world = rosmap_world("m.yaml", tmp_path)
    assert world.raster is not None
    assert world.raster.occupied.tolist() == [[False, False, False], [True, True, True]]
    assert world.bounds == pytest.approx((1.0, 2.0, 1.15, 2.1))
    free = rosmap_world("m.yaml?unknown=free&height=1.5", tmp_path)
    assert free.raster is not None
    assert free.raster.occupied.tolist() == [[False, False, False], [True, False, False]]
    assert free.raster.z == (0.0, 1.5)


def test_a_raw_map_is_occupied_from_the_threshold(tmp_path: Path) -> None:
    image = b"P5\n4 1\n255\n" + bytes([64, 65, 100, 101])
    path = written(tmp_path, image, mode="raw")
    assert load_raster(path, unknown="free").occupied.tolist() == [[False, True, True, False]]


def test_a_turned_origin_turns_the_bounds(tmp_path: Path) -> None:
    written(tmp_path, origin=f"[1.0, 2.0, {math.pi / 2}]")
    assert rosmap_world("m.yaml", tmp_path).bounds == pytest.approx((0.9, 2.0, 1.0, 2.15))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"resolution": None, "resolutoin": "0.1"}, "key 'resolution' is missing; did you mean 'resolutoin'"),
        ({"image": None}, "key 'image' is missing"),
        ({"image": "[1]"}, r"image = \[1\]: expected the name"),
        ({"image": "n.pgm"}, "n.pgm: there is no such file; did you mean 'm.pgm'"),
        ({"resolution": "0"}, "resolution = 0: expected metres a pixel"),
        ({"resolution": "fine"}, "resolution = 'fine'"),
        ({"resolution": ".nan"}, "resolution = nan"),
        ({"resolution": "true"}, "resolution = True"),
        ({"origin": "[0, 0]"}, r"origin = \[0, 0\]: expected \[x, y, yaw\]"),
        ({"origin": "[0, 0, left]"}, "origin = 'left'"),
        ({"negate": "2"}, "negate = 2: expected 0 or 1"),
        ({"occupied_thresh": "65"}, "occupied_thresh = 65: expected a number from 0 to 1"),
        ({"free_thresh": None}, "key 'free_thresh' is missing; add it, as in free_thresh: 0.196"),
        ({"free_thresh": None, "free_treshold": "0.2"}, "'free_thresh' is missing; did you mean 'free_treshold'"),
        ({"image": "/home/ann/maps/m.pgm"}, "one of this name lies beside .*m.yaml: write image: m.pgm"),
        ({"image": r"C:\maps\m.pgm"}, "one of this name lies beside .*m.yaml: write image: m.pgm"),
        ({"image": "maps/m.pgm"}, "one of this name lies beside .*m.yaml: write image: m.pgm"),
        ({"image": "maps/n.pgm"}, "there is no folder"),
        ({"mode": "ternary"}, "mode = 'ternary': expected one of trinary, scale, raw; did you mean 'trinary'"),
        ({"mode": "1"}, "mode = 1: expected one of trinary, scale, raw"),
    ],
)
def test_a_wrong_key_is_named(tmp_path: Path, keys: dict[str, str | None], message: str) -> None:
    with pytest.raises(WorldError, match=message):
        read_rosmap(written(tmp_path, **keys))


@pytest.mark.parametrize("keys", [{"mode": "Trinary"}, {"negate": "'0'"}])
def test_what_map_server_reads_is_read(tmp_path: Path, keys: dict[str, str | None]) -> None:
    assert read_rosmap(written(tmp_path, **keys)).cells.tolist() == [[0, 0, 0], [100, -1, -1]]


@pytest.fixture
def warnings_of() -> Iterator[Callable[[Path], list[str]]]:
    """Reads a map twice; gives the warnings, without its name."""
    handler = BufferingHandler(100)  # pytest's own hears nothing once a command has set up logging
    log = logging.getLogger("navloom.maps")

    def warnings(path: Path) -> list[str]:
        read_rosmap(path)
        read_rosmap(path)
        return [record.getMessage().removeprefix(f"{path}: ") for record in handler.buffer]

    log.addHandler(handler)
    yield warnings
    log.removeHandler(handler)


def test_grey_205_is_free_above_0_196_with_one_warning(
    tmp_path: Path, warnings_of: Callable[[Path], list[str]]
) -> None:
    path = written(tmp_path, free_thresh="0.25")
    (warning,) = warnings_of(path)
    assert warning.startswith("1 of 6 cells are grey 205")
    assert "write free_thresh: 0.196 (now 0.25)" in warning
    assert read_rosmap(path).cells.tolist() == [[0, 0, 0], [100, -1, 0]]


def test_opaque_grey_205_of_a_transparent_image_is_warned_of(
    tmp_path: Path, warnings_of: Callable[[Path], list[str]]
) -> None:
    # Opacity counts as a white colour: p = 1 - (3 * 205 + 255) / 1020 = 0.147.
    Image.fromarray(np.array([[(205, 255), (0, 255)]], dtype=np.uint8), mode="LA").save(tmp_path / "m.png")
    (warning,) = warnings_of(written(tmp_path, image="m.png"))
    assert "1 of 2 cells are grey 205" in warning
    assert warning.endswith("save the image without transparency")


def test_thresholds_the_wrong_way_round_are_read_as_map_server_reads_them(
    tmp_path: Path, warnings_of: Callable[[Path], list[str]]
) -> None:
    # p = 1, 0.608, 0.196 above: occupied beyond 0.3, else free below 0.7.
    path = written(tmp_path, occupied_thresh="0.3", free_thresh="0.7")
    assert warnings_of(path)[0].startswith("free_thresh = 0.7 is not below occupied_thresh = 0.3")
    assert read_rosmap(path).cells.tolist() == [[0, 0, 0], [100, 100, 0]]


def test_scale_with_equal_thresholds_leaves_the_level_between_unknown(tmp_path: Path) -> None:
    path = written(tmp_path, b"P5\n3 1\n1\n\0\1\0", mode="scale", occupied_thresh="1.0", free_thresh="1.0")
    assert read_rosmap(path).cells.tolist() == [[-1, 0, -1]]


def test_a_yaw_of_more_than_a_turn_is_read_in_radians_with_a_warning(
    tmp_path: Path, warnings_of: Callable[[Path], list[str]]
) -> None:
    path = written(tmp_path, origin="[0, 0, 90.0]")
    (warning,) = warnings_of(path)
    assert warning == "origin: a yaw of 90 is read in radians, as 14.3 turns; if it is in degrees, write 1.5708"
    assert read_rosmap(path).origin.heading == pytest.approx(90.0 - 14 * math.tau)


def test_a_yaw_beyond_half_a_turn_is_wrapped_without_a_warning(
    tmp_path: Path, warnings_of: Callable[[Path], list[str]]
) -> None:
    path = written(tmp_path, origin="[0, 0, 4.0]")
    assert warnings_of(path) == []
    assert read_rosmap(path).origin.heading == pytest.approx(4.0 - math.tau)


def test_a_number_without_a_point_is_read_as_map_server_reads_it(tmp_path: Path) -> None:
    assert read_rosmap(written(tmp_path, resolution="5e-2")).resolution == 0.05


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (b"P5\n3 2\n255\n12345", "truncated: 5 bytes of pixels, expected 6"),
        (b"P2\n3 2\n255\n1 2 3 4 5", "truncated: 5 pixels, expected 6"),
        (b"P2\n3 2\n255\n1 2 3 4 5 x", "expected numbers"),
        (b"P2\n3 2\n255\n1 2 3 4 5 6 7", "more than the 6 pixels"),
        (b"P5\n3 2\n255\n1234567", "1 bytes more than the 6 of its pixels"),
        (b"P5\n3 2\n255\n\n12345\n", "uncertain where the pixels begin"),
        (b"P2\n3 2\n200\n1 2 3 4 5 201", "a pixel of 201, expected at most the 200"),
        (b"P5\n99999 99999\n255\n", "99999 x 99999 pixels, expected 1 to 64000000"),
        (b"P5\n0 2\n255\n", "0 x 2 pixels"),
        (b"P5\n3 2\n0\n", "highest value 0"),
        (b"P5\n3\n", "PGM header"),
        (b"P6\n3 2\n255\n", "expected a PGM"),
        (b"", "expected a PGM"),
        (b"\x89PNG\r\n\x1a\nrest", "damaged PNG"),
    ],
)
def test_a_damaged_image_is_named(tmp_path: Path, image: bytes, message: str) -> None:
    with pytest.raises(WorldError, match=f"m.pgm: .*{message}"):
        read_rosmap(written(tmp_path, image))


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("n.yaml", "there is no such file; did you mean 'm.yaml'"),
        ("", "expected the name of a file"),
        ("m.yaml?unknwon=free", "option 'unknwon' does not exist; did you mean 'unknown'"),
        ("m.yaml?unknown=fre", "did you mean 'free'"),
        ("m.yaml?height=-1", "height=-1: expected a length"),
        ("m.yaml?height", "expected options"),
        ("no/m.yaml", "there is no folder"),
        (".", "cannot be read"),
    ],
)
def test_a_wrong_reference_is_explained(tmp_path: Path, argument: str, message: str) -> None:
    written(tmp_path)
    with pytest.raises(WorldError, match=message):
        rosmap_world(argument, tmp_path)


def test_a_file_that_is_no_yaml_is_named(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("image: [")
    with pytest.raises(WorldError, match=r"m\.yaml: not YAML"):
        read_rosmap(path)
    path.write_text("- 1")
    with pytest.raises(WorldError, match=r"m\.yaml: expected the keys"):
        read_rosmap(path)


GRIDS = arrays(np.int8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(-1, 100))


def save(grid: GridMap, path: Path, mode: str = "trinary") -> None:
    write_each(path.parent, rosmap_files(grid, path.stem, mode))  # type: ignore[arg-type]


@settings(deadline=None, max_examples=40)
@given(GRIDS, st.floats(1e-3, 10.0), st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3, 3)))
def test_saving_and_reading_gives_the_same_grid(
    tmp_path_factory: pytest.TempPathFactory, cells: np.ndarray, resolution: float, origin: tuple[float, float, float]
) -> None:
    path = tmp_path_factory.mktemp("saved") / "m.yaml"
    trinary = np.where(cells > 50, 100, np.where(cells < 0, -1, 0)).astype(np.int8)
    for grid, mode in ((GridMap(trinary, resolution, Place(*origin)), "trinary"), (GridMap(cells, resolution), "raw")):
        save(grid, path, mode)
        back = read_rosmap(path)
        assert np.array_equal(back.cells, grid.cells)
        assert (back.resolution, back.origin) == (grid.resolution, grid.origin)
    shutil.rmtree(path.parent)


def test_saving_trinary_rounds_to_the_saver_s_three_levels(tmp_path: Path) -> None:
    save(GridMap(np.array([[0, 19, 20, 64, 65, -1]], dtype=np.int8), 0.1), tmp_path / "m.yaml")
    assert (tmp_path / "m.pgm").read_bytes() == b"P5\n6 1\n255\n" + bytes([254, 254, 205, 205, 0, 205])
    assert read_rosmap(tmp_path / "m.yaml").cells.tolist() == [[0, 0, -1, -1, 100, -1]]
