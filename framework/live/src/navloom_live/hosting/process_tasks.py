"""Descriptions of the processes that a supervisor starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from navloom.config import Loaded

from navloom_live.hosting.node_main import share_to_json
from navloom_live.hosting.node_process import Share, longest_seizure
from navloom_live.hosting.process_setup import link_to_json
from navloom_live.transport.links import Link

__all__ = ["NODE", "ProcessTask", "node_task", "router_task"]

NODE = "navloom_live.hosting.node_main"
"""Module of a process with nodes."""


@dataclass(frozen=True)
class ProcessTask:
    """Description of a process to start.

    Attributes:
        name: Name of the process.
        module: Python module that is run with the path of a JSON file.
        given: Contents of the file.
        roles: Roles of its nodes, for the order in which processes end.
        patience: How long one of its nodes may hold the GIL, s; None for no limit.
    """

    name: str
    module: str
    given: Mapping[str, Any]
    roles: frozenset[str] = frozenset()
    patience: float | None = None


def node_task(loaded: Loaded, share: Share) -> ProcessTask:
    """The process of a share."""
    given = {"loaded": loaded.to_json(), "share": share_to_json(share)}
    roles = frozenset(role for role, _ in share.sources)
    # Ticks under the barrier have no deadline.
    patience = None if share.barrier else longest_seizure(share.sources, loaded.config.live.hang_timeout)
    return ProcessTask(share.name, NODE, given, roles, patience)


def router_task(link: Link) -> ProcessTask:
    """The process of a router."""
    return ProcessTask("router", "navloom_live.hosting.router_main", {"link": link_to_json(link)})
