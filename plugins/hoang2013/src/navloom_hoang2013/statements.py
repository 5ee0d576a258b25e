"""The technical statements of Hoang et al. 2013, one row each: printed, ours, and whether they agree."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal

from navloom.engine import System
from navloom_sensors_sim.params import PitchedLaserSettings, SonarSettings

__all__ = ["Finding", "Statement", "Verdict", "active_settings", "judged", "printed_statements", "value_of"]

Verdict = Literal["as printed", "deviates", "erratum", "cannot be checked"]
SENSORS = {"pitched_laser": PitchedLaserSettings, "sonar_ring": SonarSettings}


@dataclass(frozen=True)
class Finding:
    """What a run gave for one statement.

    Attributes:
        ours: Value as measured or set.
        holds: Whether it is the printed one.
    """

    ours: str
    holds: bool = True


@dataclass(frozen=True)
class Statement:
    """One row.

    Attributes:
        id: Section and number.
        section: Section of the paper.
        printed: The paper's words or number.
        ours: What the run gave.
        verdict: "as printed" only if the value is the printed one and every key below is active in the run.
        why: How ours differs, and why, or how it was measured.
        keys: Settings that give the printed reading, in the form of `--set`; empty where nothing is to be set.
        inactive: Those of the keys that are not active in the run.
        code: module:object that does it.
        test: file::test that covers it.
        figure: Stem of the figure that shows it; empty without one.
    """

    id: str
    section: str
    printed: str
    ours: str
    verdict: Verdict
    why: str
    keys: tuple[str, ...]
    inactive: tuple[str, ...]
    code: str
    test: str
    figure: str


def printed_statements() -> list[dict[str, Any]]:
    """The fixed parts of all statements, in the order of the text, from `statements.toml`."""
    text = files(__package__).joinpath("statements.toml").read_text("utf-8")
    found: list[dict[str, Any]] = tomllib.loads(text)["statement"]
    return found


def judged(findings: Mapping[str, Finding], system: System) -> tuple[Statement, ...]:
    """All statements with their findings, by id, and verdicts.

    Args:
        findings: One for each id.
        system: The experiment, whose settings are the active ones.
    """
    active = active_settings(system)
    return tuple(_judged(entry, findings[entry["id"]], active) for entry in printed_statements())


def _judged(entry: Mapping[str, Any], finding: Finding, active: Mapping[str, Any]) -> Statement:
    keys = tuple(entry.get("keys", ()))
    inactive = tuple(key for key in keys if not _is_active(key, active))
    verdict: Verdict
    if entry.get("kind") == "erratum":
        verdict = "erratum"
    elif entry.get("kind") == "unchecked":
        verdict = "cannot be checked"
    else:
        verdict = "as printed" if finding.holds and not inactive else "deviates"
    section = entry["id"].rpartition("-")[0]
    why, code, test, figure = entry.get("why", ""), entry["code"], entry["test"], entry["figure"]
    return Statement(
        entry["id"], section, entry["printed"], finding.ours, verdict, why, keys, inactive, code, test, figure
    )


def _is_active(key: str, active: Mapping[str, Any]) -> bool:
    name, _, text = key.partition("=")
    return name in active and bool(active[name] == value_of(text))


def value_of(text: str) -> Any:
    """The value of a setting in the form of `--set`: TOML, or a bare word."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def active_settings(system: System) -> dict[str, Any]:
    """Every setting of a system by its dotted key, defaults included."""
    config = system.config
    found: dict[str, Any] = {}
    for table in ("robot", "navigation"):
        found |= _dotted(table, getattr(config, table).model_dump(mode="json"))
    for sensor in config.sensor:
        settings = SENSORS[sensor.kind](**(sensor.model_extra or {}))
        found |= _dotted(f"sensor.{sensor.name}", settings.model_dump(mode="json"))
    for role in ("platform", "mapper", "planner", "controller", "avoider"):
        params = system.parts[(role, config.role_table(role).instance)].params
        found |= _dotted(role, params.model_dump(mode="json"))
    return found


def _dotted(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    return {f"{prefix}.{name}": _without_none(value) for name, value in values.items()}


def _without_none(value: Any) -> Any:
    """Tables without the entries that are not set, as a config would give them."""
    if isinstance(value, Mapping):
        return {name: _without_none(part) for name, part in value.items() if part is not None}
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value
