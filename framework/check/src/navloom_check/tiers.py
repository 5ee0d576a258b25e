"""The tiers of `navloom check`, each with its checks in the order they run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from navloom_check import contract
from navloom_check.behaviour import behaviour_tier as behaviour
from navloom_check.checks import Check

__all__ = ["BEHAVIOUR", "CONTRACT", "TIERS", "checks_of", "find_check"]

CONTRACT = "contract"
"""What every plugin must pass."""
BEHAVIOUR = behaviour.BEHAVIOUR
"""What a plugin claims is required; the rest is only shown."""

TIERS: Mapping[str, Sequence[Check]] = MappingProxyType({CONTRACT: contract.CHECKS, BEHAVIOUR: behaviour.CHECKS})
"""Checks by tier. A further tier is one more entry here: its package's `CHECKS`."""


def checks_of(kind: str, tiers: Sequence[str] = tuple(TIERS)) -> list[Check]:
    """The checks of some tiers that concern a kind of plugin."""
    return [check for tier in tiers for check in TIERS[tier] if kind in check.kinds]


def find_check(name: str) -> Check | None:
    """The check with this name; None if there is none."""
    return next((check for checks in TIERS.values() for check in checks if check.name == name), None)
