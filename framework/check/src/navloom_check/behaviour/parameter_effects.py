"""Whether each parameter changes an answer."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

from pydantic import ValidationError

from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PlayedScene
from navloom_check.checks import PLAYED, check
from navloom_check.contract.parameter_bounds import values_of
from navloom_check.findings import NotRun, Remark
from navloom_check.plugin_player import Fault, digest

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
            if any(_differs(bench, scene, params) for scene in bench.sound()):
                return True
            tried = True
        except (ValidationError, Fault):
            return True
    return not tried


def _differs(bench: Bench, scene: PlayedScene, params: Any) -> bool:
    """Whether a play with other parameters differs from the first play of a scene; it ends where it does."""
    with alike():
        player = bench.player(scene, params)
        return any(digest(player.step(given)) != answer
                   for given, answer in zip(scene.inputs, bench.answers(scene), strict=True))  # fmt: skip


CHECKS = (effects,)
