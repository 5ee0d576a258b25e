"""A platform that brings its own simulator needs no [world]: results that need a world use its own, or are left out."""

from __future__ import annotations

import math
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import pytest
from navloom import Contact, Cylinder, Odometry, Params, Platform, Pose2D, Registry, Truth, World, hookimpl
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.task_checks import check_task
from navloom.plugins import Discovery
from navloom.roles import PlatformInput, PlatformOutput
from navloom.runs.episode import Episode, run_episode
from navloom_study.study_worlds import OWN_WORLD, worlds_of
from pydantic import Field

POST = Cylinder("post", 1.0, 1.5, 0.2)


class IslandParams(Params):
    """Whether the platform gives its world."""

    tells: bool = Field(True, description="It tells its world.")


class Island(Platform[IslandParams]):
    """Drives exactly as it is commanded, in its own simulator, a plane with one post."""

    name = "island"
    is_simulated = True

    @classmethod
    def own_world(cls, params: IslandParams) -> World | None:
        return World("island", (POST,), bounds=(-2.0, -2.0, 5.0, 5.0)) if params.tells else None

    def reset(self) -> None:
        self._pose, self._time_ns = Pose2D(0.0, 0.0, 0.0), 0

    def advance(self, given: PlatformInput) -> PlatformOutput:
        if given.time_ns == 0:
            self.reset()
        seconds, pose = (given.time_ns - self._time_ns) * 1e-9, self._pose
        self._time_ns = given.time_ns
        way, turn = given.command.vx * seconds, given.command.wz * seconds
        middle = pose.heading + 0.5 * turn
        heading = math.remainder(pose.heading + turn, math.tau)
        self._pose = Pose2D(pose.x + way * math.cos(middle), pose.y + way * math.sin(middle), heading)
        gap = max(0.0, math.hypot(self._pose.x - POST.x, self._pose.y - POST.y) - POST.radius - 0.2)
        truth = Truth(self._pose, given.command, gap, "post", False)
        return PlatformOutput(Odometry(given.time_ns, self._pose, given.command), {}, Contact(False), truth)


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the platform."""
    registry.add(Island)


CONFIG = """
[robot]
footprint = { length = 0.4, width = 0.4 }
max_angular_deg = 90.0
[platform]
plugin = "island"
[map]
ref = "empty"
[mapper]
plugin = "known_map"
[controller]
plugin = "pure_pursuit"
[navigation]
goal = { x = 2.0, y = 0.0 }
handover = "never"
"""


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "island.toml"
    path.write_text(CONFIG, "utf-8")
    return str(path)


def discovery() -> Discovery:
    return Discovery(found=[*entry_points(group="navloom"), EntryPoint("platform.island", __name__, "navloom")])


def driven(config: str, *changes: str) -> Episode:
    return run_episode(load_config(config, changes), discovery=discovery())


def test_a_platform_that_gives_its_world_has_a_shortest_way_and_a_checked_goal(config: str) -> None:
    result = driven(config).summary()
    assert (result["outcome"], result["truly_reached"]) == ("succeeded", True)
    assert result["optimal_length_m"] == pytest.approx(2.0) and 0.9 < result["spl"] <= 1.0
    system = assemble(load_config(config, ["navigation.goal.x=1.0", "navigation.goal.y=1.5"]), discovery())
    with pytest.raises(ConfigError, match=r"navigation\.goal: the robot does not fit at \(1, 1\.5\): occupied by post"):
        check_task(system)


def test_a_platform_that_gives_no_world_drives_and_leaves_out_the_results_that_need_one(config: str) -> None:
    result = driven(config, "platform.tells=false").summary()
    assert (result["outcome"], result["truly_reached"]) == ("succeeded", True)
    assert result["optimal_length_m"] is None and result["spl"] is None
    assert result["path_length_m"] > 1.7 and result["min_clearance_m"] > 0.5


def test_the_drive_is_the_same_whether_or_not_the_platform_gives_its_world(config: str) -> None:
    traces = {driven(config, f"platform.tells={tells}").summary()["trace_sha256"] for tells in ("true", "false")}
    assert len(traces) == 1


def test_a_world_beside_that_of_the_platform_is_refused(config: str) -> None:
    with pytest.raises(
        ConfigError, match=r"world\.ref: is 'doorway', but the platform island brings a world of its own"
    ):
        assemble(load_config(config, ["world.ref=doorway"]), discovery())


def test_the_world_of_the_platform_can_be_the_map(config: str) -> None:
    cells = assemble(load_config(config, ["map.ref=world"]), discovery()).map
    assert cells is not None and (cells.cells == 100).any()
    with pytest.raises(ConfigError, match="the platform has none"):
        assemble(load_config(config, ["map.ref=world", "platform.tells=false"]), discovery())


def test_a_value_that_is_no_world_is_blamed_on_the_platform(config: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Island, "own_world", classmethod(lambda cls, params: "a hall"))
    with pytest.raises(ValueError, match="island fails in own_world: TypeError: it gives str, expected World or None"):
        assemble(load_config(config), discovery())


@pytest.mark.parametrize("tells", ["true", "false"])
def test_a_study_without_a_world_uses_that_of_the_platform(config: str, tells: str) -> None:
    (case,) = worlds_of(load_config(config, [f"platform.tells={tells}"]), (), discovery())
    assert (case.ref, case.values, bool(case.sha256)) == (OWN_WORLD, {}, tells == "true")
