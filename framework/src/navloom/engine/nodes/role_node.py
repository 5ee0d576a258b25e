"""The base of nodes round the plugin of a role, and what such nodes read of the robot's sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from types import MappingProxyType
from typing import Any, Generic, TypeVar

from navloom.engine.nodes.node import Node
from navloom.engine.ports import ExtraInputs, News
from navloom.messages import Message, RangeScan, Sweep
from navloom.roles import Role
from navloom.roles.extra import NO_EXTRAS, Extras, extras_of
from navloom.roles.readings import NO_READINGS, Readings

__all__ = ["RANGES", "RoleNode", "in_order", "of_kind", "readings_of"]

RANGES = (RangeScan, Sweep)
"""What roles are given as scans and sweeps; messages of all other sensors are their readings."""

M = TypeVar("M", bound=Message)
P = TypeVar("P", bound=Role)


class RoleNode(Node, Generic[P]):
    """Base of the nodes whose plugins may declare extra inputs."""

    extras = ExtraInputs()
    plugin: P

    def extra(self) -> Extras:
        """What the extra inputs hold."""
        if not self.extras:
            return NO_EXTRAS
        declared = extras_of(type(self.plugin))
        return Extras({declared[name]: held.value for name, held in self.extras.items()})


def in_order(sensors: Mapping[str, News[Any]]) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """What a node's sensors brought, in order of time and then of port, and the name of the sensor of each."""
    if not sensors:
        return (), ()
    if len(sensors) == 1:
        ((name, news),) = sensors.items()
        values = news.values
        return tuple(values), (name,) * len(values)
    found = sorted([(one.stamp_ns, one, name) for name, news in sensors.items() for one in news.values], key=_first)
    return tuple([one for _, one, _ in found]), tuple([name for _, _, name in found])


_first = itemgetter(0)


def of_kind(kind: type[M], named: Sequence[tuple[Any, str]]) -> tuple[tuple[M, ...], tuple[str, ...]]:
    """Messages of one class with the names of their sensors."""
    found = [(one, name) for one, name in named if isinstance(one, kind)]
    return tuple([one for one, _ in found]), tuple([name for _, name in found])


def readings_of(sensors: Mapping[str, News[Message]]) -> Readings:
    """What sensors of other kinds brought."""
    if not sensors:
        return NO_READINGS
    return MappingProxyType({name: tuple(news.values) for name, news in sensors.items() if news.values})
