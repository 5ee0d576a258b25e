"""`navloom list`: the nodes of a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from navloom.cli.options import AsJson, RobotOptions

from navloom_live.timing import STUCK_AFTER

if TYPE_CHECKING:
    from navloom_live.operating.robot_nodes import Node

__all__ = ["list_nodes"]

QUIET = ("streams", "places", "hosts")
"""Parts of a description that are left out; `navloom graph` and `navloom hz` show them."""
SILENT: dict[str, Any] = {
    **dict.fromkeys(("plugin", "process", "pid", "host", "active", "enabled", "tick", "epoch")),
    **dict.fromkeys(("busy_s", "silence_s", "period_s", "step_s", "shared_memory_mb")),
    "versions": {},
    "published": {},
    "carries": {},
    "clock_ns": -1,
    "faulted": 0,
    "fault": "",
    "config_sha256": "",
    "shares_memory": False,
    "answers": False,
}
"""Fields of a node without a description."""


def list_nodes(
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Print every node of a live robot with its state.

    Also its process and host, and the nodes that are missing.
    """
    from navloom.cli.output import print_json, print_table

    from navloom_live.operating.robot_nodes import missing, present

    with robot.look() as client:
        nodes = present(client)
    if as_json:
        print_json([_fields(node) for node in nodes])
        return
    rows = [_row(node) for node in nodes]
    for gone in missing(nodes):
        rows.append((gone.role, gone.instance, None, gone.process, None, gone.host or None, None, "missing"))
    print_table(("role", "instance", "plugin", "process", "pid", "host", "tick", "state"), rows)


def _fields(node: Node) -> dict[str, Any]:
    """The node as plain values."""
    said = node.description
    if said is None:
        why = {"unreadable": node.unreadable} if node.unreadable else {}
        return SILENT | {"process": node.process, "role": node.role, "instance": node.instance} | why
    return {key: value for key, value in said.to_json().items() if key not in QUIET} | {"answers": True}


def _row(node: Node) -> tuple[Any, ...]:
    """The node as a row of the table; its tick is left out before its first step."""
    said = node.description
    if said is None:
        return (node.role, node.instance, None, node.process, None, None, None, state(node))
    tick = said.tick if said.tick >= 0 else None
    return (node.role, node.instance, said.plugin, said.process, said.pid, said.host, tick, state(node))


def state(node: Node) -> str:
    """State of a node, in words."""
    said = node.description
    if said is None:
        return node.unreadable or "does not answer"
    words = "active" if said.active else "shadow" if said.enabled else "waiting"
    if said.waits_for:
        words += f", waits for {' and '.join(said.waits_for)}"
    if said.faulted:
        words += f", failed {said.faulted} times in a row"
    if said.busy_s is not None and said.busy_s > STUCK_AFTER:
        words += f", {said.busy_s:.1f} s in one step"
    return words
