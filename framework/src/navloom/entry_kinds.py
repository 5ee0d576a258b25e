"""What an entry point of a plugin can be named after. Keep it light: every start of `navloom` imports it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

__all__ = ["GROUP", "OTHERS", "installed_points"]

GROUP = "navloom"
"""Group of the entry points; each is named KIND.NAME, and its kind is a role or one of OTHERS."""
OTHERS = ("world", "scheme", "metric", "panel", "node", "message", "command", "observer")


def installed_points() -> EntryPoints:
    """Every entry point of the group, found without importing what it names."""
    from importlib.metadata import entry_points

    return entry_points(group=GROUP)
