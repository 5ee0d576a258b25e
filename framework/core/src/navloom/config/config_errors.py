"""Problems of a config as text: place, value, expectation and the nearest fix."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pydantic import BaseModel, ValidationError

from navloom.errors import NavloomError
from navloom.plugins.registry import PluginError, nearest

__all__ = ["ConfigError", "Gathered", "check_params", "problems_of"]

_EXPECTED = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": 'text in quotes, as in "text"',
    "list_type": "a list, as in [1, 2]",
    "tuple_type": "a list, as in [1, 2]",
    "dict_type": "a table, as in {{ key = 1 }}",
    "model_type": "a table, as in {{ key = 1 }}",
    "model_attributes_type": "a table, as in {{ key = 1 }}",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
    "string_too_short": "a text that is not empty",
    "string_too_long": "at most {max_length} characters",
    "multiple_of": "a multiple of {multiple_of}",
}
"""Expectation behind each kind of pydantic error."""

_PATTERNS = {
    r"^[A-Za-z0-9_-]+$": "letters, digits, _ and -",
    r"^[A-Za-z0-9_-]+(@[A-Za-z0-9_-]+)?$": "letters, digits, _ and -, and after an @ those of a preset",
    r"^[a-z][A-Za-z0-9_]*$": "a lower-case letter, then letters, digits and _",
}
"""Patterns of names, as text."""


class ConfigError(NavloomError, ValueError):
    """The config cannot be used. Each line of the text names a place, the value, the expectation and the nearest fix.

    Attributes:
        problems: The lines.
    """

    def __init__(self, *problems: str) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))


class Gathered:
    """Collects the problems of a config, so that all are reported at once."""

    def __init__(self) -> None:
        self._problems: list[str] = []
        self._only_plugins = True

    @contextmanager
    def gather(self) -> Iterator[None]:
        """Collect an error of the body, and continue after it."""
        try:
            yield
        except (ConfigError, PluginError) as error:
            self._problems.extend(str(error).splitlines())
            self._only_plugins = self._only_plugins and isinstance(error, PluginError)

    def refuse(self, located: Callable[..., ConfigError]) -> None:
        """Raise the collected problems, if any: a PluginError if all concern unusable plugins, else a ConfigError.

        Args:
            located: Makes the ConfigError of the problems, with their lines.
        """
        if self._problems:
            error = located(*self._problems)
            raise PluginError(str(error)) if self._only_plugins else error


def check_params(params: type[BaseModel], table: dict[str, Any], place: str) -> Any:
    """A plugin's parameters from its table.

    Raises:
        ConfigError: Keys are unknown, or values do not fit.
    """
    try:
        return params.model_validate(table)
    except ValidationError as error:
        raise ConfigError(*problems_of(error, params, place, table)) from None


def problems_of(error: ValidationError, model: type[BaseModel], prefix: str = "", given: Any = None) -> list[str]:
    """A validation error as text, one line per place."""
    lines: dict[str, list[str]] = {}
    whole: list[str] = []
    for one in error.errors(include_url=False):
        if not one["loc"] and not prefix and one["type"] == "value_error":
            whole += str(one["ctx"]["error"]).splitlines()  # these lines already name their places
            continue
        path = _path_in(one["loc"], given, one["type"] == "missing")
        place = ".".join(filter(None, [prefix, *map(str, path)])) or "config"
        lines.setdefault(place, []).append(_words(one, path, model))
    return [f"{place}: {_joined(words)}" for place, words in lines.items()] + whole


def _words(one: Mapping[str, Any], path: list[str | int], model: type[BaseModel]) -> str:
    """Text of one error, without its place."""
    kind, value, context = one["type"], one["input"], one.get("ctx", {})
    if kind == "extra_forbidden":
        return f"unknown key{nearest(str(path[-1]), list(_model_at(model, path[:-1]).model_fields))}"
    if kind == "missing":
        if isinstance(path[-1], int):
            return "is missing; expected a longer list"
        fields = _model_at(model, path[:-1]).model_fields.items()
        return f"is missing; this table needs {' and '.join(name for name, field in fields if field.is_required())}"
    shown = "" if isinstance(value, (dict, BaseModel)) and kind == "value_error" else f"got {_as_toml(value)}, "
    if kind in ("value_error", "assertion_error"):
        return shown + _small(str(context.get("error", one["msg"])))
    if kind in ("literal_error", "enum"):
        known = re.findall(r"'([^']*)'", context["expected"])
        return f"{shown}expected {context['expected']}{_close(value, known)}"
    if kind == "string_pattern_mismatch":
        return f"{shown}expected {_PATTERNS.get(context['pattern'], 'text that matches ' + context['pattern'])}"
    if kind in _EXPECTED:
        return f"{shown}expected {_EXPECTED[kind].format_map(context)}{_fix(kind, value, path)}"
    return shown + re.sub(r"^(input|value|\w+) should (be |have |match )?", "expected ", _small(one["msg"]))


def _joined(words: list[str]) -> str:
    """Text of several errors at one place, for example of a value that fits none of several types."""
    first, *others = dict.fromkeys(words)
    shown = first.partition("expected ")[0]
    return " or ".join([first, *(other.removeprefix(shown).removeprefix("expected ") for other in others)])


def _close(value: Any, known: list[str]) -> str:
    hint = nearest(value, known) if isinstance(value, str) and known else ""
    return hint if "did you mean" in hint else ""


def _fix(kind: str, value: Any, path: list[str | int]) -> str:
    """How to write a value of the wrong type correctly, if that is clear; otherwise empty."""
    key = next((str(part) for part in reversed(path) if not isinstance(part, int)), "")
    if kind in ("int_type", "float_type") and isinstance(value, str):
        number = r"[+-]?\d+" if kind == "int_type" else r"[+-]?\d+(\.\d+)?([eE][+-]?\d+)?"
        return f"; leave the quotes out: {key} = {value.strip()}" if re.fullmatch(number, value.strip()) else ""
    if kind in ("int_type", "int_from_float") and isinstance(value, float) and value == value // 1:
        return f"; write {key} = {int(value)}"
    if kind == "bool_type" and str(value).lower() in ("true", "false", "0", "1"):
        return f"; write {key} = {'true' if str(value).lower() in ('true', '1') else 'false'}"
    if kind == "string_type" and isinstance(value, (int, float)):
        return f'; write {key} = "{_as_toml(value)}"'
    return ""


def _as_toml(value: Any) -> str:
    """A value in TOML, shortened."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, dict):
        text = f"{{ {', '.join(f'{key} = {_as_toml(inner)}' for key, inner in value.items())} }}" if value else "{}"
    else:
        text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _small(message: str) -> str:
    return message[:1].lower() + message[1:]


def _path_in(location: Iterable[str | int], given: Any, is_missing: bool) -> list[str | int]:
    """An error's place in the given values, without the parts that pydantic adds, such as the types of a union."""
    keys = list(location)
    if given is None:
        return keys
    path: list[str | int] = []
    for number, key in enumerate(keys):
        is_entry = isinstance(given, (list, tuple)) and isinstance(key, int) and key < len(given)
        if is_entry or (isinstance(given, dict) and key in given):
            given = given[key]
            path.append(key)
        elif is_missing and number == len(keys) - 1:
            path.append(key)
    return path


def _model_at(model: type[BaseModel], path: Iterable[str | int]) -> type[BaseModel]:
    for key in path:
        field = model.model_fields.get(str(key))
        if field is not None:
            model = next((m for m in _models_in(field.annotation)), model)
    return model


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _models_in(inner)
