"""For authors of plugins: builders for unit tests, small scenes, and the checks behind `navloom check`."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navloom_check.builders import *  # noqa: F403
    from navloom_check.messages import *  # noqa: F403
    from navloom_check.samples import *  # noqa: F403
    from navloom_check.scenes import *  # noqa: F403

_MODULES = (
    "navloom_check.builders",
    "navloom_check.messages",
    "navloom_check.scenes",
    "navloom_check.samples",
)


def __getattr__(name: str) -> Any:
    """Import a public name on first use, since pytest imports this package in every session."""
    if not name.startswith("_"):
        for module in map(import_module, _MODULES):
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module 'navloom.testing' has no attribute {name!r}")
