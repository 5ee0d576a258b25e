"""Planner: a path through the map."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from navloom.messages import MapUpdate, Message, Path, PlanFailure, PlanRequest
from navloom.roles.base import P, Role
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.facts import RoleFacts
from navloom.roles.struct import struct

__all__ = ["Planner", "PlannerInput"]


@struct
class PlannerInput:
    """What a planner sees.

    Attributes:
        request: The request, with start and goal.
        map: The newest map.
        extra: The plugin's own extra inputs, see `Extra`.
    """

    request: PlanRequest
    map: MapUpdate
    extra: Extras = NO_EXTRAS


class Planner(Role[P]):
    """Finds paths. The robot's footprint is in the context."""

    role = "planner"
    facts = RoleFacts(
        called="Called for each request of the goal node: at the start of a goal, and when a path is blocked. Whether "
        "unknown cells are free is the planner's own decision: the shipped planners plan through them, unless their "
        "parameter `unknown` says otherwise. `navloom check` allows 1 s for an answer; the goal fails after "
        "`navigation.plan_timeout`.",
        purpose=frozenset({Claim.NO_CONTACT, Claim.REACHES, Claim.FOOTPRINT}),
        default_plugin="astar",
        process="think",
        has_large_messages=True,
    )
    is_patient = True
    accepts: ClassVar[tuple[type[Message], ...]] = ()

    @abstractmethod
    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        """A path from start to goal, or why and where there is none; `request_id` is the request's."""
