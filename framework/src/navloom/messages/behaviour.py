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
    """An avoider's answer: a velocity, how things stand, and why, which may be left out."""

    twist: Twist2D
    status: Literal["clear", "steering", "trapped"]
    diagnostics: AvoiderDiagnostics | None = None


@message()
class AvoiderStatus(Message):
    """How things stand, published beside the command; why is left out of most ticks."""

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
    """Asks the recovery for help; `active` False ends it. `reason` is why the goal is stuck."""

    active: bool
    attempt: int
    reason: Words


@message()
class RecoveryStep(Message):
    """A recovery's answer: a velocity, how far it is, and whether the map should be cleared first."""

    twist: Twist2D
    state: Literal["running", "done", "failed"]
    clear_map: bool
