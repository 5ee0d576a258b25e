"""`navloom bench`: how pairs are timed, how a missing peer is reported, what it prints and refuses."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from navloom_benchmarks import barn as bench_barn
from navloom_benchmarks.entries import rooms
from navloom_benchmarks.irsim import scene_of
from navloom_benchmarks.pairs import Child, Effort, Peer, PeerError, paired, peer_module
from scipy import ndimage

Run = Callable[..., tuple[int, str, str]]
ANSWERS = "import sys; print(7, flush=True); [print(int(line) * 2, flush=True) for line in sys.stdin]"


@pytest.fixture
def barn_file(tmp_path: Path) -> Path:
    """A file with one world, number 5: two cylinders beside the straight way from the origin to (4, 0)."""
    path = tmp_path / "worlds.npz"
    np.savez(
        path, world=[5], cyl=[[2.0, 1.5, 0.1], [2.0, -1.5, 0.1]], cyl_off=[0, 2], start=[0.0, 0.0, 0.0],
        goal=[4.0, 0.0], goal_tol=0.5, time_limit=60.0,
    )  # fmt: skip
    return path


def block(name: str, order: list[str], durations: list[float]) -> Callable[[], float]:
    """A block that returns the durations in turn, and appends its name to the order of calls."""
    left: Iterator[float] = iter(durations)

    def once() -> float:
        order.append(name)
        return next(left)

    return once


def test_blocks_take_turns_and_the_first_of_each_does_not_count() -> None:
    order: list[str] = []
    ours, theirs = block("A", order, [9.0, 1.0, 2.0, 4.0]), block("B", order, [9.0, 2.0, 6.0, 16.0])
    row = paired("thing", "ms", ours, Peer("them", theirs), 3)
    assert "".join(order) == "AB" + "AB" + "BA" + "AB"
    assert (row.ours, row.theirs) == (2000.0, 6000.0)
    assert (row.low, row.ratio, row.high) == (2.5, 3.0, 3.5)  # of 2, 3 and 4


def test_a_row_without_a_peer_has_our_figure_and_the_reason() -> None:
    row = paired("thing", "µs", lambda: 3e-6, Peer("them", absence="them is not installed: pip install them"), 2, "hot")
    assert (row.ours, row.theirs, row.ratio) == (pytest.approx(3.0), None, None)
    assert row.note == "them is not installed: pip install them; hot"


def test_a_peer_that_is_not_installed_is_named_with_how_to_install_it() -> None:
    with pytest.raises(PeerError, match=r"^no-such-thing is not installed: pip install no-such-thing$"):
        peer_module("no_such_thing", "no-such-thing")


def test_a_child_answers_line_by_line(tmp_path: Path) -> None:
    with Child("doubler", [sys.executable, "-IS", "-c", ANSWERS], tmp_path) as child:
        assert (child.hello, child.ask(4), child.ask(5)) == (7, 8, 10)


def test_a_child_that_fails_is_named_with_its_last_words(tmp_path: Path) -> None:
    with (
        Child("doubler", [sys.executable, "-IS", "-c", ANSWERS], tmp_path) as child,
        pytest.raises(PeerError, match=r"^doubler ended: ValueError: invalid literal"),
    ):
        child.ask("four")


def test_an_interpreter_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(PeerError, match=r"^ir-sim: no-such-python: No such file"):
        Child("ir-sim", ["no-such-python"], tmp_path)


def test_the_rooms_are_connected_and_cluttered() -> None:
    free = rooms(128)
    assert ndimage.label(free)[1] == 1
    assert 0.85 < free.mean() < 0.90  # walls take 6 %, clutter 5 % of the rest


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--only", "planer"), "--only planer: there is no such entry; did you mean 'planner'?"),
        (("--only", "barn"), "--only barn: it needs a file of the BARN data set, as in --barn barn_dev.npz#67"),
        (("--barn", "missing.npz"), "missing.npz"),
        (("--page", "."), "--page .: is a folder; name a file in it"),
        (("--page", "/dev/null/page.md"), "--page /dev/null/page.md: cannot be written: "),
    ],
    ids=["unknown", "barn-without-file", "no-such-file", "page-is-a-folder", "page-below-a-file"],
)
def test_an_entry_that_cannot_be_measured_is_refused(
    in_process: Run, words: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = in_process("bench", *words)
    assert (code, out) == (2, "")
    assert err.startswith("navloom: ") and message in err and len(err.splitlines()) == 1


def test_json_holds_every_figure_and_the_machine(in_process: Run) -> None:
    code, out, err = in_process("bench", "--quick", "--only", "codec", "--json")
    found = json.loads(out)
    assert (code, found["quick"], found["left_out"]) == (0, True, {})
    assert [row["name"] for row in found["rows"]] == ["encode 64 B", "decode 64 B", "encode 110 KB", "decode 110 KB"]
    for row in found["rows"]:
        assert (row["unit"], row["peer"]) == ("µs", "pickle")
        assert row["low"] <= row["ratio"] <= row["high"] and row["ours"] > 0.0 and row["theirs"] > 0.0
    assert {"cpu", "cpus", "load", "python", "versions"} == set(found["machine"])
    assert "navloom: codec" in err


def test_a_page_is_written_into_a_folder_that_does_not_exist_yet(in_process: Run, tmp_path: Path) -> None:
    page = tmp_path / "docs" / "performance.md"
    code, _, _ = in_process("bench", "--quick", "--only", "codec", "--page", str(page), "--date", "2026-11-23")
    assert code == 0
    assert "2026-11-23" in page.read_text("utf-8") and [entry.name for entry in page.parent.iterdir()] == [page.name]


def test_the_table_names_a_peer_that_is_missing(in_process: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)  # so that its import fails
    code, out, _ = in_process("bench", "--quick", "--only", "rays")
    assert code == 0
    row = next(line for line in out.splitlines() if line.startswith("9494 rays, 50 boxes"))
    assert row.split()[5:] == ["-", "ms", "-", "-", "mujoco", "mj_multiRay"]
    assert (
        "9494 rays, 50 boxes: mujoco is not installed: pip install mujoco; one thread, 64-bit floats"
        in out.splitlines()
    )


def test_an_entry_that_fails_is_left_out_and_the_exit_code_says_so(
    in_process: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "navloom_sensors_sim.casting", None)
    code, out, _ = in_process("bench", "--quick", "--only", "rays")
    assert code == 1
    assert out.endswith("left out: rays: navloom-sensors-sim is not installed: pip install navloom-sensors-sim\n")


def test_barn_without_ir_sim_gives_our_figures(
    barn_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench_barn, "CONFIGS", ("building",))
    reference = bench_barn.reference_of(str(barn_file), tmp_path)
    assert reference == f"barn:{barn_file}#5"
    bare = tmp_path / "python"  # without any package
    bare.write_text(f'#!/bin/sh\nexec {sys.executable} -S "$@"\n')
    bare.chmod(0o755)
    rows = list(bench_barn.barn(Effort(1, True), lambda text: None, reference, str(bare)))
    assert [row.name for row in rows] == ["BARN tick, simulator (building)", "BARN tick, closed loop (building)"]
    assert all(row.ours > 0.0 and row.theirs is None and "pip install ir-sim" in row.note for row in rows)


def test_ir_sim_is_given_the_same_scene() -> None:
    scene = scene_of(
        {
            "bounds": [-1.0, -2.0, 5.0, 2.0],
            "period": 0.05,
            "start": [0.0, 0.0, 1.5],
            "footprint": [[0.2, 0.1], [-0.2, 0.1], [-0.2, -0.1], [0.2, -0.1]],
            "laser": {"beams": 361, "field_of_view": math.radians(270.0), "range_max": 10.0},
            "cylinders": [[2.0, 1.5, 0.1], [2.0, -1.5, 0.2]],
        }
    )
    assert {key: scene["world"][key] for key in ("width", "height", "offset", "step_time")} == {
        "width": 6.0, "height": 4.0, "offset": [-1.0, -2.0], "step_time": 0.05,
    }  # fmt: skip
    assert [(one["shape"]["radius"], one["state"]) for one in scene["obstacle"]] == [
        (0.1, [2.0, 1.5, 0.0]),
        (0.2, [2.0, -1.5, 0.0]),
    ]
    (lidar,) = scene["robot"][0]["sensors"]
    assert (lidar["number"], lidar["range_max"], lidar["noise"]) == (361, 10.0, False)
