"""The last good pose of a live robot, kept in a file: when it is up again, it begins there, and verifies that."""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from navloom.config import Loaded
from navloom.config.schema import Config
from navloom.engine.system import System
from navloom.engine.task_checks import is_real
from navloom.files import write_whole
from navloom.inputs.spreads import GUESS
from navloom.inputs.typed_json import from_json
from navloom.messages import OccupancyGrid, Pose2D, PoseEstimate

__all__ = ["Kept", "KeptPose", "keeps_pose", "resume", "starting_at", "state_folder"]

INTERVAL = 2.0
"""Shortest time between two writes, s: flash memory wears out, and a pose of 2 s ago is a good guess."""
MOVED, TURNED = 0.02, math.radians(1.0)
"""Least motion since the last write, m and rad: a robot that stands writes nothing."""


def state_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """This user's folder for what outlives a boot: NAVLOOM_STATE_DIR, otherwise in XDG_STATE_HOME or ~/.local/state."""
    if given := environment.get("NAVLOOM_STATE_DIR"):
        return Path(given)
    return Path(environment.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "navloom"


def keeps_pose(system: System) -> bool:
    """Whether this robot keeps its pose: it has a map that lasts, and a localizer that verifies where it starts.

    A simulated one does so only if its config says so: its true start is always that of the config.
    """
    given = system.config.live.keep_pose
    is_wanted = is_real(system) if given is None else given
    can_search = ("localizer", system.config.localizer.instance) in system.searchers
    # On several hosts, each would begin with another config.
    return is_wanted and can_search and system.map is not None and not system.config.live.hosts


@dataclass(frozen=True)
class Kept:
    """A pose in the map, with its standard deviations and the map's digest.

    Attributes:
        x, y, heading: m, rad, map frame.
        spread, heading_spread: m and rad.
        unix_time: When it was good, s.
        map_sha256: Of the known map.
    """

    x: float
    y: float
    heading: float
    spread: float
    heading_spread: float
    unix_time: float
    map_sha256: str


class KeptPose:
    """The file of one robot.

    Args:
        folder: Folder for the files of all robots; it is made for the first pose.
        realm, robot: Names of the robot.
        map: The known map: a pose in another one says nothing.
        say: Told once if the file cannot be written.
    """

    def __init__(
        self, folder: Path, realm: str, robot: str, map: OccupancyGrid, say: Callable[[str], None] = lambda text: None
    ) -> None:
        self.path, self._say = folder / f"{realm}.{robot}.pose.json", say
        self._map_sha256 = _digest(map)
        self._newest: PoseEstimate | None = None
        self._written, self._written_at, self._has_failed = (math.inf, 0.0, 0.0), -math.inf, False

    def read(self) -> Kept | None:
        """The pose that was kept in this map; None for none."""
        with suppress(OSError, ValueError, TypeError):
            kept = from_json(Kept, self.path.read_text("utf-8"))
            values = (kept.x, kept.y, kept.heading, kept.spread, kept.heading_spread, kept.unix_time)
            if kept.map_sha256 == self._map_sha256 and all(map(math.isfinite, values)):
                return kept
        return None

    def note(self, estimate: PoseEstimate) -> None:
        """Keep a pose if it is good, at most every INTERVAL."""
        if estimate.state != "tracking":
            return
        self._newest = estimate
        if time.monotonic() - self._written_at >= INTERVAL:
            self.write()

    def write(self) -> None:
        """Write the newest good pose, if the robot has moved since the last write."""
        if self._newest is None:
            return
        pose, (x, y, heading) = self._newest.pose, self._written
        turned = abs(math.remainder(pose.heading - heading, math.tau))
        if math.hypot(pose.x - x, pose.y - y) < MOVED and turned < TURNED:
            return
        self._written, self._written_at = (pose.x, pose.y, pose.heading), time.monotonic()
        # Never below a guess by hand: a robot may be pushed while it is off.
        covariance = self._newest.covariance
        place = math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2])[-1])))
        turn = math.sqrt(max(0.0, float(covariance[2, 2])))
        spreads = max(place, GUESS[0]), min(max(turn, math.radians(GUESS[1])), math.pi)
        kept = Kept(pose.x, pose.y, pose.heading, *spreads, time.time(), self._map_sha256)
        try:
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_whole(self.path, json.dumps(asdict(kept)))
        except OSError as error:
            if not self._has_failed:
                self._say(f"the robot's pose cannot be kept: {self.path}: {error.strerror}; set NAVLOOM_STATE_DIR")
            self._has_failed = True


def resume(system: System, resumes: bool, say: Callable[[str], None]) -> tuple[KeptPose, Loaded]:
    """The robot's file, and the config to start with: with the kept pose, unless the command line gives a start.

    Args:
        system: A robot that keeps its pose.
        resumes: False to start as the config says.
        say: Told which start it is.
    """
    assert system.map is not None
    loaded, robot = system.loaded, system.config.robot
    keeper = KeptPose(state_folder(), robot.realm, robot.name, system.map, say)
    kept = keeper.read()
    if not resumes or kept is None or any(_is_start(place) for place, by in loaded.sources.items() if by == "--set"):
        say("start: that of the config")
        return keeper, loaded
    say(
        f"start: where it was {_span(time.time() - kept.unix_time)} ago, ({kept.x:z.2f}, {kept.y:z.2f}), "
        f"{math.degrees(kept.heading):z.0f}°; the localizer verifies it (--start-anew: that of the config)"
    )
    return keeper, starting_at(loaded, kept, system.true_start)


def _span(seconds: float) -> str:
    """A time span in words."""
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{max(0.0, seconds):.0f} s"


def starting_at(loaded: Loaded, kept: Kept, true_start: Pose2D) -> Loaded:
    """The config, with a kept pose as its start, a guess. A simulated robot still stands at its true start."""
    tree = loaded.config.model_dump(mode="json", exclude_unset=True)
    start = {
        "x": kept.x,
        "y": kept.y,
        "heading_deg": math.degrees(kept.heading),
        "spread": kept.spread,
        "heading_spread_deg": math.degrees(kept.heading_spread),
    }
    tree["navigation"] = {**tree.get("navigation", {}), "start": start}
    if "world" in tree:
        true = {"x": true_start.x, "y": true_start.y, "heading_deg": math.degrees(true_start.heading)}
        tree["world"] = {key: value for key, value in tree["world"].items() if key != "start_offset"} | {"start": true}
    sources = {place: source for place, source in loaded.sources.items() if not _is_start(place)}
    for key in start:
        sources[f"navigation.start.{key}"] = "kept pose"
    return replace(loaded, config=Config.model_validate(tree), sources=sources)


def _is_start(place: str) -> bool:
    return place == "navigation.start" or place.startswith("navigation.start.")


def _digest(map: OccupancyGrid) -> str:
    frame = (map.resolution, map.origin.x, map.origin.y, map.origin.heading, *map.cells.shape)
    return hashlib.sha256(repr(frame).encode() + np.ascontiguousarray(map.cells).tobytes()).hexdigest()
