"""Every effective value of a config, and where it came from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from navloom.config.config_tree import leaves
from navloom.config.tables import MapTable, NodeTable
from navloom.engine.plugin_factory import blamed_on_part
from navloom.engine.system import System
from navloom.roles import Platform
from navloom.roles.derived import Derived, left_out
from navloom.roles.presets import own_preset

__all__ = ["holding"]


def holding(system: System) -> list[tuple[str, Any, str]]:
    """Place, value and source of every value, plugins' own defaults included.

    Sources are default, file, --set, --shadow, world, `preset NAME` for a value that comes from a preset, and
    `derived from FACTS`, after the source of a word that stands for such a value if there is one.

    Raises:
        ConfigError, PluginError: A plugin refuses its parameters, or fails.
    """
    loaded = system.loaded
    # As JSON, since `--json` and recordings hold these values.
    tree: dict[str, Any] = loaded.config.model_dump(mode="json")
    presets: dict[str, str] = {}
    derived: dict[str, str] = {}
    for part in system.parts.values():
        table = _table(tree, part.place)
        table.update(part.params.model_dump(mode="json"))
        if not isinstance(part.table, NodeTable):  # its name is the node's, not the instance's
            table["name"] = part.table.instance
        if preset := part.table.preset or own_preset(part.cls.presets):
            # The preset's name is told even if it was not given: own presets apply by default.
            table["preset"] = preset
            listed = part.cls.presets[preset].settings
            presets |= {f"{part.place}.{key}": f"preset {preset}" for key in listed}
        with blamed_on_part(part, "derived"):
            followed = left_out(part.params, part.cls.derived(part.params, system.robot, loaded.config.run.period))
        derived |= _fill_in(table, part.place, followed)
        if part.streams:
            table["inputs"] = {name: str(port) for name, port in part.streams.items()}
        if part.role != "platform":
            table["sensors"] = list(part.sensors)
    platform = system.parts[("platform", loaded.config.platform.instance)].cls
    assert issubclass(platform, Platform)
    for number, sensor in enumerate(loaded.config.sensor):
        if sensor.kind in platform.sensor_settings:
            settings = platform.sensor_settings[sensor.kind].model_validate(sensor.params)
            tree["sensor"][number].update(settings.model_dump(mode="json"))
    if isinstance(tree["navigation"]["start"], dict) and system.start_sigma is not None:
        spread, turn = system.start_sigma
        tree["navigation"]["start"] |= {"spread": spread, "heading_spread_deg": math.degrees(turn)}
    navigation, robot = loaded.config.navigation, system.robot
    followed = {
        "localizer_timeout": Derived(system.localizer_timeout, "localizer and recovery"),
        "speed": Derived(list(navigation.speeds(robot.max_linear)), "max_linear"),
        "lateral_acceleration": Derived(navigation.sideways(robot.max_acceleration), "max_acceleration"),
    }
    derived |= _fill_in(tree["navigation"], "navigation", left_out(navigation, followed))
    if system.map is not None and tree["map"] is None:
        tree["map"] = MapTable().model_dump(mode="json")
    worlds = _of_world(system, tree)

    def source(place: str) -> str:
        # What a world fills in is in no file, but it would count as a default.
        given = worlds.get(place) or loaded.sources.get(place) or presets.get(place)
        return ", ".join(filter(None, (given, derived.get(place)))) or "default"

    return [(place, value, source(place)) for place, value in leaves(tree)]


def _fill_in(table: dict[str, Any], place: str, values: Mapping[str, Derived]) -> dict[str, str]:
    """Fill derived values into a table, and return the source of each by its place."""
    table.update({name: one.value for name, one in values.items()})
    return {f"{place}.{name}": f"derived from {one.source}" for name, one in values.items()}


def _of_world(system: System, tree: dict[str, Any]) -> dict[str, str]:
    """Fill in the task that the world names, and return the places that came from the world."""
    world, navigation = system.world, tree["navigation"]
    filled: list[str] = []
    if world is None:
        return {}
    if world.start is not None:
        own = {"x": world.start.x, "y": world.start.y, "heading_deg": math.degrees(world.start.heading)}
        if navigation["start"] is None:
            navigation["start"] = own
            filled.append("navigation.start")
        elif navigation["start"] == "unknown" and tree["world"] and tree["world"]["start"] is None:
            tree["world"]["start"] = own
            filled.append("world.start")
    if navigation["goal"] is None and world.goal is not None:
        navigation["goal"] = {"x": world.goal.x, "y": world.goal.y}
        filled.append("navigation.goal")
    if navigation["goal_tolerance"] is None:
        navigation["goal_tolerance"] = system.goal_tolerance
        filled += ["navigation.goal_tolerance"] * (world.goal_tolerance is not None)
    return {
        place: "world"
        for table, key in (place.split(".") for place in filled)
        for place, _ in leaves(tree[table][key], f"{table}.{key}")
    }


def _table(tree: dict[str, Any], place: str) -> dict[str, Any]:
    """The table of a role, or of a numbered entry, as in `alternative.0`."""
    key, _, number = place.partition(".")
    table: dict[str, Any] = tree[key][int(number)] if number else tree[key]
    return table
