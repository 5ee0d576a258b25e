"""Observes a live robot from outside: its streams and its status."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Sequence
from typing import Any

import numpy as np
from navloom.engine.streams import FRAMEWORK_PORTS
from navloom.errors import NavloomError
from navloom.messages import Envelope, Message, Parameters
from navloom.messages.codec import CodecError, decode
from navloom.messages.generic import GenericMessage
from navloom.messages.schema import older_names
from navloom.plugins.message_opening import OPENER

from navloom_live.live.mailbox import Inlet, Mailbox, Packet
from navloom_live.operating.client import Client
from navloom_live.operating.robot_nodes import Node, answering, missing
from navloom_live.transport.quality_of_service import is_retained, kind_of, most_of

__all__ = [
    "NoStream",
    "changed_parameters",
    "envelope_fields",
    "last",
    "last_words",
    "message_fields",
    "resolve",
    "retained",
    "streams",
    "tap",
]

FIRST = 4
"""Number of entries in the summary of an array."""


class NoStream(NavloomError, ValueError):
    """The robot has no stream of this key; the text names the nearest one."""


# --- its status -----------------------------------------------------------------------------------------------------


def last(client: Client, role: str, instance: str, port: str, timeout: float = 1.0) -> Message | None:
    """The last message of a stream whose publisher retains it; None if there is none."""
    for answer in client.ask_again(client.keys.port(role, instance, port), timeout):
        if not answer.refusal:
            with contextlib.suppress(CodecError):
                return decode(answer.data, answer.label)[0]
    return None


def last_words(client: Client) -> dict[str, Message | None]:
    """The last messages of the goal and the gate."""
    wanted = (("goal", "feedback"), ("goal", "result"), ("gate", "status"), ("gate", "selection"))
    return {f"{role}/{port}": last(client, role, "main", port) for role, port in wanted}


def changed_parameters(client: Client) -> dict[str, list[str]]:
    """TOML assignments of the parameters changed since the start, by "role instance"."""
    found = {}
    for answer in client.bus.ask(client.keys.port("*", "*", "parameters"), timeout=1.0):
        with contextlib.suppress(CodecError):
            message = decode(answer.data, answer.label)[0] if not answer.refusal else None
            if isinstance(message, Parameters) and message.values:
                role, name, _ = client.keys.split(answer.key)
                found[f"{role} {name}"] = list(message.values)
    return dict(sorted(found.items()))


# --- streams --------------------------------------------------------------------------------------------------------


def streams(nodes: Sequence[Node]) -> list[str]:
    """Every stream of the robot as role/instance/port."""
    return sorted(f"{node.role}/{node.instance}/{port}" for node in answering(nodes) for port in node.published)


def resolve(key: str, nodes: Sequence[Node]) -> list[str]:
    """Streams meant by role/instance/port, role/port or role, each with `*` for any.

    Raises:
        NoStream: None of that name.
    """
    known = streams(nodes)
    parts = key.strip("/").split("/")
    wanted = {1: [*parts, "*", "*"], 2: [parts[0], "*", parts[-1]]}.get(len(parts), parts)
    if len(wanted) == 3:
        fitting = [s for s in known if all(w in ("*", p) for w, p in zip(wanted, s.split("/"), strict=True))]
        if fitting:
            return fitting
    if not known:
        raise NoStream(f"no stream {key!r}: no node of the robot answers; `navloom doctor` says why")
    if lacking := _lacking(wanted, nodes):
        raise NoStream(f"no stream {key!r}: {', '.join(lacking)}; `navloom doctor` says why")
    raise NoStream(f"no stream {key!r}: expected role/port or role/instance/port; {_nearest(key, known)}")


def _lacking(wanted: Sequence[str], nodes: Sequence[Node]) -> list[str]:
    """Nodes of the wanted role and instance that are missing or do not answer."""
    found = [(gone.role, gone.instance, "is missing") for gone in missing(nodes)]
    found += [(node.role, node.instance, "does not answer") for node in nodes if node.description is None]
    return [f"{role} {name} {how}" for role, name, how in found if role == wanted[0] and wanted[1] in ("*", name)]


def _nearest(key: str, known: Sequence[str]) -> str:
    """Suggestion for a wrong key: the nearest stream, the streams of the role, or the roles."""
    short = list(dict.fromkeys(f"{role}/{port}" for role, _, port in (stream.split("/") for stream in known)))
    near = difflib.get_close_matches(key, [*known, *short], n=1, cutoff=0.8)  # the role's name makes up much of a key
    if near:
        return f"did you mean {near[0]!r}?"
    role = key.strip("/").split("/")[0]
    ports = [stream for stream in short if stream.startswith(f"{role}/")]
    return f"there are {', '.join(ports or dict.fromkeys(stream.split('/')[0] for stream in short))}"


def tap(client: Client, keys: Sequence[str], mailbox: Mailbox, limit: int = 4096) -> dict[str, Inlet]:
    """Subscribe to streams, each given as role/instance/port; `limit` messages of each may wait."""
    taps: dict[str, Inlet] = {}
    for stream in keys:
        inlet = taps[stream] = Inlet(stream, mailbox, limit)

        def receive(key: str, data: bytes | None, label: str, inlet: Inlet = inlet) -> None:
            if data is None:
                inlet.refuse("it is too large to be copied")
            else:
                inlet.give(Packet(data, label, opens=OPENER.open))

        role, _, port = stream.split("/", 2)
        client.bus.subscribe(f"{client.keys.prefix}/{stream}", receive, most_of(kind_of(role, port)))
    return taps


def retained(client: Client, stream: str) -> tuple[Message, Envelope] | None:
    """The last message of a stream whose publisher retains it, so that a viewer need not wait for the next one."""
    role, name, port = stream.split("/", 2)
    if is_retained(role, port) or not FRAMEWORK_PORTS.ports(role):
        for answer in client.bus.ask(client.keys.port(role, name, port), timeout=1.0):
            with contextlib.suppress(CodecError):
                if not answer.refusal:
                    return OPENER.open(answer.data, answer.label)
    return None


def message_fields(message: Message, whole: bool = False) -> dict[str, Any]:
    """A message as plain values, also under the names of older versions; arrays as summaries, or whole."""
    if isinstance(message, GenericMessage):
        arrays = {f"array {number}": _plain(array, whole) for number, array in enumerate(message.arrays)}
        return {**{name: _plain(value, whole) for name, value in message.fields.items()}, **arrays}
    names = [*older_names(message), *type(message).kinds]
    return {name: _plain(getattr(message, name), whole) for name in dict.fromkeys(names)}


def envelope_fields(envelope: Envelope) -> dict[str, Any]:
    """An envelope as plain values."""
    return envelope._asdict()


def _plain(value: Any, whole: bool) -> Any:
    if isinstance(value, Message):
        return message_fields(value, whole)
    if isinstance(value, dict):  # in a generic message
        return {name: _plain(entry, whole) for name, entry in value.items()}
    if isinstance(value, tuple):
        return [_plain(entry, whole) for entry in value]
    if isinstance(value, np.ndarray):
        return value.tolist() if whole else _summary(value)
    return value


def _summary(array: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Summary of an array; min, mean and max are over its finite entries, `infinite` counts the others."""
    finite = array[np.isfinite(array)]
    found: dict[str, Any] = {"dtype": array.dtype.name, "shape": list(array.shape)}
    if finite.size:
        found |= {"min": finite.min().item(), "mean": float(finite.mean()), "max": finite.max().item()}
    if finite.size < array.size:
        found["infinite"] = int(array.size - finite.size)
    return found | {"first": array.ravel()[:FIRST].tolist()}
