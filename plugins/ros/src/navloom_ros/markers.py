"""ROS markers that show why an avoider chose its direction. Reads attributes only and imports no class of navloom."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

__all__ = ["avoider_markers"]

Pose = tuple[float, float, float]

_ARROW, _LINE_STRIP, _CUBE_LIST, _TEXT = 0, 4, 6, 9
_DELETE_ALL = 3
RADIUS = 0.8
"""Distance from the robot at which free slots are drawn, m."""
ARC = 0.1
"""Angle between two points of a drawn arc, rad."""
MOST_CELLS = 10_000
"""Most cells of a window that are drawn, the most certain first."""


def avoider_markers(header: dict[str, Any], what: Any, status: str, base: Pose) -> list[dict[str, Any]]:
    """Values of the markers, map frame: certainty window (`costs`), free slots, chosen direction and the reason.

    Args:
        header: Header of each marker.
        what: The avoider's `AvoiderDiagnostics`.
        status: The avoider's status.
        base: Pose of the robot in the map, m and rad.
    """
    made: list[dict[str, Any]] = [{"header": header, "action": _DELETE_ALL}]
    if what.window.size:
        made.append(_costs(what))
    made += _slots(what.slots, base)
    if what.chosen is not None:
        tip = {"x": base[0] + RADIUS * math.cos(what.chosen), "y": base[1] + RADIUS * math.sin(what.chosen)}
        made.append(
            {"ns": "chosen", "type": _ARROW, "points": [{"x": base[0], "y": base[1]}, tip],
             "scale": {"x": 0.04, "y": 0.1, "z": 0.1}, "color": _colour(1.0, 1.0, 1.0)}
        )  # fmt: skip
    text = {"ns": "why", "type": _TEXT, "text": f"{status}: {what.why}", "scale": {"z": 0.15}}
    made.append({**text, "pose": _at(base[0], base[1], 0.6), "color": _colour(1.0, 1.0, 1.0)})
    return [{**one, "header": header} for one in made]


def _costs(what: Any) -> dict[str, Any]:
    window = what.window
    rows, columns = np.nonzero(window)
    values = window[rows, columns]
    order = np.argsort(values)[::-1][:MOST_CELLS]
    size, most = what.window_resolution, float(max(1, int(window.max())))
    points = [
        {"x": what.window_x + (column + 0.5) * size, "y": what.window_y + (row + 0.5) * size}
        for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True)
    ]
    colours = [
        _colour(0.9, 0.67 * (1.0 - value / most), 0.0, 0.4 + 0.5 * value / most) for value in values[order].tolist()
    ]
    scale = {"x": size, "y": size, "z": 0.02}
    return {
        "ns": "costs",
        "type": _CUBE_LIST,
        "points": points,
        "colors": colours,
        "scale": scale,
        "color": _colour(1, 1, 1),
    }


def _slots(slots: Any, base: Pose) -> Iterator[dict[str, Any]]:
    for number, (first, last) in enumerate(slots.tolist()):
        wide = (last - first) % math.tau
        angles = np.linspace(first, first + wide, max(2, math.ceil(wide / ARC))).tolist()
        points = [
            {"x": base[0] + RADIUS * math.cos(angle), "y": base[1] + RADIUS * math.sin(angle)} for angle in angles
        ]
        yield {"ns": "slots", "id": number, "type": _LINE_STRIP, "points": points, "scale": {"x": 0.03},
               "color": _colour(0.0, 0.6, 0.3)}  # fmt: skip


def _at(x: float, y: float, z: float) -> dict[str, Any]:
    return {"position": {"x": x, "y": y, "z": z}}


def _colour(red: float, green: float, blue: float, alpha: float = 1.0) -> dict[str, float]:
    return {"r": float(red), "g": float(green), "b": float(blue), "a": float(alpha)}
