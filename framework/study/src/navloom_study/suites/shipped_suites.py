"""The suites that come with navloom."""

from __future__ import annotations

from pathlib import Path

from navloom.plugins.hooks import hookimpl
from navloom.plugins.registry import Registry

__all__ = ["navloom_register"]


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the suites of the folder `shipped`."""
    for file in sorted(Path(__file__).with_name("shipped").glob("*.toml")):
        registry.suite(file)
