"""What `navloom ros export` and `navloom ros import` do: recordings to ROS 2 MCAP files, and bags to recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from navloom_recording import Recording, RecordingError, mount_option
from navloom_viewer import KEPT, classify_sweep, sweep_rule
from numpy.typing import NDArray

from navloom_ros.bag_import import Choice, import_bag
from navloom_ros.bag_outcome import Imported
from navloom_ros.errors import BadName, RosError
from navloom_ros.frames import Mount, quaternion_matrix
from navloom_ros.mcap_file import McapFile
from navloom_ros.message_types import Types
from navloom_ros.translating import Translator

__all__ = ["export", "import_from"]


def export(source: Path, target: Path, types: Types) -> dict[str, Any]:
    """Write a recording as an MCAP file of ROS messages.

    Stamps are the run clock. Those of a live recording are shifted so that the first is the time of its receipt.

    Returns:
        `messages`: number by topic. `left_out`: number without a counterpart in ROS, by role and port. `note`: what a
        user should know about the end of the recording.

    Raises:
        RosError: The recording cannot be read, or the file cannot be written.
    """
    translator = Translator(types)
    try:
        with Recording(source) as recording, McapFile(target, types) as out:
            translator.kept = _kept_of(recording)
            is_first = True
            for key, envelope, message, received_ns in recording.messages():
                if is_first and recording.header.clock == "wall":
                    # ROS tools expect stamps since 1970, and a run clock begins at 0.
                    translator.offset_ns = received_ns - envelope.stamp_ns
                is_first = False
                role, instance, port = key.split("/")[2:5]
                for made in translator.translate(role, instance, port, message, envelope.stamp_ns):
                    out.add(made.topic, made.message, envelope.stamp_ns + translator.offset_ns)
            # An empty file would look like a successful export.
            if not out.messages:
                raise RosError(f"{source}: it has no message with a counterpart in ROS")
        return {"messages": out.messages, "left_out": translator.left_out, "note": recording.note}
    except RecordingError as error:
        raise RosError(str(error)) from None


def _kept_of(recording: Recording) -> Callable[[Any], NDArray[np.bool_]] | None:
    """What the mapper `ipabd` of a recording keeps of a sweep of a robot that stands; None with another mapper."""
    try:
        config = recording.header.loaded().config
    except RecordingError:  # as of a robot that did not say which config it runs
        return None
    if config.mapper.plugin != "ipabd":
        return None
    rule = sweep_rule(SimpleNamespace(**(config.mapper.model_extra or {})), config.robot.height)
    return lambda sweep: classify_sweep(sweep, rule) == KEPT


def import_from(
    bag: Path,
    out: Path,
    map_topics: Sequence[str],
    mounts: Sequence[str],
    odometry: str | None,
    map_ref: str | None,
    start: tuple[float, float, float] | None,
    choice: Choice,
) -> Imported:
    """Parse the options of the command and import a bag; see `import_bag`.

    Raises:
        BadName: A --map-topic that is not TOPIC=NAME.
        ConfigError: A --mount that cannot be read.
        RecordingError: See `import_bag`.
    """
    names = {}
    for text in map_topics:
        topic, _, name = text.partition("=")
        if not topic or not name:
            raise BadName(f"--map-topic {text}: expected TOPIC=NAME, as in --map-topic /scan=laser")
        names[topic] = name
    places = {}
    for name, (x, y, yaw, z) in map(mount_option, mounts):
        rotation = quaternion_matrix(0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0))
        places[name] = Mount(rotation, np.array([x, y, z]))
    return import_bag(bag, out, names, places, odometry, map_ref, start, choice)
