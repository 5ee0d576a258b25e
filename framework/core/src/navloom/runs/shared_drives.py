"""The robots of a fleet's members, which share their world, and by that what is made of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from navloom.config import Loaded
from navloom.geometry.world import World
from navloom.plugins import Discovery
from navloom.runs.episode import Drive

__all__ = ["drives_of"]


def drives_of(members: Sequence[Loaded], discovery: Discovery | None = None) -> dict[str, Drive]:
    """The robot of each member, by name.

    Args:
        members: Their configs.
        discovery: Plugins; default the installed ones.

    Raises:
        ConfigError, PluginError: A config does not fit.
    """
    own: dict[frozenset[str], Discovery] = {}
    drives: dict[str, Drive] = {}
    for loaded in members:
        blocked = frozenset(loaded.config.plugins.blocked)
        if discovery is None and blocked not in own:
            own[blocked] = _OneWorld(blocked)
        drives[loaded.member] = Drive(loaded, discovery or own[blocked])
    return drives


class _OneWorld(Discovery):
    """The plugins of members; a world is read once for all of them."""

    def __init__(self, blocked: Iterable[str]) -> None:
        super().__init__(blocked)
        self._worlds: dict[tuple[str, Path], World] = {}

    def world(self, reference: str, base: Path) -> World:
        if (reference, base) not in self._worlds:
            self._worlds[reference, base] = super().world(reference, base)
        return self._worlds[reference, base]
