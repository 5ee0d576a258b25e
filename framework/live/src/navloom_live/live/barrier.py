"""Keeps ticks in step over the network: readers wait for step reports and admit messages by high-water marks.

Every node reports every tick with a high-water mark for each port. A message belongs to the first tick whose report
covers its sequence number, so the order of delivery does not matter. Alternatives are not waited for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from navloom.errors import NavloomError
from navloom.messages import Envelope, Message, StepReport

from navloom_live.live.live_node import Source
from navloom_live.live.mailbox import Inlet, Mailbox

__all__ = ["Barrier", "BarrierEnded", "InstanceProgress"]

BARRIER_END_CHECK_INTERVAL = 0.2
"""Interval of checking for the end of the run while waiting, s."""


class BarrierEnded(NavloomError):
    """The process is ending, so waiting stops."""


@dataclass
class InstanceProgress:
    """Progress of an instance: the last tick it reported, its ports' marks then, what it waits for, its first fault."""

    done: int = -1
    marks: dict[str, int] = field(default_factory=dict)
    enabled: bool = False
    duration_ns: int = 0
    waiting: str = ""
    fault: tuple[int, str] | None = None


@dataclass(eq=False)
class _Stream:
    """Messages of one port that have arrived, and the marks of ticks that have not been read yet."""

    inlet: Inlet
    taken: int = 0
    opened: deque[tuple[Message, Envelope]] = field(default_factory=deque)
    marks: deque[tuple[int, int]] = field(default_factory=deque)


class Barrier:
    """Reports and streams of several instances, read tick by tick by one thread.

    Args:
        mailbox: Woken by all of them.
        reports: Inlet of the step reports, by source.
        streams: Inlets of the ports that are read, each with its source and port.
        check: Called while waiting; raises BarrierEnded or another exception to end the wait.
    """

    def __init__(
        self,
        mailbox: Mailbox,
        reports: Mapping[Source, Inlet],
        streams: Mapping[Inlet, tuple[Source, str]],
        check: Callable[[], None],
    ) -> None:
        self.progress = {source: InstanceProgress() for source in reports}
        self._mailbox, self._reports, self._check = mailbox, dict(reports), check
        self._streams = {inlet: _Stream(inlet) for inlet in streams}
        self._ports: dict[Source, list[tuple[str, _Stream]]] = {}
        for inlet, (source, port) in streams.items():
            self._ports.setdefault(source, []).append((port, self._streams[inlet]))
        self._seen = 0

    def await_report(self, source: Source, tick: int) -> InstanceProgress:
        """Wait for an instance's report of a tick."""
        progress = self.progress[source]
        while progress.done < tick:
            self._hear(source)
            if progress.done < tick:
                self._wait()
        return progress

    def missing(self, sources: Sequence[Source], tick: int) -> list[Source]:
        """Sources that have not reported a tick."""
        return [source for source in sources if self.progress[source].done < tick]

    def read(self, inlet: Inlet, upto: int, waits: bool = True) -> Iterator[tuple[Message, Envelope, int]]:
        """Messages of ticks up to `upto`, each with its tick. If `waits`, it waits for those that have not arrived."""
        stream = self._streams[inlet]
        while stream.marks and stream.marks[0][0] <= upto:
            tick, mark = stream.marks[0]
            while stream.taken < mark:
                while not stream.opened:
                    stream.opened.extend(inlet.take())
                    if not stream.opened:
                        # Of an alternative, only what is there: nobody waits for it.
                        if not waits:
                            return
                        self._wait()
                message, envelope = stream.opened.popleft()
                stream.taken = envelope.sequence
                yield message, envelope, tick
            stream.marks.popleft()

    def hear_all(self) -> None:
        """Process every report that has arrived."""
        for source in self.progress:
            self._hear(source)

    def _hear(self, source: Source) -> None:
        progress = self.progress[source]
        for message, envelope in self._reports[source].take():
            assert isinstance(message, StepReport)
            progress.done, progress.enabled = envelope.tick, message.enabled
            progress.duration_ns = message.duration_ns if message.trigger else 0
            # A report without a trigger is one of a node that did not step.
            progress.waiting = "" if message.trigger else message.told
            progress.marks = {mark.port: mark.sequence for mark in message.published}
            # The first one counts, as in lockstep, where a failed node does not step again.
            if message.fault and progress.fault is None:
                progress.fault = (envelope.tick, message.fault)
            for port, stream in self._ports.get(source, ()):
                # The mark, not the order of arrival, decides to which tick a message belongs.
                stream.marks.append((envelope.tick, progress.marks[port]))

    def _wait(self) -> None:
        self._seen = self._mailbox.wait(self._seen, BARRIER_END_CHECK_INTERVAL)
        self._check()
