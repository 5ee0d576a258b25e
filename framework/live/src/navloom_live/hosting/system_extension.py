"""Adds an instance to the config and the system of a running robot, whose other nodes go on as they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from navloom.config import ConfigError, Loaded
from navloom.config.config_errors import problems_of
from navloom.config.schema import Config
from navloom.engine.build import assemble
from navloom.engine.node_ports import NodeSpec
from navloom.engine.plugin_instances import Part
from navloom.engine.system import System
from navloom.engine.task_checks import check_live
from navloom.roles import Role
from pydantic import ValidationError

__all__ = ["admit_part", "extended", "with_alternative"]

Source = tuple[str, str]


def extended(system: System, loaded: Loaded, source: Source) -> System:
    """The system with the added instance, checked like any config.

    Args:
        system: The running system.
        loaded: Its config with one more alternative.
        source: Role and name of the added instance.

    Raises:
        ConfigError, PluginError: The instance does not fit, or another node would have to read something new.
    """
    # The whole config again: an added instance may make another one's parameters wrong (an ambiguous stream).
    found = assemble(loaded)
    check_live(found)
    role, name = source
    for other, spec in found.wiring.items():
        # The new instance runs in a process of its own, which reads what it likes.
        if other == source:
            continue
        if more := sorted(_reads(spec) - _reads(system.wiring[other])):
            ports = ", ".join(dict.fromkeys(port for port, _ in more))
            raise ConfigError(
                f"{role} {name} reads what no {role} of the running robot reads, so {' '.join(other)} would have to "
                f"watch {ports} too, which it learns only at its start: start the robot with `--shadow {role}={name}`"
            )
    return found


def _reads(spec: NodeSpec) -> set[tuple[str, str]]:
    """Stream and name of each input: the gate may read one scan for its monitor and again for an avoider."""
    return {(f"{given.role}.{given.port}", given.name) for given in spec.inputs}


def admit_part(system: System, loaded: Loaded, source: Source) -> None:
    """Let a running system know of an instance of another process, without importing its plugin.

    An import may hold the GIL for as long as it likes, and this process may drive the robot.
    """
    role, _ = source
    active = next(one for one in system.parts if one[0] == role)
    table = loaded.config.alternative[-1]
    # `Role` stands for its class, which this process must not import.
    part = Part(f"alternative.{len(loaded.config.alternative) - 1}", role, table, Role, None)
    # Other threads iterate over these: replace them, and change nothing in place.
    system.wiring = {**system.wiring, source: system.wiring[active]}
    system.parts = {**system.parts, source: part}
    system.loaded = loaded


def with_alternative(loaded: Loaded, table: Mapping[str, Any], process: str) -> Loaded:
    """The config with one more `[[alternative]]`, which runs in a process of its own.

    Args:
        loaded: The config.
        table: The alternative's table: role, plugin and more.
        process: Name of the new process.

    Raises:
        ConfigError: The table does not fit; one line a problem.
    """
    tree = loaded.config.model_dump(mode="json", exclude_unset=True)
    tree["alternative"] = [*tree.get("alternative", []), dict(table)]
    instance = table.get("name") or table["plugin"]
    processes = {**loaded.config.live.processes, process: [f"{table['role']}.{instance}"]}
    tree["live"] = {**tree.get("live", {}), "processes": processes}
    try:
        config = Config.model_validate(tree)
    except ValidationError as error:
        raise loaded.error(*problems_of(error, Config, given=tree)) from None
    return replace(loaded, config=config)
