"""Units for systemd, and the notifications of a process."""

from __future__ import annotations

import inspect
import shutil
import socket
import subprocess
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom_live.hosting.network import network_of
from navloom_live.hosting.node_process import NodeProcess, Share
from navloom_live.hosting.systemd import UnitCommand, notify, units
from navloom_live.transport.links import Link

ROUTED = (
    'live.router="tls/10.0.0.1:7447"',
    'live.router_host="base"',
    'live.keys="/etc/robot keys"',
    'live.hosts={base=["robot", "safe"], brain=["think", "drive"]}',
)
COMMAND = UnitCommand(Path("/opt/navloom/bin/navloom"), "/etc/robot/r1.toml", Path("/etc/robot"), "robot")


def made(host: str | None, *overrides: str, command: UnitCommand = COMMAND) -> dict[str, str]:
    loaded = load_config("paper", overrides)
    return units(assemble(loaded), network_of(loaded.config, host, command.insecure), host, command)


def setting(text: str, name: str) -> str:
    return next(line.partition("=")[2] for line in text.splitlines() if line.startswith(f"{name}="))


def test_each_process_has_a_unit_and_the_target_wants_them_all() -> None:
    found = made(None)
    names = [f"navloom-lab-r1-{process}.service" for process in ("robot", "think", "drive", "safe")]
    assert list(found) == [*names, "navloom-lab-r1.target"]
    assert setting(found["navloom-lab-r1.target"], "Wants").split() == names
    drive = found["navloom-lab-r1-drive.service"]
    assert setting(drive, "ExecStart") == "/opt/navloom/bin/navloom node /etc/robot/r1.toml drive"
    assert setting(drive, "Type") == "notify" and setting(drive, "Restart") == "always"
    assert setting(drive, "User") == "robot" and setting(drive, "PartOf") == "navloom-lab-r1.target"


def test_the_computing_processes_end_first_then_the_gate_then_the_platform() -> None:
    found = made(None)
    after = {name: setting(text, "After").split()[1:] for name, text in found.items() if name.endswith(".service")}
    assert after == {
        "navloom-lab-r1-robot.service": [],
        "navloom-lab-r1-safe.service": ["navloom-lab-r1-robot.service"],
        "navloom-lab-r1-think.service": ["navloom-lab-r1-robot.service", "navloom-lab-r1-safe.service"],
        "navloom-lab-r1-drive.service": ["navloom-lab-r1-robot.service", "navloom-lab-r1-safe.service"],
    }


def test_control_has_priority_and_the_shorter_watchdog() -> None:
    found = made(None, "live.hang_timeout=1.5", "live.restart_limit=3", "live.restart_window=20.0")
    safe, think = found["navloom-lab-r1-safe.service"], found["navloom-lab-r1-think.service"]
    assert setting(safe, "Nice") == "-10" and "Nice=" not in think
    assert setting(safe, "WatchdogSec") == "1.5" and setting(think, "WatchdogSec") == "30"
    assert setting(think, "MemoryMax") == "4G" and setting(think, "TasksMax") == "512"
    assert setting(safe, "StartLimitBurst") == "4" and setting(safe, "StartLimitIntervalSec") == "20"


def test_the_router_is_on_its_own_host_alone() -> None:
    base, brain = made("base", *ROUTED), made("brain", *ROUTED)
    assert set(base) == {
        "navloom-lab-r1-router.service",
        "navloom-lab-r1-robot.service",
        "navloom-lab-r1-safe.service",
        "navloom-lab-r1.target",
    }
    assert set(brain) == {
        "navloom-lab-r1-think.service",
        "navloom-lab-r1-drive.service",
        "navloom-lab-r1.target",
    }
    router = setting(base["navloom-lab-r1-router.service"], "ExecStart")
    assert router == ('/opt/navloom/bin/navloom router tls/10.0.0.1:7447 --robot lab/r1 --keys "/etc/robot keys"')
    assert "navloom-lab-r1-router.service" in setting(base["navloom-lab-r1-robot.service"], "After")
    safe = setting(base["navloom-lab-r1-safe.service"], "ExecStart")
    assert safe == "/opt/navloom/bin/navloom node /etc/robot/r1.toml safe --here"


def test_nothing_in_a_path_is_expanded() -> None:
    odd = replace(COMMAND, config='/srv/50% "off"/$HOME.toml', insecure=True)
    text = made(None, command=odd)["navloom-lab-r1-safe.service"]
    assert setting(text, "ExecStart") == (
        '/opt/navloom/bin/navloom node "/srv/50%% \\"off\\"/$$HOME.toml" safe --insecure'
    )


def test_a_host_without_a_process_and_a_process_called_router_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"live\.hosts\.idle: no process runs on this host"):
        made("idle", 'live.hosts={all=["robot", "safe", "think", "drive"], idle=[]}')
    renamed = (
        'live.processes={router=["platform", "localizer", "mapper", "planner", "goal", "reference", "controller", '
        '"avoider", "recovery", "gate"]}'
    )
    with pytest.raises(ConfigError, match=r"live\.processes\.router"):
        made(None, renamed, 'live.router="tcp/127.0.0.1:7447"')


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_finds_nothing_wrong_with_them(tmp_path: Path) -> None:
    runs = replace(COMMAND, navloom=Path(shutil.which("true") or "/bin/true"), folder=tmp_path, user="root")
    for name, text in made("base", *ROUTED, command=runs).items():
        (tmp_path / name).write_text(text, "utf-8")
    files = [str(path) for path in tmp_path.iterdir()]
    done = subprocess.run(["systemd-analyze", "verify", *files], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and str(tmp_path) not in done.stderr, done.stderr


@pytest.mark.parametrize("is_abstract", [False, True], ids=["file", "abstract"])
def test_a_state_goes_to_the_socket_that_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_abstract: bool
) -> None:
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        line.bind("\0" + path if is_abstract else path)
        line.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", "@" + path if is_abstract else path)
        notify("READY=1")
        assert line.recv(64) == b"READY=1"


def test_without_a_service_manager_nothing_is_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    notify("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    notify("READY=1")
    assert list(tmp_path.iterdir()) == []


def _runner(stepper: Any) -> Any:
    return SimpleNamespace(cell=SimpleNamespace(stepper=stepper))


class Stuck:
    """A plugin that waits in its verb."""

    def __init__(self) -> None:
        self.ends = threading.Event()

    def control(self) -> None:
        self.ends.wait()


def test_the_line_in_which_a_plugin_hangs_is_named() -> None:
    process = NodeProcess(assemble(load_config("paper", ["live.hang_timeout=0.1"])), Share("x", (), Link("peer")))
    plugin = Stuck()
    thread = threading.Thread(target=plugin.control, name="controller lyapunov_tracker")
    thread.start()
    stepper = SimpleNamespace(active=True, busy_since_ns=time.monotonic_ns(), node=SimpleNamespace(plugin=plugin))
    process.runners = {("controller", "lyapunov_tracker"): _runner(stepper)}
    process._watch([], lambda: None)
    plugin.ends.set()
    thread.join()
    line = inspect.getsourcelines(Stuck.control)[1] + 1
    place = f"it is at {Path(__file__).name}:{line}, in control"
    assert process.hung == f"controller lyapunov_tracker has been in one step for 0.1 s: {place}"


def test_the_watchdog_is_fed_until_an_active_node_hangs() -> None:
    process = NodeProcess(assemble(load_config("paper", ["live.hang_timeout=0.3"])), Share("x", (), Link("peer")))
    stepper = SimpleNamespace(active=True, busy_since_ns=None, node=None)
    process.runners = {("controller", "lyapunov_tracker"): _runner(stepper)}
    fed: list[float] = []

    def alive() -> None:
        fed.append(time.monotonic())
        if len(fed) == 2:
            stepper.busy_since_ns = time.monotonic_ns()

    process._watch([], alive)
    assert len(fed) >= 2
    assert process.hung == "controller lyapunov_tracker has been in one step for 0.3 s"
    assert stepper.busy_since_ns is not None and fed[-1] - stepper.busy_since_ns * 1e-9 <= 0.3
