"""The roles: one ABC, one input struct and one verb each."""

from navloom.roles.avoider import Avoider, AvoiderInput
from navloom.roles.base import Context, InputError, Params, RobotSpec, Role, SensorSpec
from navloom.roles.claims import Claim
from navloom.roles.controller import Controller, ControllerInput
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

ROLE_API: dict[str, int] = dict.fromkeys(ROLES, 1)
"""Major version of each role that this framework supports."""


def verb_of(role: str) -> str:
    """Name of the one method that a role's plugins must implement."""
    (verb,) = ROLES[role].__abstractmethods__
    return verb


def is_patient(role: str) -> bool:
    """Whether a role's step may take long because no motor waits for it; False for the framework's own nodes."""
    return role in ROLES and ROLES[role].is_patient


__all__ = [
    "ROLES",
    "ROLE_API",
    "Avoider",
    "AvoiderInput",
    "Claim",
    "Context",
    "Controller",
    "ControllerInput",
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
    "is_patient",
    "verb_of",
]
