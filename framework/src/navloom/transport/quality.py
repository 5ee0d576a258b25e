"""Quality of service, retention and size limit of each stream, from its port's declaration."""

from __future__ import annotations

from navloom.config.schema import Config
from navloom.engine.catalogue import FRAMEWORK, Catalogue, catalogue_of
from navloom.engine.ports import Quality
from navloom.engine.streams import STATE, WORD, sensor_quality
from navloom.messages import Message, Parameters, StepReport
from navloom.messages.bounds import size_limit
from navloom.transport.keyspace import FAULT, LARGEST, STEP

__all__ = ["PARAMETERS", "Quality", "is_retained", "kind_of", "most_of", "quality_of", "retained_ports",
           "streams_of"]  # fmt: skip

PARAMETERS = "parameters"
"""Retained port on which every instance publishes its parameters after a change."""
_BY_TYPE: dict[type[Message], Quality] = {StepReport: STATE, Parameters: WORD}


def kind_of(role: str, port: str, catalogue: Catalogue = FRAMEWORK) -> type[Message] | None:
    """Message class of a stream; other messages on it are refused.

    None for a platform's sensors, which a config names, and for nodes that the catalogue does not know.
    """
    if port == PARAMETERS:
        return Parameters
    if port in (STEP, FAULT):
        return StepReport
    declared = catalogue.port(role, port)
    return None if declared is None else declared.carries


def most_of(kind: type[Message] | None) -> int:
    """Largest message on a stream of this class, bytes; None means any class."""
    limit = None if kind is None else size_limit(kind)
    return LARGEST if limit is None else min(limit, LARGEST)


def retained_ports(role: str = "", catalogue: Catalogue = FRAMEWORK) -> list[tuple[str, str]]:
    """(role, port) of each stream whose publisher keeps the last message for late joiners.

    This uses a queryable on the port's key instead of Zenoh's advanced publisher: that one needs time stamps of the
    hosts' clocks, and refuses messages from a host whose clock is ahead.
    """
    return sorted((port.role, port.name) for port in catalogue.ports(role) if port.retained)


def is_retained(role: str, port: str, catalogue: Catalogue = FRAMEWORK) -> bool:
    """Whether a stream's publisher keeps its last message; every instance keeps changed parameters."""
    declared = catalogue.port(role, port)
    return port == PARAMETERS or (declared is not None and declared.retained)


def streams_of(config: Config) -> tuple[str, ...]:
    """Every stream that a robot may have, as role/instance/port, sorted. Nodes that are not installed have none."""
    catalogue, _ = catalogue_of(config)
    instances = [(role, table.instance) for _, role, table in config.role_tables()]
    instances += [(port.role, "main") for port in catalogue.ports() if port.role not in config.roles]
    found = {f"{role}/{name}/{port}" for role, name in instances for port in (PARAMETERS, STEP, FAULT)}
    found |= {f"{role}/{name}/{port.name}" for role, name in instances for port in catalogue.ports(role)}
    found |= {f"platform/{config.platform.instance}/{sensor.name}" for sensor in config.sensor}
    return tuple(sorted(found))


def quality_of(kind: type[Message]) -> Quality:
    """Default quality of service of a message class."""
    if kind not in _BY_TYPE:
        declared = next((port for port in FRAMEWORK.ports() if port.carries is kind), None)
        _BY_TYPE[kind] = sensor_quality(kind) if declared is None else declared.quality
    return _BY_TYPE[kind]
