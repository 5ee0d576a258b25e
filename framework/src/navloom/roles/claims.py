"""Claims: properties of a plugin's behaviour beyond the contract of its role."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

__all__ = ["PURPOSE", "Claim"]


class Claim(StrEnum):
    """What `navloom check` measures in scenes, and demands of a plugin that claims it.

    Attributes:
        TRANSLATION: If the scene is moved, the answer moves with it.
        ROTATION: If the scene is turned by any angle, the answer turns with it.
        MIRROR: The mirrored scene gives the mirrored answer.
        NO_CONTACT: The robot touches no obstacle that the plugin is shown.
        FOOTPRINT: The same for the whole footprint, also of long and wide robots.
        STOPS_WHEN_CLOSED: An avoider stops when it is closed in on all sides.
        REACHES: An avoider reaches a target in the open, a planner a goal that the robot can reach.
        OPTIMAL: A planner's path is at most 8.24 % longer than the shortest any-angle path, the bound of an
            eight-connected grid, plus the cells at its ends.
        OPTIMAL_ANY_ANGLE: At most 2 % longer than the shortest any-angle path, plus the cells at its ends.
        SETTLES: A controller converges to its reference.
        ACCURATE: The pose of a localizer, or the map of a mapper, agrees with the ground truth.
        CORRECTS_DRIFT: A localizer stays accurate while odometry drifts.
        DRIVES_AS_TOLD: A platform's odometry follows the commands.
        ENDS: A recovery reports done or failed within two minutes.
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
"""Purpose of each role: its plugins claim it unless they disclaim it with a reason."""
