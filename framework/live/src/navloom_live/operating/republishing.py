"""Publishes a recording again, at its own pace or another, as a robot in realm `replay` that tools can look into."""

from __future__ import annotations

import json
import os
import platform
import threading
import time
from collections import defaultdict
from collections.abc import Callable

from navloom.engine.catalogue import FRAMEWORK, catalogue_of
from navloom.messages import SCHEMAS, Envelope, Message
from navloom.messages.codec import CodecError, redirected
from navloom_recording.reader import RawRecorded, Recording
from navloom_recording.step_replay import recorded_instances

from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder, Running
from navloom_live.live.description import Description, ProcessConfig
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.links import Link
from navloom_live.transport.quality_of_service import is_retained, quality_of
from navloom_live.transport.zenoh_bus import Bus, Publication, Question

__all__ = ["REALM", "republish"]

REALM = "replay"
"""Realm of republished messages, so that they are never taken for the robot itself."""
PROCESS = "replay"


def republish(recording: Recording, speed: float, ending: threading.Event, say: Callable[[str], None]) -> int:
    """Publish every message once, under the recorded keys in realm `replay`; ends with the recording.

    Messages are published as they were sent, those too whose class is not known here.

    Args:
        recording: What to publish.
        speed: Factor of the recorded pace.
        ending: Event that ends it.
        say: Receives the name under which it can be observed, and what was left out.

    Returns:
        Number of messages published.

    Raises:
        DirectoryError: A recording of that robot is published already.
    """
    keys = KeySpace(REALM, recording.header.robot)
    folder = RobotFolder(keys.realm, keys.robot)
    folder.make()
    if not folder.lock():
        raise DirectoryError(f"{keys.prefix} is published already: end that, or wait for it")
    folder.clear()
    own = folder.socket(PROCESS)
    try:
        with Bus(Link("peer", (own,), (), realm=keys.realm, robot=keys.robot)) as bus:
            player = _Player(bus, keys, recording)
            folder.write(Running(keys.realm, keys.robot, os.getpid(), (own,), False, str(recording.path), False))
            say(f"publishing {recording.path} at {speed:g} times its pace; look with --robot {keys.prefix}")
            count = player.play(speed, ending)
            if player.damaged:
                say(f"{player.damaged} messages are damaged and were left out; the first: {player.complaint}")
            return count
    finally:
        folder.clear()
        folder.unlock()


class _Player:
    """Stands for the nodes of a recording in the queries of tools."""

    def __init__(self, bus: Bus, keys: KeySpace, recording: Recording) -> None:
        self.bus, self.keys, self.recording = bus, keys, recording
        self.published: defaultdict[tuple[str, str], dict[str, int]] = defaultdict(dict)
        self._at: defaultdict[tuple[str, str], Envelope] = defaultdict(lambda: Envelope("", 0, 0, 0, 0, 0))
        self.damaged, self.complaint = 0, ""
        self._ways: dict[tuple[str, str], Publication] = {}
        self._last: dict[str, tuple[bytes, str]] = {}
        plugins = _plugins(recording)
        recorded = recording.keys()
        given = recording.header.config
        catalogue = FRAMEWORK if given is None else catalogue_of(recording.header.loaded().config)[0]
        for key in recorded:
            role, name, port = key.split("/", 2)[-1].split("/", 2)
            self.published[role, name][port] = 0
            if is_retained(role, port, catalogue):
                own = self.keys.port(role, name, port)
                bus.serve(own, lambda question, own=own: self._answer(question, own))  # type: ignore[misc]
        for source in recorded_instances(recording):
            bus.serve(
                keys.port(*source, "describe"),
                lambda question, source=source: self._describe(question, source, plugins.get(source)),  # type: ignore[misc]
            )
            bus.announce(keys.alive(*source, PROCESS))
        bus.serve(keys.process(PROCESS, "config"), self._show_config)

    def play(self, speed: float, ending: threading.Event) -> int:
        """Publish every message at its time."""
        began, first = time.monotonic(), None
        count = 0
        for record in self.recording.raw():
            first = record.received_ns if first is None else first
            due = began + (record.received_ns - first) * 1e-9 / speed
            if (left := due - time.monotonic()) > 0.0 and ending.wait(left):
                break
            if ending.is_set():
                break
            try:
                self._publish(record)
            except CodecError as error:
                self.damaged += 1
                self.complaint = self.complaint or f"{record.key}: {error}"
            else:
                count += 1
        return count

    def _publish(self, raw_recorded: RawRecorded) -> None:
        """Publish a message as it was sent, but for its key. Its class need not be known here."""
        role, name, port = raw_recorded.key.split("/", 2)[-1].split("/", 2)
        key, label = self.keys.port(role, name, port), raw_recorded.label
        data, envelope = redirected(raw_recorded.data, key)
        way = self._ways.get((key, label))
        if way is None:
            kind = SCHEMAS.get(label.partition("/")[0], Message)
            way = self._ways[key, label] = self.bus.publication(key, quality_of(kind))
        way.put(data, label)
        self._last[key] = (data, label)
        self._at[role, name] = envelope
        self.published[role, name][port] = envelope.sequence

    def _answer(self, question: Question, key: str) -> None:
        last = self._last.get(key)
        if last is None:
            question.drop()
        else:
            question.answer(key, *last)

    def _describe(self, question: Question, source: tuple[str, str], plugin: str | None) -> None:
        at = self._at[source]
        told = Description(
            role=source[0], instance=source[1], plugin=plugin, process=PROCESS, pid=os.getpid(), host=platform.node(),
            active=True, enabled=True, tick=at.tick, epoch=at.epoch, versions=self.recording.header.versions,
            published=self.published[source], config_sha256=self.recording.header.config_sha256, clock_ns=at.stamp_ns,
            wall_ns=time.time_ns(), places={" ".join(one): PROCESS for one in self.published},
        )  # fmt: skip
        question.answer(self.keys.port(*source, "describe"), json.dumps(told.to_json()).encode(), "json")

    def _show_config(self, question: Question) -> None:
        header = self.recording.header
        given = ProcessConfig(loaded=header.config, barrier=False, distributions=header.versions)
        question.answer(self.keys.process(PROCESS, "config"), given.to_bytes(), "json")


def _plugins(recording: Recording) -> dict[tuple[str, str], str]:
    """Plugin of each instance that the config names."""
    if recording.header.config is None:
        return {}
    tables = recording.header.loaded().config.role_tables()
    return {(role, table.instance): table.plugin for _, role, table in tables}
