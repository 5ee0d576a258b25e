"""A live run of the paper, recorded by another process, replays bit for bit, with and without the barrier."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from navloom.cli.main import app
from navloom_recording.reader import Recording
from typer.testing import CliRunner

pytestmark = pytest.mark.slow  # starts all processes of a robot, twice


@pytest.mark.parametrize(
    ("kind", "options"),
    [("barrier", ("--barrier",)), ("live", ()), ("live", ("--set", "sensor.0.mode=continuous"))],
    ids=["barrier", "free", "mapping from the first tick on"],
)
def test_a_live_recording_replays_bit_for_bit(
    kind: str, options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "r"))
    out = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "navloom", "up", "paper", *options, "--record", str(out), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    result = json.loads(done.stdout)
    assert result["truly_reached"], done.stderr
    recording = Recording(out)
    assert recording.header.kind == kind and recording.is_complete
    assert recording.counts()["dropped"] == {} and recording.counts()["malformed"] == {}
    checked = CliRunner().invoke(app, ["replay", str(out), "--check", "--json"])
    found = json.loads(checked.stdout)
    assert checked.exit_code == 0 and found["first_difference"] is None
    # In each tick localizer, reference, controller and gate say one thing, the avoider three, while there is a path.
    assert sum(node["messages"] for node in found["nodes"]) > 6 * result["ticks"] > 3000
