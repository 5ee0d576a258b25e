"""Runs another plugin open loop on a recorded run: on the inputs that the active instance received."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from navloom.config import ConfigError, Loaded
from navloom.config.config_errors import problems_of
from navloom.config.config_presets import instance_of
from navloom.config.loader import parse_override
from navloom.config.schema import Config
from navloom.config.tables import ROLE_TABLES
from navloom.engine.build import assemble
from navloom.engine.differences import differences
from navloom.messages import MapUpdate, Message, PoseEstimate
from navloom.plugins.registry import nearest
from navloom.roles.presets import named_plugin
from navloom.runs.shadow_comparison import Disagreement
from numpy.typing import NDArray
from pydantic import ValidationError

from navloom_recording.message_cache import Shelf
from navloom_recording.missing_plugins import option_of
from navloom_recording.reader import Recording
from navloom_recording.step_outputs import Outcomes
from navloom_recording.step_replay import Replayer, ReplayNode, Stepped

__all__ = ["Substitute", "substitute", "substitute_config", "with_offsets"]

Floats = NDArray[np.float64]
RESERVED = ("rate_hz", "latency", "sensors", "required")


@dataclass(eq=False)
class Substitute:
    """Result of a plugin that was run in place of the recorded one.

    Attributes:
        found: Comparison tick by tick.
        steps: Number of steps made.
        faults: Exceptions, with their ticks.
        not_fed: Steps that lacked an input, with what they lacked.
        notes: What else a reader must know.
        way: (n, 3) tick, x and y, m, map frame: track of the recorded robot.
        last: Its last answer; the final map of a mapper.
        recorded_map: The last recorded map.
    """

    found: Disagreement
    steps: int = 0
    faults: list[str] = field(default_factory=list)
    not_fed: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    way: list[tuple[int, float, float]] = field(default_factory=list)
    last: Message | None = None
    recorded_map: MapUpdate | None = None

    def summary(self) -> dict[str, Any]:
        """The result as `replay --json` prints it."""
        return self.found.summary().to_json() | {
            "steps": self.steps,
            "faults": len(self.faults),
            "first_fault": self.faults[0] if self.faults else None,
            "not_fed": len(self.not_fed),
            "first_not_fed": self.not_fed[0] if self.not_fed else None,
            "notes": self.notes,
        }


def substitute_config(loaded: Loaded, role: str, name: str, changes: Sequence[str] = ()) -> Loaded:
    """A recording's config with another plugin in a role: one of its own alternatives by name, or any plugin.

    Args:
        loaded: The recording's config.
        role: The role, or the name of a [[node]].
        name: Name of an alternative of that role, or of a plugin, which then has its default parameters.
        changes: Changes of its parameters, as `ROLE.KEY=VALUE`.

    Raises:
        ConfigError: There is no such [[node]], or the plugin or a change does not fit.
    """
    tree: dict[str, Any] = loaded.config.model_dump(mode="json", exclude_unset=True)
    tables = tree.pop("alternative", [])
    nodes = {one["name"]: one for one in tree.get("node", [])}
    if role not in loaded.config.roles:
        lacks = f"[{role}]" if role in ROLE_TABLES else f"[[node]] {role!r}{nearest(role, list(nodes))}"
        raise ConfigError(f"--node {role}={name}: the recording's config has no {lacks}")
    plugin, preset = named_plugin(name)
    own = [one for one in tables if one["role"] == role]
    chosen = next((one for one in own if name in (instance_of(one), instance_of({**one, "name": None}))), None)
    if chosen is not None:
        table = {key: value for key, value in chosen.items() if key not in ("role", "shadow")}
    else:
        old = nodes.get(role) or tree.get(role, {})
        same = (old.get("plugin"), old.get("preset")) == (plugin, preset)
        table = {**{key: value for key, value in old.items() if same or key in RESERVED}, "plugin": name}
        # Sensors and name were chosen for the old plugin.
        if not same:
            table.pop("sensors", None)
            table.pop("name", None)
    for change in changes:
        place, value = parse_override(change)
        owner, _, key = place.partition(".")
        if owner == role and key:
            table[key] = value
    if role in nodes:
        tree["node"] = [{**table, "name": role} if node is nodes[role] else node for node in nodes.values()]
    else:
        tree[role] = table
    # Recorded parameters of the old plugin do not fit the new one.
    tree["event"] = []
    try:
        return replace(loaded, config=Config.model_validate(tree))
    except ValueError as error:
        raise ConfigError(f"{option_of(role, name)}: {error}") from None


def with_offsets(loaded: Loaded, changes: Sequence[str]) -> Loaded:
    """A recording's config with other time offsets of sensors, whose raw stamps are recorded.

    Args:
        loaded: The recording's config.
        changes: `sensor.NAME.time_offset=VALUE`.

    Raises:
        ConfigError: There is no such sensor, or the value does not fit.
    """
    tree: dict[str, Any] = loaded.config.model_dump(mode="json", exclude_unset=True)
    sensors = {one["name"]: one for one in tree.get("sensor", [])}
    for change in changes:
        place, value = parse_override(change)
        name, _, key = place.removeprefix("sensor.").partition(".")
        if name not in sensors:
            raise ConfigError(f"--set {change}: there is no sensor {name!r}{nearest(name, list(sensors))}")
        if key != "time_offset":
            raise ConfigError(
                f"--set {change}: what the sensor measured is recorded; expected sensor.{name}.time_offset=SECONDS"
            )
        sensors[name]["time_offset"] = value
    try:
        return replace(loaded, config=Config.model_validate(tree))
    except ValidationError as error:
        raise ConfigError(*(f"--set {problem}" for problem in problems_of(error, Config, given=tree))) from None


def substitute(
    recording: Recording,
    loaded: Loaded,
    role: str,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[float, float], None] | None = None,
) -> Substitute:
    """Step a plugin on the inputs of the recorded active instances of its role, and compare the answers.

    Args:
        recording: A recording with step records.
        loaded: The config with the plugin in its role, see `substitute_config`.
        role: The role.
        say, progress: Receive progress of the preparation and of the replay.
    """
    name = loaded.config.role_table(role).instance
    replayer = Replayer(recording, assemble(loaded), {role: name}, say)
    ports = replayer.system.catalogue.answer_ports(role)
    watch = _Watch(Substitute(Disagreement(role, name)), Outcomes(replayer), ports)
    replayer.run(watch.again, progress)
    watch.result.notes += [note for node in replayer.nodes.values() for note in node.notes]
    _add_way(watch.result, recording, replayer)
    return watch.result


class _Watch:
    """Compares each answer with the recorded one of the same step."""

    def __init__(self, result: Substitute, outcomes: Outcomes, ports: tuple[str, ...]) -> None:
        self.result, self.outcomes, self.ports = result, outcomes, ports

    def again(self, node: ReplayNode, stepped: Stepped, shelf: Shelf) -> None:
        """Compare one step."""
        result, step = self.result, stepped.step
        ports = self.ports
        given = [message for port, message in stepped.outputs if port in ports]
        numbers = self.outcomes.numbers(stepped, dict.fromkeys(ports, len(given[:1])))
        if not step.report.trigger:
            return
        result.steps += 1
        if stepped.fault:
            result.faults.append(f"tick {step.at.tick}: {stepped.fault}")
        if stepped.fed.missing:
            result.not_fed.append(f"tick {step.at.tick} lacks {'; '.join(stepped.fed.missing)}")
        result.last = given[-1] if given else result.last
        entries = [self.outcomes.entry(step, port, number, shelf) for port in ports for number in numbers[port]]
        opened = [one for entry in entries if entry is not None and (one := entry.open()) is not None]
        if opened and given:
            found = differences(step.role, opened[-1].message, given[-1])
            result.found.add(step.at.tick, step.at.stamp_ns * 1e-9, step.instance, found)
        elif opened or given:
            result.found.unanswered += 1


def _add_way(result: Substitute, recording: Recording, replayer: Replayer) -> None:
    """Add the track of the recorded robot and its map."""
    for message in recording.messages(["localizer/*/pose", "mapper/*/map"]):
        role, name, _ = message.key.split("/", 2)[-1].split("/")
        if replayer.chosen.at(role, message.envelope.tick) != name:
            continue
        if isinstance(message.message, PoseEstimate):
            result.way.append((message.envelope.tick, message.message.pose.x, message.message.pose.y))
        elif isinstance(message.message, MapUpdate):
            result.recorded_map = message.message
