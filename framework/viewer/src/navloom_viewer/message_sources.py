"""Sources of messages for viewers: recordings and live robots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from navloom.messages import Envelope, Message, Selection
from navloom.parts import part

from navloom_viewer.drawing import Shown
from navloom_viewer.picture_setup import Facts, facts_of, unknown_robot

if TYPE_CHECKING:
    from navloom_live.operating.client import Client
    from navloom_recording.reader import Recording
    from navloom_recording.recording_header import RecordingHeader

__all__ = ["ActiveInstances", "facts_of_header", "facts_of_recording", "live_messages", "recorded_messages"]


class ActiveInstances:
    """Determines for each message of a robot whether its instance was active.

    Args:
        variant: Name of the robot in the picture.
        instances: Active instance of each role at the start; other roles have only one instance.
    """

    def __init__(self, variant: str, instances: Mapping[str, str]) -> None:
        self.variant = variant
        self._now = dict(instances)
        self._next: tuple[float, dict[str, str]] = (math.inf, {})

    def shown(self, stream: str, message: Message, at: Envelope) -> Shown:
        """The `Shown` of a message on role/instance/port."""
        role, instance, port = stream.split("/", 2)
        if isinstance(message, Selection) and message.epoch:
            self._next = message.from_tick, message.chosen
        if at.tick >= self._next[0]:
            self._now |= self._next[1]
            self._next = math.inf, {}
        active = self._now.get(role, instance) == instance
        return Shown(self.variant, role, instance, active, port, message, at.tick, at.stamp_ns)


def facts_of_header(header: RecordingHeader, title: str) -> Facts:
    """The facts of a robot from its config; without a config, those of an unknown robot."""
    from navloom.engine.build import assemble
    from navloom_recording.recording_header import RecordingError

    try:
        return facts_of({header.robot: assemble(header.loaded())}, title)
    except (RecordingError, ValueError):
        return Facts(title, (unknown_robot(header.robot, {}),), None, header.period)


def facts_of_recording(recording: Recording) -> Facts:
    """The facts of a recording; its world comes from the recording itself if its file no longer exists."""
    from navloom.engine.build import assemble
    from navloom_recording.recording_header import RecordingError
    from navloom_recording.world_attachments import with_world

    title = recording.path.name
    with TemporaryDirectory() as folder:
        try:
            loaded = with_world(recording, recording.header.loaded(), Path(folder))
            return facts_of({recording.header.robot: assemble(loaded)}, title)
        except (RecordingError, ValueError):
            return facts_of_header(recording.header, title)


def recorded_messages(recording: Recording, facts: Facts) -> Iterator[Shown]:
    """Messages of a recording in the order of receipt."""
    first = facts.variants[0]
    instances = ActiveInstances(first.name, first.instances)
    for message in recording.messages():
        yield instances.shown(message.key.split("/", 2)[2], message.message, message.envelope)


def live_messages(client: Client, facts: Facts) -> Iterator[Shown | None]:
    """Messages of a live robot as they arrive, retained ones first; None at least four times a second.

    It only subscribes and does not affect the robot.
    """
    looking = part("navloom_live.operating.introspection", "a live robot")
    nodes = part("navloom_live.operating.robot_nodes", "a live robot")
    first = facts.variants[0]
    instances = ActiveInstances(first.name, first.instances)
    mailbox = part("navloom_live.live.mailbox").Mailbox()
    names = looking.streams(nodes.listing(client))
    taps = looking.tap(client, [name for name in names if not name.endswith("/done")], mailbox)
    for name in taps:
        kept = looking.retained(client, name)
        if kept is not None:
            yield instances.shown(name, *kept)
    seen = 0
    while True:
        come: list[tuple[str, Any, Envelope]] = []
        for name, inlet in taps.items():
            come += [(name, message, at) for message, at in inlet.take()]
        # In order of the run clock, so that a robot's pose is known before the scans from that pose.
        for name, message, at in sorted(come, key=lambda one: one[2].stamp_ns):
            yield instances.shown(name, message, at)
        yield None
        seen = mailbox.wait(seen, 0.2)
