"""Runs ir-sim for the entry `barn` of `navloom bench`, as a child process under an interpreter that has ir-sim.

`PYTHON -I irsim.py SCENE.json` loads the scene and prints one line, `{"name": …, "ranges": […]}`, with the ranges at
the start, m. Then it reads a number of ticks from each line of standard input, simulates them, and prints the CPU time
they took, s. It imports only the standard library, ir-sim and ir-sim's dependencies.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.metadata
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any


def scene_of(given: dict[str, Any]) -> dict[str, Any]:
    """The scene in the format of ir-sim's YAML; JSON is also YAML.

    Args:
        given: `bounds` (left, low, right, high), m; `period`, s; `start` x, y, heading; `footprint` (n, 2), m; `laser`
            with `beams`, `field_of_view`, rad, `range_max`, m; `cylinders` (k, 3) x, y, radius, m.
    """
    left, low, right, high = given["bounds"]
    laser = given["laser"]
    lidar = {
        "name": "lidar2d", "range_min": 0.0, "range_max": laser["range_max"], "angle_range": laser["field_of_view"],
        "number": laser["beams"], "noise": False,
    }  # fmt: skip
    robot = {
        "kinematics": {"name": "diff"},
        "shape": {"name": "polygon", "vertices": given["footprint"]},
        "state": given["start"],
        "vel_max": [2.0, 3.0],
        "sensors": [lidar],
    }
    period = given["period"]
    return {
        "world": {
            "width": right - left, "height": high - low, "offset": [left, low], "step_time": period,
            "sample_time": period, "collision_mode": "unobstructed",
        },
        "robot": [robot],
        "obstacle": [
            {"shape": {"name": "circle", "radius": radius}, "state": [x, y, 0.0]} for x, y, radius in given["cylinders"]
        ],
    }  # fmt: skip


def main(path: str) -> None:
    """Load the scene, then answer requests until standard input ends."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    with contextlib.redirect_stdout(sys.stderr), tempfile.TemporaryDirectory() as folder:
        irsim, numpy = importlib.import_module("irsim"), importlib.import_module("numpy")
        given = json.loads(Path(path).read_text("utf-8"))
        scene = Path(folder) / "scene.yaml"
        scene.write_text(json.dumps(scene_of(given)), "utf-8")
        env = irsim.make(str(scene), display=False, log_level="ERROR")
        turn = numpy.array([[0.0], [given["turn_rate"]]])  # a column, which all versions accept
        env.step(0.0 * turn)
        ranges = [float(reading) for reading in env.get_lidar_scan()["ranges"]]
        _answer({"name": f"ir-sim {importlib.metadata.version('ir-sim')}", "ranges": ranges})
        for line in sys.stdin:
            _answer(_seconds(env, int(line), turn))


def _seconds(env: Any, ticks: int, command: Any) -> float:
    """CPU time of some ticks with one command, s: motion, laser, collisions, and reading the scan."""
    began = time.thread_time()
    for _ in range(ticks):
        env.step(command)
        env.get_lidar_scan()
    return time.thread_time() - began


def _answer(value: Any) -> None:
    """Print a line of JSON on the real standard output; what ir-sim prints goes to standard error."""
    assert sys.__stdout__ is not None
    sys.__stdout__.write(json.dumps(value) + "\n")
    sys.__stdout__.flush()


if __name__ == "__main__":
    main(sys.argv[1])
