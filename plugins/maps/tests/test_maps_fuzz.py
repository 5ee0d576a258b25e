"""Whatever bytes a file has, reading it gives a world or a WorldError."""

import gzip
import io
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from navloom.worlds import SCHEMES, WorldError
from navloom_maps import SCHEMES as OF_MAPS
from PIL import Image

ALL = {**SCHEMES, **OF_MAPS}

YAML = b"{image: m.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2}"
PGM = b"P5\n3 2\n255\n123456"
PLAIN = b"P2\n3 2\n255\n1 2 3 4 5 6\n"
MAP = b"type octile\nheight 2\nwidth 4\nmap\n.GS.\n@OTW\n"
TOML = b'start = { x = 0.0, y = 1 }\n[[box]]\nx = [0, 1]\ny = [0, 1]\nyaw_deg = 3\nappears = "after_sweep"\n'


def png(mode: str) -> bytes:
    file = io.BytesIO()
    Image.new(mode, (4, 3), 1).save(file, "PNG")
    return file.getvalue()


def npz() -> bytes:
    file = io.BytesIO()
    np.savez_compressed(
        file,
        world=np.array([1]),
        cyl=np.ones((2, 3)),
        cyl_off=np.array([0, 2]),
        start=np.zeros(3),
        goal=np.zeros(2),
        goal_tol=np.array(1.0),
        time_limit=np.array(9.0),
    )
    return file.getvalue()


CASES: dict[str, tuple[str, str, bytes]] = {
    "yaml": ("rosmap:m.yaml", "m.yaml", YAML),
    "pgm": ("rosmap:m.yaml", "m.pgm", PGM),
    "plain pgm": ("rosmap:m.yaml", "m.pgm", PLAIN),
    "png": ("rosmap:m.yaml", "m.pgm", png("L")),
    "palette png": ("rosmap:m.yaml", "m.pgm", png("P")),
    "16-bit png": ("rosmap:m.yaml", "m.pgm", png("I;16")),
    "map": ("movingai:m.map", "m.map", MAP),
    "gzipped map": ("movingai:m.map", "m.map", gzip.compress(MAP, mtime=0)),
    "npz": ("barn:m.npz#1", "m.npz", npz()),
    "toml": ("toml:m.toml", "m.toml", TOML),
}
EDITS = st.lists(
    st.tuples(st.sampled_from(["set", "cut", "insert", "repeat"]), st.integers(0, 4000), st.binary(max_size=6)),
    min_size=1,
    max_size=5,
)


def edited(content: bytes, edits: list[tuple[str, int, bytes]]) -> bytes:
    for kind, place, piece in edits:
        at = place % (len(content) + 1)
        if kind == "set":
            content = content[:at] + piece + content[at + len(piece) :]
        elif kind == "cut":
            content = content[:at]
        elif kind == "insert":
            content = content[:at] + piece + content[at:]
        else:
            content = content[:at] + content[max(0, at - 9) :]
    return content


def reader(case: str, folder: Path) -> tuple[Callable[[], object], Path]:
    reference, name, _ = CASES[case]
    scheme, _, argument = reference.partition(":")
    (folder / "m.yaml").write_bytes(YAML)
    (folder / "m.pgm").write_bytes(PGM)
    return lambda: ALL[scheme](argument, folder), folder / name


@pytest.mark.parametrize("case", CASES)
def test_the_whole_file_is_a_world(case: str, tmp_path: Path) -> None:
    read, path = reader(case, tmp_path)
    path.write_bytes(CASES[case][2])
    read()


@pytest.mark.parametrize("case", CASES)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=EDITS)
def test_a_damaged_file_is_a_world_or_a_world_error(
    case: str, tmp_path: Path, edits: list[tuple[str, int, bytes]]
) -> None:
    read, path = reader(case, tmp_path)
    path.write_bytes(edited(CASES[case][2], edits))
    with suppress(WorldError):
        read()


@pytest.mark.parametrize("case", CASES)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200))
def test_any_bytes_are_a_world_or_a_world_error(case: str, tmp_path: Path, content: bytes) -> None:
    read, path = reader(case, tmp_path)
    path.write_bytes(content)
    with suppress(WorldError):
        read()


@pytest.mark.parametrize("scheme", ALL)
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(argument=st.text(max_size=30))
def test_any_reference_is_a_world_or_a_world_error(scheme: str, tmp_path: Path, argument: str) -> None:
    with suppress(WorldError):
        ALL[scheme](argument, tmp_path)


HOSTILE_YAML = {
    "date": "a: 2001-99-99",
    "cycle": "image: &a [*a]",
    "list as key": "? [1]\n: 2",
    "deep": "[" * 3000,
    "code": "!!python/object/apply:os.system [ls]",
    "no integer": "image: !!int x",
    "half an integer": "image: 0b",
    "long integer": "origin: [1" + "0" * 5000 + ", 0, 0]",
    "aliases": "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]",
    "merge": "<<: 3",
}


@pytest.mark.parametrize("text", HOSTILE_YAML.values(), ids=HOSTILE_YAML)
def test_hostile_yaml_is_a_world_error(text: str, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(WorldError, match=r"m\.yaml"):
        ALL["rosmap"]("m.yaml", tmp_path)
