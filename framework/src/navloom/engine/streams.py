"""Every stream of the framework's roles and nodes: what it carries, and how. Each fact about a stream stands here."""

from __future__ import annotations

from typing import Any

from navloom.engine.ports import Port, Ports, Quality
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
    Path,
    PlanFailure,
    PlanRequest,
    PoseEstimate,
    RangeScan,
    RecoveryRequest,
    RecoveryStep,
    Reference,
    Selection,
    Sweep,
    SweepRequest,
    TrackingCommand,
    Trajectory,
    Truth,
)

__all__ = ["PLAIN", "STATE", "WORD", "AvoiderPorts", "ControllerPorts", "GatePorts", "GoalPorts", "LocalizerPorts",
           "MapperPorts", "OperatorPorts", "PlannerPorts", "PlatformPorts", "RecoveryPorts", "ReferencePorts",
           "sensor_port", "sensor_quality"]  # fmt: skip

URGENT = Quality("drop", "real_time", "drop")
STATE = Quality("drop", "interactive_high", "drop")
WORD = Quality("block", "interactive_high", "block")
PLAN = Quality("block", "data_high", "block")
MAP = Quality("block_first", "data_low", "block_first")
PLAIN = Quality("drop", "data", "drop")
UNHURRIED = Quality("drop", "background", "drop")
SENSORS: dict[type[Message], Quality] = {
    RangeScan: Quality("drop", "data_high", "block_first"),  # not behind the parts of a sweep of 100 kB
    Sweep: Quality("drop", "data", "block_first"),
}


class OperatorPorts(Ports, role="operator"):
    """What operators ask for, and how one drives himself."""

    request = Port(OperatorRequest, WORD)
    command = Port(Command, URGENT)


class PlatformPorts(Ports, role="platform"):
    """The robot's own; each sensor of a config has a further one."""

    odometry = Port(Odometry, STATE, required=True)
    contact = Port(Contact, STATE)
    truth = Port(Truth, UNHURRIED)


class LocalizerPorts(Ports, role="localizer"):
    """Where the robot is."""

    pose = Port(PoseEstimate, STATE, required=True, answers=True)


class MapperPorts(Ports, role="mapper"):
    """What is known of the surroundings."""

    map = Port(MapUpdate, MAP, retained=True, answers=True)


class GoalPorts(Ports, role="goal"):
    """What the goal asks of others, and how it stands."""

    plan = Port(PlanRequest, WORD)
    sweep = Port(SweepRequest, WORD)
    recovery = Port(RecoveryRequest, WORD, retained=True)
    clear = Port(ClearRequest, WORD)
    drive = Port(Drive, WORD, retained=True, required=True)
    feedback = Port(Feedback, PLAIN, retained=True)
    result = Port(GoalResult, WORD, retained=True)


class PlannerPorts(Ports, role="planner"):
    """A way, or why there is none."""

    path = Port(Path, PLAN, retained=True, answers=True)
    failure = Port(PlanFailure, PLAN, retained=True, answers=True)


class ReferencePorts(Ports, role="reference"):
    """What is followed, and where on it the robot is."""

    trajectory = Port(Trajectory, PLAN, retained=True)
    reference = Port(Reference, STATE, required=True)


class ControllerPorts(Ports, role="controller"):
    """The velocity that tracks the reference."""

    command = Port(TrackingCommand, URGENT, required=True, answers=True)


class AvoiderPorts(Ports, role="avoider"):
    """The velocity round obstacles, and whether it is this one that drives."""

    command = Port(Command, URGENT, required=True, answers=True)
    status = Port(AvoiderStatus, PLAIN)
    handover = Port(HandOver, PLAIN)


class RecoveryPorts(Ports, role="recovery"):
    """The velocity out of a place where the robot is stuck."""

    command = Port(Command, URGENT, answers=True)
    status = Port(RecoveryStep, WORD)


class GatePorts(Ports, role="gate"):
    """The command to the wheels, its reason, and the active instances."""

    command = Port(Command, URGENT)
    status = Port(GateStatus, WORD, retained=True)
    selection = Port(Selection, WORD, retained=True)


def sensor_quality(kind: type[Message]) -> Quality:
    """How a sensor's messages travel."""
    return SENSORS.get(kind, PLAIN)


def sensor_port(name: str, kind: type[Message]) -> Port[Any]:
    """The platform's port of a sensor that the config names."""
    port = Port(kind, sensor_quality(kind))
    port.role, port.name = "platform", name
    return port
