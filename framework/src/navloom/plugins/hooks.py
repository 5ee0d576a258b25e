"""The one hook every plugin has, and the marker it is written with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from navloom.plugins.registry import Registry

__all__ = ["HookSpecs", "hookimpl", "hookspec"]

hookspec = pluggy.HookspecMarker("navloom")
hookimpl = pluggy.HookimplMarker("navloom")


class HookSpecs:
    """What a plugin module may implement. Hooks register; control never goes through one."""

    @hookspec
    def navloom_register(self, registry: Registry) -> None:
        """Add classes, worlds, world schemes, metrics or viewer panels to the registry: `registry.add(MyPlanner)`."""
