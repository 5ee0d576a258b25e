"""The base of nodes around the plugin of a role, and how such nodes read the robot's sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from types import MappingProxyType
from typing import Any, Generic, TypeVar

from navloom.engine.node_ports import ExtraInputs, News
from navloom.engine.nodes.node_base import Node
from navloom.messages import Message, RangeScan, Sweep
from navloom.roles import Role
from navloom.roles.extra import NO_EXTRAS, Extras, extras_of
from navloom.roles.readings import NO_READINGS, Readings

__all__ = ["RANGES", "RoleNode", "in_order", "of_kind", "readings_of"]

RANGES = (RangeScan, Sweep)
"""Sensor messages that roles receive as scans and sweeps; those of all other sensors are readings."""

M = TypeVar("M", bound=Message)
P = TypeVar("P", bound=Role)


class RoleNode(Node, Generic[P]):
    """Base of nodes whose plugins may declare extra inputs."""

    extras = ExtraInputs()
    plugin: P

    def extra(self) -> Extras:
        """Current messages of the plugin's extra inputs."""
        if not self.extras:
            return NO_EXTRAS
        declared = extras_of(type(self.plugin))
        return Extras({declared[name]: held.value for name, held in self.extras.items()})


def in_order(sensors: Mapping[str, News[Any]]) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """New messages of a node's sensors, in order of time and then of port, with the sensor's name of each."""
    if not sensors:
        return (), ()
    # The usual case, which needs no sorting: a tick of a robot with one laser.
    if len(sensors) == 1:
        ((name, news),) = sensors.items()
        values = news.values
        return tuple(values), (name,) * len(values)
    # By stamp and then by port (the sort is stable), so that shadows and replays see the same order.
    found = sorted(
        [(value.stamp_ns, value, name) for name, news in sensors.items() for value in news.values], key=_first
    )
    return tuple([one for _, one, _ in found]), tuple([name for _, _, name in found])


_first = itemgetter(0)


def of_kind(kind: type[M], named: Sequence[tuple[Any, str]]) -> tuple[tuple[M, ...], tuple[str, ...]]:
    """The messages of one class, and the names of their sensors."""
    found = [(one, name) for one, name in named if isinstance(one, kind)]
    return tuple([one for one, _ in found]), tuple([name for _, name in found])


def readings_of(sensors: Mapping[str, News[Message]]) -> Readings:
    """New messages of sensors of other kinds, by the sensor's name."""
    if not sensors:
        return NO_READINGS
    return MappingProxyType({name: tuple(news.values) for name, news in sensors.items() if news.values})
