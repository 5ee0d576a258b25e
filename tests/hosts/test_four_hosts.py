"""A robot on four hosts with a router, as in a deployment; cables are cut while it scans and while it drives."""

from __future__ import annotations

import time

import pytest
from four_hosts import NAMES, Robot
from host_rig import Slow, lab, last_words, until, why_not
from motor_words import MotorWords

WITHOUT = why_not()
pytestmark = pytest.mark.skipif(bool(WITHOUT), reason=WITHOUT or "hosts can be made")
CUT = 1.5
"""How long a cable stays cut, s: more than the lease of 1 s, after which the other hosts notice."""


def test_a_goal_over_four_hosts_survives_cut_cables() -> None:
    with lab(*NAMES, slow={"brain": Slow()}) as hosts:
        robot = Robot(hosts)
        robot.bring_up()
        motors = MotorWords(robot.motors)
        goal = hosts["desk"].start("goal", "0", "2.0", *robot.options)

        goal.wait_for("mapping")
        hosts.cut("brain")  # so the first sweep is lost
        time.sleep(CUT)
        hosts.mend("brain")
        with last_words(goal, *robot.programs.values(), ask=robot.looks):
            until(lambda: motors.speed > 0.3, 60, "the robot drives")
        began = time.monotonic()
        hosts.cut("base")
        time.sleep(CUT)
        stood = motors.speed
        hosts.mend("base")
        assert stood == 0.0
        until(lambda: motors.turned_after(began + CUT), 60, "the robot drives again")
        goal.wait_for("succeeded: the goal was reached", 60)
        assert goal.process.wait(20) == 0

        fault = motors.fault(began, began + CUT, time.monotonic())
        assert fault.stopped is not None and fault.stood is not None and fault.stopped + fault.stood < CUT, fault
        assert not motors.touched
        assert robot.take_down() == {"brain": 0, "drive": 0, "base": 0, "hub": 0}


@pytest.mark.slow
def test_the_papers_goal_is_reached_over_four_hosts() -> None:
    with lab(*NAMES, slow={"brain": Slow()}) as hosts:
        robot = Robot(hosts)
        robot.bring_up()
        goal = hosts["desk"].start("goal", "0", "7.6", *robot.options)
        with last_words(goal, *robot.programs.values(), ask=robot.looks):
            goal.wait_for("succeeded: the goal was reached", 180)
        assert goal.process.wait(20) == 0
        motors = MotorWords(robot.motors).look()
        assert max(speed for _, speed, _ in motors.words) > 0.3 and not motors.touched
        assert robot.take_down() == {"brain": 0, "drive": 0, "base": 0, "hub": 0}
