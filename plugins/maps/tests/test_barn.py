import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom.geometry.world import Cylinder, Place
from navloom.worlds import WorldError
from navloom_maps.barn import barn_world

ARRAYS: dict[str, Any] = {
    "world": np.array([1, 7]),
    "cyl": np.array([(0, 1, 0.5), (2, 3, 0.25), (4, 5, 0.125)], dtype=np.float32),
    "cyl_off": np.array([0, 1, 3], dtype=np.int32),
    "start": np.array([-2.0, 3.0, 1.5]),
    "goal": np.array([-2.0, 13.0]),
    "goal_tol": np.array(1.0),
    "time_limit": np.array(100.0),
}


def written(folder: Path, **changes: Any) -> Path:
    content = {name: array for name, array in {**ARRAYS, **changes}.items() if array is not None}
    np.savez_compressed(folder / "b.npz", **content)
    return folder


def test_a_world_has_its_own_cylinders_and_the_file_s_task(tmp_path: Path) -> None:
    world = barn_world("b.npz#7", written(tmp_path))
    assert world.obstacles == (Cylinder("cylinder 1", 2.0, 3.0, 0.25), Cylinder("cylinder 2", 4.0, 5.0, 0.125))
    assert (world.start, world.goal) == (Place(-2.0, 3.0, 1.5), Place(-2.0, 13.0))
    assert (world.goal_tolerance, world.time_limit) == (1.0, 100.0)
    assert world.bounds == (-3.0, 2.0, 5.0, 14.0)
    assert world.name == "barn:b.npz#7" and world.reference_length is None


def test_a_world_has_the_organisers_length_where_the_file_gives_one(tmp_path: Path) -> None:
    lengths = np.array([12.5, 11.25], dtype=np.float32)
    assert barn_world("b.npz#7", written(tmp_path, path_len_m=lengths)).reference_length == 11.25


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("b.npz#2", "there is no world 2; the file has 1, 7"),
        ("b.npz#99999999999999999999", "the file has 1, 7"),
        ("b.npz", "after '#', expected a world's number"),
        ("b.npz#one", "'one' after '#'"),
        ("b.npz#-1", "'-1' after '#'"),
        ("b.npz#²", "after '#'"),
        ("c.npz#1", "there is no such file; did you mean 'b.npz'"),
        ("#1", "expected the name of a file"),
    ],
)
def test_a_wrong_reference_is_explained(tmp_path: Path, argument: str, message: str) -> None:
    with pytest.raises(WorldError, match=message):
        barn_world(argument, written(tmp_path))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cyl": None}, "array 'cyl' is missing; did you mean 'cyl_off'"),
        ({"cyl": np.zeros((3, 2))}, r"array 'cyl' of float64 \(3, 2\), expected numbers \(-1, 3\)"),
        ({"cyl": np.full((3, 3), np.nan)}, "array 'cyl' has a value beyond"),
        ({"cyl": np.zeros((3, 3))}, "radius 0.0, expected > 0"),
        ({"cyl_off": np.array([0, 1, 9])}, "cylinders 1 to 9 of world 7, expected 0 to 3"),
        ({"cyl_off": np.array([], dtype=np.int32)}, "'cyl_off' is empty"),
        ({"world": np.array([7])}, "array 'world'"),
        ({"start": np.array(["a", "b", "c"])}, "array 'start' of <U1"),
        ({"start": np.array([1, None, 2], dtype=object)}, "array 'start' of object"),
        ({"path_len_m": np.array([12.5])}, r"array 'path_len_m' of float64 \(1,\), expected numbers \(2,\)"),
        ({"path_len_m": np.array([12.5, 0.0])}, "path_len_m of world 7 is 0, expected a length > 0"),
        ({"goal_tol": np.array([1.0])}, r"array 'goal_tol' of float64 \(1,\)"),
    ],
)
def test_a_wrong_array_is_named(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(WorldError, match=f"b.npz: .*{message}"):
        barn_world("b.npz#7", written(tmp_path, **changes))


def test_an_array_that_claims_an_absurd_size_is_refused_before_it_is_allocated(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)})
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        archive.writestr("cyl_off.npy", header.getvalue())
    with pytest.raises(WorldError, match=r"array 'cyl_off' of float64 \(1000000000000, 3\)"):
        barn_world("b.npz#7", tmp_path)


def test_a_truncated_file_is_named(tmp_path: Path) -> None:
    whole = (written(tmp_path) / "b.npz").read_bytes()
    (tmp_path / "b.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(WorldError, match=r"damaged \.npz file"):
        barn_world("b.npz#7", tmp_path)
