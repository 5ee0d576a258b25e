"""What a check is, and what it finds.

To add a check to a tier:

1. Write a function `def mirrored(bench: Bench) -> Iterator[Finding]` in a module of the tier's package. It plays scenes
   with `bench`, and yields a `Finding` for each fault. A behaviour check yields a `Remark` for what it reports
   without judgement. If it does not apply to a plugin, it raises `NotRun` with the reason.
2. Put `@check(TIER, KINDS, "What it demands, in one sentence.")` before it. The function's name is the check's name.
3. List it in the tuple `CHECKS` of the tier's package. `navloom_check.tiers` lists the tiers.

A check runs in the process of the plugin, which may hang or die. `navloom_check.worker` explains the reports of that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from navloom.plugins.registry import NODE
from navloom.roles import ROLES

from navloom_check.check_bench import Bench
from navloom_check.checked_plugin import CHECKED
from navloom_check.findings import Finding, Remark

__all__ = ["CLASSES", "EVERY", "PLAYED", "Check", "check"]

EVERY = frozenset(CHECKED)
CLASSES = frozenset((*ROLES, NODE))
"""Kinds whose plugins are classes with parameters."""
PLAYED = CLASSES
"""Kinds whose plugins are played through scenes."""


@dataclass(frozen=True)
class Check:
    """One named demand on plugins.

    Attributes:
        name: Name, as given to `--only`.
        tier: One of `navloom_check.tiers.TIERS`.
        kinds: Roles and other kinds of plugin that it concerns.
        demands: What it demands, in one sentence.
        run: Plays a plugin and gives findings and remarks.
        is_static: It inspects the class alone and makes no object, so it also runs on the driver of a real robot.
    """

    name: str
    tier: str
    kinds: frozenset[str]
    demands: str
    run: Callable[[Bench], Iterable[Finding | Remark]]
    is_static: bool = False


def check(
    tier: str, kinds: Iterable[str], demands: str, *, is_static: bool = False
) -> Callable[[Callable[[Bench], Iterable[Finding | Remark]]], Check]:
    """Make a check of a function; its name is the function's."""

    def declare(run: Callable[[Bench], Iterable[Finding | Remark]]) -> Check:
        return Check(run.__name__, tier, frozenset(kinds), demands, run, is_static)

    return declare
