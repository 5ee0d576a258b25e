"""How each kind of message travels: what may be dropped, what goes first, what late joiners are given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from navloom.messages import (
    AvoiderStatus,
    Command,
    Contact,
    Drive,
    GateStatus,
    GoalResult,
    HandOver,
    MapUpdate,
    Message,
    Odometry,
    OperatorRequest,
    Parameters,
    Path,
    PlanFailure,
    PlanRequest,
    PoseEstimate,
    RangeScan,
    RecoveryRequest,
    RecoveryStep,
    Reference,
    Selection,
    StepReport,
    Sweep,
    SweepRequest,
    TrackingCommand,
    Trajectory,
    Truth,
)
from navloom.runtime.keyspace import STEP

__all__ = ["RETAINED", "Quality", "first_kind", "is_retained", "quality_of"]

Congestion = Literal["drop", "block", "block_first"]
Priority = Literal["real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"]


@dataclass(frozen=True)
class Quality:
    """Quality of service of one stream.

    Attributes:
        congestion: What happens to a message when the link is full, on one host.
        priority: Which queue of the link it waits in.
        off_host: The same as congestion, where the link leaves the host.
    """

    congestion: Congestion
    priority: Priority
    off_host: Congestion


def _same(congestion: Congestion, priority: Priority) -> Quality:
    return Quality(congestion, priority, congestion)


_URGENT = _same("drop", "real_time")
_STATE = _same("drop", "interactive_high")
_WORD = _same("block", "interactive_high")
_SENSOR = Quality("drop", "data", "block_first")
_PLAN = _same("block", "data_high")
_DEFAULT = _same("drop", "data")

_BY_TYPE: dict[type[Message], Quality] = {
    Command: _URGENT,
    TrackingCommand: _URGENT,
    StepReport: _STATE,
    Odometry: _STATE,
    PoseEstimate: _STATE,
    Reference: _STATE,
    Contact: _STATE,
    Drive: _WORD,
    PlanRequest: _WORD,
    SweepRequest: _WORD,
    RecoveryRequest: _WORD,
    RecoveryStep: _WORD,
    OperatorRequest: _WORD,
    Selection: _WORD,
    GateStatus: _WORD,
    GoalResult: _WORD,
    Parameters: _WORD,
    RangeScan: _SENSOR,
    Sweep: _SENSOR,
    Path: _PLAN,
    PlanFailure: _PLAN,
    Trajectory: _PLAN,
    MapUpdate: _same("block_first", "data_low"),
    Truth: _same("drop", "background"),
}

RETAINED: frozenset[tuple[str, str]] = frozenset(
    {
        ("mapper", "map"),
        ("planner", "path"),
        ("planner", "failure"),
        ("reference", "trajectory"),
        ("goal", "drive"),
        ("goal", "recovery"),
        ("goal", "feedback"),
        ("goal", "result"),
        ("gate", "selection"),
        ("gate", "status"),
    }
)
"""(role, port) whose publisher keeps the last message, so that who joins or comes back later is given it.

A queryable of our own on the port's key rather than Zenoh's advanced publisher: that one needs time stamps of the
hosts' clocks, and refuses messages from a host whose clock runs ahead.
"""


FIRST: dict[tuple[str, str], type[Message]] = {
    ("platform", "odometry"): Odometry,
    ("platform", "contact"): Contact,
    ("localizer", "pose"): PoseEstimate,
    ("goal", "drive"): Drive,
    ("goal", "plan"): PlanRequest,
    ("planner", "path"): Path,
    ("reference", "trajectory"): Trajectory,
    ("reference", "reference"): Reference,
    ("controller", "command"): TrackingCommand,
    ("avoider", "command"): Command,
    ("avoider", "status"): AvoiderStatus,
    ("avoider", "handover"): HandOver,
    ("gate", "command"): Command,
    ("gate", "status"): GateStatus,
}
"""What streams carry whose first message must not wait for a declaration."""


def first_kind(role: str, port: str) -> type[Message] | None:
    """The message to declare a stream for ahead of time; None where it can wait."""
    return StepReport if port == STEP else FIRST.get((role, port))


def is_retained(role: str, port: str) -> bool:
    """Whether a stream's publisher keeps its last message; parameters that were changed are kept by every instance."""
    return (role, port) in RETAINED or port == "parameters"


def quality_of(kind: type[Message]) -> Quality:
    """How messages of a type travel; what is not listed may be dropped and waits with the sensors."""
    return _BY_TYPE.get(kind, _DEFAULT)
