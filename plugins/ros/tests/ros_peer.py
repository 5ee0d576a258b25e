"""Controls the peer process of dora-rs (peers/dora_peer.py), for test_ros_peers.py."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parent / "peers" / "dora_peer.py"
ENVIRONMENT = "NAVLOOM_ROS_PEERS"
"""Folder of a virtual environment with the dependency group `ros-peers`."""
BASE, NAME = 1, 2


def environment() -> Path | None:
    """Folder in which the peers are installed; None if they are not."""
    folder = os.environ.get(ENVIRONMENT, "")
    return Path(folder) if folder else None


class DoraError(Exception):
    """An error that the peer reported."""


class Dora:
    """The process. Every operation of `dora_peer.Peer` is a method here."""

    def __init__(self, folder: Path, router: str, described: Path) -> None:
        command = [str(folder / "bin" / "python"), str(SCRIPT), router, str(folder), str(described)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._answer()

    def __getattr__(self, operation: str) -> Any:
        return lambda *arguments: self._ask(operation, *arguments)

    def close(self) -> None:
        """End the process."""
        self.process.stdin.close()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.kill()

    def kill(self) -> None:
        """Kill it, so that it cannot leave the network."""
        self.process.kill()
        self.process.wait(5.0)

    def _ask(self, operation: str, *arguments: Any) -> Any:
        self.process.stdin.write(json.dumps([operation, *arguments]) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        line = self.process.stdout.readline()
        if not line:
            raise DoraError("the peer has ended")
        answer = json.loads(line)
        if "error" in answer:
            raise DoraError(answer["error"].partition("Location:")[0].strip())
        return answer["ok"]


def shape(types: Any, name: str) -> dict[str, Any]:
    """The shape of a type, by field: from it the peer makes the Arrow type."""
    return {field: _shape(types, descriptor) for field, descriptor in types.fields(name)}


def _shape(types: Any, descriptor: Any) -> Any:
    kind, rest = descriptor
    if kind == BASE:
        return rest[0]
    return shape(types, rest) if kind == NAME else [_shape(types, rest[0])]


def arrow(types: Any, name: str, /, **values: Any) -> list[Any]:
    """A message for the peer to send."""
    return [types.plain(types.new(name, **values)), shape(types, name)]
