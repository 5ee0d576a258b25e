"""The list of the paper's statements: it cannot rot, and it says "as printed" only where it may."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from typing import Any

import pytest
from navloom.config import load_config
from navloom_hoang2013.measured import findings_of, statements_of
from navloom_hoang2013.plates import Reproduction, plates_of
from navloom_hoang2013.reproduction import is_reproduced
from navloom_hoang2013.runs import drive
from navloom_hoang2013.statements import Finding, active_settings, judged, printed_statements, value_of

ENTRIES = printed_statements()
IDS = [entry["id"] for entry in ENTRIES]
FIELDS = {"id", "printed", "keys", "kind", "why", "code", "test", "figure"}


def named(place: str) -> Any:
    """The object of `module:a.b`."""
    module, _, path = place.partition(":")
    found: Any = importlib.import_module(module)
    for name in path.split("."):
        found = getattr(found, name)
    return found


def test_ids_are_sections_with_numbers_in_the_order_of_the_text() -> None:
    assert len(set(IDS)) == len(IDS) >= 40
    seen: dict[str, int] = {}
    for name in IDS:
        section, _, number = name.rpartition("-")
        assert re.fullmatch(r"I|II\.[AB]|III\.[ABC]|IV\.[ABCD]|V", section), name
        seen[section] = seen.get(section, 0) + 1
        assert int(number) == seen[section], name
    assert list(seen) == ["I", "II.A", "II.B", "III.A", "III.B", "III.C", "IV.A", "IV.B", "IV.C", "IV.D", "V"]


@pytest.mark.parametrize("entry", ENTRIES, ids=IDS)
def test_the_code_of_a_statement_can_be_imported(entry: dict[str, Any]) -> None:
    assert set(entry) <= FIELDS and entry.get("kind") in (None, "erratum", "unchecked")
    assert named(entry["code"]) is not None


@pytest.mark.parametrize("entry", [entry for entry in ENTRIES if entry.get("keys")], ids=lambda entry: str(entry["id"]))
def test_the_keys_of_a_statement_are_accepted_and_known(entry: dict[str, Any], made: Reproduction) -> None:
    load_config("paper", entry["keys"])
    known = active_settings(made.run.episode.system)
    assert [key for key in entry["keys"] if key.partition("=")[0] not in known] == []


def test_every_statement_has_a_finding_and_a_figure_that_exists(made: Reproduction) -> None:
    assert set(findings_of(made)) == set(IDS)
    stems = {plate.stem for plate in plates_of(made)} | {"errata-calibration", ""}
    assert {entry["figure"] for entry in ENTRIES} <= stems


def test_as_printed_is_said_only_where_every_key_is_active(made: Reproduction) -> None:
    statements = statements_of(made)
    assert [row.id for row in statements if row.verdict == "as printed" and row.inactive] == []
    assert {row.id for row in statements if row.verdict == "as printed"} >= {"II.A-5", "III.C-2", "III.C-8", "IV.D-3"}
    by_id = {row.id: row for row in statements}
    assert by_id["III.A-5"].verdict == "deviates" and by_id["III.A-5"].inactive == ("planner.anchor=lowest",)
    assert by_id["II.B-5"].verdict == "erratum" and by_id["IV.D-4"].verdict == "cannot be checked"


def test_the_robust_avoider_is_not_as_printed(made: Reproduction) -> None:
    robust = made.readings.avoiders[1].drive.episode.system
    by_id = {row.id: row for row in judged(findings_of(made), robust)}
    assert by_id["III.C-11"].inactive == ("avoider.distance_from=centre", "avoider.brakes=false")
    assert by_id["III.C-2"].verdict == "deviates" and by_id["III.C-2"].inactive == ("avoider.reset_scope=window",)
    assert {row.id for row in by_id.values() if row.verdict == "deviates"} >= {"III.C-2", "III.C-3", "III.C-7"}


def test_a_value_that_is_not_the_printed_one_deviates(made: Reproduction) -> None:
    findings = {**findings_of(made), "II.A-1": Finding("93", holds=False)}
    row = next(row for row in judged(findings, made.run.episode.system) if row.id == "II.A-1")
    assert (row.ours, row.verdict) == ("93", "deviates")


def test_a_drive_that_only_believes_to_be_at_d_is_not_reproduced(made: Reproduction) -> None:
    """Here the robot is 0.3 m further from D than it says: 0.2 m and 0.1 m for the robot's own error count."""
    astray = replace(made, run=drive(seed=6))
    recorder = astray.run.episode.recorder
    recorder.truth[:] = [(time, x, y - 0.3, *rest) for time, x, y, *rest in recorder.truth]  # D is ahead, along y
    vars(astray.run.episode).pop("trail", None)
    summary = astray.run.episode.summary()
    assert summary["outcome"] == "succeeded" and summary["goal_error_m"] > 0.3
    assert is_reproduced(made) and not is_reproduced(astray)
    (row,) = (row for row in statements_of(astray) if row.id == "IV.D-3")
    assert row.verdict == "deviates" and row.ours.startswith(f"with O {summary['goal_error_m']:.2f} m from D")


@pytest.mark.parametrize(
    ("text", "value"),
    [("0.4", 0.4), ("paper", "paper"), ("false", False), ("[0.2, 0.4]", [0.2, 0.4]), ("{x=1}", {"x": 1})],
)
def test_a_setting_is_toml_or_a_word(text: str, value: Any) -> None:
    assert value_of(text) == value
