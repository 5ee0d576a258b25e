"""How each kind of message travels: what may be dropped, what goes first, what late joiners are given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from navloom.messages import (
    AvoiderStatus,
    ClearRequest,
    Command,
    Contact,
    Drive,
    Feedback,
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

__all__ = ["RETAINED", "Quality", "is_retained", "kind_of", "quality_of"]

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
    ClearRequest: _WORD,
    OperatorRequest: _WORD,
    Selection: _WORD,
    GateStatus: _WORD,
    GoalResult: _WORD,
    Parameters: _WORD,
    RangeScan: Quality("drop", "data_high", "block_first"),  # not behind the parts of a sweep of 100 kB
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


CARRIES: dict[tuple[str, str], type[Message]] = {
    ("operator", "request"): OperatorRequest,
    ("operator", "command"): Command,
    ("platform", "odometry"): Odometry,
    ("platform", "contact"): Contact,
    ("platform", "truth"): Truth,
    ("localizer", "pose"): PoseEstimate,
    ("mapper", "map"): MapUpdate,
    ("goal", "plan"): PlanRequest,
    ("goal", "sweep"): SweepRequest,
    ("goal", "recovery"): RecoveryRequest,
    ("goal", "clear"): ClearRequest,
    ("goal", "drive"): Drive,
    ("goal", "feedback"): Feedback,
    ("goal", "result"): GoalResult,
    ("planner", "path"): Path,
    ("planner", "failure"): PlanFailure,
    ("reference", "trajectory"): Trajectory,
    ("reference", "reference"): Reference,
    ("controller", "command"): TrackingCommand,
    ("avoider", "command"): Command,
    ("avoider", "status"): AvoiderStatus,
    ("avoider", "handover"): HandOver,
    ("recovery", "command"): Command,
    ("recovery", "status"): RecoveryStep,
    ("gate", "command"): Command,
    ("gate", "status"): GateStatus,
    ("gate", "selection"): Selection,
}
"""What the streams of each (role, port) carry; a platform's sensors, which a config names, are not among them."""


def kind_of(role: str, port: str) -> type[Message] | None:
    """What a stream carries: it is declared for that ahead of its first message, and nothing else is taken from it."""
    if port == "parameters":
        return Parameters
    return StepReport if port == STEP else CARRIES.get((role, port))


def is_retained(role: str, port: str) -> bool:
    """Whether a stream's publisher keeps its last message; parameters that were changed are kept by every instance."""
    return (role, port) in RETAINED or port == "parameters"


def quality_of(kind: type[Message]) -> Quality:
    """How messages of a type travel; what is not listed may be dropped and waits with the sensors."""
    return _BY_TYPE.get(kind, _DEFAULT)
