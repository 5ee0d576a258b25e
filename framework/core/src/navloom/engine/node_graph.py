"""The order in which nodes step, and the errors of a wiring that has none."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

from navloom.engine.node_ports import Input, NodeSpec
from navloom.errors import NavloomError

__all__ = ["GraphError", "edges", "order"]


class GraphError(NavloomError, ValueError):
    """The wiring does not work: an input that leads nowhere, or a cycle without a `~` edge."""


def edges(specs: Sequence[NodeSpec]) -> list[tuple[str, str, Input]]:
    """Every edge as (publishing role, reading role, input).

    Raises:
        GraphError: No node publishes an input, or its port carries another message; the text names both ends.
    """
    ports = {spec.role: {port.name: port for port in spec.ports} for spec in specs}
    found = []
    for spec in specs:
        for given in spec.inputs:
            if given.role not in ports:
                near = get_close_matches(given.role, list(ports), n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"nodes are {', '.join(ports)}"
                raise GraphError(f"{spec.role} reads {given}, but there is no node {given.role!r}; {hint}")
            if given.port not in ports[given.role]:
                near = get_close_matches(given.port, list(ports[given.role]), n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"it publishes {', '.join(ports[given.role])}"
                raise GraphError(f"{spec.role} reads {given}, but {given.role} publishes no {given.port!r}; {hint}")
            carried = ports[given.role][given.port].carries
            # mypy checks this where both ends are code; ports that a config names are known only now.
            if given.source.carries is not carried:
                raise GraphError(
                    f"{spec.role} reads {given} as {given.source.carries.__name__}, but it carries {carried.__name__}"
                )
            found.append((given.role, spec.role, given))
    return found


def order(specs: Sequence[NodeSpec]) -> list[NodeSpec]:
    """The nodes in the order they step within a tick: topological over all edges except `~`, ties in listed order.

    Raises:
        GraphError: A cycle, printed edge by edge, or an input that leads nowhere.
    """
    wires = [(source, target, given) for source, target, given in edges(specs) if not given.delayed]
    left = list(specs)
    placed: list[NodeSpec] = []
    done: set[str] = set()
    while left:
        # The first that is ready in listed order, so that the order of steps is the same in each process.
        ready = next((s for s in left if all(src in done for src, dst, _ in wires if dst == s.role)), None)
        if ready is None:
            raise GraphError(_cycle(wires, {spec.role for spec in left}))
        left.remove(ready)
        placed.append(ready)
        done.add(ready.role)
    return placed


def _cycle(wires: Sequence[tuple[str, str, Input]], among: set[str]) -> str:
    """One cycle among the nodes that could not be placed: walk against the edges until a node repeats."""
    back = {dst: (src, given) for src, dst, given in wires if dst in among and src in among}
    # `min`, because sets have another order in each process and the message must not.
    node = min(among & set(back))
    seen: list[str] = []
    while node not in seen:
        seen.append(node)
        node = back[node][0]
    loop = seen[seen.index(node) :]
    parts = [f"{role} reads {back[role][1]}" for role in loop]
    return f"cycle without a ~ edge: {'; '.join(parts)}. Mark one of these inputs ~ to read the previous tick"
