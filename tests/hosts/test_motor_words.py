"""Measurements from a motor log made by hand."""

from __future__ import annotations

from pathlib import Path

from motor_words import MotorWords

LOG = """\
1000000000 0.400000 0.100000
at 1000000000 0.400000 0.100000 0 1.0000 2.0000
1050000000 0.400000 0.100000
1170000000 0.000000 0.000000
at 1200000000 0.150000 0.000000 0 1.0500 2.0000
at 1250000000 0.000000 0.000000 0 1.0600 2.0000
1300000000 0.000000 0.000000
5500000000 0.050000 0.000000
"""


def test_a_fault_is_timed_by_the_commands_to_the_motors(tmp_path: Path) -> None:
    log = tmp_path / "motors.log"
    log.write_text(LOG + "5550000000 0.1", "utf-8")  # the last line is being written
    motors = MotorWords(log)
    assert motors.speed == 0.05
    fault = motors.fault(1.06, 4.0, 5.6)
    assert round(fault.ran_on, 3) == 0.12
    assert fault.stopped is not None and round(fault.stopped, 3) == 0.11
    assert fault.stood is not None and round(fault.stood, 3) == 0.08
    assert fault.again is not None and round(fault.again, 3) == 1.5
    assert motors.place == (1.06, 2.0) and not motors.touched


def test_motors_that_never_stopped_have_no_time_of_stopping(tmp_path: Path) -> None:
    log = tmp_path / "motors.log"
    log.write_text("".join(f"{n}000000000 0.4 0.0\n" for n in range(5)), "utf-8")
    fault = MotorWords(log).fault(1.0, 2.0, 4.5)
    assert (fault.ran_on, fault.stopped, fault.stood, fault.again) == (1.0, None, None, None)


def test_motors_that_get_no_more_commands_run_on_until_the_end_of_the_measurement(tmp_path: Path) -> None:
    log = tmp_path / "motors.log"
    log.write_text("1000000000 0.4 0.0\n1050000000 0.4 0.0\n", "utf-8")
    assert round(MotorWords(log).fault(1.06, 2.0, 11.05).ran_on, 3) == 10.0
