"""A robot of dora-rs, with physics of its own, driven by the unchanged stack; `campaign_ros2_base.py` has the whole."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from ros_peer import environment

PEERS = environment()
CAMPAIGN = Path(__file__).parent / "campaign_ros2_base.py"


@pytest.mark.slow
@pytest.mark.skipif(PEERS is None, reason="needs NAVLOOM_ROS_PEERS: a venv with the group ros-peers")
def test_it_reaches_five_goals_and_stops_when_it_is_broken(tmp_path):
    out, faults = tmp_path / "out.json", ["kill robot", "stop robot", "kill up", "cut our link"]
    command = [sys.executable, str(CAMPAIGN), str(PEERS), "--each", "1", "--out", str(out), "--only", *faults]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads(out.read_text())
    assert [goal["outcome"] for goal in report["goals"]] == ["succeeded"] * 5
    assert max(goal["true_error_m"] for goal in report["goals"]) < 0.3  # the tolerance, and 0.1 m
    assert {name: entry["missed"] for name, entry in report["faults"].items()} == dict.fromkeys(faults, 0)
