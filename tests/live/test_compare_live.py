"""`navloom compare --live`: the same table and report as in lockstep, from robots that drive one after the other."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path

import pytest
from live_rig import BROKEN, COMMAND, EMPTY, runtime_folder
from navloom_live.hosting.descendants import left_of
from navloom_live.hosting.runtime_folders import RobotFolder, robots
from navloom_study.live_episodes import NAME

CONFIG = EMPTY.replace("drive = false", "goal = { x = 0.7, y = 0.0 }")


def compare(folder: Path, config: Path, *arguments: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "NAVLOOM_RUNTIME_DIR": str(folder)}
    command = [*COMMAND, "compare", str(config), "--live", *arguments]
    return subprocess.Popen(
        command, env=environment, cwd=config.parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(CONFIG, "utf-8")
    return path


def test_methods_drive_live_into_the_table_and_the_report_of_a_study(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with runtime_folder() as folder:
        study = compare(folder, config, "--vary", "avoider=vff,dwa", "--out", str(out), "--json")
        said, complained = study.communicate(timeout=180)
    assert study.returncode == 0, complained
    found = json.loads(said)
    assert found["live"] is True and json.loads((out / "study.json").read_text("utf-8"))["live"] is True
    assert [(episode["method"], episode["outcome"]) for episode in found["episodes"]] == [
        ("vff", "succeeded"),
        ("dwa", "succeeded"),
    ]
    assert all(
        1.0 < episode["time"] < 60.0 for episode in found["episodes"]
    )  # 0.5 m to the tolerance at 0.3 m/s and more
    assert "driven live" in (out / "report.md").read_text("utf-8")


def test_ctrl_c_leaves_no_process_behind(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with runtime_folder() as folder:
        study = compare(folder, config, "--vary", "avoider=vff,dwa")
        assert study.stderr is not None
        assert any("every node is there" in line for line in study.stderr)
        study.send_signal(signal.SIGINT)
        _, complained = study.communicate(timeout=60)
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(folder))
        assert study.returncode == 1 and "interrupted" in complained
        assert [*robots()] == [] and left_of(RobotFolder("lab", NAME).path) == []


def test_a_robot_that_does_not_start_is_one_message(config: Path) -> None:
    (config.parent / "broken.py").write_text(BROKEN, "utf-8")
    with runtime_folder() as folder:
        study = compare(folder, config, "--vary", "avoider=broken", "--plugin", "broken.py")
        _, complained = study.communicate(timeout=120)
    last = complained.splitlines()[-1]
    assert study.returncode == 1 and "Traceback" not in complained
    assert (
        last.startswith("navloom: broken in empty, seed 0: process drive ended with code") and "no such device" in last
    )


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--jobs", "2"), "live episodes run one after the other, or they would slow each other"),
        (("--scheduler", "tcp://127.0.0.1:1"), "live episodes run on this host"),
        (("--twice",), "two live drives are never equal"),
        (("--open-loop",), "it drives in lockstep"),
    ],
)
def test_options_that_make_no_sense_live_are_refused(arguments: tuple[str, ...], reason: str, config: Path) -> None:
    with runtime_folder() as folder:
        study = compare(folder, config, "--vary", "avoider=vff,dwa", *arguments)
        _, complained = study.communicate(timeout=60)
    assert study.returncode == 2 and f"--live with {arguments[0]}" in complained and reason in complained
