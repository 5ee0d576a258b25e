"""What a node of a live robot says about itself: `describe` answers with it, and every tool reads it.

On the wire it is a JSON object, see `Description.to_json`. Fields may be added: an older tool ignores those that it
does not know, and a newer tool takes the default of those that an older robot does not send.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from navloom.errors import NavloomError
from navloom.inputs.typed_json import from_builtins

__all__ = ["Description", "DescriptionError", "ProcessConfig", "StreamSummary", "clocks", "read_description"]

IF_KNOWN = frozenset({"up_s", "notes", "waits_for", "is_patient", "ticks", "late_ticks", "stops", "driven_ticks",
                      "own_ticks", "chain_p50_s", "chain_p99_s", "clock_ns", "wall_ns"})  # fmt: skip
"""Fields that are left out of the JSON object, instead of null, if they are None."""


class DescriptionError(NavloomError, ValueError):
    """A node answers with something that this version cannot read; the text names the node, the entry, the versions."""


@dataclass(frozen=True, kw_only=True)
class StreamSummary:
    """Counts of a stream at a node that reads it, see `mailbox.StreamCounts`.

    Attributes:
        received, dropped, malformed, misrouted, late: Numbers of messages since the start.
        latest: Whether only the newest message counts, so that dropped ones are no loss.
        complaint: What was wrong with the last malformed message.
        origin: Stream of the last misrouted message.
        age_p50_s, age_p99_s: Median and 99th percentile of the ages, s, since the platform's stamp.
    """

    received: int
    dropped: int
    malformed: int
    misrouted: int = 0
    late: int
    complaint: str | None = None
    origin: str | None = None
    age_p50_s: float | None = None
    age_p99_s: float | None = None
    latest: bool

    def to_json(self) -> dict[str, Any]:
        """The JSON object, without what is not known."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class Description:
    """A node of a live robot. None: not known, or not so for this node.

    Attributes:
        plugin: Its plugin; None for a node of navloom itself.
        process, pid, host: Where it runs.
        active, enabled: Whether it is its role's active instance, and whether it steps at all.
        tick, epoch: Tick of its last step, -1 before the first; epoch of the selection that it knows.
        busy_s: Duration of the current step so far, s; None between steps.
        silence_s: Time since the last platform message, s.
        period_s, step_s: Its period, and the median duration of its newest steps, s.
        versions: Versions that must agree between the hosts of a robot, by distribution.
        published, carries: Number of messages, and schema label, by port that it publishes.
        streams: Counts of each stream that it reads, by role/instance/port.
        places: Process of each node of the robot, by "role instance", in the order of the graph.
        hosts: Host of each process that the config assigns to one.
        faulted, fault: Steps in a row in which its plugin failed, and how the last one did.
        config_sha256: Hash of the config that its process runs.
        shares_memory, shared_memory_mb: Whether large messages pass through shared memory, and how much is free, MiB.
        role, instance: Its names.
        up_s: Time since its process offered its services, s.
        notes: What is unusual about its plugin.
        waits_for: Streams without which it does not step, and of which no message has come so far.
        is_patient: Whether its step may take long, because no motor waits for it.
        ticks, late_ticks, stops, driven_ticks, own_ticks: Of a platform: ticks; those that came late; stops for a stale
            command; ticks in which the wheels turned, and those of them that were driven by their own command.
        chain_p50_s, chain_p99_s: Of a gate: from a tick of the platform to its command, median, 99th percentile, s.
        clock_ns, wall_ns: Run clock, -1 if it is not known, and wall clock of its host, ns.
    """

    plugin: str | None
    process: str
    pid: int
    host: str
    active: bool
    enabled: bool
    tick: int
    epoch: int
    busy_s: float | None = None
    silence_s: float | None = None
    period_s: float | None = None
    step_s: float | None = None
    versions: Mapping[str, str]
    published: Mapping[str, int]
    carries: Mapping[str, str] = field(default_factory=dict)
    streams: Mapping[str, StreamSummary] = field(default_factory=dict)
    places: Mapping[str, str] = field(default_factory=dict)
    hosts: Mapping[str, str] = field(default_factory=dict)
    clock_ns: int | None = None
    faulted: int = 0
    fault: str = ""
    config_sha256: str = ""
    shares_memory: bool = False
    shared_memory_mb: float | None = None
    role: str
    instance: str
    up_s: float | None = None
    notes: tuple[str, ...] | None = None
    waits_for: tuple[str, ...] | None = None
    is_patient: bool | None = None
    ticks: int | None = None
    late_ticks: int | None = None
    stops: int | None = None
    driven_ticks: int | None = None
    own_ticks: int | None = None
    chain_p50_s: float | None = None
    chain_p99_s: float | None = None
    wall_ns: int | None = None

    @property
    def name(self) -> str:
        """Role and instance."""
        return f"{self.role} {self.instance}"

    def to_json(self) -> dict[str, Any]:
        """The JSON object."""
        every = ((field.name, getattr(self, field.name)) for field in fields(self))
        told = {name: value for name, value in every if value is not None or name not in IF_KNOWN}
        return told | {"streams": {stream: counts.to_json() for stream, counts in self.streams.items()}}


@dataclass(frozen=True, kw_only=True)
class ProcessConfig:
    """What a process runs, for recordings: the answer of its service `config`.

    Attributes:
        loaded: The config, from `Loaded.to_json`; None if it is not known.
        barrier: Whether the robot runs under the barrier.
        distributions: Versions of Python, navloom, numpy and the distributions of the plugins in use.
    """

    loaded: dict[str, Any] | None
    barrier: bool
    distributions: Mapping[str, str]

    def to_bytes(self) -> bytes:
        """The JSON object."""
        return json.dumps(vars(self)).encode()


def clocks(clock_ns: int, wall_ns: int) -> dict[str, int]:
    """The entries of a description's JSON object that are new in every answer, also where the rest is reused."""
    return {"clock_ns": clock_ns, "wall_ns": wall_ns}


def read_description(role: str, instance: str, data: bytes) -> Description:
    """Read the answer of a node.

    Args:
        role, instance: The node, from the key of the answer: a shadow's plugin may answer anything, but only under its
            own key.
        data: The answer.

    Raises:
        DescriptionError: It is no description, or of a version that this one cannot read.
    """
    given: Any = None
    try:
        given = json.loads(data)
        if not isinstance(given, dict):
            raise ValueError(f"expected object, got {type(given).__name__}")
        found = from_builtins(Description, {**given, "role": role, "instance": instance})
        for node in found.places:
            if " " not in node:
                raise ValueError(f"places: expected ROLE INSTANCE, got {node!r}")
        return found
    except (ValueError, RecursionError) as error:
        raise DescriptionError(
            f"{role} {instance}: its description cannot be read ({error}): {_versions(given)}; "
            "install the same version on both"
        ) from None


def _versions(given: Any) -> str:
    """Version of the robot, if it says one, and of this tool."""
    from importlib.metadata import version

    versions = given.get("versions") if isinstance(given, dict) else None
    theirs = versions.get("navloom") if isinstance(versions, dict) else None
    said = f"it runs navloom {theirs}" if isinstance(theirs, str) else "it names no version of navloom"
    return f"{said}, this is navloom {version('navloom')}"
