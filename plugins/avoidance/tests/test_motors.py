"""Commands that the wheels have not carried out yet: dead time and lag."""

import numpy as np
import pytest
from navloom_avoidance.motors import Motors


def sent(motors, *commands, twist=(0.0, 0.0), share=1.0):
    for command in commands:
        motors.give(*command)
        flying = motors.in_flight(twist, share)
    return flying


def test_with_ideal_motors_only_the_measured_velocity_counts():
    assert sent(Motors(0.0, 0.0, 0.05, 2.0, 2.0), (0.5, 0.1), twist=(0.2, 0.3)).tolist() == [[0.2, 0.3]]


def test_commands_within_the_dead_time_are_still_to_come():
    """The gate lets the speed rise by 2 m/s^2 for 0.05 s, which is 0.1 m/s a tick."""
    motors = Motors(0.1, 0.1, 0.05, 2.0, 2.0)
    assert sent(motors, (0.5, 0.1), (0.5, 0.2)) == pytest.approx(np.array([[0.1, 0.1], [0.2, 0.2]]))


def test_a_command_that_the_gate_held_back_is_not_to_come():
    motors = Motors(0.1, 0.05, 0.05, 2.0, 2.0)
    assert sent(motors, (0.1, 0.4), share=0.5) == pytest.approx(np.array([[0.05, 0.2]]))


def test_a_robot_that_another_drives_follows_its_own_measured_speed():
    motors = Motors(0.1, 0.05, 0.05, 2.0, 2.0)
    assert sent(motors, (0.0, 0.0), twist=(1.0, 0.3)).tolist() == [[1.0, 0.3]]
