"""Clocks of devices: the quickest message gives the offset; no stamp runs back or is in the future."""

from __future__ import annotations

import random

from navloom.drivers.clocks import ClockOffset

MS = 1_000_000


def test_delays_do_not_move_the_stamps() -> None:
    """Delays of 2 to 40 ms, every tenth of 2 ms: once one of these came, stamps are at most 2 ms late."""
    random.seed(1)
    clock, stamps = ClockOffset(), []
    for number in range(500):
        device_ns = number * 20 * MS
        way_ns = 2 * MS if number % 10 == 0 else random.randrange(2 * MS, 40 * MS)
        stamps.append(clock.local(device_ns, 10**12 + device_ns + way_ns) - 10**12 - device_ns)
    assert all(2 * MS <= late <= 2.1 * MS for late in stamps[1:])


def test_a_clock_that_drifts_is_followed() -> None:
    """A clock 100 ppm fast gains 60 ms in ten minutes; the stamps stay within 2 ms of the truth."""
    clock = ClockOffset()
    late = [clock.local(round(number * 20 * MS * 1.0001), number * 20 * MS + 5 * MS) for number in range(30_000)]
    errors = [stamp - number * 20 * MS for number, stamp in enumerate(late)]
    assert max(errors) <= 5 * MS and min(errors) >= 3 * MS


def test_a_clock_that_wraps_continues_and_a_device_that_restarts_is_detected() -> None:
    modulus_ns = 2**32 * 1000
    clock = ClockOffset(modulus_ns=modulus_ns)
    for number in range(100):
        device_ns = (modulus_ns - 1000 * MS + number * 20 * MS) % modulus_ns
        assert clock.local(device_ns, number * 20 * MS + MS) == number * 20 * MS + MS
    assert clock.restarts == 0
    stamp_ns = clock.local(0, 5000 * MS)
    assert clock.restarts == 1 and stamp_ns == 5000 * MS
    assert clock.local(20 * MS, 5020 * MS) == 5020 * MS


def test_stamps_never_run_back_when_messages_overtake_each_other() -> None:
    clock = ClockOffset()
    stamps = [clock.local(device * MS, at * MS) for device, at in ((0, 10), (40, 50), (20, 51), (60, 70))]
    assert stamps == sorted(stamps) and stamps[2] == stamps[1] and clock.restarts == 0
