"""What avoiders and recoveries say, and who drives."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from navloom.messages.motion import Twist2D
from navloom.messages.schema import Array, Message, Unbounded, Words, message

__all__ = ["Avoidance", "AvoiderDiagnostics", "AvoiderStatus", "HandOver", "RecoveryRequest", "RecoveryStep"]

Floats = NDArray[np.float64]


@message()
class AvoiderDiagnostics(Message):
    """Why an avoider chose what it chose. A method fills what it has and leaves the rest empty.

    Attributes:
        window: (rows, cols) certainty values round the robot; (0, 0) where there is no grid.
        window_resolution: Edge of a cell, m; 0 without a grid.
        window_x, window_y: Lower left corner of the window, m, map frame.
        histogram: (sectors,) obstacle density by direction, sector 0 at the map's x axis, counter-clockwise.
        threshold: Density above which a sector is blocked.
        slots: (k, 2) first and last direction of each free slot, rad, map frame.
        chosen: Direction steered to, rad, map frame, or None.
        why: One phrase for people.
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
    """An avoider's answer.

    Attributes:
        twist: Velocity asked for, base frame; the gate limits it to what the robot can do.
        status: clear: nothing is in the way; steering: it drives round something; trapped: there is no way on, which
            asks for a recovery.
        diagnostics: Why; None where it is left out, see `Avoider.is_to_explain`.
    """

    twist: Twist2D
    status: Literal["clear", "steering", "trapped"]
    diagnostics: AvoiderDiagnostics | None = None


@message()
class AvoiderStatus(Message):
    """How things stand, published beside the command.

    Attributes:
        status: Of the avoider's answer.
        diagnostics: Why; None in most ticks.
    """

    status: Literal["clear", "steering", "trapped"]
    diagnostics: AvoiderDiagnostics | None = None


@message()
class HandOver(Message):
    """Whether the avoider drives instead of the controller, and since when the way is blocked.

    Attributes:
        engaged: The avoider drives.
        nearest: Distance to the nearest thing sensed in the corridor, m; infinite where it is free.
    """

    engaged: bool
    nearest: Unbounded


@message()
class RecoveryRequest(Message):
    """Asks the recovery for help.

    Attributes:
        active: False ends it.
        attempt: 1 for the first attempt at this goal.
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
        state: running: it goes on; done: the goal may plan again; failed: the next attempt begins, if there is one.
        clear_map: The map should be cleared before the next plan.
    """

    twist: Twist2D
    state: Literal["running", "done", "failed"]
    clear_map: bool
