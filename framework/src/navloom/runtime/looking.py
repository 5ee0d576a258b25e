"""What can be seen of a live robot from outside: who is there, what flows, and what is wrong."""

from __future__ import annotations

import difflib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navloom.messages import Envelope, Message
from navloom.messages.codec import CodecError
from navloom.runtime.client import Client
from navloom.runtime.mailbox import Inlet, Mailbox, Packet

__all__ = [
    "NoStream",
    "StreamMeter",
    "envelope_fields",
    "last_words",
    "listing",
    "message_fields",
    "offsets",
    "resolve",
    "streams",
    "tap",
]


class NoStream(ValueError):
    """A key that no stream of the robot has; the text names the nearest."""


def listing(client: Client) -> list[dict[str, Any]]:
    """Every node: what it says of itself, and those whose token is there but that do not answer."""
    nodes = client.describe()
    answered = {(node["role"], node["instance"]) for node in nodes}
    for key in client.bus.alive(client.keys.alive("*", "*", "*")):
        role, name, _ = client.keys.split(key)
        if (role, name) not in answered:
            answered.add((role, name))
            nodes.append({"role": role, "instance": name, "answers": False})
    for node in nodes:
        node.setdefault("answers", True)
    return sorted(nodes, key=lambda node: (node["role"], node["instance"]))


def streams(nodes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Every stream of the robot as role/instance/port."""
    found = [f"{n['role']}/{n['instance']}/{port}" for n in nodes if n["answers"] for port in n["published"]]
    return sorted(found)


def resolve(key: str, nodes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Streams meant by role/instance/port or role/port, either with `*`.

    Raises:
        NoStream: None of that name.
    """
    known = streams(nodes)
    parts = key.strip("/").split("/")
    wanted = [parts[0], "*", parts[1]] if len(parts) == 2 else parts
    if len(wanted) == 3:
        fitting = [s for s in known if all(w in ("*", p) for w, p in zip(wanted, s.split("/"), strict=True))]
        if fitting:
            return fitting
    short = sorted({f"{role}/{port}" for role, _, port in (stream.split("/") for stream in known)})
    near = difflib.get_close_matches(key, [*known, *short], n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"as in {', '.join(short[:4])}"
    raise NoStream(f"no stream {key!r}: expected role/port or role/instance/port; {hint}")


@dataclass
class StreamMeter:
    """What a stream does: rate, jitter, ages, bytes, gaps."""

    arrivals: list[float] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    size: int = 0
    lost: int = 0
    malformed: int = 0
    last: int = 0

    def note(self, packet: Packet, platform_ns: int) -> None:
        """Take one message; `platform_ns` is what the platform's clock shows, -1 where it is not known."""
        self.size += len(packet.data)
        try:
            _, envelope = packet.open()
        except CodecError:
            self.malformed += 1
            return
        self.arrivals.append(packet.arrived_ns * 1e-9)
        if self.last and envelope.sequence > self.last + 1:
            self.lost += envelope.sequence - self.last - 1
        self.last = envelope.sequence
        if platform_ns >= 0:
            self.ages.append((platform_ns - envelope.cause_ns) * 1e-9)

    def summary(self, seconds: float) -> dict[str, Any]:
        """Figures over s of listening; SI units."""
        gaps = np.diff(np.array(self.arrivals))
        ages = ages_of(self.ages)
        return {
            "messages": len(self.arrivals),
            "rate_hz": float(1.0 / gaps.mean()) if gaps.size else len(self.arrivals) / seconds,
            "jitter_std_s": float(gaps.std()) if gaps.size else None,
            "interval_max_s": float(gaps.max()) if gaps.size else None,
            "age_p50_s": ages[0],
            "age_p99_s": ages[1],
            "bytes_per_s": self.size / seconds,
            "lost": self.lost,
            "malformed": self.malformed,
        }


def ages_of(ages: Sequence[float]) -> tuple[float | None, float | None]:
    """Median and 99th percentile, s."""
    if not ages:
        return None, None
    return float(np.percentile(ages, 50)), float(np.percentile(ages, 99))


def tap(client: Client, keys: Sequence[str], mailbox: Mailbox) -> dict[str, Inlet]:
    """Listen to streams, given as role/instance/port."""
    taps: dict[str, Inlet] = {}
    for stream in keys:
        inlet = taps[stream] = Inlet(stream, mailbox, 4096)

        def receive(key: str, data: bytes | None, label: str, inlet: Inlet = inlet) -> None:
            if data is not None:
                inlet.give(Packet(data, label))

        client.bus.subscribe(f"{client.keys.prefix}/{stream}", receive)
    return taps


def message_fields(message: Message, whole: bool = False) -> dict[str, Any]:
    """A message as plain values; arrays as what they are like, or whole."""
    return {name: _plain(getattr(message, name), whole) for name in type(message).kinds}


def envelope_fields(envelope: Envelope) -> dict[str, Any]:
    """An envelope as plain values."""
    return envelope._asdict()


def _plain(value: Any, whole: bool) -> Any:
    if isinstance(value, Message):
        return message_fields(value, whole)
    if isinstance(value, tuple):
        return [_plain(entry, whole) for entry in value]
    if isinstance(value, np.ndarray):
        if whole:
            return value.tolist()
        found: dict[str, Any] = {"dtype": value.dtype.name, "shape": list(value.shape)}
        finite = value[np.isfinite(value)] if value.size else value
        if finite.size:
            found |= {"min": finite.min().item(), "mean": float(finite.mean()), "max": finite.max().item()}
        if value.size:
            found["first"] = value.ravel()[:4].tolist()
        return found
    return value


def offsets(client: Client, rounds: int = 5) -> dict[str, float]:
    """Offset of each host's wall clock to this one's, s, by the shortest of some round trips."""
    best: dict[str, tuple[float, float]] = {}
    for _ in range(rounds):
        before = time.time_ns()
        for node in client.describe():
            after = time.time_ns()
            trip = (after - before) * 1e-9
            offset = (node["wall_ns"] - (before + after) / 2) * 1e-9
            if node["host"] not in best or trip < best[node["host"]][0]:
                best[node["host"]] = (trip, offset)
    return {host: offset for host, (_, offset) in best.items()}


def last_words(client: Client) -> dict[str, Message | None]:
    """The last of what the goal and the gate said."""
    wanted = (("goal", "feedback"), ("goal", "result"), ("gate", "status"), ("gate", "selection"))
    return {f"{role}/{port}": client.last(role, "main", port) for role, port in wanted}
