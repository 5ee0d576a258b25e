"""The ROS graph: who is there, as liveliness tokens tell it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from navloom_ros.errors import BadToken
from navloom_ros.tokens import Entity

__all__ = ["ACTION_PART", "Graph", "Listed"]

MOST_ENTITIES = 20_000
"""Entities that are kept: whoever floods the network with tokens fills no more memory than these."""
ACTION_PART = "/_action/"
"""In the names of the topics and services that an action is made of."""


@dataclass
class Listed:
    """What is known under one name.

    Attributes:
        types: Of those who offer or use it, in the order they came.
        providers, users: Publishers and subscriptions of a topic; servers and clients of a service or action.
    """

    types: list[str] = field(default_factory=list)
    providers: list[Entity] = field(default_factory=list)
    users: list[Entity] = field(default_factory=list)


class Graph:
    """All entities of one domain; tokens come and go in any order.

    Attributes:
        unread: Tokens that could not be read, or were too many.
    """

    def __init__(self) -> None:
        self._entities: dict[str, Entity] = {}
        self.unread = 0

    def add(self, token: str) -> Entity | None:
        """Keep an entity; None where its token cannot be read."""
        if token in self._entities:
            return self._entities[token]
        try:
            if len(self._entities) >= MOST_ENTITIES:
                raise BadToken("too many entities")
            entity = Entity.parsed(token)
        except BadToken:
            self.unread += 1
            return None
        self._entities[token] = entity
        return entity

    def remove(self, token: str) -> Entity | None:
        """Forget an entity; None where it was not known."""
        return self._entities.pop(token, None)

    def without(self, session: str) -> Graph:
        """The graph as it would be without one process."""
        left = Graph()
        left._entities = {token: one for token, one in list(self._entities.items()) if one.session != session}
        return left

    @property
    def entities(self) -> list[Entity]:
        """All, in the order they came."""
        return list(self._entities.values())

    def find(self, name: str, kinds: Iterable[str]) -> list[Entity]:
        """Endpoints of these kinds with this full name."""
        return [one for one in self.entities if one.name == name and one.kind in kinds]

    def nodes(self) -> list[str]:
        """Full names, sorted; two nodes of one name appear once."""
        return sorted({one.full_node_name for one in self.entities if one.kind == "NN"})

    def topics(self) -> dict[str, Listed]:
        """By name, without those of actions."""
        return self._listed("MP", "MS")

    def services(self) -> dict[str, Listed]:
        """By name, without those of actions."""
        return self._listed("SS", "SC")

    def actions(self) -> dict[str, Listed]:
        """By name; the type is that of the action."""
        found: dict[str, Listed] = {}
        for one in self.entities:
            name, separator, part = one.name.partition(ACTION_PART)
            if separator and part == "send_goal":
                listed = found.setdefault(name, Listed())
                kind = one.type_name.removesuffix("_SendGoal")
                if kind not in listed.types:
                    listed.types.append(kind)
                (listed.providers if one.kind == "SS" else listed.users).append(one)
        return dict(sorted(found.items()))

    def _listed(self, provider: str, user: str) -> dict[str, Listed]:
        found: dict[str, Listed] = {}
        for one in self.entities:
            if one.kind not in (provider, user) or ACTION_PART in one.name:
                continue
            listed = found.setdefault(one.name, Listed())
            if one.type_name not in listed.types:
                listed.types.append(one.type_name)
            (listed.providers if one.kind == provider else listed.users).append(one)
        return dict(sorted(found.items()))
