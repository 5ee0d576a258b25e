"""A recorder is killed with SIGKILL at random moments, while a robot is published from a recording."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from navloom.cli.main import app
from navloom_recording.reader import Recording
from typer.testing import CliRunner

pytestmark = pytest.mark.slow  # 20 recorders are started, and killed
KILLS = 20
COMMAND = [sys.executable, "-m", "navloom"]


@pytest.fixture
def published(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Publishes the paper's run, slowly enough to last."""
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "r"))
    source = tmp_path / "source.mcap"
    CliRunner().invoke(app, ["run", "paper", "--record", str(source)])
    command = [*COMMAND, "replay", str(source), "--live", "--speed", "0.1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as player:
        assert player.stderr is not None and "publishing" in player.stderr.readline()
        yield
        player.terminate()


def test_a_killed_recorder_leaves_a_file_that_opens_and_lacks_a_second_at_most(published: None, tmp_path: Path) -> None:
    draw = random.Random(5)
    lost = []
    for number in range(KILLS):
        out = tmp_path / f"{number}.mcap"
        command = [*COMMAND, "record", "--robot", "replay/r1", "--out", str(out)]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as recorder:
            assert recorder.stderr is not None and "recording" in recorder.stderr.readline()
            with pytest.raises(subprocess.TimeoutExpired):
                recorder.wait(draw.uniform(0.8, 2.5))
            os.kill(recorder.pid, signal.SIGKILL)
            killed_ns = time.time_ns()
        recording = Recording(out)
        found = list(recording.messages())
        lost.append((killed_ns - found[-1].received_ns) * 1e-9)
        numbers = defaultdict(list)
        for message in found:
            numbers[message.key].append(message.envelope.sequence)
        assert recording.malformed == 0 and not recording.is_complete
        assert all(runs == list(range(runs[0], runs[0] + len(runs))) for runs in numbers.values())
    print("lost, s:", " ".join(f"{seconds:.2f}" for seconds in sorted(lost)))
    assert max(lost) < 1.0
