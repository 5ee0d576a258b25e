"""What operators do from the page: each act as a request to the robot."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from navloom import NavloomError
from navloom.plugins import Discovery, PluginError
from navloom_live import Navigator

__all__ = ["ACTS", "LONGEST", "BadRequest", "json_object", "number", "parameters", "text"]

MOST_POINTS = 512
"""Most points of a goal."""
FULL_SCALE = 1e6
"""Largest coordinate, m."""
LONGEST = 1e12
"""Largest time of a clock, s or ms."""

Given = Mapping[str, Any]


class BadRequest(NavloomError, ValueError):
    """A request of the page that has not the form it should have."""


def json_object(data: str | bytes) -> dict[str, Any]:
    """The JSON object in a message of the page. Raises BadRequest."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise BadRequest("expected a JSON object")
    return found


def number(given: Given, name: str, largest: float = FULL_SCALE) -> float:
    """A finite number of a request. Raises BadRequest."""
    value = given.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise BadRequest(f"{name} is {_shown(value)}, expected a finite number")
    if abs(value) > largest:
        raise BadRequest(f"{name} is {value:g}, expected at most {largest:g}")
    return float(value)


def text(given: Given, name: str) -> str:
    """A short text of a request. Raises BadRequest."""
    value = given.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= 255:
        raise BadRequest(f"{name} is {_shown(value)}, expected a text")
    return value


def _shown(value: Any) -> str:
    return "missing" if value is None else repr(value)[:60]


def _goal(robot: Navigator, given: Given) -> dict[str, Any]:
    points = given.get("points")
    if (
        not isinstance(points, list)
        or not 0 < len(points) <= MOST_POINTS
        or not all(isinstance(p, dict) for p in points)
    ):
        raise BadRequest(f"points: expected 1 to {MOST_POINTS} points {{x, y, heading}}, the goal last")
    *via, last = points
    heading = None if last.get("heading") is None else number(last, "heading")
    handle = robot.go(number(last, "x"), number(last, "y"), heading, [(number(p, "x"), number(p, "y")) for p in via])
    return {"goal_id": handle.goal_id}


def _pose(robot: Navigator, given: Given) -> dict[str, Any]:
    sigma = None
    if given.get("spread") is not None:
        sigma = number(given, "spread"), number(given, "heading_spread")
    return {"warning": robot.place(number(given, "x"), number(given, "y"), number(given, "heading"), sigma)}


def _swap(robot: Navigator, given: Given) -> dict[str, Any]:
    said: list[str] = []
    epoch = robot.swap(text(given, "role"), text(given, "instance"), say=said.append)
    return {"epoch": epoch, "said": said}


def _param(robot: Navigator, given: Given) -> dict[str, Any]:
    role, instance = _node(given)
    name = text(given, "name")
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.]*", name):
        raise BadRequest(f"name is {name!r}, expected that of a parameter")
    value = given.get("value")
    if not isinstance(value, (bool, int, float, str)) or (isinstance(value, float) and not math.isfinite(value)):
        raise BadRequest(f"value is {_shown(value)}, expected a number, a text, true or false")
    # JSON's texts, numbers and words are TOML's too.
    return {"values": robot.set_parameters(role, instance, [f"{name} = {json.dumps(value)}"])}


def _node(given: Given) -> tuple[str, str]:
    role, _, instance = text(given, "node").partition(" ")
    if not re.fullmatch(r"[A-Za-z0-9_@.-]+", role) or not re.fullmatch(r"[A-Za-z0-9_@.-]+", instance):
        raise BadRequest(f"node is {given.get('node')!r}, expected a role and an instance, as 'avoider vfh'")
    return role, instance


def _cancel(robot: Navigator, given: Given) -> dict[str, Any]:
    return {"had_goal": robot.cancel()}


def _resume(robot: Navigator, given: Given) -> dict[str, Any]:
    robot.resume()
    return {}


def _relocalise(robot: Navigator, given: Given) -> dict[str, Any]:
    robot.relocalise()
    return {}


def _clear(robot: Navigator, given: Given) -> dict[str, Any]:
    robot.clear_map()
    return {}


ACTS: dict[str, Callable[[Navigator, Given], dict[str, Any]]] = {
    "goal": _goal, "cancel": _cancel, "pose": _pose, "relocalise": _relocalise, "resume": _resume, "swap": _swap,
    "param": _param, "clear": _clear,
}  # fmt: skip
"""Each act by its name, with what it answers. `record` is not among them: it does nothing to the robot."""


def parameters(robot: Navigator) -> list[dict[str, Any]]:
    """Parameters of every node with a plugin: value, default, bounds, unit and meaning.

    A plugin that is not installed here has its values only.
    """
    discovery = Discovery()
    found = []
    for node in robot.client.describe():
        if not node.plugin:
            continue
        try:
            values = robot.get_parameters(node.role, node.instance)
        except NavloomError:
            continue
        rows = [_row(name, value, _schema(discovery, node.role, node.plugin)) for name, value in values.items()]
        found.append(
            {"node": f"{node.role} {node.instance}", "plugin": node.plugin, "active": node.active, "params": rows}
        )
    return found


def _schema(discovery: Discovery, role: str, plugin: str) -> dict[str, Any]:
    name = plugin.partition("@")[0]
    try:
        cls = discovery.role(role, name)
    except PluginError:
        try:
            cls = discovery.node(name)
        except PluginError:
            return {}
    schema: dict[str, Any] = cls.Params.model_json_schema()
    return schema


def _row(name: str, value: Any, schema: Mapping[str, Any]) -> dict[str, Any]:
    field = dict(schema.get("properties", {}).get(name, {}))
    for choice in field.get("anyOf", ()):  # a value that may be derived or left out: the bounds are those of its number
        if choice.get("type") in ("number", "integer"):
            field = {**choice, **field}
    meaning = field.get("description", "")
    unit = re.search(
        r"(?:, |^)(m/s²|m/s|m²|m|rad/s²|rad/s|rad|deg/s²|deg/s|degrees|deg|s|1/s|Hz|ns|%)(?=[.:;,( ]|$)", meaning
    )
    low = field.get("minimum", field.get("exclusiveMinimum"))
    high = field.get("maximum", field.get("exclusiveMaximum"))
    return {
        "name": name, "value": value, "default": field.get("default"), "min": low, "max": high,
        "type": field.get("type"), "choices": field.get("enum"), "unit": unit[1] if unit else "", "meaning": meaning,
    }  # fmt: skip
