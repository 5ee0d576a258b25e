"""Parameters that no code reads: a config sets them, and nothing happens."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

from navloom.roles import Params
from pydantic.fields import FieldInfo

from navloom_check.check_bench import Bench
from navloom_check.checked_plugin import place_of
from navloom_check.checks import check
from navloom_check.contract.kinds import PLAYED
from navloom_check.contract.plugin_declarations import fields_of, models_of
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import Fault

__all__ = ["CHECKS"]

NOT_OWN = ("navloom", "pydantic", "abc", "builtins", "typing")
"""Packages of base classes that read no parameters of a plugin."""
WHOLE = {"__dict__", "__pydantic_fields_set__", "model_dump", "model_dump_json", "model_copy", "__iter__"}
"""Attributes through which all parameters are read at once."""


@check("contract", PLAYED, "Some code reads each parameter, and each setting of a sensor.")
def parameters_used(bench: Bench) -> Iterator[Finding]:
    """Read in any scene, or named in the plugin's modules outside the model of the parameters.

    A parameter that is kept for old configs only is marked `Field(deprecated=...)`.
    """
    models = models_of(bench.subject.thing)
    if not any(fields_of(model) for model in models.values()):
        raise NotRun("it has no parameters")
    read: dict[type[Params], set[str]] = {model: set() for model in models.values()}
    with ExitStack() as stack:
        for model, names in read.items():
            stack.enter_context(_noted(model, names))
        for scene in bench.scenes:
            with suppress(Fault):
                bench.play(scene)
    named = _named_in(bench)
    for owner, model in models.items():
        if read[model] & WHOLE or (owner and not read[model]):
            continue  # read all at once, or the settings of a sensor that no scene has
        for name, field in fields_of(model):
            if name not in read[model] | named and not field.deprecated and not _is_fixed(field):
                yield Finding(
                    f"the parameter {name}{owner} is read nowhere", f"code that uses self.params.{name}; or no such "
                    "parameter; or Field(deprecated='…') if it is kept for old configs only", place_of(model),
                )  # fmt: skip


def _is_fixed(field: FieldInfo) -> bool:
    """Whether a parameter allows a single value only, which tells no code anything."""
    return get_origin(field.annotation) is Literal and len(get_args(field.annotation)) == 1


@contextmanager
def _noted(model: type[Params], names: set[str]) -> Iterator[None]:
    """Note which attributes are read of the objects of a model."""
    before = model.__getattribute__

    def noted(self: Any, name: str) -> Any:
        names.add(name)
        return before(self, name)

    type.__setattr__(model, "__getattribute__", noted)
    try:
        yield
    finally:
        type.__delattr__(model, "__getattribute__")


def _named_in(bench: Bench) -> set[str]:
    """Names of attributes and texts in the packages of the plugin, its base classes and its models."""
    bases = [*bench.subject.thing.__mro__, *(one for model in models_of(bench.subject.thing).values()
                                             for one in model.__mro__)]  # fmt: skip
    homes = {package for base in bases if (package := base.__module__.partition(".")[0]) not in NOT_OWN}
    modules = [
        module for name, module in list(sys.modules.items())
        if isinstance(module, ModuleType) and (name.partition(".")[0] in homes or bench.subject.is_own(name))
    ]  # fmt: skip
    found: set[str] = set()
    for module in modules:
        with suppress(OSError, TypeError, SyntaxError):
            for node in ast.walk(ast.parse(inspect.getsource(module))):
                if isinstance(node, ast.Attribute):
                    found.add(node.attr)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.add(node.value)
    return found


CHECKS = (parameters_used,)
