"""Every stream of the framework's roles and nodes: message class, quality of service and whether it is retained."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from navloom.engine.node_ports import Port, Ports, Quality
from navloom.messages import (
    AvoiderStatus,
    Bodies,
    ClearRequest,
    Command,
    Contact,
    Drive,
    Feedback,
    GateStatus,
    GoalResult,
    HandOver,
    Hypotheses,
    MapUpdate,
    Message,
    OccupancyGrid,
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
    Rollouts,
    Selection,
    Sweep,
    SweepRequest,
    TrackingCommand,
    Trajectory,
    Truth,
)

__all__ = ["FRAMEWORK_PORTS", "OWN_PORTS", "PLAIN", "STATE", "STEP", "WORD", "AvoiderPorts", "ControllerPorts",
           "GatePorts", "GoalPorts", "LocalizerPorts", "MapperPorts", "OperatorPorts", "PlannerPorts", "PlatformPorts",
           "PortTable", "RecoveryPorts", "ReferencePorts", "WorldPorts", "sensor_port", "sensor_quality"]  # fmt: skip

STEP = "step"
"""Port of every node's step reports."""

# Dropped rather than late: a command that waited in a queue is stale.
URGENT = Quality("drop", "real_time", "drop")
STATE = Quality("drop", "interactive_high", "drop")
# Never dropped: these messages are sent once and change what a node does.
WORD = Quality("block", "interactive_high", "block")
PLAN = Quality("block", "data_high", "block")
# Only one may wait: the next map replaces it anyway, and a full link must not block the mapper.
# A map is sent whole: parts of one would need rules for late joiners and lost messages, and save 2 % of a core.
MAP = Quality("block_first", "data_low", "block_first")
PLAIN = Quality("drop", "data", "drop")
# The truth of a simulator is for viewers: no robot waits for it.
UNHURRIED = Quality("drop", "background", "drop")
# In one queue, a small scan behind the parts of a sweep would find no room within the time that it may wait.
SENSORS: dict[type[Message], Quality] = {
    RangeScan: Quality("drop", "data_high", "block_first"),  # not behind the parts of a sweep of 100 kB
    Sweep: Quality("drop", "data", "block_first"),
}


class OperatorPorts(Ports, role="operator"):
    """Operators' requests, and the commands of an operator who drives."""

    request = Port(OperatorRequest, WORD)
    command = Port(Command, URGENT)


class WorldPorts(Ports, role="world"):
    """What moves in the simulated world beside the robot: the ground truth, as that of the platform."""

    bodies = Port(Bodies, STATE, required=True)


class PlatformPorts(Ports, role="platform"):
    """Ports of every platform; each sensor of a config adds one."""

    odometry = Port(Odometry, STATE, required=True)
    contact = Port(Contact, STATE)
    truth = Port(Truth, UNHURRIED)


OWN_PORTS = frozenset(port.name for port in PlatformPorts.declared())
"""Ports of every platform, which no sensor can have."""


class LocalizerPorts(Ports, role="localizer"):
    """Where the robot is."""

    pose = Port(PoseEstimate, STATE, required=True, answers=True)
    hypotheses = Port(Hypotheses, PLAIN, retained=True)


class MapperPorts(Ports, role="mapper"):
    """What is known of the surroundings."""

    known = Port(OccupancyGrid, MAP, retained=True)
    map = Port(MapUpdate, MAP, retained=True, answers=True)


class GoalPorts(Ports, role="goal"):
    """The goal's requests to other nodes, its feedback and its result."""

    plan = Port(PlanRequest, WORD)
    sweep = Port(SweepRequest, WORD)
    recovery = Port(RecoveryRequest, WORD, retained=True)
    clear = Port(ClearRequest, WORD)
    drive = Port(Drive, WORD, retained=True, required=True)
    feedback = Port(Feedback, PLAIN, retained=True)
    result = Port(GoalResult, WORD, retained=True)


class PlannerPorts(Ports, role="planner"):
    """A path, or why there is none."""

    path = Port(Path, PLAN, retained=True, answers=True)
    failure = Port(PlanFailure, PLAN, retained=True, answers=True)


class ReferencePorts(Ports, role="reference"):
    """The trajectory to follow, and the robot's place on it."""

    trajectory = Port(Trajectory, PLAN, retained=True)
    reference = Port(Reference, STATE, required=True)


class ControllerPorts(Ports, role="controller"):
    """The velocity that tracks the reference."""

    command = Port(TrackingCommand, URGENT, required=True, answers=True)


class AvoiderPorts(Ports, role="avoider"):
    """The velocity around obstacles, and whether the avoider drives instead of the controller."""

    command = Port(Command, URGENT, required=True, answers=True)
    status = Port(AvoiderStatus, PLAIN)
    handover = Port(HandOver, PLAIN)
    rollouts = Port(Rollouts, PLAIN)


class RecoveryPorts(Ports, role="recovery"):
    """The velocity that frees a stuck robot, and the state of the attempt."""

    command = Port(Command, URGENT, answers=True)
    status = Port(RecoveryStep, WORD)


class GatePorts(Ports, role="gate"):
    """The command to the platform, the gate's status, and the active instances."""

    command = Port(Command, URGENT)
    status = Port(GateStatus, WORD, retained=True)
    selection = Port(Selection, WORD, retained=True)


# Streams are declared here and not in the nodes that publish them: nodes read each other in a circle, and a class
# cannot refer to one that is defined after it.
class PortTable:
    """Declared ports by role and name; not the ports of sensors, which a config names."""

    def __init__(self, ports: Iterable[Port[Any]]) -> None:
        self._ports = {(port.role, port.name): port for port in ports}

    def port(self, role: str, name: str) -> Port[Any] | None:
        """A declared port; None for a sensor's port, which a config names, and for a port that is not declared."""
        return self._ports.get((role, name))

    def ports(self, role: str = "") -> list[Port[Any]]:
        """Every declared port, or those of one node; not the ports of sensors, which a config names."""
        return [port for port in self._ports.values() if role in ("", port.role)]


FRAMEWORK_PORTS = PortTable(port for role in Ports.__subclasses__() for port in role.declared())
"""The ports of every robot. Tools read streams by them without the nodes, whose kernels take a second to load."""


def sensor_quality(kind: type[Message]) -> Quality:
    """Quality of service of a sensor's messages."""
    return SENSORS.get(kind, PLAIN)


def sensor_port(name: str, kind: type[Message], time_offset: float = 0.0, is_truth: bool = False) -> Port[Any]:
    """The platform's port of a sensor that the config names, with what its readers add to its stamps, s."""
    port = Port(kind, sensor_quality(kind))
    port.role, port.name, port.offset_ns = "platform", name, round(1e9 * time_offset)
    port.is_truth = is_truth
    return port
