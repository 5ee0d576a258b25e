"""`navloom list`: the nodes of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from navloom.cli.options import AsJson, RobotOptions

__all__ = ["list_nodes"]

SHOWN = ("plugin", "process", "pid", "host")
LONG = 0.5
"""Duration of a step from which a node counts as busy, s."""
QUIET = ("streams", "places", "hosts")
"""Parts of a description that are left out; `navloom graph` and `navloom hz` show them."""


def list_nodes(
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Print every node of a live robot with its state.

    Also its process and host, and the nodes that are missing.
    """
    from navloom.cli.output import print_json, print_table

    from navloom_live.operating.client import ClientError
    from navloom_live.operating.looking import listing, missing

    with robot.look() as client:
        nodes = listing(client)
    if not nodes:
        raise ClientError(f"no node of robot {client.keys.prefix} is there; `navloom doctor` says why")
    if as_json:
        print_json([{key: value for key, value in node.items() if key not in QUIET} for node in nodes])
        return
    rows = [(n["role"], n["instance"], *(n[key] for key in SHOWN), _tick(n), state(n)) for n in nodes]
    for gone in missing(nodes):
        rows.append((gone.role, gone.instance, None, gone.process, None, gone.host or None, None, "missing"))
    print_table(("role", "instance", *SHOWN, "tick", "state"), rows)


def _tick(node: Mapping[str, Any]) -> int | None:
    """Tick of its last step; None before the first."""
    tick: int | None = node["tick"]
    return None if tick is None or tick < 0 else tick


def state(node: Mapping[str, Any]) -> str:
    """State of a node, in words."""
    if not node["answers"]:
        return "does not answer"
    words = "active" if node["active"] else "shadow" if node["enabled"] else "waiting"
    if waits_for := node.get("waits_for"):
        words += f", waits for {' and '.join(waits_for)}"
    if node["faulted"]:
        words += f", failed {node['faulted']} times in a row"
    if (node["busy_s"] or 0.0) > LONG:
        words += f", {node['busy_s']:.1f} s in one step"
    return words
