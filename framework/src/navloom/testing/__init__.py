"""For authors of plugins: builders for unit tests, small scenes, and the checks behind `navloom check`."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navloom.testing.builders import *  # noqa: F403
    from navloom.testing.messages import *  # noqa: F403
    from navloom.testing.samples import *  # noqa: F403
    from navloom.testing.scenes import *  # noqa: F403

_MODULES = (
    "navloom.testing.builders",
    "navloom.testing.messages",
    "navloom.testing.scenes",
    "navloom.testing.samples",
)


def __getattr__(name: str) -> Any:
    """Import a public name on first use, since pytest imports this package in every session."""
    if not name.startswith("_"):
        for module in map(import_module, _MODULES):
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module 'navloom.testing' has no attribute {name!r}")
