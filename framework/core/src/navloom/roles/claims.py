"""Claims: what a plugin states about its own behaviour, beyond what the contract of its role requires."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Claim"]


class Claim(StrEnum):
    """A behaviour that `navloom check` measures in scenes, and requires of a plugin that claims it.

    Attributes:
        TRANSLATION: If the whole scene is moved, the answer is the same, moved with it.
        ROTATION: If the whole scene is turned by any angle, the answer is the same, turned with it.
        MIRROR: A mirrored scene gets the mirrored answer.
        NO_CONTACT: It does not lead the robot into an obstacle that it is shown.
        FOOTPRINT: It keeps the whole footprint clear, also of long or wide robots.
        STOPS_WHEN_CLOSED: An avoider stops if it is closed in on all sides.
        REACHES: It gets there: an avoider to a target in the open, a planner to a goal that a robot can reach.
        OPTIMAL: A planner's path is no longer than the shortest path on an eight-connected grid can be: 8.24 % above
            the shortest any-angle path, plus the cells at its ends.
        OPTIMAL_ANY_ANGLE: At most 2 % above the shortest any-angle path, plus the cells at its ends.
        SETTLES: A controller converges to its reference and stays on it.
        ACCURATE: A localizer or mapper is right where its data is.
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
