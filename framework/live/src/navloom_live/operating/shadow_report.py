"""How much the shadows of a live robot differ from its active instances, as `navloom up` compares them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

from navloom.engine.difference_units import UNITS
from navloom.engine.shadow_state import ShadowState
from navloom.inputs.typed_json import from_builtins

from navloom_live.operating.client import Client
from navloom_live.operating.robot_nodes import Node, answering
from navloom_live.transport.keyspace import SUPERVISOR

__all__ = ["COLUMNS", "cells_of", "differing_text", "shadows_of", "sizes_text"]

COLUMNS = ("in shadow", "against", "ticks", "differing", "now", "mean", "would stop", "hands over otherwise")
"""Head of a table of shadows, a row for each `cells_of`."""

LEAST = 5e-4
"""Smallest difference that is printed as different from 0, in its unit."""


def shadows_of(client: Client, nodes: Sequence[Node]) -> list[ShadowState]:
    """Each shadow that steps, with its comparison so far.

    A shadow that `navloom up` does not compare, or of a robot without one, has no `ticks`.
    """
    found = {
        (node.role, node.instance): ShadowState(node.role, node.instance)
        for node in answering(nodes)
        if node.plugin and not node.active and node.enabled
    }
    for answer in client.bus.ask(client.keys.process(SUPERVISOR, "shadows"), timeout=1.0) if found else ():
        for given in [] if answer.refusal else json.loads(answer.data):
            state = from_builtins(ShadowState, given)
            if (state.role, state.instance) in found:
                found[state.role, state.instance] = state
    return list(found.values())


def cells_of(state: ShadowState) -> tuple[str, ...]:
    """The comparison of a shadow as text, in the order of COLUMNS; "-" where there is nothing to compare."""
    name = f"{state.role} {state.instance}"
    if not state.ticks:
        return (name, *["-"] * (len(COLUMNS) - 1))
    handovers = f"{state.handovers} ticks" if state.role == "avoider" else "-"
    share = f"{100.0 * (state.differing_share or 0.0):.0f} %"
    stops = f"{state.stops} ticks" if "vx" in state.mean else "-"
    sizes = sizes_text(state.now), sizes_text(state.mean)
    return (name, str(state.against), str(state.ticks), share, *sizes, stops, handovers)


def differing_text(state: ShadowState) -> str:
    """The comparison of a shadow on one line."""
    if not state.ticks:
        return "nothing to compare so far" if state.ticks is not None else "not compared"
    _, against, ticks, share, now, mean, stops, handovers = cells_of(state)
    more = [f"would have stopped in {stops}"] if state.stops else []
    more += [f"would have handed over otherwise in {handovers}"] if state.handovers else []
    return "; ".join([f"differs from {against} in {share} of {ticks} ticks", f"now {now}", f"mean {mean}", *more])


def sizes_text(sizes: Mapping[str, float]) -> str:
    """Differences with their units: speeds in m/s, turn rates in deg/s, others by name; sideways only if any."""
    texts = []
    for name, size in sizes.items():
        size = size if abs(size) >= LEAST else 0.0  # no -0.00
        if name == "wz":
            texts.append(f"{math.degrees(size):.1f} deg/s")
        elif name == "vx" or (name == "vy" and size):
            texts.append(f"{size:.2f} m/s{' sideways' if name == 'vy' else ''}")
        elif name != "vy":
            texts.append(f"{name} {size:.3g}{'' if UNITS[name] == '1' else ' ' + UNITS[name]}")
    return ", ".join(texts) or "-"
