"""The live gate: how long it waits for messages, and when a tick is complete."""

from __future__ import annotations

import numpy as np
import pytest
from gate_rig import (
    AHEAD,
    GOAL,
    MS,
    ORIGIN,
    PLATFORM,
    STILL,
    Gate,
    at,
    command,
    driving,
    last,
    published,
    stamped,
    stepped,
)
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.messages import Command, Drive, Odometry, RangeScan

AFTER = 0.0002
"""Delay of a check after an input has gone stale, s."""


# --- how long it waits ------------------------------------------------------------------------------------------------


def test_before_the_first_stamp_it_looks_every_50_ms() -> None:
    assert Gate().runner.wait_time() == 0.05


def test_it_waits_two_fifths_of_a_period_for_the_commands_of_a_tick() -> None:
    """The stamp of tick 0 has arrived; 5 ms later 15 ms are left."""
    gate = stamped()
    gate.give(PLATFORM, "odometry", Odometry(0, ORIGIN, STILL), 0)
    gate.runner.take_in()
    assert gate.runner.wait_time() == pytest.approx(0.02 + AFTER)
    gate.clock.now += 5 * MS
    assert gate.runner.wait_time() == pytest.approx(0.015 + AFTER)
    gate.clock.now += 90 * MS
    assert gate.runner.wait_time() == 0.0


def test_after_its_decision_it_waits_for_the_next_tick_and_its_commands() -> None:
    """At 100 ms it has decided. The next tick is complete at 170 ms at the latest; it looks after 50 ms anyway."""
    gate = driving()
    at(gate, 105)
    gate.look()
    assert gate.runner.wait_time() == 0.05
    at(gate, 125)
    gate.look()
    assert gate.runner.wait_time() == pytest.approx(0.045 + AFTER)


def test_it_wakes_when_its_commands_go_stale() -> None:
    """The commands are of 100 ms, the stamp of 150 ms: both are stale at 200 ms, before the next tick at 220 ms."""
    gate = driving()
    at(gate, 150)
    gate.tick(3)
    at(gate, 171)
    gate.look()
    assert stepped(gate) == 3 and last(gate).reason == ""
    assert gate.runner.wait_time() == pytest.approx(0.029 + AFTER)
    at(gate, 200)
    gate.look()
    assert last(gate).reason == ""
    at(gate, 200.001)
    gate.look()
    assert last(gate).reason.startswith("stale: ")


def test_it_wakes_when_an_operator_goes_silent() -> None:
    gate = stamped()
    at(gate, 0)
    gate.give(("operator", "main"), "command", Command(AHEAD), 0)
    gate.tick(0)
    at(gate, 50)
    gate.tick(1)
    at(gate, 71)
    gate.look()
    assert last(gate).source == "operator"
    assert gate.runner.wait_time() == pytest.approx(0.029 + AFTER)


def test_it_wakes_when_a_sensor_goes_silent() -> None:
    """A scan of 0 ms and a timeout of 150 ms; the ticks come on time."""
    system = assemble(load_config("paper", ["gate.sensor_timeout=0.15"]))
    gate = stamped(system)
    name = next(iter(gate.node.required))
    one = np.ones(1)
    gate.give(PLATFORM, name, RangeScan(0, np.zeros((1, 2)), one, one, 0 * one, one, 0.1, 4.0), 0)
    for tick in range(3):
        at(gate, 50 * tick)
        gate.give(GOAL, "drive", Drive(1, 1, None, False), tick)
        command(gate, "controller", "avoider", tick=tick)
        gate.tick(tick)
    at(gate, 121)
    gate.look()
    assert last(gate).reason == "" and gate.runner.wait_time() == pytest.approx(0.029 + AFTER)
    at(gate, 150.001)
    gate.look()
    assert last(gate).reason == f"silent: sensor {name}"


def test_it_wakes_when_the_platform_has_been_silent_for_the_deadline() -> None:
    """100 ms after its last stamp: at 200 ms, here with no command that could go stale."""
    gate = stamped()
    for tick in range(3):
        at(gate, 50 * tick)
        gate.tick(tick)
    at(gate, 171)
    gate.look()
    assert gate.runner.wait_time() == pytest.approx(0.029 + AFTER)
    at(gate, 200)
    gate.look()
    assert not gate.node.is_silent
    at(gate, 200.001)
    gate.look()
    assert gate.node.is_silent


# --- when a tick is complete ------------------------------------------------------------------------------------------


def test_it_decides_when_both_commands_are_there() -> None:
    gate = driving()
    at(gate, 150)
    gate.tick(3)
    at(gate, 151)
    command(gate, "controller", tick=3)
    gate.look()
    assert stepped(gate) == 2
    command(gate, "avoider", tick=3)
    gate.look()
    assert stepped(gate) == 3


def test_it_decides_without_them_after_two_fifths_of_a_period() -> None:
    gate = driving()
    at(gate, 150)
    gate.tick(3)
    at(gate, 169.9)
    gate.look()
    assert stepped(gate) == 2
    at(gate, 170.001)
    gate.look()
    assert stepped(gate) == 3


def test_it_decides_once_a_tick() -> None:
    gate = driving()
    before = published(gate)
    at(gate, 130)
    gate.look()
    gate.look()
    assert published(gate) == before and stepped(gate) == 2


def test_a_robot_that_follows_nothing_waits_for_no_command() -> None:
    gate = stamped()
    gate.tick(0)
    assert stepped(gate) == 0


class Recovering:
    """A recovery's state as the goal tells it; only `active` counts here."""

    def __init__(self, active: bool) -> None:
        self.active = active


def test_a_robot_that_recovers_waits_for_the_recoverys_command_alone() -> None:
    gate = driving()
    slot = gate.runner._feeds["recovering"].wire.slot
    slot.put(Recovering(True), 1, (2, 0, 0, 0), 2)  # type: ignore[arg-type]
    at(gate, 150)
    command(gate, "controller", "avoider", tick=3)
    gate.tick(3)
    assert stepped(gate) == 2
    gate.give(("recovery", gate.node.selected["recovery"]), "command", Command(STILL), 3)
    gate.look()
    assert stepped(gate) == 3
    slot.put(Recovering(False), 2, (3, 0, 0, 0), 3)  # type: ignore[arg-type]
    at(gate, 200)
    command(gate, "controller", "avoider", tick=4)
    gate.tick(4)
    assert stepped(gate) == 4


def test_a_message_without_such_a_state_is_no_recovery() -> None:
    gate = driving()
    gate.runner._feeds["recovering"].wire.slot.put(Command(STILL), 1, (2, 0, 0, 0), 2)
    at(gate, 150)
    command(gate, "controller", "avoider", tick=3)
    gate.tick(3)
    assert stepped(gate) == 3


def test_between_two_ticks_a_recovery_of_the_next_one_does_not_count_yet() -> None:
    """It would lack its command."""
    gate = driving()
    gate.runner._feeds["recovering"].wire.slot.put(Recovering(True), 1, (3, 0, 0, 0), 3)  # type: ignore[arg-type]
    at(gate, 110)
    gate.look()
    assert last(gate).reason == ""
