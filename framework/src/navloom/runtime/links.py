"""How a process joins a robot's network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any


class LinkError(ValueError):
    """A link that is refused."""


@dataclass(frozen=True)
class Link:
    """How a process joins a robot's network."""

    mode: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    credentials: Path | None = None
    identity: str | None = None
    insecure: bool = False
    realm: str = "lab"
    robot: str = "r1"


def settings(link: Link) -> dict[str, Any]:
    """What goes into zenoh's configuration."""
    return {
        "mode": link.mode,
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "listen": {"endpoints": list(link.listen)},
        "connect": {
            "endpoints": list(link.connect),
            "timeout_ms": -1 if link.mode != "client" else 300,
            "exit_on_failure": link.mode == "client",
            "retry": {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 2},
        },
        "transport": {"link": {"tx": {"lease": 1000, "keep_alive": 4}}},
    }
