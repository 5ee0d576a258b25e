"""Quality of service, retention and size limit of each stream, from its port's declaration."""

from __future__ import annotations

from navloom.engine.node_ports import Quality
from navloom.engine.streams import FRAMEWORK_PORTS, STATE, STEP, WORD, PortTable, sensor_quality
from navloom.messages import Message, Parameters, StepReport
from navloom.messages.bounds import size_limit

from navloom_live.transport.keyspace import FAULT, LARGEST

__all__ = ["PARAMETERS", "Quality", "is_retained", "kind_of", "most_of", "quality_of", "retained_ports"]

PARAMETERS = "parameters"
"""Retained port on which every instance publishes its parameters after a change."""
_BY_TYPE: dict[type[Message], Quality] = {StepReport: STATE, Parameters: WORD}


def kind_of(role: str, port: str, ports: PortTable = FRAMEWORK_PORTS) -> type[Message] | None:
    """Message class of a stream; other messages on it are refused.

    None for a platform's sensors, which a config names, and for nodes that are not among these.
    """
    if port == PARAMETERS:
        return Parameters
    if port in (STEP, FAULT):
        return StepReport
    declared = ports.port(role, port)
    return None if declared is None else declared.carries


def most_of(kind: type[Message] | None) -> int:
    """Largest message on a stream of this class, bytes; None means any class."""
    limit = None if kind is None else size_limit(kind)
    return LARGEST if limit is None else min(limit, LARGEST)


def retained_ports(role: str = "", ports: PortTable = FRAMEWORK_PORTS) -> list[tuple[str, str]]:
    """(role, port) of each stream whose publisher keeps the last message for late joiners.

    This uses a queryable on the port's key instead of Zenoh's advanced publisher: that one needs time stamps of the
    hosts' clocks, and refuses messages from a host whose clock is ahead.
    """
    return sorted((port.role, port.name) for port in ports.ports(role) if port.retained)


def is_retained(role: str, port: str, ports: PortTable = FRAMEWORK_PORTS) -> bool:
    """Whether a stream's publisher keeps its last message; every instance keeps changed parameters."""
    declared = ports.port(role, port)
    return port == PARAMETERS or (declared is not None and declared.retained)


def quality_of(kind: type[Message]) -> Quality:
    """Default quality of service of a message class."""
    if kind not in _BY_TYPE:
        declared = next((port for port in FRAMEWORK_PORTS.ports() if port.carries is kind), None)
        _BY_TYPE[kind] = sensor_quality(kind) if declared is None else declared.quality
    return _BY_TYPE[kind]
