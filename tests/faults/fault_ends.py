"""The supervisor of a driving robot is killed or stopped."""

from __future__ import annotations

import os
import signal
import time

from fault_kinds import HOLD, Outcome
from fault_leftovers import WAYS, fork_first
from fault_rig import SHARES, Rig, is_running, until
from leftovers import below
from motor_record import ran_on
from navloom_live.operating.host_faults import is_stopped

__all__ = ["ENDS", "end_of_supervisor", "name_of_end"]

LIMIT = 20.0
"""Longest wait for the robot's processes to end, s."""
ENDS = ("", *SHARES)
"""Process that is stopped while the supervisor is killed; an empty name for none."""


def name_of_end(stopped: str, is_stopped_first: bool, way: str = "") -> str:
    """Name of such a fault in the book."""
    name = "SIGSTOP, SIGKILL up" if is_stopped_first else "SIGKILL up"
    name += f", a plugin {WAYS[way]}" if way else ""
    return f"{name}, {stopped} stopped" if stopped else name


def end_of_supervisor(rig: Rig, stopped: str = "", is_stopped_first: bool = False, way: str = "") -> Outcome:
    """Kill `up` at full speed, and measure how its processes and the motors end.

    Args:
        rig: The robot; down afterwards.
        stopped: Process that is stopped at that time; empty for none.
        is_stopped_first: Stop the supervisor itself for a while before, which must not disturb the robot.
        way: How a plugin has created children before, a key of WAYS; empty for none.
    """
    outcome = Outcome(name_of_end(stopped, is_stopped_first, way))
    if way:
        fork_first(way)(rig)
    rig.wait_full_speed()
    pids, outcome.load = rig.pids(), os.getloadavg()[0]
    if is_stopped_first:
        stopped_ns = time.monotonic_ns()
        os.kill(rig.up.pid, signal.SIGSTOP)
        time.sleep(HOLD)
        outcome.note["stood_while_stopped"] = rig.motors.zero_after(stopped_ns) is not None
    if stopped:
        os.kill(pids[stopped], signal.SIGSTOP)
        until(lambda: is_stopped(pids[stopped]), LIMIT, f"{stopped} is stopped")
    began = time.monotonic_ns()
    rig.driver.ending.set()
    rig.up.kill()
    rig.up.wait()
    limit = time.monotonic() + LIMIT
    while any(below(rig.folder)) and time.monotonic() < limit:
        time.sleep(0.02)
    ended = time.monotonic_ns()
    outcome.note["ended_s"] = (ended - began) * 1e-9
    outcome.note["left"] = [share for share, pid in pids.items() if is_running(pid)]
    outcome.note["census"] = rig.census.left()
    zero = rig.motors.zero_after(began)
    outcome.zero = None if zero is None else (zero.time_ns - began) * 1e-9
    words = rig.motors.between(began - 200_000_000, ended)
    outcome.ran_on = None if stopped == "robot" else ran_on(words, ended)
    outcome.touched = rig.motors.touched
    until(lambda: not outcome.note["left"] or _cleared(rig), LIMIT, "what was left behind is gone")
    return outcome


def _cleared(rig: Rig) -> bool:
    for pid in rig.pids().values():
        os.kill(pid, signal.SIGKILL)
    return not rig.pids()
