"""Planner: a path through the map."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from navloom.messages import MapUpdate, Message, Path, PlanFailure, PlanRequest
from navloom.roles.base import P, Role
from navloom.roles.extra import NO_EXTRAS, Extras
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
    is_patient = True
    accepts: ClassVar[tuple[type[Message], ...]] = ()

    @abstractmethod
    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        """A path from start to goal, or why and where there is none; `request_id` is the request's."""
