"""Whether each parameter changes an answer."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

from pydantic import ValidationError

from navloom_check.check_bench import Bench
from navloom_check.checks import PLAYED, check
from navloom_check.contract.parameter_bounds import values_of
from navloom_check.findings import NotRun, Remark
from navloom_check.plugin_player import Fault

__all__ = ["CHECKS"]

ENOUGH = 5.0
"""Time after which no further parameters are tried, s."""


@check("behaviour", PLAYED, "Shows parameters that change no answer in any scene, at any of their extremes.")
def effects(bench: Bench) -> Iterator[Remark]:
    """Such a parameter may be forgotten in the code, or matter only in situations that no scene has."""
    bench.steady()
    given = bench.subject.params.model_dump()
    if not given:
        raise NotRun("it has no parameters")
    begun = perf_counter()
    idle = [name for name in given if perf_counter() - begun < ENOUGH and not _has_effect(bench, name, given)]
    if idle:
        yield Remark(f"no scene shows an effect of {', '.join(idle)}: look whether the code uses it")


def _has_effect(bench: Bench, name: str, given: dict[str, Any]) -> bool:
    """Whether a value of a parameter changes an answer, is refused, or makes a step fail; True if it has no values."""
    model = bench.subject.thing.Params
    others = [value for value in values_of(model.model_fields[name], given[name]) if value != given[name]]
    tried = False
    for value in others:
        try:
            params = model.model_validate({**given, name: value})
            if any(bench.play(scene, params) != bench.answers(scene) for scene in bench.sound()):
                return True
            tried = True
        except (ValidationError, Fault):
            return True
    return not tried


CHECKS = (effects,)
