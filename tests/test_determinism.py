"""The same config and seed give the same bytes, in any process, whatever observes the run."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.plugin_factory import make_plugins
from navloom.runs.episode import Episode
from numba.core.event import install_recorder

Run = Callable[..., Episode]
SHORT = "run.stop_after=12.0"
QUIET = ("platform.noise=false", "sensor.laser.noise=false", "sensor.sonars.noise=false")
SHADOW = 'alternative=[{name="twin",role="avoider",plugin="improved_vfh",max_speed=0.2}]'


def trace(run: Run, *overrides: str) -> str:
    return run(SHORT, *overrides).log.trace_sha256


def run_in_a_process(folder: Path) -> dict[str, object]:
    command = [sys.executable, "-m", "navloom", "run", "paper", "--set", SHORT, "--out", str(folder), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1, done.stderr  # cut short at 12 s: a timeout
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def test_two_processes_agree_with_each_other_and_with_the_file(paper: Run, tmp_path: Path) -> None:
    other = run_in_a_process(tmp_path / "a")
    assert other["trace_sha256"] == trace(paper)
    assert hashlib.sha256((tmp_path / "a" / "trace.bin").read_bytes()).hexdigest() == other["trace_sha256"]


def test_another_seed_gives_another_trace(paper: Run) -> None:
    assert trace(paper) != trace(paper, "run.seed=8")


def test_with_all_noise_off_two_seeds_agree(paper: Run) -> None:
    assert trace(paper, *QUIET) == trace(paper, *QUIET, "run.seed=8")


def test_a_changed_gain_changes_the_trace(paper: Run) -> None:
    assert trace(paper) != trace(paper, "controller.k3=0.7")


def test_a_shadow_does_not_change_the_trace(paper: Run) -> None:
    assert trace(paper) == trace(paper, SHADOW)


def test_no_control_tick_compiles() -> None:
    system = assemble(load_config("paper"))
    make_plugins(system)
    executor = lockstep_of(system)
    with install_recorder("numba:compile") as recorded:
        executor.run(700)
    assert recorded.buffer == []
