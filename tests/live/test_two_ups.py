"""Two starts of one robot: behind one router, and from two shells of one user."""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path

import pytest
from live_rig import COMMAND, EMPTY, Up, runtime_folder, up

HOSTS = """
[live]
router = "{end}"
router_host = "hub"
hosts = {{ base = ["robot", "think", "drive", "safe"], hub = [] }}
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_a_copy_of_a_robot_behind_the_same_router_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    config = tmp_path / "copied.toml"
    config.write_text(EMPTY + HOSTS.format(end=f"tcp/127.0.0.1:{free_port()}"), "utf-8")
    with up(str(config), "--host", "hub"), up(str(config), "--host", "base") as first:
        first.wait_for("every node is there")
        with runtime_folder() as other:  # that of the other computer
            copy = Up(other, [str(config), "--host", "base"])
            assert copy.process.wait(60) == 2
            copy.wait_for(f"runs already on host {socket.gethostname()}, process {first.process.pid}, since 2")
        assert first.json("doctor")["healthy"]
        assert first.process.poll() is None


@pytest.mark.slow
def test_a_second_start_from_a_shell_without_xdg_runtime_dir_is_refused(tmp_path: Path) -> None:
    config = tmp_path / "shells.toml"
    name = f"r{os.getpid()}-{free_port()}"
    config.write_text(f'{EMPTY}\n[robot]\nname = "{name}"\n', "utf-8")
    plain = {key: value for key, value in os.environ.items() if not key.endswith("RUNTIME_DIR")}
    with runtime_folder() as folder:
        first = Up(folder, [str(config)], {**plain, "XDG_RUNTIME_DIR": str(folder)})
        try:
            first.wait_for("every node is there")
            second = subprocess.run(
                [*COMMAND, "up", str(config)],
                env={**plain, "TMPDIR": str(folder)},
                capture_output=True,
                text=True,
                timeout=60,
                check=False,
            )
            assert second.returncode == 2 and f", process {first.process.pid}, since 2" in second.stderr
        finally:
            first.end()
