"""A role that the framework does not know is added in one place, and runs in every executor."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest
from live_rig import COMMAND, runtime_folder, up

ROLE = '''
"""A detector: how many beams of this step's scans hear something, and where the robot is then."""

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from navloom import Context, PoseEstimate, RangeScan, hookimpl
from navloom.engine.catalogue import add_role
from navloom.engine.node import Node
from navloom.engine.ports import Latest, Output, Port, Ports, Sensors
from navloom.engine.role_nodes import in_order
from navloom.engine.streams import STATE, LocalizerPorts
from navloom.messages.schema import Message, message
from navloom.roles import Role


@message()
class Detection(Message):
    """What was heard, and the x of the robot, m, map frame."""

    stamp_ns: int
    heard: int
    x: float


@dataclass(frozen=True, slots=True)
class DetectorInput:
    stamp_ns: int
    scans: tuple
    estimate: PoseEstimate


class Detector(Role):
    role = "detector"

    @abstractmethod
    def detect(self, given: DetectorInput) -> Detection: ...


class DetectorPorts(Ports, role="detector"):
    found = Port(Detection, STATE, answers=True)


class DetectorNode(Node):
    role = "detector"
    scans = Sensors()
    pose = Latest(LocalizerPorts.pose, triggers=True)
    found = Output(DetectorPorts.found)
    cause = pose

    def __init__(self, plugin):
        self.plugin = plugin

    def step(self, tick):
        self.found.put(self.plugin.detect(DetectorInput(tick.time_ns, in_order(self.scans), self.pose.value)))


add_role(Detector, DetectorNode)


class Count(Detector):
    name = "count"
    accepts = (RangeScan,)

    def detect(self, given):
        heard = sum(int(np.isfinite(scan.ranges).sum()) for scan in given.scans)
        return Detection(given.stamp_ns, heard, given.estimate.pose.x)


@hookimpl
def navloom_register(registry):
    registry.add(Count)
'''
CONFIG = """
[run]
seed = 3
stop_after = {stop}

[world]
ref = "paper_gates_obstacle"

[[sensor]]
name = "laser"
kind = "pitched_laser"
geometry = "paper"

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[detector]
plugin = "count"

[navigation]
start = {{ x = 0.0, y = 0.0, heading_deg = 90.0 }}
goal = {{ x = 0.0, y = 7.6 }}

[live]
processes = {{ robot = ["platform", "localizer"], think = ["mapper", "planner", "goal"], drive = ["reference", "controller", "avoider", "recovery", "detector"], safe = ["gate"] }}
"""  # noqa: E501  (a table in TOML stands on one line)


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A config with a detector; every process that starts from here has the role from its first line on."""
    folder = tmp_path / "lib"
    about = folder / "detector_role-1.0.dist-info"
    about.mkdir(parents=True)
    (folder / "detector_role.py").write_text(ROLE, "utf-8")
    (folder / "sitecustomize.py").write_text("import detector_role\n", "utf-8")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: detector_role\nVersion: 1.0\n", "utf-8")
    (about / "entry_points.txt").write_text("[navloom]\ndetector.count = detector_role\n", "utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")])))
    path = tmp_path / "detecting.toml"
    path.write_text(CONFIG.format(stop=6.0), "utf-8")
    return path


def navloom(*arguments: str, folder: Path | None = None) -> Any:
    """What a command prints as JSON, whatever it made of the goal."""
    environment = os.environ if folder is None else {**os.environ, "NAVLOOM_RUNTIME_DIR": str(folder)}
    done = subprocess.run(
        [*COMMAND, *arguments, "--json"], capture_output=True, text=True, timeout=180, env=environment
    )
    assert done.stdout, done.stderr
    return json.loads(done.stdout)


def test_it_runs_in_lockstep_under_the_barrier_and_in_replay(config: Path, tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    ran = navloom("run", str(config), "--record", str(recording), "--out", str(tmp_path / "out"))
    assert b"detector count found detector_role.Detection/1" in (tmp_path / "out" / "trace.bin").read_bytes()
    with runtime_folder() as folder:
        assert navloom("up", str(config), "--barrier", folder=folder)["trace_sha256"] == ran["trace_sha256"]
    checked = {node["node"]: node for node in navloom("replay", str(recording), "--check")["nodes"]}
    assert checked["detector count"]["steps"] > 100 and checked["detector count"]["differing"] == 0


def test_it_runs_live_and_is_in_the_graph(config: Path) -> None:
    wired = {node["role"]: node for node in navloom("graph", str(config))["nodes"]}
    assert wired["detector"]["publishes"] == ["found"]
    with up(str(config)) as robot:
        robot.wait_for("every node is there")
        command = [*COMMAND, "echo", "detector/count/found", "--count", "3", "--json"]
        told = subprocess.run(command, capture_output=True, text=True, timeout=60, env=robot.environment, check=True)
        lines = [json.loads(line) for line in told.stdout.splitlines()]
        assert len(lines) == 3 and all("heard" in line["message"] for line in lines)
