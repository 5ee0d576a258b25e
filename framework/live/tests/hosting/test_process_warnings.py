"""Warnings of a process of a live robot; `navloom up` prints each once."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.engine.build import assemble
from navloom.engine.run_warnings import LARGEST_MESSAGE, RunWarning
from navloom.engine.system import System
from navloom.plugins.output_limit import LARGEST_OUTPUT
from navloom_live.drives.live_warnings import LiveWarnings
from navloom_live.hosting import process_warnings
from navloom_live.hosting.process_warnings import LARGE, MANY, ProcessWarnings
from navloom_live.live.live_runner import StepTimes
from navloom_live.transport.keyspace import KeySpace
from toys import Bystander, discovery, toy_config

AVOIDER, PLATFORM = ("avoider", "toy_bystander"), ("platform", "toy_robot")


@pytest.fixture
def system(tmp_path: Path) -> System:
    return assemble(toy_config(tmp_path), discovery())


def cell(source: tuple[str, str], stepped: int = 200, notes: list[str] | None = None, **outlets: Any) -> Any:
    """A node as the checks see it: each outlet with number of messages, tick of the last one, and largest size."""
    made = {
        port: SimpleNamespace(sequence=count, last=(None, SimpleNamespace(tick=tick)), largest=largest, sent=largest)
        for port, (count, tick, largest) in outlets.items()
    }
    node = SimpleNamespace(door=SimpleNamespace(notes=notes or []))
    stepper = SimpleNamespace(role=source[0], name=source[1], node=node, stepped=stepped)
    return SimpleNamespace(stepper=stepper, outlets=made)


def runner(cell: Any, spent_ms: list[float], computed: float = 1.0) -> Any:
    """A node with steps of these durations, of which it computed for a share."""
    times = StepTimes()
    for tick, spent in enumerate(spent_ms):
        times.note(tick, round(spent * 1e6), round(computed * spent * 1e6))
    return SimpleNamespace(cell=cell, times=times)


def told(system: System, cells: dict[Any, Any], live: dict[Any, Any]) -> list[str]:
    found = ProcessWarnings(system, [AVOIDER, PLATFORM])
    return [str(one) for one in found.listed(cells, live)]


def test_a_stream_that_is_too_large_and_a_command_beyond_limits_are_named(system: System) -> None:
    avoider = cell(AVOIDER, notes=["asked for 46 times the turn limit"], status=(9, 9, LARGEST_MESSAGE + 1))
    told_of = told(system, {AVOIDER: avoider}, {})
    assert [one.partition(";")[0] for one in told_of] == [
        "avoider toy_bystander published a message of 16.8 MB on status, of at most 16.8 MB",
        "avoider toy_bystander asked for 46 times the turn limit",
    ]


@pytest.mark.parametrize(("late", "is_told"), [(MANY // 10, False), (MANY // 10 + 1, True)])
def test_a_node_is_slow_when_more_than_a_tenth_of_its_steps_are_late(system: System, late: int, is_told: bool) -> None:
    spent = [60.0] * late + [1.0] * (MANY - late)
    told_of = told(system, {}, {AVOIDER: runner(cell(AVOIDER), spent)})
    assert [one.startswith(f"avoider toy_bystander is slow: {late} of its 100 steps") for one in told_of] == [
        True
    ] * is_told


def test_a_node_that_other_programs_delay_is_late_and_not_slow(system: System) -> None:
    (told_of,) = told(system, {}, {AVOIDER: runner(cell(AVOIDER), [60.0] * MANY, computed=0.5)})
    assert told_of.startswith("avoider toy_bystander was late: 100 of its 100 steps took longer than the 50 ms ")
    assert "p99 60 ms, but they computed for 30 ms of CPU time" in told_of


@pytest.mark.parametrize(
    ("began", "scans", "is_told"),
    [
        (0, (200, 199), False),
        (0, (100, 99), True),  # it stopped 5 s ago
        (190, (0, -1), False),  # its process is 0.5 s old
        (100, (0, -1), True),
        (0, (20, 180), False),  # one scan in 0.5 s: the next one is due
    ],
)
def test_a_sensor_that_is_silent_is_named(system: System, began: int, scans: tuple[int, int], is_told: bool) -> None:
    platform = cell(PLATFORM, 199, odometry=(200 - began, 199, 1), ear=(*scans, 1))
    told_of = told(system, {}, {PLATFORM: runner(platform, [])})
    assert ["gave no scan of the sensor 'ear'" in one for one in told_of] == [True] * is_told


class Chatty(Bystander):
    """An avoider that prints."""

    def say(self) -> None:
        print("x" * LARGEST_OUTPUT)


def test_a_flood_is_named_while_the_process_runs(system: System, capsys: pytest.CaptureFixture[str]) -> None:
    system.parts[AVOIDER].cls = Chatty
    found = ProcessWarnings(system, [AVOIDER])
    before = sys.stdout
    with found.watch():
        for _ in range(3):
            Chatty.__new__(Chatty).say()
    assert sys.stdout is before and len(capsys.readouterr().out) == LARGEST_OUTPUT + 1
    (warning,) = found.listed({}, {})
    assert "avoider toy_bystander printed more than 64 kB within 10 s" in str(warning)


def test_a_process_that_eats_memory_is_named_once(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    found = ProcessWarnings(system, [AVOIDER])
    for used in (LARGE, LARGE + LARGE // 2, 4 * LARGE):
        monkeypatch.setattr(process_warnings, "resident_bytes", lambda used=used: used)
        listed = [str(one) for one in found.listed({}, {})]
        assert len(listed) == (used > LARGE)
    assert listed[0].startswith("avoider toy_bystander runs in a process that uses 1.5 GiB of memory; if it grows on")


def test_of_a_process_that_eats_memory_the_shadow_is_named(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    shadow = SimpleNamespace(role=AVOIDER[0], name=AVOIDER[1], shadow=True)
    monkeypatch.setattr(System, "config", SimpleNamespace(alternative=[shadow]))
    monkeypatch.setattr(process_warnings, "resident_bytes", lambda: 2 * LARGE)
    (warning,) = ProcessWarnings(system, [PLATFORM, AVOIDER]).listed({}, {})
    assert "toy_bystander runs in a process that uses 2.0 GiB of memory, with platform toy_robot" in str(warning)


def test_each_warning_of_a_live_robot_is_printed_once() -> None:
    warnings = [RunWarning("slow", "avoider", "left", "vff", "is slow", {"late": 3})]
    bus: Any = SimpleNamespace()
    bus.ask = lambda key, timeout: [
        SimpleNamespace(refusal="", data=json.dumps([warning.to_json() for warning in warnings]).encode()),
        SimpleNamespace(refusal="timed out", data=b""),
    ]
    said: list[str] = []
    heard = LiveWarnings(bus, KeySpace("lab", "r1"), said.append)
    assert heard.look() == warnings
    warnings.append(RunWarning("limits", "avoider", "left", "vff", "asked for 46 times"))
    assert heard.look() == warnings
    assert said == [
        "warning: avoider left (plugin vff) is slow",
        "warning: avoider left (plugin vff) asked for 46 times",
    ]
