"""What a plugin declares: signatures and parameters, and whether its code reads them."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

from navloom.messages import Message
from navloom.roles import Params
from navloom.runs.metrics import Metric
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from navloom_check.check_bench import Bench
from navloom_check.checked_plugin import place_of
from navloom_check.checks import CLASSES, EVERY, PLAYED, check
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import Fault

__all__ = ["CHECKS", "fields_of", "has_unit", "models_of"]

UNIT = re.compile(
    r"(?<![\w])(m|mm|cm|km|s|ms|ns|min|h|rad|deg|degrees?|°|Hz|kHz|kg|N|V|A|W|%|m/s|m/s\^2|m/s²|rad/s|rad/s²|1/s|1/m|"
    r"m²|m\^2|percent|cells?|metres?|seconds?|sectors?|beams?|scans?|steps?|ticks?|points?|counts?|iterations?|samples?|"
    r"nodes?|times|frames?|bytes?|particles?|px|pixels?|dB|dBm|K|kelvin|°C|rad²|rad\^2|rad2|deg²|°²|s²|m³|m rad|Nm|"
    r"N m|J|Pa|hPa|mV|mA|Ah|Wh|lx|rpm|bits?|mrad|µm|µs|us|revolutions?|pulses?)(?![\w])"
    r"|[,(;:] 1(?=[.,;:)]|$)"
)
NO_UNIT = re.compile(
    r"\b(no unit|dimensionless|unitless|weights?|gains?|ratio|share|fraction|factor|probability|percent|number of|"
    r"how many|over nominal|multiple|exponent|power of|quantile|score|preference|times|per|threshold|density|damping|"
    r"coefficient|divided by|cost|beams?|scans?|cells?|steps?|points?|samples?|particles?|likelihood|confidence|"
    r"odds|correlation|similarity|overlap|entropy|index|indices|efficiency|friction|albedo|reflectivity|contrast|"
    r"(?:co)?sine|smoothing|forgetting|discount|momentum|penalty|reward|unit vectors?|normali[sz]ed|logarithm|count|"
    r"rank|p-value|chi-squared?|standard deviations|sigmas?)\b",
    re.IGNORECASE,
)


def fields_of(model: type[Params]) -> list[tuple[str, FieldInfo]]:
    """The parameters of a model."""
    return list(model.model_fields.items())


def models_of(cls: Any) -> dict[str, type[Params]]:
    """Models of a plugin's config tables: its parameters, and the settings of each kind of sensor."""
    settings: Mapping[str, type[Params]] = getattr(cls, "sensor_settings", {})
    return {"": cls.Params, **{f" of the sensor {kind!r}": model for kind, model in settings.items()}}


@check("contract", EVERY, "It is found under its name, and the registry accepts it.", is_static=True)
def registers(bench: Bench) -> Iterator[Finding]:
    """Find nothing: the worker fails this check for a plugin that cannot be loaded, before it runs any."""
    yield from ()


@check("contract", CLASSES, "Its verb, reset, configure and warm_up accept the framework's arguments.",
       is_static=True)  # fmt: skip
def signatures(bench: Bench) -> Iterator[Finding]:
    """Each method is bound to the arguments that the framework calls it with."""
    cls = bench.subject.thing
    calls: dict[str, tuple[tuple[str, ...], str]] = {
        bench.subject.verb: (("self", "given"), "(self, given)"),
        "reset": (("self",), "(self)"),
        "configure": (("self", "params"), "(self, params)"),
        "warm_up": ((), "(cls), marked @classmethod"),
    }
    for name, (arguments, form) in calls.items():
        method = getattr(cls, name)
        try:
            inspect.signature(method).bind(*arguments)
        except TypeError as error:
            yield Finding(
                f"{name}{inspect.signature(method)} cannot be called: {error}", f"def {name}{form}", place_of(method)
            )
        if inspect.iscoroutinefunction(method) or inspect.isgeneratorfunction(method):
            yield Finding(f"{name}() gives a coroutine or generator", f"a plain method that returns its answer: def "
                          f"{name}{form}", place_of(method))  # fmt: skip


@check("contract", CLASSES, "Each default is within its parameter's own bounds.", is_static=True)
def defaults_within_bounds(bench: Bench) -> Iterator[Finding]:
    """Pydantic does not check defaults by itself."""
    for owner, model in models_of(bench.subject.thing).items():
        values = {name: field.get_default(call_default_factory=True) for name, field in fields_of(model) if not
                  field.is_required()}  # fmt: skip
        given = {**(bench.subject.params.model_dump() if not owner else {}), **values}
        try:
            model.model_validate(given)
        except ValidationError as error:
            for one in error.errors(include_url=False):
                if owner and one["type"] == "missing":
                    continue
                name = ".".join(map(str, one["loc"])) or "the defaults together"
                yield Finding(
                    f"the default of {name}{owner} is {one['input']!r}",
                    f"a default that its own bounds allow: {one['msg']}", place_of(model),
                )  # fmt: skip


@check(
    "contract",
    CLASSES,
    "The description of each parameter, and of each setting of a sensor, gives its unit.",
    is_static=True,
)
def units(bench: Bench) -> Iterator[Finding]:
    """Only real numbers need a unit."""
    for owner, model in models_of(bench.subject.thing).items():
        for name, field in fields_of(model):
            text = field.description or ""
            if not text:
                yield Finding(
                    f"the parameter {name}{owner} has no description",
                    "what it is, and its unit: Field(…, description='…, m.')", place_of(model),
                )  # fmt: skip
            elif _is_real(field.annotation) and not (has_unit(text) or _is_angle(name)):
                yield Finding(
                    f"the description of {name}{owner} gives no unit: {text!r}", "its unit, as in 'Look-ahead "
                    "distance, m.'; or 'no unit'", place_of(model),
                )  # fmt: skip


@check("contract", CLASSES, "Parameters that the plugin does not know are refused.", is_static=True)
def unknown_parameters(bench: Bench) -> Iterator[Finding]:
    """A misspelt key in a config is an error only where the model forbids it."""
    model: type[Params] = bench.subject.thing.Params
    if model.model_config.get("extra") != "forbid":
        yield Finding(
            f"{model.__name__} accepts unknown keys", "model_config without `extra`, so that misspelt keys are refused",
            place_of(model),
        )  # fmt: skip


def has_unit(text: str) -> bool:
    """Whether a description gives a unit, or says that there is none."""
    return bool(UNIT.search(text) or NO_UNIT.search(text))


def _is_real(annotation: Any) -> bool:
    """Whether a parameter is a real number, or may be one."""
    return annotation is float or float in get_args(annotation)


def _is_angle(name: str) -> bool:
    return name.endswith(("_deg", "_hz", "_ns", "_ms", "_m", "_s"))


@check("contract", {"message"}, "Its docstring names each field.", is_static=True)
def documented(bench: Bench) -> Iterator[Finding]:
    """Shape, unit and frame belong there: readers of the stream have nothing else."""
    cls: type[Message] = bench.subject.thing
    text = cls.__doc__ or ""
    missing = [name for name, kind in cls.kinds.items() if name not in text and kind.rule != "stamp"]
    if missing:
        yield Finding(f"the docstring of {cls.__name__} does not name {', '.join(missing)}",
                      "each field with its meaning, unit and frame, arrays with their shape")  # fmt: skip


@check("contract", {"metric"}, "It has a unit, a description, and bounds in ascending order.", is_static=True)
def described(bench: Bench) -> Iterator[Finding]:
    """The tables of `compare` print these."""
    metric = bench.subject.thing
    if not isinstance(metric, Metric):
        yield Finding(f"is a {type(metric).__name__}", "a navloom.Metric")
        return
    if not metric.unit:
        yield Finding("has no unit", "unit='m', or '1' for shares and counts")
    if len(metric.about.split()) < 3:
        yield Finding(f"is described by {metric.about!r}", "about: what it is, and when it is not defined")
    low, high = metric.bounds
    if low is not None and high is not None and not low < high:
        yield Finding(f"has the bounds {metric.bounds}", "a least value below the greatest")
    if metric.better not in ("lower", "higher", None):
        yield Finding(f"has better = {metric.better!r}", "'lower', 'higher' or None")


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


CHECKS = (
    registers, signatures, defaults_within_bounds, units, unknown_parameters, documented, described, parameters_used,
)  # fmt: skip
