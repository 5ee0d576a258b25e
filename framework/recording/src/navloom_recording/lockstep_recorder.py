"""Records a run in lockstep, as an observer of every message and step."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from navloom.config import Loaded
from navloom.engine.streams import STEP
from navloom.messages import Envelope, InputRead, Message, PortMark, StepRecord, StepReport
from navloom.messages.codec import encode, schema_label
from navloom.runs.provenance import distributions

from navloom_recording.recorder_counts import RecorderCounts
from navloom_recording.recording_header import header_of
from navloom_recording.world_attachments import world_files
from navloom_recording.writer import RecordingWriter, WriteError

__all__ = ["LockstepRecorder", "recorded"]

CLOSE_EVERY = 0.4
"""Interval of closing chunks, s of wall clock."""


class LockstepRecorder:
    """Observer that writes a recording. Use it in a `with` statement. A full disk is reported once; the run continues.

    Args:
        writer: Writer of the recording.
        say: Receives a message if writing fails.

    Attributes:
        failure: Why it stopped writing; empty while it writes.
    """

    wants: frozenset[tuple[str, str]] | None = None
    wants_steps: bool = True

    def __init__(self, writer: RecordingWriter, say: Callable[[str], None]) -> None:
        self.writer, self.failure = writer, ""
        self.counts = RecorderCounts()
        self._say = say
        self._marks: defaultdict[tuple[str, str], dict[str, int]] = defaultdict(dict)
        self._steps: defaultdict[tuple[str, str], int] = defaultdict(int)
        self._pending: StepRecord | None = None
        self._now_ns = 0
        self._closed_at = time.monotonic()

    def __enter__(self) -> LockstepRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._report()
        if not self.failure:
            try:
                self.writer.close(self.counts.summary())
            except WriteError as failure:
                self._fail(failure)

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Record a message, also of a shadow."""
        self._marks[role, instance][port] = at.sequence
        self._write(message, at)

    def on_step(self, record: StepRecord) -> None:
        """Record a step, after the messages that it published, so that their sequence numbers are known."""
        self._report()
        self._pending = record
        self._now_ns = max(self._now_ns, record.stamp_ns)
        # Wall clock: what a kill loses is counted in time, and lockstep runs faster than its own clock.
        if time.monotonic() - self._closed_at > CLOSE_EVERY and not self.failure:
            self._closed_at = time.monotonic()
            try:
                self.writer.flush()
            except WriteError as error:
                self._fail(error)

    def _report(self) -> None:
        record, self._pending = self._pending, None
        if record is None:
            return
        source = (record.role, record.instance)
        self._steps[source] += 1
        marks = tuple(PortMark(port, mark) for port, mark in self._marks[source].items())
        read = tuple(InputRead(name, sequences) for name, sequences in record.consumed)
        report = StepReport(
            record.trigger, read, marks, not record.fault, record.params_version, record.resets, record.duration_ns,
            record.fault, record.told,
        )  # fmt: skip
        key = f"{self.writer.header.prefix}/{record.role}/{record.instance}/{STEP}"
        number = self._steps[source]
        self._write(report, Envelope(key, number, record.tick, record.stamp_ns, record.stamp_ns, record.epoch))

    def _write(self, message: Message, at: Envelope) -> None:
        if self.failure:
            return
        # Receive times must not fall, and a node with latency publishes older stamps.
        self._now_ns = max(self._now_ns, at.stamp_ns)
        data = encode(message, at)
        try:
            self.writer.add(at.key, schema_label(type(message)), data, self._now_ns, at.stamp_ns, at.sequence)
        except WriteError as error:
            self._fail(error)
            return
        self.counts.note(at.key, at.sequence)

    def _fail(self, error: WriteError) -> None:
        self.failure = str(error)
        self._say(self.failure)


@contextmanager
def recorded(loaded: Loaded, path: Path, say: Callable[[str], None]) -> Iterator[LockstepRecorder]:
    """Yield the observer that writes a recording of a run. A full disk ends the recording, not the run.

    Args:
        loaded: The run's config.
        path: The recording's file.
        say: Receives why the recording ended early.
    """
    writer = RecordingWriter(path, header_of(loaded, "lockstep", distributions(loaded.config)), world_files(loaded))
    try:
        with LockstepRecorder(writer, say) as recorder:
            yield recorder
    except BaseException:
        if not writer.messages:  # the run was refused: the file is empty
            writer.discard()
        raise
