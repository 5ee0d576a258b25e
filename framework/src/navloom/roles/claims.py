"""Claims: what a plugin says of its own behaviour, beyond what the contract of its role demands."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

__all__ = ["PURPOSE", "Claim"]


class Claim(StrEnum):
    """What `navloom check` measures in scenes, and demands of a plugin that claims it.

    Attributes:
        TRANSLATION: The scene moved as a whole gets the same answer, moved along.
        ROTATION: The scene turned by any angle gets the same answer, turned along.
        MIRROR: The mirrored scene gets the mirrored answer.
        NO_CONTACT: It does not lead the robot into what it is shown.
        FOOTPRINT: It keeps the whole footprint clear, of robots that are long or wide, too.
        STOPS_WHEN_CLOSED: An avoider stops where it is closed in on all sides.
        REACHES: It gets there: an avoider to a target in the open, a planner to a goal that a robot can reach.
        OPTIMAL: A planner's path is at most as long as the shortest on an eight-connected grid must be: 8.24 % above
            the shortest at any angle, and the cells at its ends.
        OPTIMAL_ANY_ANGLE: At most 2 % above the shortest at any angle, and the cells at its ends.
        SETTLES: A controller comes onto its reference and stays on it.
        ACCURATE: A localizer or a mapper is right where its data is.
        CORRECTS_DRIFT: A localizer stays right while odometry drifts.
        DRIVES_AS_TOLD: A platform's odometry follows the commands.
        ENDS: A recovery says done or failed within two minutes.
    """

    TRANSLATION = "translation"
    ROTATION = "rotation"
    MIRROR = "mirror"
    NO_CONTACT = "no_contact"
    FOOTPRINT = "footprint"
    STOPS_WHEN_CLOSED = "stops_when_closed"
    REACHES = "reaches"
    OPTIMAL = "optimal"
    OPTIMAL_ANY_ANGLE = "optimal_any_angle"
    SETTLES = "settles"
    ACCURATE = "accurate"
    CORRECTS_DRIFT = "corrects_drift"
    DRIVES_AS_TOLD = "drives_as_told"
    ENDS = "ends"


PURPOSE: Mapping[str, frozenset[Claim]] = MappingProxyType(
    {
        "platform": frozenset({Claim.DRIVES_AS_TOLD}),
        "localizer": frozenset({Claim.ACCURATE}),
        "mapper": frozenset({Claim.ACCURATE}),
        "planner": frozenset({Claim.NO_CONTACT, Claim.REACHES, Claim.FOOTPRINT}),
        "controller": frozenset({Claim.SETTLES}),
        "avoider": frozenset({Claim.NO_CONTACT, Claim.REACHES}),
        "recovery": frozenset({Claim.NO_CONTACT, Claim.ENDS}),
    }
)
"""What each role is for: its plugins claim it unless they say why not in `disclaims`."""
