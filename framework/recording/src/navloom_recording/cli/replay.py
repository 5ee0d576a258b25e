"""`navloom replay`: repeats a recording node by node, unchanged or with another plugin in one role."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from navloom.cli.options import AsJson, MapOptions, PluginFiles, Shadows, a_number
from navloom.cli.output import LOG, log_of
from navloom.cli.tracebacks import with_traceback_of
from navloom.parts import part

if TYPE_CHECKING:
    from navloom_recording.excerpt import Excerpt
    from navloom_recording.replay_check import NodeCheck

__all__ = ["replay"]

DEBUGGING = "One node or one step"

Plugin = Annotated[
    str | None, typer.Option(metavar="NAME", help="Another plugin, or an [[alternative]] of the config.")
]


def replay(
    file: Annotated[Path, typer.Argument(metavar="F.mcap", help="A recording.")],
    place: MapOptions,
    avoider: Plugin = None,
    controller: Plugin = None,
    planner: Plugin = None,
    mapper: Plugin = None,
    localizer: Plugin = None,
    node: Annotated[
        list[str] | None,
        typer.Option("--node", metavar="NODE=NAME", help="Another plugin in a [[node]] of the config; repeats."),
    ] = None,
    shadow: Shadows = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="ROLE.KEY=V",
            help="A parameter of such a plugin, or sensor.NAME.time_offset=S; repeats.",
        ),
    ] = None,
    plugin: PluginFiles = None,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 if an output differs from the recorded one.")] = False,
    live: Annotated[bool, typer.Option("--live", help="Publish the recording as a robot in realm replay.")] = False,
    speed: Annotated[
        float, typer.Option(metavar="X", min=0.01, help="With --live: speed factor.", callback=a_number)
    ] = 1.0,
    only: Annotated[
        str | None, typer.Option(metavar="ROLE[.NAME]", help="Step this node alone.", rich_help_panel=DEBUGGING)
    ] = None,
    until: Annotated[
        int | None, typer.Option(metavar="TICK", min=0, help="Step up to this tick.", rich_help_panel=DEBUGGING)
    ] = None,
    pdb: Annotated[
        bool,
        typer.Option(
            "--pdb", help="Stop inside the step of that tick, in Python's debugger.", rich_help_panel=DEBUGGING
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for result.json, the ticks as CSV, and a picture.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Replay a recording, or try another plugin on its inputs.

    Each node steps on its recorded inputs, and its outputs are compared with the recorded ones.
    """
    from tempfile import TemporaryDirectory

    from navloom.config import ConfigError
    from navloom.config.loader import parse_shadows

    from navloom_recording.cli.imported_replay import replay_imported
    from navloom_recording.excerpt import excerpt_of
    from navloom_recording.reader import Recording
    from navloom_recording.substitutes import with_offsets
    from navloom_recording.world_attachments import with_world

    given = {"avoider": avoider, "controller": controller, "planner": planner, "mapper": mapper, "localizer": localizer}
    stand_ins = [(role, name) for role, name in given.items() if name is not None]
    for text in node or ():
        owner, equals, name = text.partition("=")
        if not equals or not owner or not name:
            raise ConfigError(f"--node {text}: expected NODE=NAME, as in --node people=nearest_tracker")
        stand_ins.append((owner, name))
    for text in shadow or ():
        role, names = parse_shadows(text)
        stand_ins += [(role, name) for name in names]
    if sum((bool(stand_ins), live, check)) > 1:
        raise ConfigError("--check, --live and another plugin are three ways to replay: choose one")
    is_part = only is not None or until is not None or pdb
    if is_part and (live or stand_ins):
        raise ConfigError("--only, --until and --pdb replay what was recorded: leave --live and another plugin out")
    offsets = [change for change in set_ or () if change.startswith("sensor.")]
    set_ = [change for change in set_ or () if change not in offsets]
    if live and offsets:
        raise ConfigError(f"--set {offsets[0]}: --live publishes what the sensors said: give the offset to its readers")
    for change in set_:
        if change.partition(".")[0] not in dict(stand_ins):
            tried = ", ".join(dict(stand_ins)) or "none has"
            raise ConfigError(f"--set {change}: expected ROLE.KEY=V, with a ROLE that has another plugin here: {tried}")
    recording = Recording(file)
    tell_reading(recording)
    if live:
        _publish(recording, speed)
        return
    is_imported = recording.header.kind == "imported"
    if is_part and is_imported:
        raise ConfigError("--only, --until and --pdb: an imported log holds no steps of nodes")
    excerpt = excerpt_of(recording, only, until, pdb)
    if not is_imported and place != MapOptions():
        raise ConfigError("--map and --start are for imported logs: this recording holds its own world and start")
    with TemporaryDirectory() as folder:
        loaded = with_offsets(with_world(recording, recording.header.loaded(), Path(folder)), offsets)
        if is_imported:
            if shadow:
                raise ConfigError("--shadow: an imported log has no plugins; name one for each role, as --avoider vff")
            replay_imported(recording, loaded, dict(stand_ins), set_, out, as_json, place)
        elif stand_ins:
            _substitute(recording, loaded, stand_ins, set_, out, as_json)
        else:
            _check(recording, loaded, excerpt, check, out, as_json)


def tell_reading(recording: Any) -> None:
    """Log what a user should know of a recording: an incomplete end, and messages that are unknown here."""
    from navloom.plugins.message_opening import OPENER

    if recording.header.config is not None:
        OPENER.block(recording.header.loaded().config.plugins.blocked)
    for note in filter(None, (recording.note, *recording.unknown())):
        LOG.info(note)


def _check(recording: Any, loaded: Any, excerpt: Excerpt, is_check: bool, out: Path | None, as_json: bool) -> None:
    from navloom.cli.output import json_bytes, print_json, stage
    from navloom.cli.written_files import tell_out
    from navloom.runs.result_folder import OutFolder

    from navloom_recording.excerpt import DebuggerLeft
    from navloom_recording.missing_plugins import refuse_missing
    from navloom_recording.replay_check import check, installed_part
    from navloom_recording.step_replay import Replayer

    refuse_missing(recording, loaded.config)
    with OutFolder(out, ("result.json",)) as folder:
        with stage(as_json or excerpt.is_debugged) as (say, progress):
            system, missing = installed_part(loaded)
            try:
                found = [*check(Replayer(recording, system, None, say, excerpt), progress), *missing]
            except DebuggerLeft:
                raise typer.Exit(0) from None
        differing = [one.first for one in found if one.differing and one.first is not None]
        first = min(differing, key=lambda one: one.tick, default=None)
        compared = sum(one.messages - one.unverified for one in found)
        result = {
            "file": str(recording.path),
            "kind": recording.header.kind,
            "complete": recording.is_complete,
            "same": not any(one.differing for one in found) and compared > 0,
            "first_difference": None if first is None else str(first),
            "nodes": [one.to_json() for one in found],
            "recorder": recording.counts(),
        }
        folder.write({"result.json": json_bytes(result)})
    for one in found:
        _tell_fault(recording.path, one, excerpt)
    if as_json:
        print_json(result)
    else:
        _tell_check(found, first, compared)
    is_whole = tell_out(folder, as_json)
    raise typer.Exit(0 if is_whole and (result["same"] or not is_check) else 1)


def _tell_fault(path: Path, node_check: NodeCheck, excerpt: Excerpt) -> None:
    """Log an exception of a node and the command that repeats the step; for a requested step, log its traceback too."""
    from navloom_recording.excerpt import repeating

    fault = node_check.first_fault if excerpt.until is None else node_check.last_fault
    if fault is None:
        return
    role, name = node_check.node.split(" ", 1)
    more = f", and in {node_check.faults - 1} more steps" if node_check.faults > 1 else ""
    same = "as recorded" if fault.is_recorded else "which is not what was recorded"
    text = f"{node_check.node} failed in tick {fault.tick}{more}, {same}: {fault.text}"
    if fault.tick != excerpt.until or excerpt.only is None:
        text += f"\nrepeat that step: {repeating(path, role, name, fault.tick, is_only=False)}"
    LOG.warning(text, extra=with_traceback_of(fault.text))


def _tell_check(found: Sequence[Any], first: Any, compared: int) -> None:
    """Print the result of a check for people."""
    from navloom.cli.output import print_table

    print_table(
        ("node", "steps", "messages", "differ", "not fed in full"),
        [(one.node, one.steps, one.messages, one.differing, one.not_fed) for one in found],
    )
    for one in found:
        for caveat in one.caveats():
            typer.echo(f"{one.node}: {caveat}")
    if first is not None:
        typer.echo(f"first difference: {first}")
    elif compared:
        typer.echo(f"all {compared} messages that could be compared are those recorded, bit for bit")
    else:
        typer.echo("nothing could be compared: the recording holds no step records")


def _substitute(
    recording: Any,
    loaded: Any,
    stand_ins: Sequence[tuple[str, str]],
    changes: Sequence[str],
    out: Path | None,
    as_json: bool,
) -> None:
    from navloom.cli.output import json_bytes, print_json, stage
    from navloom.cli.written_files import tell_out
    from navloom.messages import MapUpdate
    from navloom.runs.result_folder import MAP, OutFolder
    from navloom.runs.shadow_comparison import shadow_table

    from navloom_recording.cli.substitute_output import can_draw, tell_substitute
    from navloom_recording.missing_plugins import refuse_missing
    from navloom_recording.substitutes import substitute, substitute_config

    roles = [role for role, _ in stand_ins]
    for role in dict.fromkeys(roles):
        refuse_missing(recording, loaded.config, role)
    results = []
    pictures: dict[str, bytes] = {}
    names = [role if roles.count(role) == 1 else f"{role}-{name}" for role, name in stand_ins]
    with OutFolder(out, ("result.json", "ticks.csv", *(f"{name}.png" for name in names), *MAP)) as folder:
        draws = out is not None and can_draw()
        with stage(as_json) as (say, progress):
            for (role, name), picture in zip(stand_ins, names, strict=True):
                changed = substitute_config(loaded, role, name, changes)
                found, recorded = substitute(recording, changed, role, say, progress), loaded.config.role_table(role)
                results.append((found, recorded.instance))
                if draws:
                    pictures[f"{picture}.png"] = part("navloom_study.report.substitute_figure").draw_substitute(
                        found, recorded.instance
                    )
        table = shadow_table([found.found for found, _ in results])
        summaries = [found.summary() for found, _ in results]
        folder.write({"result.json": json_bytes(summaries), "ticks.csv": table, **pictures})
        maps = [found.last.grid for found, _ in results if isinstance(found.last, MapUpdate)]
        if len(maps) == 1:
            folder.write_map(maps[0])
    if as_json:
        print_json(summaries)
    else:
        for found, instance in results:
            tell_substitute(found, instance)
    raise typer.Exit(0 if tell_out(folder, as_json) else 1)


def _publish(recording: Any, speed: float) -> None:
    from navloom.cli.interrupts import ending

    with ending() as event:
        counted = part("navloom_live.operating.republishing", "--live").republish(
            recording, speed, event, log_of("recording").info
        )
    typer.echo(f"published {counted} messages")
