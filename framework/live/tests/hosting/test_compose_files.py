"""`navloom export compose`: services with existing commands, on loopback and without privileges."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import typer.main
import yaml
from navloom.cli.main import app
from navloom.config import load_config
from navloom_live.hosting.network import network_of

Command = Callable[..., tuple[int, str, str]]
CONFIG = """
[platform]
plugin = "sensors_sim"

[world]
ref = "empty"
"""


def exported(in_process: Command, *words: str) -> tuple[dict[str, Any], str]:
    """The services, and the container file."""
    code, said, errors = in_process("export", "compose", *words, "--json")
    assert code == 0, errors
    folder = Path(json.loads(said)["folder"])
    assert (folder / "wheels").is_dir()
    return yaml.safe_load((folder / "compose.yaml").read_text("utf-8")), (folder / "Containerfile").read_text("utf-8")


def unknown_options(command: list[str]) -> list[str]:
    """Options that the command line does not have."""
    known: Any = typer.main.get_command(app)
    found = known.whole()[command[0]]
    options = {name for param in found.params for name in param.opts}
    return [word for word in command if word.startswith("--") and word not in options]


def starts_router(command: list[str], config: Path) -> bool:
    """Whether `navloom up` with these words starts the router itself."""
    given = dict(pairwise(command))
    changes = [value for word, value in pairwise(command) if word == "--set"]
    return network_of(load_config(str(config), changes).config, given.get("--host"), insecure=False).starts_router


def test_a_robot_with_one_named_host_uses_the_router_of_its_service(tmp_path: Path, in_process: Command) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(CONFIG + '[live]\nhosts = { base = ["robot", "safe", "think", "drive"] }\n', "utf-8")
    for words, host in (([], "robot"), (["--host", "base"], "base")):
        tree, _ = exported(in_process, str(config), *words, "--out", str(tmp_path / "d"))
        command = tree["services"]["robot"]["command"]
        assert "router" in tree["services"] and not starts_router(command, config)
        assert command[command.index("--host") + 1] == host


def test_router_robot_viewer_and_metrics_share_the_loopback(tmp_path: Path, in_process: Command) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(CONFIG, "utf-8")
    tree, build = exported(in_process, str(config), "--out", str(tmp_path / "d"), "--device", "/dev/ttyUSB0")
    services = tree["services"]
    assert list(services) == ["router", "robot", "viewer", "metrics"] and tree["name"] == "navloom-lab-r1"
    for service in services.values():
        assert unknown_options(service["command"]) == []
        assert service["network_mode"] == "host" and service["cap_drop"] == ["ALL"] and service["read_only"]
        assert "ports" not in service and "0.0.0.0" not in str(service) and "privileged" not in service
    assert services["router"]["command"][:2] == ["router", "tcp/127.0.0.1:7447"]
    assert services["robot"]["command"][:2] == ["up", "/robot/robot.toml"]
    assert starts_router(services["robot"]["command"], config) is False  # the router's service has the port
    assert services["robot"]["devices"] == ["/dev/ttyUSB0:/dev/ttyUSB0"] and "devices" not in services["viewer"]
    assert f"{tmp_path}:/robot:ro" in services["robot"]["volumes"]
    for name in ("navloom[view]==", "navloom-sensors-sim==", "navloom-astar=="):
        assert f'"{name}' in build
    assert "USER robot" in build


def test_a_config_with_its_own_router_keeps_router_and_keys(tmp_path: Path, in_process: Command) -> None:
    config = tmp_path / "robot.toml"
    live = '[live]\nrouter = "tls/10.0.0.5:7447"\nrouter_host = "base"\nkeys = "keys"\n'
    hosts = 'hosts = { base = ["robot", "safe"], brain = ["think", "drive"] }\n'
    config.write_text(CONFIG + live + hosts, "utf-8")
    base, _ = exported(in_process, str(config), "--host", "base", "--out", str(tmp_path / "base"))
    brain, _ = exported(in_process, str(config), "--host", "brain", "--out", str(tmp_path / "brain"))
    for tree, host in ((base, "base"), (brain, "brain")):
        assert list(tree["services"]) == ["robot", "viewer", "metrics"]  # `up` starts it on its host
        words = tree["services"]["robot"]["command"]
        assert starts_router(words, config) is (host == "base")
        assert words[words.index("--host") + 1] == host and "live.keys=/keys" in words
        assert "tls/10.0.0.5:7447" in tree["services"]["viewer"]["command"]
        assert any(volume.endswith("/keys:/keys:ro") for volume in tree["services"]["metrics"]["volumes"])


def test_a_shipped_config_needs_no_mount_and_an_unknown_host_is_refused(tmp_path: Path, in_process: Command) -> None:
    tree, _ = exported(in_process, "paper", "--out", str(tmp_path))
    assert tree["services"]["robot"]["command"][1] == "paper" and len(tree["services"]["robot"]["volumes"]) == 1
    code, _, errors = in_process("export", "compose", "paper", "--host", "base", "--out", str(tmp_path))
    assert code == 2 and "--host base: the config has no [live.hosts]" in errors
