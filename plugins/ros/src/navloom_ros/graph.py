"""The ROS graph: which nodes, topics, services and actions exist, from the liveliness tokens of rmw_zenoh."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from navloom_ros.errors import BadToken
from navloom_ros.tokens import Entity

__all__ = ["ACTION_PART", "Graph", "Listed"]

MOST_ENTITIES = 20_000
"""Most entities that are stored, so that a flood of tokens cannot fill the memory."""
MOST_ALIKE = 3
"""Most topics that `Graph.alike` names."""
ACTION_PART = "/_action/"
"""Part of the name of every topic and service that an action consists of."""


@dataclass
class Listed:
    """A topic, service or action.

    Attributes:
        types: Types of its endpoints, in order of discovery; more than one is an error on the network.
        providers, users: Publishers and subscriptions of a topic; servers and clients of a service or action.
    """

    types: list[str] = field(default_factory=list)
    providers: list[Entity] = field(default_factory=list)
    users: list[Entity] = field(default_factory=list)


class Graph:
    """All entities of one domain. Tokens may appear and disappear in any order.

    Attributes:
        unread: Number of tokens that were ignored: invalid, or more than MOST_ENTITIES.
        reason: Why the last of them was ignored.
    """

    def __init__(self) -> None:
        self._entities: dict[str, Entity] = {}
        self.unread, self.reason = 0, ""

    def add(self, token: str) -> Entity | None:
        """Store the entity of a token; None if the token is ignored."""
        if token in self._entities:
            return self._entities[token]
        try:
            if len(self._entities) >= MOST_ENTITIES:
                raise BadToken(f"token {token[:200]!r}: {MOST_ENTITIES} others are stored already")
            entity = Entity.parsed(token)
        except BadToken as error:
            self.unread, self.reason = self.unread + 1, str(error)
            return None
        self._entities[token] = entity
        return entity

    def remove(self, token: str) -> Entity | None:
        """Remove the entity of a token; None if it is not stored."""
        return self._entities.pop(token, None)

    def without(self, session: str) -> Graph:
        """A copy of the graph without the entities of one process."""
        left = Graph()
        left._entities = {token: one for token, one in list(self._entities.items()) if one.session != session}
        return left

    @property
    def entities(self) -> list[Entity]:
        """All entities, in order of discovery."""
        return list(self._entities.values())

    def find(self, name: str, kinds: Iterable[str]) -> list[Entity]:
        """Endpoints with a full name, of some kinds (keys of `tokens.KINDS`)."""
        return [entity for entity in self.entities if entity.name == name and entity.kind in kinds]

    def alike(self, name: str, kind: str) -> str:
        """Advice that names other topics with the same last part and endpoints of a kind; empty without any."""
        last = name.rpartition("/")[2]
        others = {one.name for one in self.entities if one.kind == kind and one.name.rpartition("/")[2] == last}
        found = sorted(others - {name})[:MOST_ALIKE]
        return f"; {' and '.join(found)} exist{'s' * (len(found) == 1)}: set namespace or remap" if found else ""

    def nodes(self) -> list[str]:
        """Full names of the nodes, sorted and distinct."""
        return sorted({entity.full_node_name for entity in self.entities if entity.kind == "NN"})

    def topics(self) -> dict[str, Listed]:
        """Topics by name, without those of actions."""
        return self._listed("MP", "MS")

    def services(self) -> dict[str, Listed]:
        """Services by name, without those of actions."""
        return self._listed("SS", "SC")

    def actions(self) -> dict[str, Listed]:
        """Actions by name, with the type of the action."""
        found: dict[str, Listed] = {}
        for entity in self.entities:
            name, separator, part = entity.name.partition(ACTION_PART)
            if separator and part == "send_goal":
                listed = found.setdefault(name, Listed())
                kind = entity.type_name.removesuffix("_SendGoal")
                if kind not in listed.types:
                    listed.types.append(kind)
                (listed.providers if entity.kind == "SS" else listed.users).append(entity)
        return dict(sorted(found.items()))

    def _listed(self, provider: str, user: str) -> dict[str, Listed]:
        found: dict[str, Listed] = {}
        for entity in self.entities:
            if entity.kind not in (provider, user) or ACTION_PART in entity.name:
                continue
            listed = found.setdefault(entity.name, Listed())
            if entity.type_name not in listed.types:
                listed.types.append(entity.type_name)
            (listed.providers if entity.kind == provider else listed.users).append(entity)
        return dict(sorted(found.items()))
