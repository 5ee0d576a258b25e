"""Methods of a file, `--method mine.toml`, for a suite: they set what a `[[method]]` sets, and nothing of the suite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from navloom.config import ConfigError, Loaded, load_config
from navloom.config.config_errors import problems_of
from navloom.config.config_methods import SET_NAVIGATION, SET_ROLES, MethodTable, problems_of_method, settings_of
from navloom.config.config_tree import leaves
from navloom.config.schema import Config
from navloom.config.toml_lines import line_of
from navloom.engine.build import assemble
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import toml_of
from navloom.plugins import Discovery
from navloom.plugins.registry import nearest
from pydantic import ValidationError

from navloom_study.study_methods import Method, methods_of, toml_value
from navloom_study.suites.suite import Part, Suite

__all__ = ["methods_in_suite", "read_methods"]

Settings = Mapping[str, Any]


def read_methods(path: Path) -> dict[str, Settings]:
    """The overrides of each `[[method]]` of a file, by its name.

    Raises:
        ConfigError: The file holds something else, or a method sets what belongs to the suite.
    """
    try:
        text = read_file(path, TEXT_MB, ConfigError).decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"--method {path}: cannot be read: {error}") from None
    tree = toml_of(text, str(path), ConfigError)
    problems = [
        f"{key}: belongs to the suite; a file of methods holds [[method]] tables only"
        for key in tree
        if key != "method"
    ]
    tables = tree.get("method", [])
    if not tables or not isinstance(tables, list):
        problems.append('method: is missing; write [[method]] with name = "…" and set = { … }')
        tables = []
    found: dict[str, Settings] = {}
    for number, table in enumerate(tables):
        try:
            method = MethodTable.model_validate(table)
        except ValidationError as error:
            problems += [f"method.{number}.{problem}" for problem in problems_of(error, MethodTable, given=table)]
            continue
        if method.name in found:
            problems.append(f"method.{number}.name: {method.name} is there twice; give each method its own name")
        problems += problems_of_method(f"method.{number}.set", method.set, Config.model_fields)
        found[method.name] = method.set
    if problems:
        lines = [(line_of(text, problem.partition(": ")[0]) or 0, problem) for problem in problems]
        raise ConfigError(*(f"{path}:{line}: {problem}" if line else f"{path}: {problem}" for line, problem in lines))
    return found


def methods_in_suite(
    suite: Suite, part: Part, own: Sequence[str], given: Mapping[str, Settings], discovery: Discovery
) -> list[Method]:
    """The methods of a suite in one of its conditions.

    Args:
        suite, part: The suite and the condition.
        own: Names of the suite's own methods.
        given: Overrides of further methods, by name.
        discovery: Plugins.

    Raises:
        ConfigError: No such method, a name that the suite has already, or a method that changes the suite.
    """
    families = (methods_of(suite.config, [family], part.changes, discovery) for family in suite.methods)
    known = {method.name: method for family in families for method in family}
    for name in own:
        if name not in known:
            raise ConfigError(f"--methods {name}: {suite.name} has no such method{nearest(name, [*known])}")
    for name in given:
        if name in known:
            raise ConfigError(f"method {name}: {suite.name} has a method of its own with that name; rename yours")
    base = load_config(suite.config, part.changes)
    found = [known[name] for name in own]
    for name, settings in given.items():
        changes = (*(f"{place}={toml_value(value)}" for place, value in settings_of(settings)), *part.changes)
        try:
            method = Method(name, changes, load_config(suite.config, changes))
        except ConfigError as error:
            raise ConfigError(*(f"method {name}: {problem}" for problem in error.problems)) from None
        _check_equal(suite, method, base)
        _check_map(suite, method, base, discovery)
        found.append(method)
    return found


def _check_equal(suite: Suite, method: Method, base: Loaded) -> None:
    """Refuse a method whose whole config differs from the suite's where a method may not, however it was spelt."""
    before, after = (dict(_held(loaded)) for loaded in (base, method.loaded))
    wrong = sorted(place for place in {*before, *after} if before.get(place) != after.get(place))
    if wrong:
        raise ConfigError(f"method {method.name}: sets {', '.join(wrong)}, which belongs to the suite {suite.name}")


def _held(loaded: Loaded) -> Iterable[tuple[str, Any]]:
    """Every value of a config that no method may set, by place."""
    for place, value in leaves(loaded.config.model_dump(mode="json")):
        head, _, key = place.partition(".")
        if head == "navigation":
            is_held = key.partition(".")[0] not in SET_NAVIGATION
        else:
            delay = "latency" if head != "node" else f"{key.partition('.')[0]}.latency"
            # A plugin that is added has the default, no delay, where the suite has no such table.
            # Where processes run makes no method: `live` follows from the nodes.
            is_held = head not in (*SET_ROLES, "node", "live") or (key == delay and value != 0.0)
        if is_held:
            yield place, value


def _check_map(suite: Suite, method: Method, base: Loaded, discovery: Discovery) -> None:
    """Refuse plugins that have the framework hand in a map, where the robot of the suite drives without one."""

    def reading(loaded: Loaded) -> list[str]:
        return [
            f"{part.role}.{part.cls.name}" for part in assemble(loaded, discovery).parts.values() if part.cls.needs_map
        ]

    if base.config.map is None and not reading(base) and (wrong := reading(method.loaded)):
        raise ConfigError(
            f"method {method.name}: {', '.join(wrong)} needs a map of the world, and {suite.name} gives none"
        )
