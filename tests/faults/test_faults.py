"""One fault of each important kind at full speed: the robot stops, recovers, reaches its goal and ends.

`campaign.py` measures how fast it stops (docs/lab/fault-campaigns.md); here other tests share the processors.
"""

from __future__ import annotations

from dataclasses import replace

from fault_ends import end_of_supervisor
from fault_kinds import PARTS, PROCESSES, SEIZED, STRANGERS, inject
from fault_leftovers import DELETIONS, FORKS, forks, zombies
from fault_rig import rig

SOON, EXIT = 1.5, 10.0
"""Longest time that motors may repeat a command, and longest time to end, on a loaded machine, s."""
CHOSEN = (
    "SIGSTOP safe, SIGCONT",
    "faulty_tracker raises each tick",
    "faulty_tracker publishes NaN past the checks",
    "faulty_vfh computes for ever in C code",
    "faulty_tracker sleeps for ever in C code that holds the GIL",
    "faulty_tracker has forked a daemon, SIGKILL drive",
    "runtime folder deleted, SIGKILL drive",
    "commands from the future",
    "10,000 malformed messages",
)
POOL = "faulty_tracker has a pool of processes, SIGKILL drive"
TWO_PROCESSES = """
[live.processes]
drive = ["reference", "controller", "avoider", "recovery"]
rest = ["platform", "localizer", "mapper", "planner", "goal", "gate"]
"""


def test_after_each_fault_it_drives_again_and_at_last_reaches_its_goal() -> None:
    faults = {fault.name: fault for fault in (*PROCESSES, *PARTS, *SEIZED, *FORKS, *DELETIONS, *STRANGERS)}
    deletion = "runtime folder deleted, SIGKILL drive"
    faults[deletion] = replace(faults[deletion], prepare=faults[POOL].prepare)  # the pool must end, too
    with rig("shared_memory = true\n") as robot:  # so that there are segments that could be left over
        assert forks(robot) == []
        for name in CHOSEN:
            outcome = inject(robot, faults[name])
            assert outcome.goal == "kept" and outcome.old == 0 and not outcome.touched, outcome
            assert outcome.ran_on is not None and outcome.ran_on < SOON, outcome
            if faults[name] in FORKS:
                assert outcome.note["before"]["children"] and not outcome.note["after"]["children"], outcome
        assert robot.said("controller faulty_tracker failed: RuntimeError: told to fail (fault_plugins.py:")
        killed = inject(robot, faults["SIGKILL robot"])
        assert killed.left_driving is not None and killed.fresh, killed
        assert robot.reach_a_goal() == "succeeded: the goal was reached"
        assert zombies(robot) == [] and robot.describe()
        assert robot.end() < EXIT
        assert robot.census.segments > 0 and not any(robot.census.left().values()), robot.census.left()
        # the driver sends goal after goal: a goal that goes down with the robot gives exit code 1
        assert robot.up.returncode == (1 if robot.said("went down, and goal") else 0)


def test_no_process_is_left_when_its_supervisor_is_killed_not_even_a_stopped_one() -> None:
    with rig(TWO_PROCESSES) as robot:
        outcome = end_of_supervisor(robot, "drive", way="daemon")
        census = outcome.note["census"]
        assert census.pop("files") == 2 and not any(census.values()), census  # what it ran, for doctor
        assert outcome.note["left"] == [] and outcome.zero is not None and not outcome.touched, outcome
        # and the folder of a dead robot does not count as a robot
        assert "no robot of this user is up" in robot.run("down").stderr
