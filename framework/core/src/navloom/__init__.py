"""navloom: plugin-based navigation for mobile robots. Plugins import from here and from navloom.testing only."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from navloom.names import MODULE_OF
from navloom.parts import install_aliases, part

if TYPE_CHECKING:
    from navloom_live.operating.navigator import *  # noqa: F403
    from navloom_viewer import *  # noqa: F403

    from navloom.engine.nodes.node_plugin import *  # noqa: F403
    from navloom.errors import *  # noqa: F403
    from navloom.geometry.world import *  # noqa: F403
    from navloom.messages import *  # noqa: F403
    from navloom.plugins import *  # noqa: F403
    from navloom.roles import *  # noqa: F403
    from navloom.runs.metrics import *  # noqa: F403
    from navloom.runs.trail import Trail as Trail

install_aliases()


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use, so that each loads only what it needs."""
    module = MODULE_OF.get(name)
    if module is not None:
        return getattr(import_module(module) if module.startswith("navloom.") else part(module), name)
    if name.startswith("_"):
        raise AttributeError(f"module 'navloom' has no attribute {name!r}")
    from navloom.misspelt import close_to

    raise AttributeError(f"module 'navloom' has no attribute {name!r}{close_to(name, list(MODULE_OF))}")
