"""A live robot whose plugins cause every warning: each is printed once, during the drive, and is in the result."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from live_rig import EMPTY, up

pytestmark = pytest.mark.slow  # starts a robot, which drives until each warning has come

PLUGINS = """
import threading
import time
from dataclasses import replace
from typing import Annotated

import numpy as np
from navloom import Array, Message, NodePlugin, Publishes, Stamp, Tick, Twist2D, message
from navloom_improved_vfh.adapter import ImprovedVfh
from navloom_sensors_sim.adapter import SensorsSim


@message
class Blob(Message):
    stamp_ns: Stamp
    data: Annotated[np.ndarray, Array("uint8", ("n",))]


class Busy(NodePlugin):
    name = "busy"
    ticks = True
    blobs = Publishes(Blob)

    def step(self, tick: Tick) -> None:
        self.steps = getattr(self, "steps", 0) + 1
        if self.steps % 10 == 0:
            self.blobs.put(Blob(tick.time_ns, np.zeros(17 * 2**20, np.uint8)))
        if not hasattr(self, "thread"):
            self.thread = threading.Thread(target=time.sleep, args=(300.0,), name="stays", daemon=False)
            self.thread.start()
        print("x" * 5000)
        time.sleep(0.06)


class Spinning(ImprovedVfh):
    name = "spinning"

    def avoid(self, given):
        return replace(super().avoid(given), twist=Twist2D(0.1, 0.0, 20.0))


class HalfDeaf(SensorsSim):
    name = "half_deaf"

    def advance(self, given):
        got = super().advance(given)
        heard = {name: scan for name, scan in got.scans.items() if name != "second" or given.time_ns < 1_000_000_000}
        return replace(got, scans=heard)
"""
CONFIG = (
    EMPTY.replace("drive = false\n", "goal = { x = 4.5, y = 7.0 }\n").replace("sensors_sim", "half_deaf")
    + """
[[sensor]]
name = "second"
kind = "sonar_ring"

[[node]]
name = "busy"
plugin = "busy"

[avoider]
plugin = "spinning"
sensors = ["sonars"]
"""
)
SAID = {
    "large": "busy busy published a message of 17.8 MB on blobs",
    "limits": "avoider spinning asked for ",
    "output": "busy busy printed more than 64 kB within 10 s: the rest is left out (everything_wrong.py:",
    "silent": "platform half_deaf gave no scan of the sensor 'second' ",
    "late": "busy busy was late: ",
    "thread": "busy busy started the thread 'stays', which still runs and is not a daemon (everything_wrong.py:",
}


def test_each_warning_is_printed_once_while_the_robot_is_up(tmp_path: Path) -> None:
    config, plugins = tmp_path / "robot.toml", tmp_path / "everything_wrong.py"
    config.write_text(CONFIG, "utf-8")
    plugins.write_text(PLUGINS, "utf-8")
    with up(str(config), "--plugin", str(plugins), "--json", "--set", "run.stop_after=40") as robot:
        robot.wait_for("every node is there")
        robot.run("hz", "busy/blobs", "--for", "4")  # only a stream with a reader is sent
        for text in SAID.values():
            robot.wait_for(f"warning: {text}", 60.0)
        assert robot.process.stdout is not None
        robot.run("cancel")
        result = json.loads(robot.process.stdout.read())
    for kind, text in SAID.items():
        assert sum(f"warning: {text}" in line for line in robot.said) == 1
        assert [warning["kind"] for warning in result["warnings"] if warning["text"].startswith(text)] == [kind]
