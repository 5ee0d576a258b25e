import math
from pathlib import Path

import pytest
from navloom.geometry.world import Box, Cylinder, Place
from navloom.worlds import SCHEMES, WorldError, tomlfile

WHOLE = """
bounds = [-5.0, -1.0, 5.0, 9.0]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 7.6 }
goal_tolerance = 0.2
time_limit = 120

[[box]]
name = "cupboard"
x = [1.0, 1.6]
y = [2.0, 2.4]
z = [0.0, 1.8]
yaw_deg = 30.0

[[box]]
x = [-1, 1]
y = [5, 6]
appears = "after_sweep"

[[cylinder]]
name = "person"
x = 0.5
y = 3.0
radius = 0.25
appears_at = 5.0
waypoints = [[5.0, 0.5, 3.0], [9.0, 2.5, 3.0]]
loops = true
"""


def load(folder: Path, text: str) -> object:
    (folder / "w.toml").write_text(text)
    return SCHEMES["toml"]("w.toml", folder)


def test_every_key_arrives(tmp_path: Path) -> None:
    (tmp_path / "w.toml").write_text(WHOLE)
    world = SCHEMES["toml"]("w.toml", tmp_path)
    assert world.obstacles == (
        Box("cupboard", (1.0, 1.6), (2.0, 2.4), (0.0, 1.8), math.radians(30.0)),
        Box("box 2", (-1.0, 1.0), (5.0, 6.0), appears_after_sweep=True),
        Cylinder("person", 0.5, 3.0, 0.25, appears_at=5.0, waypoints=((5.0, 0.5, 3.0), (9.0, 2.5, 3.0)), loops=True),
    )
    assert (world.start, world.goal) == (Place(0.0, 0.0, math.pi / 2), Place(0.0, 7.6))
    assert (world.bounds, world.goal_tolerance, world.time_limit) == ((-5.0, -1.0, 5.0, 9.0), 0.2, 120.0)
    assert (world.name, world.raster) == ("w.toml", None)


def test_the_file_of_the_module_s_description_is_a_world(tmp_path: Path) -> None:
    assert tomlfile.__doc__ is not None
    example = tomlfile.__doc__.split("```")[1].removeprefix("toml\n")
    (tmp_path / "office.pgm").write_bytes(b"P5\n2 1\n255\n\x00\xfe")
    (tmp_path / "office.yaml").write_text(
        "{image: office.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2}"
    )
    (tmp_path / "w.toml").write_text(example)
    world = SCHEMES["toml"]("w.toml", tmp_path)
    assert world.raster is not None
    assert world.raster.occupied.tolist() == [[True, False]]
    assert [o.name for o in world.obstacles] == ["cupboard", "glass wall", "person"]


def test_without_bounds_they_go_round_everything(tmp_path: Path) -> None:
    (tmp_path / "w.toml").write_text(
        "start = { x = 0, y = 0 }\n[[box]]\nx = [1, 2]\ny = [1, 2]\n"
        "[[cylinder]]\nx = 0\ny = 0\nradius = 0.5\nwaypoints = [[0, 0, 0], [1, -4, 0]]"
    )
    assert SCHEMES["toml"]("w.toml", tmp_path).bounds == (-5.0, -1.5, 3.0, 3.0)
    (tmp_path / "w.toml").write_text("")
    assert SCHEMES["toml"]("w.toml", tmp_path).bounds == (-10.0, -10.0, 10.0, 10.0)


def test_what_is_not_mapped_and_what_is_glass(tmp_path: Path) -> None:
    (tmp_path / "w.toml").write_text(BOX + 'material = "glass"\n[[cylinder]]\nx=3\ny=0\nradius=1\nis_mapped = false')
    box, cylinder = SCHEMES["toml"]("w.toml", tmp_path).obstacles
    assert (box.is_mapped, box.material) == (True, "glass")
    assert (cylinder.is_mapped, cylinder.material) == (False, "solid")


BOX = "[[box]]\nx = [0, 1]\ny = [0, 1]\n"
POST = "[[cylinder]]\nx = 0\ny = 0\nradius = 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bunds = [0, 0, 1, 1]", "w.toml: key 'bunds' does not exist; did you mean 'bounds'"),
        (BOX + "yaw = 1", r"\[\[box\]\] 1: key 'yaw' does not exist; did you mean 'yaw_deg'"),
        (BOX + BOX + "colour = 1", r"\[\[box\]\] 2: key 'colour' does not exist; known are"),
        ("[[box]]\nx = [0, 1]", r"\[\[box\]\] 1: key 'y' is missing"),
        ("[[box]]\nx = [1, 0]\ny = [0, 1]", r"x = \[1, 0\], expected \[lowest, highest\]"),
        ("[[box]]\nx = 1\ny = [0, 1]", r"x = 1, expected \[lowest, highest\]"),
        ("[[box]]\nx = [0, nan]\ny = [0, 1]", r"x = \[0, nan\]"),
        ("[[box]]\nx = [0, true]\ny = [0, 1]", r"x = \[0, True\]"),
        ("[[box]]\nx = [0, 1e300]\ny = [0, 1]", "expected"),
        (POST.replace("1\n", "0\n"), r"\[\[cylinder\]\] 1: radius = 0, expected a length > 0"),
        (POST.replace("1\n", "'1'\n"), "radius = '1', expected a number"),
        (POST + "appears = 'later'", "appears = 'later', expected one of at_start, after_sweep"),
        (POST + "appears = 'after_sweep'\nappears_at = 1", "exclude each other"),
        (POST + "appears_at = -1", "appears_at = -1, expected a number from 0"),
        (POST + "loops = true", "expected waypoints"),
        (POST + "loops = 1\nwaypoints = [[1, 0, 0]]", "loops = 1, expected true or false"),
        (POST + "waypoints = [[0, 0, 0], [0, 1, 1]]", "waypoint 2 at 0 s, expected times from 0 that rise"),
        (POST + "waypoints = [[0, 0]]", r"waypoint 1: point = \[0, 0\], expected \[time, x, y\]"),
        (POST + "waypoints = []", r"expected \[\[time, x, y\]"),
        (POST + "name = ''", "name = '', expected a text"),
        (BOX + "name = 'a'\n" + POST + "name = 'a'", "two obstacles are named 'a'"),
        ("box = 3", r"box: expected \[\[box\]\]"),
        ("start = 3", "start: 3, expected a table"),
        ("start = { x = 0 }", "start: key 'y' is missing"),
        ("bounds = [1, 0, 0, 1]", r"bounds = \[1.0, 0.0, 0.0, 1.0\], expected \[lowest x"),
        ("goal_tolerance = -1", "goal_tolerance = -1"),
        ("[raster]\nmap = 'no.yaml'", "no.yaml: there is no such file"),
        ("[raster]", r"\[raster\]: key 'map' is missing"),
        ("x = ", "not TOML"),
        ("\ufeff\x00", "not TOML"),
    ],
)
def test_a_wrong_key_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(WorldError, match=message):
        load(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("start = { x = 0, y = 0, heading_deg = 900 }", "start: heading_deg: got 900, expected degrees of -360 to 360"),
        (BOX + "yaw_deg = -361", "yaw_deg: got -361, expected degrees of -360 to 360"),
    ],
)
def test_an_angle_beyond_a_turn_is_refused(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "w.toml").write_text(text)
    with pytest.raises(WorldError, match=why):
        SCHEMES["toml"]("w.toml", tmp_path)
