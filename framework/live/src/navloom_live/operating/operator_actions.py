"""What an operator does to a live robot: requests to its nodes. Nothing here decodes messages or loads kernels."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from navloom_live.live.requests import (
    ADD,
    CANCEL,
    CLEAR,
    GET_PARAMETERS,
    LIMIT,
    PLACE,
    PLAN,
    RELOCALISE,
    REPLAN,
    SET_PARAMETERS,
    SWAP,
    Add,
    Assignments,
    Between,
    Place,
    Planned,
    SpeedLimit,
    Swap,
)
from navloom_live.live.service import RESUME, Nothing, Service
from navloom_live.operating.client import Client, ClientError, Refused
from navloom_live.timing import INSTANCE_START_LIMIT

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "cancel",
    "clear_map",
    "footprint",
    "get_parameters",
    "limit_speed",
    "place",
    "plan",
    "relocalise",
    "resume",
    "set_parameters",
    "swap",
]


def resume(client: Client) -> None:
    """Let the robot drive again after a stop or a contact."""
    client.call("gate", "main", RESUME, Nothing())


def cancel(client: Client) -> bool:
    """Cancel the current goal; False if there is none."""
    return bool(client.call("goal", "main", CANCEL, Nothing()).goal_id)


def place(client: Client, x: float, y: float, heading: float, sigma: tuple[float, float] | None = None) -> str:
    """Tell every localizer where the robot is; see `Navigator.place`."""
    spread, heading_spread = sigma or (None, None)
    given = {"x": x, "y": y, "heading": heading, "spread": spread, "heading_spread": heading_spread}
    for name, value in given.items():
        if value is not None and not math.isfinite(value):
            raise Refused(f"{name} is {value}, expected a finite number")
    answers = _tell_localizers(client, PLACE, Place(x, y, heading, spread, heading_spread))
    return next((answer.warning for answer in answers if answer.warning), "")


def relocalise(client: Client) -> None:
    """Have every localizer that can search for the robot anywhere; see `Navigator.relocalise`."""
    _tell_localizers(client, RELOCALISE, Nothing())


def _tell_localizers(client: Client, service: Service[Any, Any], asked: Any) -> list[Any]:
    """Ask every localizer, and have the goal planned again; their answers."""
    there = [node for node in client.describe() if node.role == "localizer"]
    answers = []
    # The active one first: if it refuses, nothing is changed.
    for node in sorted(there, key=lambda node: not node.active):
        try:
            answers.append(client.call("localizer", node.instance, service, asked))
        except Refused:
            if node.active:
                raise
    if not any(node.active for node in there):
        raise ClientError(f"robot {client.keys.prefix}: no localizer answers; `navloom doctor` says why")
    with contextlib.suppress(ClientError):  # without a goal node there is no goal to plan again
        client.call("goal", "main", REPLAN, Nothing())
    return answers


def plan(client: Client, start: tuple[float, float, float], goal: tuple[float, float, float]) -> Planned:
    """The active planner's path between two poses on its newest map; see `Navigator.plan`."""
    return client.call("planner", _active(client, "planner"), PLAN, Between(start, goal))


def clear_map(client: Client) -> None:
    """Have the active mapper clear what it can observe again; see `Navigator.clear_map`."""
    client.call("mapper", _active(client, "mapper"), CLEAR, Nothing())


def footprint(client: Client) -> NDArray[np.float64]:
    """The robot's outline as its config gives it; see `Navigator.footprint`."""
    from navloom.engine.build import robot_spec

    from navloom_live.operating.live_recorder import ask_header

    return robot_spec(ask_header(client).loaded().config.robot).footprint


def limit_speed(client: Client, speed: float, is_percentage: bool = False) -> float:
    """Limit the robot's speed; see `Navigator.limit_speed`."""
    if not (math.isfinite(speed) and speed >= 0.0):
        raise Refused(f"speed limit is {speed}, expected 0 for none, or more")
    return client.call("gate", "main", LIMIT, SpeedLimit(speed, is_percentage)).speed


def _active(client: Client, role: str) -> str:
    """Name of the active instance of a role. Raises ClientError if none answers."""
    for node in client.describe():
        if node.role == role and node.active:
            return node.instance
    raise ClientError(f"robot {client.keys.prefix}: no {role} answers; `navloom doctor` says why")


def swap(
    client: Client,
    role: str,
    instance: str,
    timeout: float = 10.0,
    say: Callable[[str], None] = lambda text: None,
) -> int:
    """Make another instance active as soon as it is ready; see `Navigator.swap`."""
    if not client.lives(role, instance):
        if role == "method":
            from navloom.config.config_methods import ALTERNATIVE_INSTEAD

            raise Refused(ALTERNATIVE_INSTEAD)
        _start_in_shadow(client, role, instance, say)
    answer = client.call("gate", "main", SWAP, Swap(role, instance))
    limit = time.monotonic() + timeout
    while answer.selected != instance:
        if time.monotonic() > limit:
            raise TimeoutError(
                f"{role} {instance} has not taken over within {timeout:g} s: it has published nothing yet; "
                f"{answer.selected} stays active until it has"
            )
        time.sleep(0.05)
        # Asked again, since the gate answers at once and takes over when the instance is warm.
        answer = client.call("gate", "main", SWAP, Swap(role, instance))
    return answer.epoch


def get_parameters(client: Client, role: str, instance: str) -> dict[str, Any]:
    """Parameters of an instance."""
    return client.call(role, instance, GET_PARAMETERS, Nothing()).values


def set_parameters(client: Client, role: str, instance: str, assignments: Sequence[str]) -> dict[str, Any]:
    """Change parameters between two ticks, all or none; see `Navigator.set_parameters`."""
    return client.call(role, instance, SET_PARAMETERS, Assignments(tuple(assignments))).values


START_CHECK_INTERVAL = 0.1
"""Interval of looking for the instance, s."""
START_QUERY_INTERVAL = 1.0
"""Interval of asking how its process is doing, s."""


def _start_in_shadow(client: Client, role: str, name: str, say: Callable[[str], None]) -> None:
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
    limit, asked = time.monotonic() + INSTANCE_START_LIMIT, time.monotonic()
    while not client.lives(role, name):
        now = time.monotonic()
        if now > limit:
            why = f": its process {answer.why}" if answer.why else ""
            raise Refused(
                f"{role} {name} has not started within {INSTANCE_START_LIMIT:g} s{why}; `navloom doctor` says more"
            )
        if now - asked > START_QUERY_INTERVAL:
            asked, answer = now, client.call_supervisor(ADD, Add(role, name))
            if answer.state == "failed":
                raise Refused(f"{role} {name} does not start: its process {answer.why}: {answer.last_words}")
        time.sleep(START_CHECK_INTERVAL)
