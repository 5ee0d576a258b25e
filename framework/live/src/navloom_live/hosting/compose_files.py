"""A robot in containers: a compose file for router, robot, viewer and metrics, and the file that builds the image."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from navloom_live.hosting.network import Network
from navloom_live.timing import CONTAINER_STOP_LIMIT

__all__ = ["Compose", "compose_files"]

ROUTER = "tcp/127.0.0.1:7447"
"""Endpoint of the router if the config names none: with the host's network, only this host can reach it."""
CONFIGS, KEYS, CACHE = "/robot", "/keys", "/home/robot/.cache"
"""Folders in the containers for the config, the certificates and compiled kernels."""
HOST = "robot"
"""Name of the host of all processes, if the command names none."""
PYTHON = "3.12"


@dataclass(frozen=True)
class Compose:
    """Contents of the files.

    Attributes:
        config: The config's file; None for a shipped one.
        name: The config as the command names it: the file's name, or a shipped name.
        distributions: Version of each distribution to install in the image, by name.
        image: Name of the image.
        processes: The robot's processes.
        devices: Device files that the robot opens.
    """

    config: Path | None
    name: str
    distributions: Mapping[str, str]
    image: str
    processes: Sequence[str]
    devices: Sequence[str] = field(default=())


def compose_files(network: Network, host: str | None, given: Compose) -> dict[str, str]:
    """Text of each file by its name: `compose.yaml`, `Containerfile`, `.containerignore`.

    Args:
        network: The robot's network.
        host: Host of the config's `[live.hosts]`; None for all.
        given: Contents of the files.
    """
    robot = f"{network.realm}/{network.robot}"
    router = network.router or ROUTER
    secured = ["--insecure"] * network.insecure
    tool = ["--connect", router, "--robot", robot, *(["--keys", KEYS] if network.keys else []), *secured]
    config = f"{CONFIGS}/{given.name}" if given.config is not None else given.name
    # As JSON lines, because containers' logs are collected by machines.
    up = ["up", config, "--log-json", *secured]
    if not network.router:
        up += ["--set", f"live.router={router}"]
        if host is None:  # without a named host, `up` would start the router too
            host = HOST
            up += ["--set", f"live.hosts={{ {HOST} = {json.dumps(list(given.processes))} }}"]
    if host is not None:
        up += ["--host", host]
    if network.keys:
        up += ["--set", f"live.keys={KEYS}"]
    services = {
        "router": ["router", *tool[1:], "--log-json"],
        "robot": up,
        "viewer": ["view", "--web", *tool],
        "metrics": ["metrics", *tool],
    }
    if network.router and (network.starts_router or host is not None):
        del services["router"]  # `up` starts it, or another host has it
    # Compiled kernels outlive the container, which would otherwise compile for minutes at each start.
    mounts = [f"cache:{CACHE}"]
    if given.config is not None:
        mounts.append(f"{given.config.absolute().parent}:{CONFIGS}:ro")
    if network.folder is not None:
        mounts.append(f"{network.folder.absolute()}:{KEYS}:ro")
    tree = {
        "name": f"navloom-{network.realm}-{network.robot}".lower(),
        "services": {name: _service(name, words, given, mounts, services) for name, words in services.items()},
        "volumes": {"cache": {}},
    }
    head = f"# Robot {robot}: docker compose up --build. Nothing listens off this host unless live.router says so.\n"
    return {
        "compose.yaml": head + yaml.safe_dump(tree, sort_keys=False, width=120),
        "Containerfile": _containerfile(given),
        ".containerignore": "*\n!wheels\n",
    }


def _service(
    name: str, words: Sequence[str], given: Compose, mounts: Sequence[str], services: Mapping[str, Any]
) -> dict[str, Any]:
    """A container without privileges, on the host's network, where it listens only on the loopback interface."""
    service: dict[str, Any] = {
        "image": given.image,
        "command": list(words),
        # Between containers' own networks, the router would have to listen on an interface that others reach.
        "network_mode": "host",
        "restart": "unless-stopped",
        # A process that reaps orphans must be there: `navloom` is not always the subreaper.
        "init": True,
        "stop_grace_period": f"{CONTAINER_STOP_LIMIT:g}s",
        "read_only": True,
        # The root is read-only, and the runtime folder with the sockets is in /tmp.
        "tmpfs": ["/tmp"],
        "cap_drop": ["ALL"],
        "security_opt": ["no-new-privileges:true"],
        "volumes": list(mounts),
    }
    if name == "robot":
        service["build"] = {"context": ".", "dockerfile": "Containerfile"}
        service["healthcheck"] = {"test": ["CMD", "navloom", "status"], "interval": "10s", "start_period": "180s"}
        if given.devices:
            service["devices"] = [f"{device}:{device}" for device in given.devices]
            # Serial ports of Debian's images belong to this group.
            service["group_add"] = ["dialout"]
    needed = {"robot": ["router"], "viewer": ["robot"], "metrics": ["robot"]}.get(name, [])
    if depends := [one for one in needed if one in services]:
        service["depends_on"] = depends
    return service


def _containerfile(given: Compose) -> str:
    names = [f'"navloom[view]=={given.distributions["navloom"]}"']
    names += [f'"{name}=={version}"' for name, version in sorted(given.distributions.items()) if name != "navloom"]
    listed = " \\\n        ".join(names)
    return f"""\
# Wheels that are on no index go into the folder wheels/, beside this file.
FROM docker.io/library/python:{PYTHON}-slim
COPY wheels /wheels
RUN pip install --no-cache-dir --find-links /wheels \\
        {listed}
RUN useradd --uid 1000 --create-home robot && mkdir {CACHE} && chown robot {CACHE}
USER robot
WORKDIR {CONFIGS}
ENV NAVLOOM_RUNTIME_DIR=/tmp/navloom PYTHONUNBUFFERED=1
ENTRYPOINT ["navloom"]
"""
