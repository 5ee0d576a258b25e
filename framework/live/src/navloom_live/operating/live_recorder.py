"""Records a live robot from outside, with a bounded queue between the network and the writer thread."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import NamedTuple

from navloom.config import Loaded
from navloom.engine.catalogue import catalogue_of
from navloom.inputs.typed_json import from_json
from navloom.messages.codec import CodecError, read_envelope
from navloom.plugins.message_opening import OPENER
from navloom_recording.recorder_counts import RecorderCounts
from navloom_recording.recording_header import RecordingHeader, header_of
from navloom_recording.writer import RecordingWriter, WriteError

from navloom_live.hosting.network import streams_of
from navloom_live.live.description import ProcessConfig
from navloom_live.operating.client import Client, ClientError
from navloom_live.transport.keyspace import ATTENDANT, FAULT, GAINED, LINKED
from navloom_live.transport.quality_of_service import retained_ports

__all__ = ["LiveRecorder", "ask_header"]

CHUNK_INTERVAL = 0.3
"""Interval of closing chunks, s: a kill loses at most this, and the messages in transit."""
COUNTER_INTERVAL = 1.0
"""Interval of counter records, s."""
MOST_WAITING = 16384
MOST_BYTES = 128 << 20
"""Most messages, and most bytes, that may wait to be written; further messages are dropped and counted."""
CONFIG_WAIT = 3.0
"""Longest wait for a process of the robot to report its config, s."""


class _Waiting(NamedTuple):
    key: str
    label: str
    data: bytes
    received_ns: int


def ask_header(client: Client) -> RecordingHeader:
    """Header of a recording, from the robot's own description. Plugins that its config blocks are blocked here too.

    Raises:
        ClientError: No process of the robot answers, or the answer cannot be read.
    """
    limit = time.monotonic() + CONFIG_WAIT
    while True:
        for answer in client.bus.ask(client.keys.process("*", "config"), timeout=1.0):
            if not answer.refusal:
                given, loaded = _read_config(client.keys.prefix, answer.data)
                OPENER.block(loaded.config.plugins.blocked)
                header = header_of(loaded, "barrier" if given.barrier else "live", given.distributions)
                return replace(header, realm=client.keys.realm, robot=client.keys.robot)
        if time.monotonic() > limit:
            raise ClientError(
                f"robot {client.keys.prefix}: no process reports its config; `navloom list` shows its nodes"
            )
        time.sleep(0.05)


def _read_config(robot: str, data: bytes) -> tuple[ProcessConfig, Loaded]:
    try:
        given = from_json(ProcessConfig, data)
        if given.loaded is None:
            raise ValueError("its config is not known")
        return given, Loaded.from_json(given.loaded)
    except (KeyError, TypeError, ValueError) as error:
        why = " ".join(str(error).split())
        raise ClientError(
            f"robot {robot}: the config that it reports cannot be read ({why}); install the same version of navloom "
            "on both"
        ) from None


def _recorded(header: RecordingHeader) -> list[str]:
    """Streams to record, one by one: a viewer may not subscribe by wildcard. Faults are in the step reports too."""
    return [stream for stream in streams_of(header.loaded().config) if not stream.endswith(f"/{FAULT}")]


class LiveRecorder:
    """Records every message of a robot, from `start` to `stop`.

    Args:
        client: Client of the robot.
        writer: Writer of the recording.
        patterns: Keys to keep, with `*`, whole or below REALM/ROBOT; empty for all.

    Attributes:
        counts: Numbers of kept, dropped, lost and malformed messages.
        failure: Why it stopped writing; empty while it writes.
    """

    def __init__(self, client: Client, writer: RecordingWriter, patterns: Sequence[str] = ()) -> None:
        self.client, self.writer, self.counts, self.failure = client, writer, RecorderCounts(), ""
        self._patterns = list(patterns)
        self._kept: dict[str, bool] = {}
        self._waiting: deque[_Waiting] = deque()
        self._bytes = 0
        self._condition = threading.Condition()
        self._ends = False
        self._thread = threading.Thread(target=self._write, name="recorder")
        self._gained, self._header = threading.Event(), writer.header
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def start(self) -> None:
        """Start recording: messages retained for late joiners first, then all new ones."""
        self._thread.start()
        self.client.bus.watch(self.client.keys.process("*", GAINED), lambda key, alive: self._gained.set())
        for stream in _recorded(self.writer.header):
            self.client.bus.subscribe(f"{self.client.keys.prefix}/{stream}", self.receive)
        for role, port in retained_ports(ports=catalogue_of(self.writer.header.loaded().config)[0]):
            self._fetch(role, port)
        self._fetch("*", "parameters")
        # Announced after the subscriptions, on the same links: a process that sees it can already send to it.
        self.client.bus.announce(self.client.keys.process(ATTENDANT, LINKED))

    def look(self) -> None:
        """Record instances that the robot has gained, too. Call it several times a second."""
        if not self._gained.is_set():
            return
        self._gained.clear()
        try:
            before, header = _recorded(self._header), ask_header(self.client)
        except ClientError:  # no process answers now: try again
            self._gained.set()
            return
        for stream in _recorded(header):
            if stream not in before:
                self.client.bus.subscribe(f"{self.client.keys.prefix}/{stream}", self.receive)
        self._header = header

    def stop(self) -> None:
        """Write all messages received so far and close the file."""
        with self._condition:
            self._ends = True
            self._condition.notify()
        if self._thread.is_alive():
            self._thread.join()

    def wait(self, timeout: float) -> bool:
        """Wait for `timeout`, s, or until writing fails. Returns whether it still writes."""
        self._thread.join(timeout)
        return self._thread.is_alive()

    def receive(self, key: str, data: bytes | None, label: str) -> None:
        """Queue a message, on the network's thread. It never waits for the disk and never raises."""
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = self._fits(key)
        if not kept or self.failure:
            return
        received_ns = time.monotonic_ns() + self._ahead_ns
        with self._condition:
            if data is None:
                self.counts.malformed[key] += 1
            elif len(self._waiting) >= MOST_WAITING or self._bytes + len(data) > MOST_BYTES:
                self.counts.dropped[key] += 1
            else:
                self._bytes += len(data)
                self._waiting.append(_Waiting(key, label, data, received_ns))
            if len(self._waiting) > MOST_WAITING // 8:  # below that the writer's own polling suffices
                self._condition.notify()

    def _fits(self, key: str) -> bool:
        below = key.split("/", 2)[-1]
        return not self._patterns or any(fnmatchcase(key, p) or fnmatchcase(below, p) for p in self._patterns)

    def _fetch(self, role: str, port: str) -> None:
        for answer in self.client.ask_again(self.client.keys.port(role, "*", port), timeout=0.5):
            if not answer.refusal:
                self.receive(answer.key, answer.data, answer.label)

    def _write(self) -> None:
        closed = counted = time.monotonic()
        try:
            while not self._ends:
                with self._condition:
                    self._condition.wait(CHUNK_INTERVAL / 3.0)
                self._drain()
                if self.writer.header is not self._header:
                    self.writer.extend(self._header)
                now = time.monotonic()
                if now - counted >= COUNTER_INTERVAL:
                    counted = now
                    self.writer.add_counts(self._summary(), time.time_ns())
                if now - closed >= CHUNK_INTERVAL:
                    closed = now
                    self.writer.flush()
            self._drain()
            self.writer.close(self._summary())
        except WriteError as error:
            self.failure = str(error)
            with self._condition:
                self.counts.messages = self.writer.messages
                self._waiting.clear()

    def _drain(self) -> None:
        while self._waiting:
            one = self._waiting.popleft()
            with self._condition:
                self._bytes -= len(one.data)
            try:
                envelope = read_envelope(one.data)
            except CodecError:
                self.counts.malformed[one.key] += 1
                continue
            if envelope.key != one.key:
                self.counts.malformed[one.key] += 1
                continue
            if self.counts.has(one.key, envelope.sequence):  # retained for late joiners, then received once more
                continue
            self.writer.add(one.key, one.label, one.data, one.received_ns, envelope.stamp_ns, envelope.sequence)
            self.counts.note(one.key, envelope.sequence)

    def _summary(self) -> dict[str, object]:
        with self._condition:
            return self.counts.summary()
