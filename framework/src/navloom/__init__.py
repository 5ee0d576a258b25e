"""navloom: plugin-based navigation for mobile robots. Plugins import from here and from navloom.testing only."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navloom.engine.nodes.node_plugin import *  # noqa: F403
    from navloom.errors import *  # noqa: F403
    from navloom.geometry.world import *  # noqa: F403
    from navloom.messages import *  # noqa: F403
    from navloom.operating.navigator import *  # noqa: F403
    from navloom.plugins import *  # noqa: F403
    from navloom.roles import *  # noqa: F403
    from navloom.study import *  # noqa: F403
    from navloom.viewer import *  # noqa: F403

_HOUSES = (
    "navloom.messages",
    "navloom.errors",
    "navloom.geometry.world",
    "navloom.roles",
    "navloom.plugins",
    "navloom.engine.nodes.node_plugin",
    "navloom.operating.navigator",
    "navloom.study",
    "navloom.viewer",
)


def __getattr__(name: str) -> Any:
    """Import a public name from its house on first use, so that `import navloom` itself is fast."""
    if not name.startswith("_"):
        for house in _HOUSES:
            module = import_module(house)
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module 'navloom' has no attribute {name!r}")
