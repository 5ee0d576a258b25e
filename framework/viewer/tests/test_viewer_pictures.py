"""Pictures of the viewer without a screen: objects appear where the camera must see them."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.runs.episode import Episode, run_episode
from navloom_viewer.blueprint import camera
from navloom_viewer.colours import CLOUD, DRIVEN, PLAN, TRAJECTORY
from navloom_viewer.draw_sensing import FREE
from navloom_viewer.drawing import Drawing
from navloom_viewer.lockstep_viewing import Gathering
from navloom_viewer.picture_setup import Facts, actors_of, facts_of
from navloom_viewer.program import Program
from navloom_viewer.rerun_stream import FileSink
from PIL import Image

experimental = pytest.importorskip("rerun.experimental", reason="the extra `view` is not installed")
FIELD_OF_VIEW = math.radians(55.0)
"""Vertical, of the viewer's 3D views."""
GREEN, STATE_AVOIDER = (0, 158, 115), (184, 127, 0)
AT = 15.0
"""Run time of the picture, s: the robot passes the obstacle."""


@dataclass(eq=False)
class Looked:
    """Output of a viewer: pixels of each view, (rows, cols, 3), and its complaints."""

    views: dict[str, np.ndarray]
    complaints: list[Any]
    facts: Facts

    def near(self, view: str, colour: tuple[int, ...], tolerance: int = 12) -> np.ndarray:
        """(n, 2) x, y of the pixels of a colour; none if the view is missing."""
        if view not in self.views:
            return np.empty((0, 2), int)
        close = np.abs(self.views[view].astype(int) - np.array(colour[:3])).max(axis=2) <= tolerance
        return np.argwhere(close)[:, ::-1]

    def misses(self, colour: tuple[int, ...], place: tuple[float, float, float], tolerance: int = 12) -> float:
        """Distance from the expected pixel of a place of the map to the nearest pixel of a colour, pixels."""
        found = self.near("3D", colour, tolerance)
        return float(np.hypot(*(found - self.seen_at(place)).T).min()) if len(found) else math.inf

    def seen_at(self, place: tuple[float, float, float]) -> np.ndarray:
        """Expected x, y, pixels, of a place of the map in the 3D view: a pinhole camera at the place in the layout."""
        high, wide = self.views["3D"].shape[:2]
        eye, target = (np.array(point) for point in camera(self.facts))
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        ray = np.array(place) - eye
        scale = 0.5 * high / math.tan(0.5 * FIELD_OF_VIEW) / (ray @ ahead)
        return np.array([0.5 * wide + scale * (ray @ right), 0.5 * high - scale * (ray @ np.cross(right, ahead))])


Look = Callable[[Callable[[Looked], None], Path, Facts], None]
"""Takes a check of the output, a file and its facts."""


@pytest.fixture
def look(tmp_path: Path) -> Iterator[Look]:
    """Opens an .rrd file without a screen, and takes pictures until one passes a check, or for a minute.

    How long a viewer without a graphics card takes to draw everything depends on the load of the machine. Skips where
    nothing can be drawn.
    """
    program = Program(options=("--headless",))
    client = experimental.ViewerClient.connect(program.url)

    def until(check: Callable[[Looked], None], file: Path, facts: Facts) -> None:
        limit = time.monotonic() + 60.0
        try:
            client.open(str(file))
            client.set_time("run_time", duration=AT, play_state="paused")
            while True:
                try:
                    return check(_seen(client, tmp_path, facts))
                except AssertionError:
                    if time.monotonic() > limit:
                        raise
                    time.sleep(0.3)
        except ConnectionError:
            if program.process.poll() is None:
                raise
            pytest.skip("no Vulkan driver: apt-get install libvulkan1 mesa-vulkan-drivers")

    yield until
    program.end()


def _seen(client: Any, folder: Path, facts: Facts) -> Looked:
    """Output of the viewer now."""
    views = client.get_state().views
    pictures = {}
    for view in views:
        picture = folder / f"{view.view_class}.png"
        with contextlib.suppress(ConnectionError):  # a tab that another one hides
            client.save_screenshot(str(picture), view_id=view.view_id)
            key = view.view_class if view.view_class != "TimeSeries" else view.origin.rsplit("/", 1)[1]
            pictures[key] = np.asarray(Image.open(picture).convert("RGB"))
    return Looked(pictures, [report for view in views for report in view.reports], facts)


def recorded(folder: Path, methods: dict[str, tuple[str, ...]]) -> tuple[Path, Facts, dict[str, Episode]]:
    """Runs of the paper's config, changed, in one file."""
    loaded = {name: load_config("paper", changes) for name, changes in methods.items()}
    facts = facts_of({name: assemble(one) for name, one in loaded.items()}, "paper")
    file = folder / "run.rrd"
    drawing = Drawing(facts, [FileSink(file, "paper", "test")])
    drawing.begin()
    episodes = {}
    for name, one in loaded.items():
        gathering = Gathering(name, drawing.take)
        episodes[name] = run_episode(one, observers=[gathering])
        gathering.drain()
    drawing.close()
    assert drawing.broken == {}
    return file, facts, episodes


def place_at(episode: Episode, seconds: float) -> tuple[float, float]:
    """True place of the robot."""
    row = min(episode.recorder.truth, key=lambda row: abs(row[0] - seconds))
    return row[1], row[2]


def test_the_paper_run_shows_every_object_at_its_place(tmp_path: Path, look: Look) -> None:
    file, facts, episodes = recorded(tmp_path, {"r1": ()})

    def shows_everything(seen: Looked) -> None:
        recorder = episodes["r1"].recorder
        assert seen.complaints == []
        # For each object a place at which it must appear, within a few pixels, not hidden by others.
        assert seen.misses(GREEN, (0.0, 7.6 - 0.2, 0.09), 25) < 8  # the goal's ring
        assert seen.misses(DRIVEN, (*place_at(episodes["r1"], 3.5), 0.1)) < 8
        assert seen.misses(DRIVEN, (*place_at(episodes["r1"], 6.5), 0.1)) < 8
        plan = recorder.plans[0].points
        corner = plan[len(plan) // 2]
        assert seen.misses(PLAN, (corner[0], corner[1], 0.04)) < 12
        late = recorder.trajectories[0].samples
        way = late[np.searchsorted(late[:, 0], 0.8 * late[-1, 0])]
        assert seen.misses(TRAJECTORY, (way[1], way[2], 0.06)) < 8
        assert recorder.map is not None
        longest = max(recorder.map.segments, key=lambda s: math.hypot(s[2] - s[0], s[3] - s[1]))
        middle = (0.5 * (longest[0] + longest[2]), 0.5 * (longest[1] + longest[3]), 0.08)
        assert seen.misses(CLOUD["kept"], middle) < 8
        assert len(seen.near("3D", FREE)) > 20_000  # the floor it knows to be free
        assert seen.misses(FREE, (-1.0, 3.0, 0.0)) < 3
        assert len(seen.near("3D", CLOUD["behind"], 20)) > 200
        assert len(seen.near("3D", CLOUD["overhead"], 20)) > 200
        # The other views: each has its data in the colour it must have.
        own = actors_of(facts)[("r1", "", "")].colour
        for metric in ("speed", "clearance", "cross_track"):
            assert len(seen.near(metric, own, 30)) > 300, metric
        assert len(seen.near("BarChart", (76, 154, 202), 20)) > 300
        lane = seen.near("StateTimeline", STATE_AVOIDER)
        # Driven by the avoider from 4.4 to 17.8 s.
        assert len(lane) and np.ptp(lane[:, 0]) > 0.4 * seen.views["StateTimeline"].shape[1]
        assert len(seen.near("TextLog", (235, 235, 235), 40)) > 300

    look(shows_everything, file, facts)


@pytest.mark.slow  # three runs of the paper's config, and half a minute of drawing without a graphics card
def test_three_methods_side_by_side_have_their_own_colour_where_they_are(tmp_path: Path, look: Look) -> None:
    names = ("improved_vfh", "vff", "dwa")
    file, facts, episodes = recorded(tmp_path, {name: (f"avoider.plugin={name}",) for name in names})

    def tells_them_apart(seen: Looked) -> None:
        assert seen.complaints == []
        actors = actors_of(facts)
        for name in names:
            colour = actors[(name, "", "")].colour
            x, y = place_at(episodes[name], AT)
            assert seen.misses(colour, (x, y, 1.2), 60) < 60, name
            for metric in ("speed", "clearance", "cross_track"):
                assert len(seen.near(metric, colour, 30)) > 100, (name, metric)
        # A lane each, one below the other, with a stretch that the avoider drove.
        lane = seen.near("StateTimeline", STATE_AVOIDER)
        rows = np.unique(lane[:, 1])
        assert 1 + int((np.diff(rows) > 1).sum()) >= 3

    look(tells_them_apart, file, facts)
