"""Starts an instance that a running robot does not have, in shadow."""

from __future__ import annotations

import time
from collections.abc import Callable

from navloom_live.live.requests import ADD, Add
from navloom_live.operating.client import Client, ClientError, Refused

__all__ = ["STARTS", "start_in_shadow"]

STARTS = 120.0
"""Longest start of an instance, s: its kernels may have to be compiled."""
LOOK = 0.1
"""Interval of looking for the instance, s."""
ASK = 1.0
"""Interval of asking how its process is doing, s."""


def start_in_shadow(client: Client, role: str, name: str, say: Callable[[str], None]) -> None:
    """Let the robot's supervisor start an instance, and wait until it is alive.

    A robot whose nodes were started one by one has no supervisor; then this does nothing.

    Args:
        client: Client of the robot.
        role: Its role.
        name: Its plugin, or plugin@preset, which becomes its name.
        say: Receives what happens.

    Raises:
        Refused: It cannot be added, or does not start, with the reason and a remedy.
    """
    try:
        answer = client.call_supervisor(ADD, Add(role, name, again=True))
    except ClientError:
        return
    if answer.is_new:
        say(f"{role}: starting {name} in shadow")
    limit, asked = time.monotonic() + STARTS, time.monotonic()
    while not client.lives(role, name):
        now = time.monotonic()
        if now > limit:
            why = f": its process {answer.why}" if answer.why else ""
            raise Refused(f"{role} {name} has not started within {STARTS:g} s{why}; `navloom doctor` says more")
        if now - asked > ASK:
            asked, answer = now, client.call_supervisor(ADD, Add(role, name))
            if answer.state == "failed":
                raise Refused(f"{role} {name} does not start: its process {answer.why}: {answer.last_words}")
        time.sleep(LOOK)
