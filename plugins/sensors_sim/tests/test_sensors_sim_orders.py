"""Commands between ticks: each applies from its own time on."""

from __future__ import annotations

import pytest
from navloom_sensors_sim.orders import Orders

TICK = 50_000_000


def test_without_orders_the_ticks_own_command_holds() -> None:
    assert Orders().legs(0, TICK, (0.3, 0.1)) == [(0.3, 0.1, 0.05)]


def test_an_order_within_the_tick_splits_it_and_holds_on() -> None:
    orders = Orders()
    orders.give(10_000_000, 0.4, 0.0)
    orders.give(30_000_000, 0.0, 0.0)
    first = orders.legs(0, TICK, (9.0, 9.0))
    assert first == [(0.0, 0.0, 0.01), (0.4, 0.0, 0.02), (0.0, 0.0, 0.02)]
    assert sum(leg[2] for leg in first) == pytest.approx(0.05)
    assert orders.legs(TICK, 2 * TICK, (9.0, 9.0)) == [(0.0, 0.0, 0.05)]


def test_an_order_for_a_later_tick_waits_for_it() -> None:
    orders = Orders()
    orders.give(0, 0.2, 0.0)
    orders.give(60_000_000, 0.0, 0.0)
    assert orders.legs(0, TICK, (9.0, 9.0)) == [(0.2, 0.0, 0.05)]
    assert orders.legs(TICK, 2 * TICK, (9.0, 9.0)) == [(0.2, 0.0, 0.01), (0.0, 0.0, 0.04)]


def test_a_dead_time_delays_the_commands_of_ticks() -> None:
    """50 ms ticks, 70 ms of dead time: the first command acts 20 ms into the second tick."""
    orders = Orders(70_000_000)
    assert orders.legs(0, TICK, (0.5, 0.1)) == [(0.0, 0.0, 0.05)]
    assert orders.legs(TICK, 2 * TICK, (0.2, 0.0)) == [(0.0, 0.0, 0.02), (0.5, 0.1, 0.03)]
    assert orders.legs(2 * TICK, 3 * TICK, (0.2, 0.0)) == [(0.5, 0.1, 0.02), (0.2, 0.0, 0.03)]


def test_a_dead_time_delays_commands_between_ticks_and_the_tick_adds_none() -> None:
    orders = Orders(20_000_000)
    orders.give(10_000_000, 0.4, 0.0)
    assert orders.legs(0, TICK, (9.0, 9.0)) == [(0.0, 0.0, 0.03), (0.4, 0.0, 0.02)]
    assert orders.legs(TICK, 2 * TICK, (9.0, 9.0)) == [(0.4, 0.0, 0.05)]
