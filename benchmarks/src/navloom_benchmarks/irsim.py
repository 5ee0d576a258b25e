"""The peer of `navloom bench --barn`: ir-sim, under whatever interpreter has it.

`PYTHON -I bench_irsim.py SCENE.json`: makes the scene, gives `{"name": …, "ranges": […]}` on a line, the ranges as they
are read at the start, m; then answers each number of ticks on standard input with the CPU seconds they took. Standard
library, ir-sim and what it brings only.
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
    """A scene as ir-sim's YAML has it; JSON is YAML.

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
    """Serve until standard input ends."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    with contextlib.redirect_stdout(sys.stderr), tempfile.TemporaryDirectory() as folder:
        irsim, numpy = importlib.import_module("irsim"), importlib.import_module("numpy")
        given = json.loads(Path(path).read_text("utf-8"))
        scene = Path(folder) / "scene.yaml"
        scene.write_text(json.dumps(scene_of(given)), "utf-8")
        env = irsim.make(str(scene), display=False, log_level="ERROR")
        turn = numpy.array([[0.0], [given["turn_rate"]]])  # a column, which all versions take
        env.step(0.0 * turn)
        ranges = [float(reading) for reading in env.get_lidar_scan()["ranges"]]
        _answer({"name": f"ir-sim {importlib.metadata.version('ir-sim')}", "ranges": ranges})
        for line in sys.stdin:
            _answer(_seconds(env, int(line), turn))


def _seconds(env: Any, ticks: int, command: Any) -> float:
    """CPU time of so many ticks with one command: drive, laser, collisions, and the scan read."""
    began = time.thread_time()
    for _ in range(ticks):
        env.step(command)
        env.get_lidar_scan()
    return time.thread_time() - began


def _answer(value: Any) -> None:
    """One line of JSON on the standard output that the package's own chatter is kept from."""
    assert sys.__stdout__ is not None
    sys.__stdout__.write(json.dumps(value) + "\n")
    sys.__stdout__.flush()


if __name__ == "__main__":
    main(sys.argv[1])
