"""What an operator does to a live robot: requests to its nodes. Nothing here decodes messages or loads kernels."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from navloom_live.live.requests import (
    CANCEL,
    GET_PARAMETERS,
    PLACE,
    REPLAN,
    SET_PARAMETERS,
    SWAP,
    Assignments,
    Place,
    Swap,
)
from navloom_live.live.service import RESUME, Nothing
from navloom_live.operating.client import Client, ClientError, Refused
from navloom_live.operating.starting import start_in_shadow

__all__ = ["cancel", "get_parameters", "place", "resume", "set_parameters", "swap"]


def resume(client: Client) -> None:
    """Let the robot drive again after a stop or a contact."""
    client.call("gate", "main", RESUME, Nothing())


def cancel(client: Client) -> bool:
    """Cancel the current goal; False if there is none."""
    return bool(client.call("goal", "main", CANCEL, Nothing()).goal_id)


def place(client: Client, x: float, y: float, heading: float) -> str:
    """Tell every localizer where the robot is; see `Navigator.place`."""
    for name, value in (("x", x), ("y", y), ("heading", heading)):
        if not math.isfinite(value):
            raise Refused(f"{name} is {value}, expected a finite number")
    there = [node for node in client.describe() if node.role == "localizer"]
    warning = ""
    for node in sorted(there, key=lambda node: not node.active):
        try:
            answer = client.call("localizer", node.instance, PLACE, Place(x, y, heading))
            warning = warning or answer.warning
        except Refused:
            if node.active:
                raise
    if not any(node.active for node in there):
        raise ClientError(f"robot {client.keys.prefix}: no localizer answers; `navloom doctor` says why")
    with contextlib.suppress(ClientError):  # without a goal node there is no goal to plan again
        client.call("goal", "main", REPLAN, Nothing())
    return warning


def swap(
    client: Client,
    role: str,
    instance: str,
    timeout: float = 10.0,
    say: Callable[[str], None] = lambda text: None,
) -> int:
    """Make another instance active as soon as it is ready; see `Navigator.swap`."""
    if not client.lives(role, instance):
        start_in_shadow(client, role, instance, say)
    answer = client.call("gate", "main", SWAP, Swap(role, instance))
    limit = time.monotonic() + timeout
    while answer.selected != instance:
        if time.monotonic() > limit:
            raise TimeoutError(
                f"{role} {instance} has not taken over within {timeout:g} s: it has published nothing yet; "
                f"{answer.selected} stays active until it has"
            )
        time.sleep(0.05)
        answer = client.call("gate", "main", SWAP, Swap(role, instance))
    return answer.epoch


def get_parameters(client: Client, role: str, instance: str) -> dict[str, Any]:
    """Parameters of an instance."""
    return client.call(role, instance, GET_PARAMETERS, Nothing()).values


def set_parameters(client: Client, role: str, instance: str, assignments: Sequence[str]) -> dict[str, Any]:
    """Change parameters between two ticks, all or none; see `Navigator.set_parameters`."""
    return client.call(role, instance, SET_PARAMETERS, Assignments(tuple(assignments))).values
