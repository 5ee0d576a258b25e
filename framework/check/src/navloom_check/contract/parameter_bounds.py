"""A plugin at the bounds of its parameters, and when they change while it runs."""

from __future__ import annotations

import types
from collections.abc import Iterator
from enum import Enum
from time import perf_counter
from typing import Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from navloom.roles import Params
from navloom.roles.derived import filled
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from navloom_check.check_bench import Bench, alike
from navloom_check.checks import PLAYED, check
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import Fault

__all__ = ["CHECKS", "values_of"]

STEPS = 4
"""Steps played with each value."""
ENOUGH = 8.0
"""Time after which no further values are tried, s."""


@check("contract", PLAYED, "Every value that a parameter's bounds allow works, with the others at their defaults.")
def extremes(bench: Bench) -> Iterator[Finding]:
    """The least and the greatest value, each choice, both positions of a switch.

    A plugin may refuse a value with ValueError in its constructor.
    """
    scene = bench.sound()[0]
    model: type[Params] = bench.subject.thing.Params
    given = bench.subject.params.model_dump()
    begun = perf_counter()
    for name, field in model.model_fields.items():
        for value in values_of(field, given.get(name)):
            if perf_counter() - begun > ENOUGH:
                return
            try:
                params = model.model_validate({**given, name: value})
            except ValidationError:  # the model refuses this value together with the other defaults
                continue
            try:
                with alike():
                    bench.player(scene, params).play(scene.inputs[:STEPS])
            except Fault as fault:
                if not _refuses(fault):
                    yield Finding(fault.problem, f"an answer, or bounds of {name} that exclude {value!r}", fault.place,
                                  f"{name} = {value!r}, scene {scene.name!r}", scene.name)  # fmt: skip


def _refuses(fault: Fault) -> bool:
    """Whether a plugin refuses its parameters: with InputError, or with ValueError in its constructor.

    A check of the config reports the latter.
    """
    return fault.is_refusal or (fault.call == "__init__" and isinstance(fault.__cause__, ValueError))


@check("contract", PLAYED, "configure() accepts checked parameters while the plugin runs.")
def configure(bench: Bench) -> Iterator[Finding]:
    """Parameters change between two steps, as an operator changes them.

    Afterwards `self.params` must be the new parameters, and further steps must work.
    """
    scene = bench.sound()[0]
    params = _changed(bench)
    half = len(scene.inputs) // 2
    with alike():
        try:
            player = bench.player(scene)
            player.play(scene.inputs[:half])
            player.configure(params)
            plugin = player.plugin
            expected = params
            if (context := getattr(plugin, "context", None)) is not None:
                expected = filled(params, plugin.derived(params, context.robot, context.period))
            if getattr(plugin, "params", None) != expected:
                problem = "configure() does not change self.params"
                yield Finding(problem, "super().configure(params), or self.params = params", given=f"{params!r}")
            player.play(scene.inputs[half:])
        except Fault as fault:
            yield bench.finding(fault, f"configure() after {half} steps of scene {scene.name!r}", scene.name)


def _changed(bench: Bench) -> Any:
    """The plugin's parameters, with the first one changed that has another valid value."""
    model: type[Params] = bench.subject.thing.Params
    given = bench.subject.params.model_dump()
    for name, field in model.model_fields.items():
        for value in values_of(field, given.get(name)):
            if value != given.get(name):
                try:
                    params = model.model_validate({**given, name: value})
                    with alike():
                        bench.player(bench.sound()[0], params)
                    return params
                except (ValidationError, Fault):
                    continue
    if not model.model_fields:
        raise NotRun("it has no parameters")
    return bench.subject.params


def values_of(field: FieldInfo, default: Any) -> Iterator[Any]:
    """The extremes of one parameter."""
    kinds = _kinds(field.annotation)
    for kind in kinds:
        if get_origin(kind) is Literal:
            yield from get_args(kind)
        elif kind is bool:
            yield from (False, True)
        elif isinstance(kind, type) and issubclass(kind, Enum):
            yield from kind
        elif kind is type(None):
            yield None
    if float in kinds or int in kinds:
        yield from _bounds(field, default, int in kinds and float not in kinds)


def _bounds(field: FieldInfo, default: Any, is_whole: bool) -> Iterator[Any]:
    """The least and the greatest value; at an open bound, a value near it."""
    known = default if isinstance(default, (int, float)) and not isinstance(default, bool) else 1
    for mark in field.metadata:
        if isinstance(mark, Ge):
            yield mark.ge
        elif isinstance(mark, Le):
            yield mark.le
        elif isinstance(mark, Gt):
            bound: Any = mark.gt
            yield bound + 1 if is_whole else bound + 0.1 * abs(known - bound)
        elif isinstance(mark, Lt):
            top: Any = mark.lt
            yield top - 1 if is_whole else top - 0.1 * abs(top - known)


def _kinds(annotation: Any) -> tuple[Any, ...]:
    """The types that an annotation allows."""
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(kind for argument in get_args(annotation) for kind in _kinds(argument))
    return (annotation,)


CHECKS = (configure, extremes)
