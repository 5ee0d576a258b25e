"""`navloom echo`: the messages of a stream as they come."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any

import typer
from navloom.cli.options import AsJson, PluginFiles, RobotOptions
from navloom.cli.output import LOG
from navloom.inputs import printable

__all__ = ["echo"]

ENTRIES = 6
"""Largest number of list entries in the text output."""
SILENCE_LOGGED_AFTER = 2.0
"""Longest silence before it is logged, s."""


def echo(
    key: Annotated[str, typer.Argument(metavar="KEY", help="role/port or role/instance/port, with * for any.")],
    fields: Annotated[str | None, typer.Option(metavar="A.B,C", help="Only these fields.")] = None,
    count: Annotated[int | None, typer.Option(metavar="N", min=1, help="End after N messages.")] = None,
    whole: Annotated[bool, typer.Option("--whole", help="Arrays whole instead of summarised.")] = False,
    plugin: PluginFiles = None,
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Print the messages of a stream as they arrive, until Ctrl-C.

    The last map, path and the like is printed at once.
    """
    from navloom.cli.output import json_line

    from navloom_live.operating.introspection import envelope_fields, message_fields

    with robot.look() as client:
        left = count
        try:
            for stream, message, envelope in _messages(client, key):
                values = chosen(message_fields(message, whole), fields)
                head = envelope_fields(envelope)
                if as_json:
                    typer.echo(json_line({"stream": stream, "envelope": head, "message": values}))
                else:
                    typer.echo(_text(stream, head, values))
                left = None if left is None else left - 1
                if left == 0:
                    return
        except KeyboardInterrupt:
            return


def _messages(client: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    """Stream, message and envelope: retained messages first, then new ones. Logs what cannot be decoded."""
    from navloom.messages.generic import GenericMessage

    from navloom_live.live.mailbox import Mailbox
    from navloom_live.operating.client import ClientError
    from navloom_live.operating.introspection import resolve, retained, tap
    from navloom_live.operating.robot_nodes import listing

    mailbox = Mailbox()
    taps = tap(client, resolve(key, listing(client)), mailbox)
    kept = {stream: retained(client, stream) for stream in taps}
    seen = 0
    told: set[str] = set()
    malformed = dict.fromkeys(taps, 0)
    silent_from: float | None = time.monotonic()
    while True:
        for stream, inlet in taps.items():
            come = list(inlet.take())
            last = kept.pop(stream, None)
            if last is not None and (not come or last[1].sequence < come[0][1].sequence):
                come.insert(0, last)
            for message, envelope in come:
                silent_from = None
                why = message.why if isinstance(message, GenericMessage) else ""
                if why and why not in told:
                    told.add(why)
                    LOG.warning(f"{why}; shown from its header alone")
                yield stream, message, envelope
            if inlet.counts.malformed > malformed[stream]:
                malformed[stream] = inlet.counts.malformed
                LOG.warning(f"{stream}: malformed message: {inlet.counts.complaint}")
        if silent_from is not None and time.monotonic() - silent_from > SILENCE_LOGGED_AFTER:
            silent_from = None
            LOG.info(f"nothing has come on {', '.join(taps)} so far")
        if not client.bus.neighbours():
            raise ClientError(f"robot {client.keys.prefix} has gone")
        seen = mailbox.wait(seen, 0.2)


def chosen(values: Mapping[str, Any], fields: str | None) -> dict[str, Any]:
    """Only the named fields, by dotted path; list entries by number."""
    if fields is None:
        return dict(values)
    found = {}
    for path in (part.strip() for part in fields.split(",")):
        value: Any = values
        for name in path.split("."):
            value = _entry(value, name, path)
        found[path] = value
    return found


def _entry(value: Any, name: str, path: str) -> Any:
    if isinstance(value, Mapping):
        if name in value:
            return value[name]
        known = f"there are {', '.join(value)}"
    elif isinstance(value, Sequence) and not isinstance(value, str):
        if name.isdecimal() and int(name) < len(value):
            return value[int(name)]
        known = f"it is a list of {len(value)} entries, from 0"
    else:
        known = "it has no parts"
    raise typer.BadParameter(f"--fields {path}: there is no {name!r}; {known}")


def _text(stream: str, head: Mapping[str, Any], values: Mapping[str, Any]) -> str:
    stamp, cause = head["stamp_ns"] * 1e-9, head["cause_ns"] * 1e-9
    lines = [
        f"{stream}  number {head['sequence']}  tick {head['tick']}  stamp {stamp:.3f} s  "
        f"from {cause:.3f} s  selection {head['epoch']}"
    ]
    width = max((len(name) for name in values), default=0)
    return "\n".join([*lines, *(f"  {name:<{width}}  {_value(value)}" for name, value in values.items())])


def _value(value: Any) -> str:
    """A value as text on one line."""
    if isinstance(value, Mapping):
        if "dtype" in value and "shape" in value:
            return _array(value)
        return "(" + ", ".join(f"{name} {_value(part)}" for name, part in value.items()) + ")"
    if isinstance(value, list):
        more = f", … {len(value)} in all" if len(value) > ENTRIES else ""
        return "[" + ", ".join(_value(part) for part in value[:ENTRIES]) + more + "]"
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    return f"{value:.5g}" if isinstance(value, float) else printable(str(value))


def _array(summary: Mapping[str, Any]) -> str:
    text = f"{summary['dtype']}[{', '.join(map(str, summary['shape']))}]"
    for name in ("min", "mean", "max", "infinite"):
        if name in summary:
            text += f"  {name} {_value(summary[name])}"
    return f"{text}  {_value(summary['first'])}" if summary["first"] else text
