"""Each planted fault is caught by its check and blamed on the plugin; sound plugins pass every check."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from checking_rig import FAULTS, HERE, ODD, SOUND, install
from navloom.plugins import Discovery
from navloom_check.checked_plugin import CHECKED
from navloom_check.runner import check_plugin
from navloom_check.tiers import TIERS
from navloom_check.worker_process import FLAGS

DEADLY = {"survives", "returns"}
"""Checks in which a fault ends the process, so each plugin needs its own process."""
SLOW = {"step_time", "message_size", "memory", "fresh_process", "no_processes", "reaches", "threads", "episodes",
        "repeats", "typed_failures", "optimal", "optimal_any_angle", "footprint", "ends", "settles",
        "accurate", "goes_on", "no_contact"}  # fmt: skip
"""Checks that take seconds, run only with `-m slow`."""
KINDS = {"platform", "localizer", "mapper", "planner", "controller", "avoider", "recovery", "metric", "panel", "world",
         "scheme", "message", "node"}  # fmt: skip

SHIPPED = [f"{info.role}.{info.name}" for info in Discovery().infos() if info.role in CHECKED]


@pytest.fixture(autouse=True)
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path / "site", monkeypatch)


def results_of(pairs: Sequence[tuple[str, str]]) -> dict[str, dict[str, Any]]:
    """Results of one check on each of several plugins, all in one process, by plugin."""
    done = subprocess.run(
        [sys.executable, *FLAGS, str(HERE / "one_process.py")], input=json.dumps(pairs), capture_output=True,
        text=True, timeout=600.0,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return {line["plugin"]: line for line in map(json.loads, done.stdout.splitlines())}


def first_of_each_check(skipped: set[str]) -> list[tuple[str, str]]:
    """One fault for each check that has faults."""
    found: dict[str, str] = {}
    for name, (entry, _) in FAULTS.items():
        if entry.caught_by not in skipped:
            found.setdefault(entry.caught_by, name)
    return [(name, check) for check, name in found.items()]


def missed(pairs: Sequence[tuple[str, str]], results: dict[str, dict[str, Any]]) -> list[str]:
    """Faults that their check did not find, or blamed on other code than the plugin's."""
    wrong = []
    for name, check in pairs:
        result = results[name]["result"]
        places = {finding["place"] or results[name]["place"] for finding in result["findings"]}
        if result["check"] != check or result["outcome"] != "failed":
            wrong.append(f"{name}: {check} {result['outcome']} {result['reason']}")
        elif check != "registers" and not all(is_planted(place) for place in places):
            wrong.append(f"{name}: {check} blames {places}")
    return wrong


def is_planted(place: str) -> bool:
    """Whether a place, such as `avoiders.py:12`, is in a planted module."""
    return (HERE / "planted" / place.partition(":")[0]).is_file()


def test_there_are_enough_faults_of_all_kinds_and_odd_plugins() -> None:
    assert len(FAULTS) >= 60 and len(ODD) >= 20
    assert {entry.kind for entry, _ in FAULTS.values()} == KINDS


def test_each_fault_names_a_check_of_its_kind() -> None:
    checks = {check.name: check for tier in TIERS.values() for check in tier}
    assert [name for name, (entry, _) in FAULTS.items() if entry.kind not in checks[entry.caught_by].kinds] == []


@pytest.mark.once
def test_a_fault_of_each_quick_check_is_caught_and_blamed_on_the_plugin() -> None:
    pairs = first_of_each_check(DEADLY | SLOW)
    assert missed(pairs, results_of(pairs)) == []


def test_parameters_of_every_shipped_plugin_name_their_units() -> None:
    results = results_of([(name, "units") for name in SHIPPED])
    assert [
        result["result"]["findings"] for result in results.values() if result["result"]["outcome"] == "failed"
    ] == []


@pytest.mark.slow
def test_every_planted_fault_is_caught_by_the_named_check() -> None:
    pairs = [(name, entry.caught_by) for name, (entry, _) in FAULTS.items() if entry.caught_by not in DEADLY]
    assert missed(pairs, results_of(pairs)) == []


@pytest.mark.slow
def test_a_module_that_keeps_answers_is_not_blamed_on_the_order_of_sets() -> None:
    results = results_of([("avoider.cached_by_place", "fresh_process"), ("avoider.order_of_sets", "fresh_process")])
    cached, ordered = (results[name]["result"]["findings"][0] for name in results)
    assert cached["problem"].endswith("in which other scenes were played before")
    assert ordered["problem"].endswith("with another PYTHONHASHSEED")


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, (entry, _) in FAULTS.items() if entry.caught_by in DEADLY])
def test_a_plugin_that_ends_or_hangs_its_process_is_named(name: str) -> None:
    report = check_plugin(name, only=(FAULTS[name][0].caught_by,))
    (result,) = report.failed
    assert report.plugin == name
    assert all(is_planted(finding.place or report.place) for finding in result.findings)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SOUND, *ODD])
def test_a_sound_plugin_passes_every_check(name: str) -> None:
    report = check_plugin(name)
    assert [line for result in report.failed for line in report.sentences(result)] == []
    assert [result.reason for result in report.results if "itself failed" in result.reason] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_plugin_passes_every_check(name: str) -> None:
    report = check_plugin(name)
    assert [line for result in report.failed for line in report.sentences(result)] == []
    assert [result.reason for result in report.results if "itself failed" in result.reason] == []
