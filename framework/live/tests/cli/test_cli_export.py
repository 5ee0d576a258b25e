"""`navloom export systemd` as people and scripts use it, and the commands of its units as systemd runs them."""

from __future__ import annotations

import json
import os
import shlex
import signal
import socket
import subprocess
import tempfile
from pathlib import Path

import pytest
from navloom.config import ConfigError
from navloom_live.cli.export import app
from typer.testing import CliRunner

RUNNER = CliRunner()
CONFIG = """
[world]
ref = "empty"

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "laser"
kind = "pitched_laser"

[[sensor]]
name = "sonars"
kind = "sonar_ring"

[live]
router = "tcp/127.0.0.1:7447"
hosts = { base = ["robot", "safe"], brain = ["think", "drive"] }
"""


def run(*words: str) -> str:
    done = RUNNER.invoke(app, ["systemd", *words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def lines_of(path: Path) -> dict[str, str]:
    pairs = (line.partition("=") for line in path.read_text("utf-8").splitlines() if "=" in line)
    return {name: value for name, _, value in pairs}


def test_it_prints_how_to_install_the_units(tmp_path: Path) -> None:
    said = run("paper", "--out", str(tmp_path / "units"))
    assert f"5 units in {tmp_path / 'units'}." in said
    assert "sudo systemctl enable --now navloom-lab-r1.target" in said
    assert len(list((tmp_path / "units").iterdir())) == 5


def test_a_host_has_its_share_and_runs_it_from_the_configs_folder(tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(CONFIG, "utf-8")
    found = json.loads(run(str(config), "--host", "base", "--user", "robot", "--out", str(tmp_path), "--json"))
    assert found == {
        "folder": str(tmp_path),
        "units": ["navloom-lab-r1-robot.service", "navloom-lab-r1-safe.service", "navloom-lab-r1.target"],
    }
    unit = lines_of(tmp_path / "navloom-lab-r1-robot.service")
    assert unit["WorkingDirectory"] == str(tmp_path) and unit["User"] == "robot"
    assert shlex.split(unit["ExecStart"])[1:] == ["node", str(config), "robot", "--here"]


def test_units_of_a_robot_that_cannot_drive_are_refused_and_nothing_is_written(tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(CONFIG + "\n[run]\nperiod = 0.2\n", "utf-8")
    with pytest.raises(ConfigError, match=r"gate\.stop_deadline: is 0\.1 s; expected more than run\.period = 0\.2 s"):
        run(str(config), "--host", "base", "--out", str(tmp_path / "units"))
    assert not (tmp_path / "units").exists()


def test_an_unknown_host_is_refused_by_name(tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(CONFIG, "utf-8")
    with pytest.raises(ConfigError, match="--host bas: hosts are base, brain"):
        run(str(config), "--host", "bas", "--out", str(tmp_path))
    with pytest.raises(ConfigError, match=r"--host base: the config has no \[live.hosts\]"):
        run("paper", "--host", "base", "--out", str(tmp_path))


@pytest.mark.parametrize("user", ["two words", "x\nExecStartPre=/bin/true", "", "-u"])
def test_a_user_name_that_systemd_would_refuse_is_refused_and_nothing_is_written(tmp_path: Path, user: str) -> None:
    with pytest.raises(ConfigError, match=r"--user .*: expected the name of a user, or a number"):
        run("paper", f"--user={user}", "--out", str(tmp_path / "units"))
    assert not (tmp_path / "units").exists()


def test_a_units_command_notifies_systemd_when_ready_alive_and_stopping(tmp_path: Path) -> None:
    run("paper", "--out", str(tmp_path))
    command = shlex.split(lines_of(tmp_path / "navloom-lab-r1-safe.service")["ExecStart"])
    with (
        tempfile.TemporaryDirectory(prefix="nl", dir="/tmp") as runtime,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line,
    ):
        line.bind(f"{runtime}/notify")
        line.settimeout(240.0)  # kernels may have to be compiled
        given = {**os.environ, "NOTIFY_SOCKET": f"{runtime}/notify", "NAVLOOM_RUNTIME_DIR": runtime}
        process = subprocess.Popen(command, env=given, stderr=subprocess.DEVNULL)
        try:
            assert [line.recv(64) for _ in range(4)] == [b"READY=1", *[b"WATCHDOG=1"] * 3]
            process.send_signal(signal.SIGTERM)
            while (said := line.recv(64)) == b"WATCHDOG=1":
                continue
            assert said == b"STOPPING=1"
            assert process.wait(30) == 0
        finally:
            process.kill()
            process.wait()
