"""What another plugin would have said in a recorded run: open loop, on the inputs that the one in charge was given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navloom.config import ConfigError, Loaded
from navloom.config.loader import parse_override
from navloom.config.schema import ROLE_TABLES, Config
from navloom.engine.build import assemble
from navloom.engine.differences import UNITS, differences
from navloom.messages import MapUpdate, Message, PoseEstimate
from navloom.plugins.registry import nearest
from navloom.recording.outcomes import Outcomes
from navloom.recording.reader import Recording
from navloom.recording.replaying import Replayer, ReplayNode, Stepped
from navloom.recording.shelf import Shelf
from navloom.study.plotting import GREY, OKABE_ITO, new_figure, png_of, styled
from navloom.study.shadows import Disagreement

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Substitute", "draw_substitute", "substitute", "substitute_config", "substitute_figure"]

Floats = NDArray[np.float64]
TICKS = 5
"""At most on an x axis: those of a robot that has run for days have many digits."""
LARGE = 1e6
"""Numbers above it are shown as what they exceed a common one by."""
RESERVED = ("rate_hz", "latency", "sensors", "required")


@dataclass(eq=False)
class Substitute:
    """What came of a plugin in the place of the recorded one.

    Attributes:
        found: Tick by tick.
        steps: Made.
        faults: Steps in which it raised something, and the first of them.
        not_fed: Steps that lacked an input, and the first of them.
        notes: What else a reader must know.
        way: (n, 3) tick, x and y, m, map frame: where the recorded robot was.
        last: Its last answer; of a mapper the map it ended with.
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
        """For `replay --json`."""
        return self.found.summary() | {
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
        role: Which.
        name: Name of an alternative of that role, or of a plugin, whose parameters are then its defaults.
        changes: `ROLE.KEY=VALUE` of its parameters.

    Raises:
        ConfigError: A change that is not of this role or does not fit.
    """
    tree: dict[str, Any] = loaded.config.model_dump(mode="json", exclude_unset=True)
    tables = tree.pop("alternative", [])
    nodes = {one["name"]: one for one in tree.get("node", [])}
    if role not in (*ROLE_TABLES, *nodes):
        raise ConfigError(
            f"--node {role}={name}: the recording's config has no [[node]] {role!r}{nearest(role, list(nodes))}"
        )
    chosen = next((one for one in tables if one["role"] == role and name in (one.get("name"), one["plugin"])), None)
    if chosen is not None:
        table = {key: value for key, value in chosen.items() if key not in ("role", "shadow")}
    else:
        old = nodes.get(role) or tree.get(role, {})
        same = old.get("plugin") == name
        table = {**{key: value for key, value in old.items() if same or key in RESERVED}, "plugin": name}
        if not same:
            table.pop("sensors", None)
            table.pop("name", None)
    for change in changes:
        place, value = parse_override(change)
        owner, _, key = place.partition(".")
        if owner == role and key:
            table[key] = value
    if role in nodes:
        tree["node"] = [{**table, "name": role} if one is nodes[role] else one for one in nodes.values()]
    else:
        tree[role] = table
    tree["event"] = []
    try:
        return replace(loaded, config=Config.model_validate(tree))
    except ValueError as error:
        option = f"--{role} {name}" if role in ROLE_TABLES else f"--node {role}={name}"
        raise ConfigError(f"{option}: {error}") from None


def substitute(
    recording: Recording,
    loaded: Loaded,
    role: str,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[float, float], None] | None = None,
) -> Substitute:
    """Step a plugin on what the recorded instances in charge of its role were given, and compare.

    Args:
        recording: With step records.
        loaded: The config with the plugin in its role, see `substitute_config`.
        role: Which.
        say, progress: Told what is prepared, and how far it is.
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
        """Take one step."""
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
    """Where the recorded robot was, and the map it had."""
    for one in recording.messages(["localizer/*/pose", "mapper/*/map"]):
        role, name, _ = one.key.split("/", 2)[-1].split("/")
        if replayer.chosen.at(role, one.envelope.tick) != name:
            continue
        if isinstance(one.message, PoseEstimate):
            result.way.append((one.envelope.tick, one.message.pose.x, one.message.pose.y))
        elif isinstance(one.message, MapUpdate):
            result.recorded_map = one.message


def draw_substitute(result: Substitute, what: str) -> bytes:
    """PNG of `substitute_figure`."""
    return png_of(substitute_figure(result, what))


def substitute_figure(result: Substitute, what: str) -> Figure:
    """Where along the driven way it would have acted differently, and by how much over time.

    Args:
        result: Of the comparison.
        what: The recorded plugin's name, for the legend.
    """
    found = result.found
    names = [name for name in found.values if np.nanmax(np.abs(found.values[name]), initial=0.0) > 0.0][:3]
    with styled():
        from matplotlib.ticker import MaxNLocator

        figure, axes = new_figure(180.0, 100.0, 1, 2)
        _draw_way(axes[0], result, what)
        _draw_series(axes[1], result, names)
        figure.suptitle(f"{found.role} {found.instance} on the recorded inputs of {what}", fontsize=9.0)
        for one in axes:
            one.xaxis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 2.5, 5, 10]))
            one.ticklabel_format(axis="x", useOffset=one.get_xlim()[1] > LARGE)
            handles, labels = one.get_legend_handles_labels()
            if handles:  # below the axes, where it hides nothing that is drawn
                one.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=len(handles))
    return figure


def _draw_way(axes: Any, result: Substitute, what: str) -> None:
    found = result.found
    update = result.recorded_map
    way = np.array(result.way, dtype=np.float64).reshape(-1, 3)
    if update is not None:
        for x1, y1, x2, y2 in update.segments:
            axes.plot([x1, x2], [y1, y2], color=GREY, lw=2.0, solid_capstyle="round")
    axes.plot(way[:, 1], way[:, 2], color=OKABE_ITO[5], lw=5.0, solid_capstyle="round", label=f"driven by {what}")
    differing = {tick for tick, differs in zip(found.ticks, found.differing, strict=True) if differs}
    at = way[np.isin(way[:, 0], sorted(differing))]
    told = f"{found.instance} differs ({len(differing)} ticks)"
    axes.plot(at[:, 1], at[:, 2], ".", color=OKABE_ITO[1], ms=3.0, label=told)
    if len(way):
        axes.plot(*way[0, 1:], "o", color=OKABE_ITO[2], ms=6.0, label="start")
        low, high = way[:, 1:].min(axis=0) - 1.5, way[:, 1:].max(axis=0) + 1.5
        middle, half = (low + high) / 2.0, float((high - low).max()) / 2.0
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _draw_series(axes: Any, result: Substitute, names: Sequence[str]) -> None:
    found = result.found
    for number, name in enumerate(names):
        unit = UNITS[name]
        label = name if unit == "1" else f"{name}, {unit}"
        axes.plot(found.times, found.values[name], color=OKABE_ITO[number + 1], lw=1.0, label=label)
    axes.axhline(0.0, color=GREY, lw=0.6)
    axes.set_xlabel("run time, s")
    axes.set_ylabel("difference, its answer less the recorded one")
    if not names:
        axes.set_yticks([0.0])
        axes.text(0.5, 0.6, "no difference in any tick", transform=axes.transAxes, ha="center", color=GREY)
