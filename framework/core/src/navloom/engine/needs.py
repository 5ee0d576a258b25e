"""Sensors that plugins need, and which sensor or other plugin would satisfy the need."""

from __future__ import annotations

from collections.abc import Iterator

from navloom.engine.plugin_instances import Part
from navloom.engine.system import System
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import NODE
from navloom.roles import ROLES, Platform, Role

__all__ = ["needed_sensors"]


def needed_sensors(system: System) -> Iterator[str]:
    """One problem, with fixes, for each plugin that needs a sensor and has none that it accepts."""
    for part in system.parts.values():
        # An avoider that never drives may stay blind.
        is_idle = part.role == "avoider" and system.config.navigation.handover == "never"
        if part.cls.needs_sensor and part.cls.accepts and not part.sensors and not is_idle:
            yield _without_sensor(system, part)


def _without_sensor(system: System, part: Part) -> str:
    messages = " or ".join(message.__name__ for message in part.cls.accepts)
    key, default = "plugin", "" if system.loaded.gives(f"{part.place}.plugin") else ", the default,"
    if part.table.sensors is not None:
        key, has = "sensors", "this list names none"
    else:
        present = ", ".join(sorted({sensor.kind for sensor in system.sensors}))
        has = f"there is none among {present}" if present else "there is no [[sensor]]"
    platform = system.parts[("platform", system.config.platform.instance)].cls
    assert issubclass(platform, Platform)
    kinds = [kind for kind, message in platform.sensor_kinds.items() if issubclass(message, part.cls.accepts)]
    fixes = [f"add a [[sensor]] of kind {' or '.join(kinds)}"] if kinds and part.table.sensors is None else []
    if others := _others(system, part):
        fixes.append(f"take another {part.role}, as {' or '.join(others)}")
    if part.role == "avoider":
        fixes.append('set navigation.handover = "never"')
    helps = f": {', or '.join(fixes)}" if fixes else ""
    return f"{part.place}.{key}: {part.cls.name}{default} needs a sensor that gives {messages}, and {has}{helps}"


def _others(system: System, part: Part) -> list[str]:
    """Plugins of the same role that can work with the configured sensors."""
    platform = system.parts[("platform", system.config.platform.instance)].cls
    assert issubclass(platform, Platform)
    given = [platform.sensor_kinds[sensor.kind] for sensor in system.sensors]
    discovery, found = Discovery(system.config.plugins.blocked), []
    for name in discovery.names(part.role if part.role in ROLES else NODE):
        try:
            cls: type[Role] = discovery.plugin(part.role, name)
        # A broken plugin is no fix; `navloom plugins` tells about it.
        except PluginError:
            continue
        if not (cls.needs_sensor and cls.accepts) or any(issubclass(message, cls.accepts) for message in given):
            found.append(name)
    return found
