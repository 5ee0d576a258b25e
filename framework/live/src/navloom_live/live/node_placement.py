"""Assigns nodes to processes."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from navloom.config.schema import Config
from navloom.config.tables import OWN_NODES, ROLE_TABLES, WORLD_NODE
from navloom.roles import ROLES

from navloom_live.live.live_node import Source

__all__ = ["are_on_one_host", "goes_first", "spread"]

PLANNING = frozenset(role for role, cls in ROLES.items() if cls.is_patient and not cls.facts.commands)
"""Roles that compute without a deadline: their processes have low priority."""


def goes_first(roles: Collection[str]) -> bool:
    """Whether a process has priority on the CPU: it drives, and neither maps nor plans."""
    return PLANNING.isdisjoint(roles) and any(role in ROLE_TABLES or role in OWN_NODES for role in roles)


def are_on_one_host(config: Config, *nodes: str) -> bool:
    """Whether the config starts these nodes, named as in `live.processes`, on the same host."""
    placed = {node: process for process, held in config.live.processes.items() for node in held}
    wanted = {placed[node] for node in nodes}
    # Without hosts, all processes are on this one.
    return not config.live.hosts or any(wanted <= set(processes) for processes in config.live.hosts.values())


def spread(config: Config, sources: Sequence[Source], host: str | None) -> dict[str, tuple[Source, ...]]:
    """Nodes of each process of a host, or of all hosts. An alternative runs with its role unless it is placed by name.

    The node `world` runs with the platform unless it is placed: then both end together, and no robot drives on among
    bodies that have stopped.

    Args:
        config: The config with its `[live]` table.
        sources: Every instance.
        host: Name of the host; None for all processes.
    """
    placed = {node: process for process, nodes in config.live.processes.items() for node in nodes}
    shares: dict[str, list[Source]] = {process: [] for process in config.live.processes}
    for role, name in sources:
        if role != "operator":
            home = placed["platform"] if role == WORLD_NODE and role not in placed else placed[role]
            shares[placed.get(f"{role}.{name}", home)].append((role, name))
    wanted = config.live.hosts[host] if host is not None else list(shares)
    return {process: tuple(share) for process, share in shares.items() if share and process in wanted}
