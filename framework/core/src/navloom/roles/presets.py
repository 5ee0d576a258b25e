"""Named sets of a plugin's parameters, such as those that its paper prints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Preset", "instance_name", "named_plugin", "own_preset"]


@dataclass(frozen=True)
class Preset:
    """A named set of parameters of a plugin; a config's own keys override it.

    Attributes:
        about: What it follows, one phrase.
        settings: Value of a parameter, and where its source prints it, or why it was decided so. Parameters that are
            not listed have their default.
    """

    about: str
    settings: Mapping[str, tuple[Any, str]] = field(default_factory=dict)

    def values(self) -> dict[str, Any]:
        """Value of each listed parameter."""
        return {key: value for key, (value, _) in self.settings.items()}


def own_preset(presets: Mapping[str, Preset]) -> str | None:
    """Name of the preset that is the defaults, and holds where a config names none; None if there is none."""
    return next((name for name, preset in presets.items() if not preset.settings), None)


def named_plugin(text: str) -> tuple[str, str | None]:
    """Plugin and preset of `vfh@printed`; the preset is None in `vfh`."""
    plugin, at, preset = text.partition("@")
    return plugin, preset if at else None


def instance_name(plugin: str, preset: str | None) -> str:
    """How a config, a study or an operator names a plugin with a preset: `vfh@printed`, or `vfh` without one."""
    return plugin if preset is None else f"{plugin}@{preset}"
