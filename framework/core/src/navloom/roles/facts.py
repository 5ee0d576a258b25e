"""Facts about a role that the framework, its tools and its tests ask for: declared once, by the role's ABC."""

from __future__ import annotations

from dataclasses import dataclass

from navloom.roles.claims import Claim

__all__ = ["RoleFacts"]


@dataclass(frozen=True)
class RoleFacts:
    """What is true of every plugin of a role. All lists of roles derive from these facts.

    Attributes:
        called: When the framework calls the verb, in whole sentences for the reference.
        purpose: What a plugin of the role is for, as claims: it makes them unless its `disclaims` says why not.
        default_plugin: Plugin of a config that names none; empty if the config must name one.
        process: Process of `[live]` that runs it unless the config says otherwise: robot, think or drive.
        api: Major version of the role that this framework supports.
        is_optional: A config without its table has no such node, and the robot drives without it.
        is_exchangeable: Alternatives of it may run in shadow and be swapped in.
        commands: Its answers are velocities, and the gate may pass them to the platform.
        sees_map: Its context has the known map of the run.
        gives_diagnostics: Its table may set `diagnostics_rate_hz`.
        has_large_messages: It publishes maps, paths or scans, whose size has no limit between hosts.
    """

    called: str
    purpose: frozenset[Claim] = frozenset()
    default_plugin: str = ""
    process: str = "think"
    api: int = 1
    is_optional: bool = False
    is_exchangeable: bool = True
    commands: bool = False
    sees_map: bool = False
    gives_diagnostics: bool = False
    has_large_messages: bool = False
