"""Bad input: one clear message, exit 2, nothing written. Through the command line, as a user meets it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from navloom import MapperInput, PoseTrack, Sweep
from navloom.cli import main
from navloom.roles import InputError

Navloom = Callable[..., tuple[int, str, str]]


@pytest.fixture
def navloom(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Navloom:
    """Runs the command line; gives exit code, standard output and standard error."""

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["navloom", *words])
        with pytest.raises(SystemExit) as caught:
            main()
        said = capsys.readouterr()
        return int(caught.value.code or 0), said.out, said.err

    return run


def write(folder: Path, text: str, name: str = "robot.toml") -> str:
    path = folder / name
    path.write_text(text, "utf-8")
    return str(path)


def refused(navloom: Navloom, folder: Path, *words: str) -> str:
    """The message of a request that is refused, with nothing written."""
    out = folder / "out"
    code, said, error = navloom("run", *words, "--out", str(out), "--json")
    assert code == 2, said + error
    assert said == "" and not out.exists()
    # Parameters that a change of plugin made void are listed first; then comes the one message.
    *dropped, message = error.splitlines()
    assert all(line.endswith("dropped") for line in dropped)
    assert message.startswith("navloom: ") and "Traceback" not in error
    return message


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("controller.k4=1.0", "controller.k4: unknown key; known are k1, k3"),
        ("controller.k3=fast", "controller.k3: got 'fast', expected a number"),
        ("controller.k3=-1.0", "controller.k3: got -1.0, expected more than 0"),
        ("run.period=5.0", "run.period: got 5.0, expected at most 1"),
        ("avoider.plugin=improved_vhf", "no plugin 'avoider.improved_vhf' is installed; did you mean 'improved_vfh'?"),
        ("sensor.laser.beems=5", "sensor.0.beems: unknown key; did you mean 'beams'?"),
        ("sensor.laser.sigma=-1", "sensor.0.sigma: got -1"),
        ("navigation.goal.y=5.3", "occupied by girder A"),
        ("navigation.start.y=50", "navigation.start: (0, 50) is outside the world paper_gates_obstacle"),
        ("navigation.start.y=9.3", "navigation.start: the robot does not fit at (0, 9.3): occupied by back wall"),
        ("world.ref=paper_gate", "world 'paper_gate' does not exist; did you mean 'paper_gates'?"),
        ("world.ref=rosmap:nowhere.yaml", "there is no such file"),
        ("planner.rate_hz=7", "does not divide the tick rate of 20 Hz"),
    ],
)
def test_a_value_that_does_not_fit_names_place_value_and_fix(
    navloom: Navloom, tmp_path: Path, change: str, said: str
) -> None:
    assert said in refused(navloom, tmp_path, "paper", "--set", change)


def test_an_unknown_config_is_refused(navloom: Navloom, tmp_path: Path) -> None:
    assert "did you mean 'paper'?" in refused(navloom, tmp_path, "papper")
    near = write(tmp_path, "")
    assert f"did you mean '{near}'?" in refused(navloom, tmp_path, near.replace("robot", "robott"))
    assert "a map of ROS is a world, as in --set world.ref=m.yaml" in refused(navloom, tmp_path, "m.yaml")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("runn",), "No such command 'runn'; did you mean 'run'?"),
        (("help",), "Write `navloom --help`."),
        (("help", "plan"), "Write `navloom plan --help`."),
        (("qqqq",), "No such command 'qqqq'."),
    ],
)
def test_an_unknown_command_is_refused_with_the_nearest(navloom: Navloom, words: tuple[str, ...], said: str) -> None:
    code, _, error = navloom(*words)
    assert code == 2 and error.endswith(f"{said}\n")


def ros_map(folder: Path, image: bytes | None) -> str:
    write(folder, "image: m.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n"
                  "free_thresh: 0.196\n", "m.yaml")  # fmt: skip
    if image is not None:
        (folder / "m.pgm").write_bytes(image)
    return f"world.ref=rosmap:{folder / 'm.yaml'}"


def test_a_map_without_its_image_is_refused(navloom: Navloom, tmp_path: Path) -> None:
    assert "m.pgm: there is no such file; " in refused(navloom, tmp_path, "paper", "--set", ros_map(tmp_path, None))


def test_a_truncated_map_is_refused(navloom: Navloom, tmp_path: Path) -> None:
    cut = b"P5\n40 40\n255\n" + bytes(100)
    message = refused(navloom, tmp_path, "paper", "--set", ros_map(tmp_path, cut))
    assert "m.pgm" in message and "1600" in message and "100" in message


def fake_entry_points(monkeypatch: pytest.MonkeyPatch, *extra: EntryPoint) -> None:
    """Adds entry points to those installed."""
    import navloom.plugins.discovery as discovery

    real = discovery.available_points
    monkeypatch.setattr(discovery, "available_points", lambda: [*real(), *extra])


def test_two_plugins_of_one_name_are_refused(navloom: Navloom, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_entry_points(monkeypatch, EntryPoint("planner.astar", "somewhere_else", "navloom"))
    assert "two plugins are named 'planner.astar'" in refused(navloom, tmp_path, "paper")


def test_a_plugin_that_breaks_on_import_is_fatal_only_if_used(
    navloom: Navloom, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_plugin.py").write_text("raise RuntimeError('no luck')\n", "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    fake_entry_points(monkeypatch, EntryPoint("planner.broken", "broken_plugin", "navloom"))
    code, listed, _ = navloom("plugins")
    assert code == 0 and "broken" in listed
    code, _, _ = navloom("config", "check", "paper")
    assert code == 0
    message = refused(navloom, tmp_path, "paper", "--set", "planner.plugin=broken")
    assert "planner.broken" in message and "RuntimeError: no luck" in message


def test_a_goal_that_only_the_robots_map_says_is_occupied_is_rejected(navloom: Navloom) -> None:
    # The robot's disc fits at (-2.4, 4.6) in the true world, but that is within two cells of the mapped gate wall.
    code, said, _ = navloom("run", "paper", "--set", "navigation.goal={x=-2.4,y=4.6}", "--json")
    result = json.loads(said)
    assert (code, result["outcome"]) == (1, "rejected")
    assert result["reason"].startswith("goal_occupied: the goal (-2.40, 4.60)")


def test_negative_coordinates_parse(navloom: Navloom) -> None:
    code, said, error = navloom("plan", "empty", "--from", "-1,-1", "--to", "-1,2", "--json")
    assert code == 0, error
    # Three metres, and at most a cell of 0.05 m to reach the lattice at either end.
    assert 3.0 <= json.loads(said)["length_m"] < 3.1


def test_a_place_outside_the_map_is_refused(navloom: Navloom) -> None:
    code, _, error = navloom("plan", "empty", "--from", "0,0", "--to", "0,99")
    assert code == 2 and "--to 0,99: outside the map" in error


def sweep(ranges: np.ndarray) -> Sweep:
    frames, beams = ranges.shape
    return Sweep(0, 1, ranges, np.zeros(frames), np.zeros(frames), np.linspace(-0.5, 0.5, beams), "paper",
                 0.0, 0.0, 0.4, 0.1, 80.0)  # fmt: skip


def test_nan_in_a_sweep_is_refused_at_once() -> None:
    ranges = np.full((3, 4), 5.0)
    ranges[1, 2] = np.nan
    with pytest.raises(ValueError, match=r"Sweep\.ranges.*nan"):
        sweep(ranges)


def test_an_empty_sweep_is_refused_by_the_mapper() -> None:
    from navloom.config import load_config
    from navloom.engine.build import assemble
    from navloom.engine.plugin_factory import make_plugins

    system = assemble(load_config("paper"))
    make_plugins(system)
    mapper = system.plugin("mapper", "ipabd@printed")
    track = PoseTrack(np.zeros(1, dtype=np.int64), np.zeros((1, 3)))
    with pytest.raises(InputError, match="sweep"):
        mapper.update(MapperInput(0, (sweep(np.empty((0, 4))),), (), track))  # type: ignore[attr-defined]


def test_a_result_folder_that_cannot_be_made_is_refused(navloom: Navloom, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way", "utf-8")
    code, said, error = navloom("run", "paper", "--out", str(tmp_path / "file" / "out"))
    assert code == 2 and said == ""
    assert "cannot be written: Not a directory; name a folder" in error
