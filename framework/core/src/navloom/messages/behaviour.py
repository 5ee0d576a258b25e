"""Messages of avoiders and recoveries, and the hand-over between controller and avoider."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from navloom.messages.motion import Twist2D
from navloom.messages.schema import Array, Message, Unbounded, Words, message

__all__ = ["Avoidance", "AvoiderDiagnostics", "AvoiderStatus", "HandOver", "RecoveryRequest", "RecoveryStep",
           "Rollouts"]  # fmt: skip

Floats = NDArray[np.float64]


@message()
class AvoiderDiagnostics(Message):
    """Why an avoider chose its answer. A method fills the fields that it has and leaves the others empty.

    Attributes:
        window: (rows, cols) certainty values around the robot; (0, 0) for a method without a grid.
        window_resolution: Edge of a cell, m; 0 without a grid.
        window_x, window_y: Lower left corner of the window, m, map frame.
        histogram: (sectors,) obstacle density by direction, sector 0 at the map's x axis, counter-clockwise.
        threshold: Density above which a sector is blocked.
        slots: (k, 2) first and last direction of each free slot, rad, map frame.
        chosen: Chosen direction, rad, map frame, or None.
        why: Explanation in one phrase.
    """

    window: Annotated[NDArray[np.uint8], Array("uint8", ("rows", "cols"))]
    window_resolution: float
    window_x: float
    window_y: float
    histogram: Annotated[Floats, Array("float64", ("sectors",))]
    threshold: float
    slots: Annotated[Floats, Array("float64", ("k", 2))]
    chosen: float | None
    why: Words


@message()
class Avoidance(Message):
    """An avoider's answer; its node publishes it as a Command and an AvoiderStatus.

    Attributes:
        twist: Requested velocity, base frame; the gate limits it to what the robot can do.
        status: clear: nothing is in the way; steering: it drives around something; trapped: there is no way ahead,
            which requests a recovery.
        diagnostics: Why it chose this; None if left out, see `Avoider.is_to_explain`.
    """

    twist: Twist2D
    status: Literal["clear", "steering", "trapped"]
    diagnostics: AvoiderDiagnostics | None = None


@message()
class AvoiderStatus(Message):
    """Status of the avoider, published with the command.

    Attributes:
        status: As in Avoidance.
        diagnostics: Why it chose its answer: at the avoider's `diagnostics_rate_hz`, and when it becomes trapped;
            otherwise None.
    """

    status: Literal["clear", "steering", "trapped"]
    diagnostics: AvoiderDiagnostics | None = None


@message()
class Rollouts(Message):
    """Some of the motions that an avoider rolled out in one tick, and what its critics make of the chosen one.

    Attributes:
        points: (n, points, 2) positions of the base along each, m, map frame; one that collides ends before that.
        costs: (n,) from 0, the cheapest, to 1, the dearest without a collision; infinite for one that collides.
        chosen: (points, 2) the chosen motion, m, map frame.
        critics: Names of the critics.
        critic_costs: (critics,) what the chosen motion costs by each, weighted.
    """

    points: Annotated[NDArray[np.float32], Array("float32", ("n", "points", 2))]
    costs: Annotated[Floats, Array("float64", ("n",), infinite=True, at_least=0.0)]
    chosen: Annotated[NDArray[np.float32], Array("float32", ("points", 2))]
    critics: tuple[Words, ...]
    critic_costs: Annotated[Floats, Array("float64", ("critics",))]


@message()
class HandOver(Message):
    """Whether the avoider drives instead of the controller, and how far the nearest obstacle in the way is.

    Attributes:
        engaged: The avoider drives.
        nearest: Distance to the nearest echo in the corridor, m; infinite if it is free.
    """

    engaged: bool
    nearest: Unbounded


@message()
class RecoveryRequest(Message):
    """Starts or ends a recovery.

    Attributes:
        active: True starts the recovery, False ends it.
        attempt: Number of the attempt for this goal, from 1.
        reason: Why the goal is stuck.
    """

    active: bool
    attempt: int
    reason: Words


@message()
class RecoveryStep(Message):
    """A recovery's answer.

    Attributes:
        twist: Velocity for this tick, base frame.
        state: running: it continues; done: the goal may plan again; failed: the next attempt begins, if there is one.
        clear_map: The map should be cleared before the next plan.
    """

    twist: Twist2D
    state: Literal["running", "done", "failed"]
    clear_map: bool
