"""Times of a live robot's watchdogs, s: each says what it must be longer or shorter than.

`framework/live/tests/test_timing.py` asserts these inequalities, with the defaults of `config.tables` for what a config
can set: `gate.stop_deadline`, `gate.sensor_timeout`, `live.hang_timeout`, `live.restart_window` and `run.period`.
Intervals and waits that no inequality holds stand in the module that uses them. This module imports nothing.
"""

from __future__ import annotations

__all__ = [
    "ADDITION_ANSWER_WAIT",
    "ADDITION_TRIES",
    "APPLY_WAIT",
    "CLOCK_LEAD_LIMIT",
    "CLOCK_READ_INTERVAL",
    "COMMAND_WAIT_LEAST",
    "COMMAND_WAIT_SHARE",
    "COMMAND_WAIT_SHARE_MOST",
    "CONTAINER_STOP_LIMIT",
    "DEAD_TOKEN_WAIT",
    "DOWN_LIMIT",
    "DUMP_WAIT",
    "FOLLOW_INTERVAL",
    "FORK_SERVER_READY",
    "GATE_CHECK_INTERVAL",
    "GATHER_WAIT",
    "GOAL_CHECK_INTERVAL",
    "GOAL_POSE_WAIT",
    "GROUP_STOP_WAIT",
    "HEALTHY_AFTER",
    "HEART_CHECK_INTERVAL",
    "INSTANCE_START_LIMIT",
    "LATE_LIMIT",
    "LINK_CLOSE_WAIT",
    "LINK_LEASE",
    "LINK_RETRY_FIRST",
    "LINK_RETRY_MOST",
    "ORPHAN_SHUTDOWN_LIMIT",
    "PATIENT_STEP_LIMIT",
    "PLATFORM_RETRY_INTERVAL",
    "PLATFORM_SILENCE",
    "PRESENCE_DOUBT_PERIODS",
    "RECORDER_WAIT",
    "REMOTE_GOAL_SILENCE",
    "REQUEST_ATTEMPT",
    "REQUEST_TIMEOUT",
    "RESTART_WAIT_FIRST",
    "RESTART_WAIT_MOST",
    "RIVAL_WINDOW",
    "ROBOT_GONE_AFTER",
    "ROUTER_REPLACED_WITHIN",
    "RUNNER_IDLE",
    "SERVICE_STOP_LIMIT",
    "SESSION_LINGER",
    "SESSION_SETTLE",
    "SESSION_SPREAD",
    "SHUTDOWN_LIMIT",
    "SIBLING_WAIT_FIRST",
    "STALE_CHECK_DELAY",
    "START_LIMIT",
    "STATE_RECALL_WAIT",
    "STOPPED_GAP",
    "STOP_WITHIN",
    "STUCK_AFTER",
    "STUCK_AFTER_PATIENT",
    "SUPERVISOR_TIMEOUT",
    "TELEOP_INTERVAL",
    "TOKEN_SETTLE_WAIT",
    "TOOL_JOIN_WAIT",
    "WAITING_REPORT_INTERVAL",
    "WATCH_INTERVAL",
    "WHEELS_REFUSE_LIMIT",
    "command_wait",
    "rate_of_wait",
]

# Stopping the wheels: docs/faults.md promises a zero command within 0.150 s of the last good one.
GATE_CHECK_INTERVAL = 0.05
"""Longest time between two checks of the gate, s. With `gate.stop_deadline` at most STOP_WITHIN."""
STOP_WITHIN = 0.150
"""Longest time from the last good command to zero at the wheels, s, with the default deadline."""
STALE_CHECK_DELAY = 0.0002
"""Delay of a check after an input has gone stale, s, so that it is not too early. Far below PLATFORM_RETRY_INTERVAL."""
PLATFORM_RETRY_INTERVAL = 0.01
"""Interval between two attempts to begin, or to repeat a command that the wheels refused, s. Several fit a deadline."""
WHEELS_REFUSE_LIMIT = 1.0
"""How long commands to the wheels may fail before the platform's process ends, s; its successor opens the driver again.
Shorter than `live.hang_timeout`."""
COMMAND_WAIT_SHARE, COMMAND_WAIT_SHARE_MOST, COMMAND_WAIT_LEAST = 0.4, 0.8, 0.008
"""Wait of the gate for a tick's commands: share of the period; largest share, of short periods; shortest wait, s. A
period and this wait together are shorter than `gate.stop_deadline`."""
TELEOP_INTERVAL = 0.05
"""Interval of an operator's commands, s. Two fit into `gate.stop_deadline`, so that one may be lost."""
PRESENCE_DOUBT_PERIODS = 1.25
"""Longest silence of a process whose liveliness tokens are lost before it counts as gone, in periods. Longer than one,
shorter than two."""
REMOTE_GOAL_SILENCE = 0.5
"""Longest time without a step of a goal node on another host, s: its messages may cross a slow network. Longer than
`gate.stop_deadline` with the gate's wait."""

# The goal
GOAL_CHECK_INTERVAL = 0.05
"""Shortest wait between two checks while no pose arrives, s. Shorter than GOAL_POSE_WAIT."""
GOAL_POSE_WAIT = 0.2
"""Time without a pose after which the goal steps without one, s. At least two periods, below PLATFORM_SILENCE."""
PLATFORM_SILENCE = 1.0
"""Silence of the platform after which a goal pauses and `doctor` reports a process as cut off from it, s. Longer than
`gate.sensor_timeout`."""

# Waits of a node
SIBLING_WAIT_FIRST = 0.25
"""Longest wait for other inputs of the same tick before the first step, s: a process that joins a robot during a drive
gets the first message of each stream at another moment, within a few periods. At most RUNNER_IDLE."""
RUNNER_IDLE = 0.5
"""Longest wait of a runner while no message arrives, s. Shorter than `live.hang_timeout`."""
WAITING_REPORT_INTERVAL = 0.25
"""Interval of the reports of a node that waits for its first message, s. At most RUNNER_IDLE."""
CLOCK_READ_INTERVAL = 0.25
"""Interval of reading the platform's clock where nothing else needs it, s. Shorter than CLOCK_LEAD_LIMIT."""
CLOCK_LEAD_LIMIT = 0.5
"""Largest lead of a message over the platform's clock as known here, s: a small lead is due to transport delays. Longer
than CLOCK_READ_INTERVAL."""
LATE_LIMIT = 0.25
"""Age against the newest message from which a message is late, s. Below RIVAL_WINDOW."""
RIVAL_WINDOW = 2.0
"""Time within which two publishers of one stream are noticed, s, and how long only one must have been heard until it
counts as the only one. Longer than LINK_LEASE: a dead one must be gone by then."""

# Hanging processes
WATCH_INTERVAL = 0.1
"""Interval of a process's check of its nodes and of its heartbeat, s. Half of HEART_CHECK_INTERVAL or less."""
HEART_CHECK_INTERVAL = 0.2
"""Interval of the supervisor's check of a heartbeat, s. Several fit into `live.hang_timeout`."""
STOPPED_GAP = 0.5
"""Gap after which a thread that runs every WATCH_INTERVAL must have waited for the GIL or been stopped, s. Several
WATCH_INTERVALs."""
DUMP_WAIT = 0.5
"""How long a hanging process may take to print its traceback before it is killed, s, after its own timer has ended."""
PATIENT_STEP_LIMIT = 30.0
"""Longest step of a patient role (mapper, planner), s. Longer than STUCK_AFTER_PATIENT."""
STUCK_AFTER, STUCK_AFTER_PATIENT = 0.5, 5.0
"""Time in one step after which tools show a node as stuck, s: before `live.hang_timeout` ends its process."""

# Starts and restarts
RESTART_WAIT_FIRST, RESTART_WAIT_MOST = 0.1, 5.0
"""Wait before the first restart, and longest wait before a later one, s."""
HEALTHY_AFTER = 5.0
"""How long a process must run for its next crash to count as a first one, s. At least RESTART_WAIT_MOST."""
FORK_SERVER_READY = 60.0
"""How long the fork server may take to import everything, s. Shorter than START_LIMIT."""
INSTANCE_START_LIMIT, START_LIMIT = 120.0, 180.0
"""Longest start of one instance, s, and longest part of a robot's start without a new node or compiled kernel, s."""
STATE_RECALL_WAIT = 0.5
"""How long a starting process queries others for the robot's state while some do not answer, s. Below LINK_LEASE."""
ROBOT_GONE_AFTER = 15.0
"""Time without any node after which a robot counts as gone, s. Longer than RESTART_WAIT_MOST and HEALTHY_AFTER."""

# Shutdown, innermost first
GROUP_STOP_WAIT = 1.0
"""How long each group of processes may take to end before the supervisor kills it, s."""
SHUTDOWN_LIMIT = 4.0
"""How long a process may take after a signal before its own timer ends it, s. Longer than GROUP_STOP_WAIT."""
ORPHAN_SHUTDOWN_LIMIT = 4.5
"""How long forked processes may take to end after the supervisor's death, s. Longer than SHUTDOWN_LIMIT."""
SERVICE_STOP_LIMIT, CONTAINER_STOP_LIMIT = 5.0, 10.0
"""Longest end of a process under systemd and in a container, s. Longer than ORPHAN_SHUTDOWN_LIMIT."""
DOWN_LIMIT = 15.0
"""How long `navloom down` waits, s. Longer than all of these."""

# Links
LINK_LEASE = 1.0
"""Silence after which a neighbour counts as gone (cut cable, stopped process), s. A closed socket is seen at once."""
LINK_CLOSE_WAIT = 1.5
"""How long a reliable message waits before the link is closed, s: longer than LINK_LEASE, so that a link to a dead
process ends by that, and shorter than `live.hang_timeout`, so that a writer does not count as hung because its reader
is. `engine.task_checks` refuses a shorter timeout."""
LINK_RETRY_FIRST, LINK_RETRY_MOST = 0.05, 0.2
"""First and longest interval of connection attempts, s. Two of the longest fit into GATHER_WAIT."""
GATHER_WAIT = 0.5
"""Longest wait at a peer's opening until it is linked to every running peer, s. It must be linked then: a process that
restarts queries the others for the robot's state, such as a latched stop, as soon as it is open. Shorter than
TOOL_JOIN_WAIT."""
TOKEN_SETTLE_WAIT = 0.5
"""Time between declaring a claim and looking at those of others, s: longer than two messages between hosts take."""
DEAD_TOKEN_WAIT = 3.0
"""Longest wait for the tokens of a process that has died, s. Longer than LINK_LEASE on both sides of a router."""
TOOL_JOIN_WAIT = 2.0
"""Longest time in which a tool finds the robot's processes, s. Longer than GATHER_WAIT."""
FOLLOW_INTERVAL = 0.3
"""Interval of looking for processes that the robot gains, s: shorter than one takes to start, and with GATHER_WAIT
shorter than RECORDER_WAIT."""
RECORDER_WAIT = 2.0
"""How long a process that joins a recorded robot waits for the recorder, s: longer than this takes to see it."""

# Requests, from the service outwards
APPLY_WAIT = 2.0
"""How long a node may take to begin with a change, s. Shorter than REQUEST_ATTEMPT."""
REQUEST_ATTEMPT = 2.4
"""Wait for an answer before a retry, s. Longer than a service takes (APPLY_WAIT), shorter than SESSION_LINGER."""
SESSION_LINGER = 2.5
"""How long a session stays open after another has taken over, s. Longer than a query waits for its answer."""
REQUEST_TIMEOUT = 5.0
"""Longest time of a request with its retries, s. Room for two attempts."""
ADDITION_ANSWER_WAIT, ADDITION_TRIES = 2.0, 4
"""Longest wait for a process to take in an instance, s (it assembles no plugin for it), and number of attempts, because
the process may be restarting. Together below SUPERVISOR_TIMEOUT."""
SUPERVISOR_TIMEOUT = 10.0
"""Longest time of a request to the supervisor, s."""
SESSION_SPREAD, SESSION_SETTLE = 1.0, 0.3
"""Time over which the processes of a host open new sessions, s, so that they do not all load the CPU at once; and wait
from the opening of a session until it is used, s: by then the network knows its streams."""
ROUTER_REPLACED_WITHIN = SESSION_SPREAD + SESSION_SETTLE + SESSION_LINGER + 2.0
"""Longest wait until the clients have left the replaced router, s: a revoked certificate works no longer than this."""


def command_wait(period: float) -> float:
    """How long after a platform stamp the gate waits for the commands of its tick, s.

    With a longer wait, a robot with ticks of 50 ms would stop for one late command: by the late decision the command
    of the previous tick would be stale.
    """
    return min(COMMAND_WAIT_SHARE_MOST * period, max(COMMAND_WAIT_SHARE * period, COMMAND_WAIT_LEAST))


def rate_of_wait(seconds: float) -> float:
    """Largest tick rate, Hz, at which commands that take `seconds` are waited for: the inverse of `command_wait`."""
    return (COMMAND_WAIT_SHARE_MOST if seconds <= COMMAND_WAIT_LEAST else COMMAND_WAIT_SHARE) / seconds
