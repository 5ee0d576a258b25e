"""Inequalities between the times of the live robot's watchdogs."""

from __future__ import annotations

import ast
import itertools
import re
from collections import Counter
from pathlib import Path

import pytest
from navloom.config.tables import GateTable, LiveTable, RunTable
from navloom.engine.task_checks import LEAST_HANG_TIMEOUT
from navloom_live import timing as t
from navloom_live.live.process_streams import RETAINED_RETRY_INTERVAL
from navloom_live.transport.access import PACE, PACES, RECALLED, SAID

DEADLINE = GateTable().stop_deadline
SENSOR = GateTable().sensor_timeout
HANG = LiveTable().hang_timeout
PERIOD = RunTable().period
RESTART_WAITS = [min(t.RESTART_WAIT_MOST, 2**n * t.RESTART_WAIT_FIRST) for n in range(LiveTable().restart_limit)]
RISING = {
    "wheels stop in time": (DEADLINE + t.GATE_CHECK_INTERVAL, t.STOP_WITHIN + 1e-9),
    "platform stops by itself": (DEADLINE + t.PLATFORM_RETRY_INTERVAL + t.STALE_CHECK_DELAY, t.STOP_WITHIN),
    "stale checks are exact": (20 * t.STALE_CHECK_DELAY, t.PLATFORM_RETRY_INTERVAL, DEADLINE / 5),
    "a late command is no stop": (t.command_wait(PERIOD), PERIOD, PERIOD + t.command_wait(PERIOD), DEADLINE),
    "one lost teleop command": (2 * t.TELEOP_INTERVAL, DEADLINE + 1e-9),
    "tokens lost": (PERIOD, t.PRESENCE_DOUBT_PERIODS * PERIOD, DEADLINE + 1e-9),
    "goal on another host": (DEADLINE + t.command_wait(PERIOD), t.REMOTE_GOAL_SILENCE, t.PLATFORM_SILENCE),
    "goal without poses": (t.GOAL_CHECK_INTERVAL, t.GOAL_POSE_WAIT, t.PLATFORM_SILENCE),
    "two periods per pose": (2 * PERIOD - 1e-9, t.GOAL_POSE_WAIT),
    "deadlines below silences": (DEADLINE, SENSOR, t.PLATFORM_SILENCE),
    "first step": (4 * PERIOD, t.SIBLING_WAIT_FIRST, t.RUNNER_IDLE, HANG),
    "waiting is reported": (t.WAITING_REPORT_INTERVAL, t.RUNNER_IDLE),
    "clock": (t.CLOCK_READ_INTERVAL, t.CLOCK_LEAD_LIMIT),
    "rivals": (t.LATE_LIMIT, t.LINK_LEASE, t.RIVAL_WINDOW),
    "wheels that refuse": (DEADLINE, t.WHEELS_REFUSE_LIMIT, HANG),
    "heartbeat": (2 * t.WATCH_INTERVAL - 1e-9, t.HEART_CHECK_INTERVAL, 4 * t.HEART_CHECK_INTERVAL, HANG),
    "stopped process": (3 * t.WATCH_INTERVAL, t.STOPPED_GAP, HANG),
    "own timer, then the supervisor": (HANG, HANG + t.DUMP_WAIT, t.DEAD_TOKEN_WAIT),
    "shown before it is ended": (t.STUCK_AFTER, HANG),
    "patient roles": (HANG, t.STUCK_AFTER_PATIENT, t.PATIENT_STEP_LIMIT),
    "restarts": (t.RESTART_WAIT_FIRST, t.RESTART_WAIT_MOST, t.HEALTHY_AFTER + 1e-9),
    "restarts within the window": (sum(RESTART_WAITS), LiveTable().restart_window),
    "a restart is not the end": (t.RESTART_WAIT_MOST + t.HEALTHY_AFTER, t.ROBOT_GONE_AFTER),
    "starts": (t.FORK_SERVER_READY, t.INSTANCE_START_LIMIT, t.START_LIMIT),
    "shutdown": (
        t.GROUP_STOP_WAIT,
        t.SHUTDOWN_LIMIT,
        t.ORPHAN_SHUTDOWN_LIMIT,
        t.SERVICE_STOP_LIMIT,
        t.CONTAINER_STOP_LIMIT,
        t.DOWN_LIMIT,
    ),
    "a dead reader is no hang": (t.LINK_LEASE, t.LINK_CLOSE_WAIT, HANG),
    "retries within a gathering": (2 * t.LINK_RETRY_MOST, t.GATHER_WAIT, t.TOOL_JOIN_WAIT),
    "state is recalled before a lease ends": (t.STATE_RECALL_WAIT, t.LINK_LEASE),
    "claims of the dead": (t.TOKEN_SETTLE_WAIT, 2 * t.LINK_LEASE, t.DEAD_TOKEN_WAIT),
    "recorder": (t.FOLLOW_INTERVAL + t.GATHER_WAIT, t.RECORDER_WAIT),
    "recorder sees a process": (3 * t.FOLLOW_INTERVAL, t.RECORDER_WAIT),
    "requests": (t.APPLY_WAIT, t.REQUEST_ATTEMPT, t.SESSION_LINGER, 2 * t.REQUEST_ATTEMPT, t.REQUEST_TIMEOUT),
    "additions": (t.ADDITION_TRIES * t.ADDITION_ANSWER_WAIT, t.SUPERVISOR_TIMEOUT),
}


@pytest.mark.parametrize("name", RISING)
def test_each_time_is_shorter_than_the_next(name: str) -> None:
    assert all(shorter < longer for shorter, longer in itertools.pairwise(RISING[name])), RISING[name]


def test_queries_are_slower_than_a_router_admits() -> None:
    assert 1.0 / PACE < RETAINED_RETRY_INTERVAL
    assert 1.0 / PACES[RECALLED] < 0.02  # pause between two queries for the robot's state
    assert 1.0 / SAID < t.TELEOP_INTERVAL


def test_a_config_may_set_no_hang_timeout_below_the_wait_of_a_writer() -> None:
    assert LEAST_HANG_TIMEOUT == t.LINK_CLOSE_WAIT


def test_no_two_times_have_one_name() -> None:
    names: Counter[str] = Counter()
    for path in Path(t.__file__).parent.rglob("*.py"):
        for constant, docstring in itertools.pairwise(ast.parse(path.read_text("utf-8")).body):
            says = ast.unparse(docstring) if isinstance(docstring, ast.Expr) else ""
            if isinstance(constant, ast.Assign) and re.search(r", (s|ms|µs|ns)\b", says):
                names.update(node.id for node in ast.walk(constant.targets[0]) if isinstance(node, ast.Name))
    assert len(names) > 100
    assert [name for name, count in names.items() if count > 1] == []
