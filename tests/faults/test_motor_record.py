"""Measurements of faults from records of the motors that can be checked by hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from motor_record import ADVANCE, DRIVE, START, Line, MotorRecord, longest_gap, old_words, ran_on

MS = 1_000_000
REST = (float("nan"),) * 5


def word(at_ms: int, vx: float, wz: float = 0.0, kind: int = DRIVE) -> Line:
    return Line(kind, False, 7, at_ms * MS, vx, wz, *REST)


def tick(at_ms: int, speed: float, x: float = 0.0, touching: bool = False) -> Line:
    return Line(ADVANCE, touching, 7, at_ms * MS, 0.0, 0.0, x, 0.0, speed, 0.0, 1.0)


def test_a_record_is_read_as_it_grows_and_a_partial_entry_waits(tmp_path: Path) -> None:
    path = tmp_path / "motors.bin"
    motors = MotorRecord(path)
    assert motors.look().words == [] and motors.speed() == 0.0
    first, second = word(0, 0.5, 0.01).bytes(), tick(50, 0.5, 3.0, True).bytes()
    path.write_bytes(first + second[:20])
    assert [(line.time_ns, line.vx, line.wz) for line in motors.look().words] == [(0, 0.5, 0.01)]
    assert not motors.touched
    path.write_bytes(first + second)
    assert motors.place == (3.0, 0.0) and motors.touched


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([word(0, 0.5), word(50, 0.49), word(100, 0.48), word(150, 0.47)], 0.05),
        ([word(0, 0.5), word(50, 0.5), word(120, 0.0)], 0.12),
        ([word(0, 0.5), word(50, 0.0), word(900, 0.0), word(1200, 0.0)], 0.05),
        ([word(0, 0.5), word(40, 0.0, 0.1), word(100, 0.0)], 0.06),
        ([word(0, 0.5), word(5000, 0.0, kind=START), word(5050, 0.0)], 0.0),
        ([word(0, 0.5), word(3000, 0.5), word(5000, 0.0, kind=START), word(5050, 0.0)], 3.0),
        ([word(-9850, 0.5), word(-5000, 0.5), word(50, 0.5)], 10.0),
        ([word(100, 0.5)], 0.05),
        ([word(-10000, 0.5), word(-9900, 0.0)], 0.1),
        ([], 0.0),
    ],
    ids=[
        "healthy",
        "same-again",
        "standing",
        "turning",
        "another-process",
        "repeated-until-another-process",
        "repeated-to-the-end",
        "one-command",
        "stopped-to-the-end",
        "empty",
    ],
)
def test_the_longest_time_on_one_command_until_the_look(words: list[Line], expected: float) -> None:
    assert ran_on(words, 150 * MS) == pytest.approx(expected)


def test_a_gap_is_the_time_without_a_command_while_the_motors_turn() -> None:
    turning = [word(50 * number, 0.0, 1.0) for number in range(60)]
    assert ran_on(turning, 3000 * MS) == pytest.approx(3.0) and longest_gap(turning) == pytest.approx(0.05)
    assert longest_gap([word(0, 0.5), word(120, 0.5), word(170, 0.0), word(900, 0.5)]) == pytest.approx(0.12)
    assert longest_gap([word(0, 0.5)]) == 0.0


def test_an_old_command_that_comes_again_is_counted() -> None:
    words = [word(0, 0.5, 0.01), word(50, 0.5, 0.02), word(100, 0.5, 0.02), word(150, 0.5, 0.01), word(200, 0.5, 0.03)]
    assert old_words(words, 0) == 1
    assert old_words(words, 160 * MS) == 0
    standing = [word(0, 0.5, 0.01), word(50, 0.0), word(100, 0.5, 0.02), word(150, 0.0)]
    assert old_words(standing, 0) == 0


def test_the_first_stop_standstill_and_turn_after_a_time_are_found(tmp_path: Path) -> None:
    path = tmp_path / "motors.bin"
    lines = [word(0, 0.5), word(90, 0.0), tick(100, 0.4), tick(150, 5e-4), word(700, 0.1)]
    path.write_bytes(b"".join(line.bytes() for line in lines))
    motors = MotorRecord(path)
    zero = motors.zero_after(10 * MS)
    assert zero is not None and zero.time_ns == 90 * MS
    again, standing = motors.turn_after(zero.time_ns), motors.standing_after(zero.time_ns)
    assert again is not None and again.time_ns == 700 * MS
    assert standing is not None and standing.time_ns == 150 * MS
    assert motors.turn_after(700 * MS) is None
