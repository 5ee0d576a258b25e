"""How much the shadows of a live robot differ from its active instances, as `navloom up` compares them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from navloom.engine.difference_units import UNITS

from navloom_live.operating.client import Client
from navloom_live.transport.keyspace import SUPERVISOR

__all__ = ["COLUMNS", "cells_of", "differing_text", "shadows_of", "sizes_text"]

COLUMNS = ("in shadow", "against", "ticks", "differing", "now", "mean", "would stop", "hands over otherwise")
"""Head of a table of shadows, a row for each `cells_of`."""

LEAST = 5e-4
"""Smallest difference that is printed as different from 0, in its unit."""


def shadows_of(client: Client, nodes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each shadow that steps, with its comparison so far, see `recording.shadows.Disagreement.so_far`.

    A shadow that `navloom up` does not compare, or of a robot without one, has no `ticks`.
    """
    found: dict[tuple[str, str], dict[str, Any]] = {
        (node["role"], node["instance"]): {"role": node["role"], "instance": node["instance"], "ticks": None}
        for node in nodes
        if node["plugin"] and node["active"] is False and node["enabled"]
    }
    for answer in client.bus.ask(client.keys.process(SUPERVISOR, "shadows"), timeout=1.0) if found else ():
        for one in [] if answer.refusal else json.loads(answer.data):
            if (one["role"], one["instance"]) in found:
                found[one["role"], one["instance"]] = one
    return list(found.values())


def cells_of(one: Mapping[str, Any]) -> tuple[str, ...]:
    """The comparison of a shadow as text, in the order of COLUMNS; "-" where there is nothing to compare."""
    name = f"{one['role']} {one['instance']}"
    if not one["ticks"]:
        return (name, *["-"] * (len(COLUMNS) - 1))
    handovers = f"{one['handovers']} ticks" if one["role"] == "avoider" else "-"
    share, stops = f"{100.0 * one['differing_share']:.0f} %", f"{one['stops']} ticks" if "vx" in one["mean"] else "-"
    sizes = sizes_text(one["now"]), sizes_text(one["mean"])
    return (name, str(one["against"]), str(one["ticks"]), share, *sizes, stops, handovers)


def differing_text(one: Mapping[str, Any]) -> str:
    """The comparison of a shadow on one line."""
    if not one["ticks"]:
        return "nothing to compare so far" if one["ticks"] is not None else "not compared"
    _, against, ticks, share, now, mean, stops, handovers = cells_of(one)
    more = [f"would have stopped in {stops}"] if one["stops"] else []
    more += [f"would have handed over otherwise in {handovers}"] if one["handovers"] else []
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
