"""Presets in a config: `plugin = "vfh@printed"`, or `plugin = "vfh"` and `preset = "printed"`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from navloom.config.config_errors import ConfigError, check_params
from navloom.plugins.registry import nearest
from navloom.roles import Role
from navloom.roles.presets import instance_name, named_plugin

__all__ = ["instance_of", "params_of", "preset_values", "split_preset"]


def split_preset(table: Mapping[str, Any]) -> dict[str, Any]:
    """The table of a plugin with its preset under a key of its own. Raises ValueError if it names two presets."""
    plugin, preset = named_plugin(table["plugin"]) if isinstance(table.get("plugin"), str) else (None, None)
    if preset is None:
        return dict(table)
    if table.get("preset", preset) != preset:
        raise ValueError(
            f'plugin is "{table["plugin"]}" and preset "{table["preset"]}", expected one preset: leave one of them out'
        )
    return {**table, "plugin": plugin, "preset": preset}


def instance_of(table: Mapping[str, Any]) -> str:
    """Name of the instance of a role's table that was not checked yet."""
    return str(table.get("name") or instance_name(str(table.get("plugin")), table.get("preset")))


def preset_values(plugin: type[Role], preset: str | None, place: str) -> dict[str, Any]:
    """Parameters of a plugin's preset; none for None.

    Raises:
        ConfigError: There is no such preset; the text begins with `place`.
    """
    if preset is None:
        return {}
    if preset not in plugin.presets:
        known = nearest(preset, list(plugin.presets)) if plugin.presets else "; it has none"
        raise ConfigError(f'{place}: {plugin.role}.{plugin.name} has no preset "{preset}"{known}')
    return plugin.presets[preset].values()


def params_of(plugin: type[Role], preset: str | None, given: Mapping[str, Any], place: str) -> Any:
    """A plugin's parameters: those of its preset, unless they are given.

    Args:
        plugin: Class of the plugin.
        preset: Name of the preset; None for the defaults.
        given: Parameters by name.
        place: Place of the table, for messages.

    Raises:
        ConfigError: The plugin has no such preset, keys are unknown, or values do not fit.
    """
    return check_params(plugin.Params, {**preset_values(plugin, preset, f"{place}.preset"), **given}, place)
