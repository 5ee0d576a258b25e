"""Which kinds of plugin a check concerns."""

from __future__ import annotations

from navloom.plugins.registry import NODE
from navloom.roles import ROLES

from navloom_check.checked_plugin import CHECKED

__all__ = ["CLASSES", "EVERY", "PLAYED"]

EVERY = frozenset(CHECKED)
CLASSES = frozenset((*ROLES, NODE))
"""Kinds whose plugins are classes with parameters."""
PLAYED = CLASSES
"""Kinds whose plugins are played through scenes."""
