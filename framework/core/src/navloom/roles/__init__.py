"""The roles that plugins fill: one abstract class, one input struct and one verb each.

Begin with `base.py` (construction, parameters, context, errors), then any role, as `avoider.py`.
A fact about a role (its purpose, its process, who commands the wheels) is stated once, as its `facts` (`facts.py`).
`engine/nodes` steps each role, and `engine/streams.py` declares what it publishes.
`extra.py` declares messages that a plugin reads beyond its role, `claims.py` what it promises to do.
A new role touches this package, `names.py`, `engine/streams.py`, a node in `engine/nodes` and `engine/catalogue.py`.
"""

from functools import cache
from typing import get_args, get_type_hints

from navloom.roles.avoider import Avoider, AvoiderInput
from navloom.roles.base import ANYWHERE, Context, InputError, Params, RobotSpec, Role, SensorSpec
from navloom.roles.claims import Claim
from navloom.roles.controller import Controller, ControllerInput
from navloom.roles.derived import LEFT_OUT, Derivable, Derived
from navloom.roles.disturbances import Disturbance
from navloom.roles.extra import Extra, Extras
from navloom.roles.localizer import Localizer, LocalizerInput
from navloom.roles.mapper import Mapper, MapperInput
from navloom.roles.planner import Planner, PlannerInput
from navloom.roles.platform import Platform, PlatformInput, PlatformOutput
from navloom.roles.presets import Preset
from navloom.roles.recovery import Recovery, RecoveryInput

ROLES: dict[str, type[Role]] = {
    role.role: role for role in (Platform, Localizer, Mapper, Planner, Controller, Avoider, Recovery)
}
"""The ABC of each role, by name. All other lists of roles derive from this one."""

ROLE_API: dict[str, int] = {role: cls.facts.api for role, cls in ROLES.items()}
"""Major version of each role that this framework supports."""
FIXED = frozenset(role for role, cls in ROLES.items() if not cls.facts.is_exchangeable)
"""Roles whose instance is neither shadowed nor swapped: the robot itself."""


def verb_of(role: str) -> str:
    """Name of the one method that a role's plugins must implement."""
    (verb,) = ROLES[role].__abstractmethods__
    return verb


@cache
def given_of(role: str) -> type:
    """The input struct of a role's verb."""
    given: type = get_type_hints(getattr(ROLES[role], verb_of(role)))["given"]
    return given


@cache
def answers_of(role: str) -> tuple[type, ...]:
    """The classes that a role's verb may answer with; NoneType among them where it may answer None."""
    answer = get_type_hints(getattr(ROLES[role], verb_of(role)))["return"]
    return get_args(answer) or (answer,)


__all__ = [
    "ANYWHERE",
    "LEFT_OUT",
    "ROLES",
    "ROLE_API",
    "Avoider",
    "AvoiderInput",
    "Claim",
    "Context",
    "Controller",
    "ControllerInput",
    "Derivable",
    "Derived",
    "Disturbance",
    "Extra",
    "Extras",
    "InputError",
    "Localizer",
    "LocalizerInput",
    "Mapper",
    "MapperInput",
    "Params",
    "Planner",
    "PlannerInput",
    "Platform",
    "PlatformInput",
    "PlatformOutput",
    "Preset",
    "Recovery",
    "RecoveryInput",
    "RobotSpec",
    "Role",
    "SensorSpec",
    "verb_of",
]
