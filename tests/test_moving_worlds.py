"""Robots in worlds where something moves, in whole runs: the node `world`, what the robot meets, replays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from navloom import Bodies, Latest, NodePlugin, Params, Tracks
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.plugin_factory import make_plugins
from navloom.plugins import Discovery
from navloom.runs.episode import Episode, run_episode
from navloom.runs.metric_functions import others_contacts, own_contacts
from navloom_recording.lockstep_recorder import LockstepRecorder
from navloom_recording.reader import Recording
from navloom_recording.recording_header import header_of
from navloom_recording.replay_check import check
from navloom_recording.step_replay import Replayer
from navloom_recording.writer import RecordingWriter

CROSSING = "world.ref=crossing_person"


def drive(*overrides: str, seconds: float = 6.0) -> Episode:
    """The robot of the config `building`, for a time."""
    return run_episode(load_config("building", [f"run.stop_after={seconds}", *overrides]))


def places_of(episode: Episode, name: str) -> np.ndarray:
    """(n, 2) places of a body in each tick, m."""
    return np.array([seen.poses[seen.names.index(name), :2] for seen in episode.recorder.bodies])


def test_only_a_world_where_something_moves_has_its_node() -> None:
    for world, has_node in (("corridor", False), ("crossing_person", True)):
        system = assemble(load_config("building", [f"world.ref={world}"]), Discovery())
        assert ("world" in [spec.role for spec in system.specs]) == has_node
        assert ("bodies" in [given.name for given in system.wiring["platform", "sensors_sim"].inputs]) == has_node


def test_the_platform_gets_what_stands_and_no_other_plugin_gets_either() -> None:
    system = assemble(load_config("building", [CROSSING]), Discovery())
    make_plugins(system)
    worlds = {role: part.plugin.context.world for (role, _), part in system.parts.items()}
    assert [obstacle.name for obstacle in worlds.pop("platform").obstacles] == ["left wall", "right wall"]
    assert set(worlds.values()) == {None}


def test_actors_move_alike_whatever_the_robot_does() -> None:
    """The person rests 5 s, then walks 3 m in 7.5 s: after 6 s it has come 0.4 m."""
    driving, standing = drive(CROSSING), drive(CROSSING, "event=[{at=0,do='stop'}]")
    assert driving.trail.path_length > 1.0 and standing.trail.path_length == 0.0
    person = places_of(driving, "person")[:121]
    assert np.array_equal(person, places_of(standing, "person")[:121])
    assert person[120] == pytest.approx([-1.1, 4.5])


def test_the_robot_is_among_the_bodies_where_it_was_a_tick_before() -> None:
    episode = drive(CROSSING)
    trail = episode.trail
    assert places_of(episode, "r1")[1:] == pytest.approx(np.column_stack([trail.x, trail.y])[:-1])


def test_no_plugin_may_read_what_moves() -> None:
    class Watcher(NodePlugin[Params]):
        name = "watcher"
        seen = Latest(Bodies, triggers=True)

        def step(self, tick) -> None:
            pass

    class Discovered(Discovery):
        def node(self, name):
            return Watcher if name == "watcher" else super().node(name)

    with pytest.raises(ConfigError, match="watcher reads Bodies: no plugin may read the ground truth"):
        assemble(load_config("building", [CROSSING, "node=[{name='watcher',plugin='watcher'}]"]), Discovered())


TOLD = "sensor=[{name='laser',kind='laser_2d'},{name='told',kind='true_tracks'}]"
PEOPLE = "node=[{name='people',plugin='people_tracker'}]"


@pytest.mark.parametrize(
    ("changes", "read"),
    [
        ([], []),
        (["avoider.inputs.tracks=platform.told"], ["platform"]),
        ([PEOPLE], ["people"]),
        ([PEOPLE, "avoider.inputs.tracks=platform.told"], ["platform"]),
    ],
)
def test_tracks_from_truth_are_read_only_by_name(changes: list[str], read: list[str]) -> None:
    """A row of a study without its own tracker must not read the truth that another row is to be compared with."""
    system = assemble(load_config("explore", [CROSSING, "avoider.plugin=orca", TOLD, *changes]), Discovery())
    inputs = system.wiring["avoider", "orca"].inputs
    assert [given.role for given in inputs if given.name == "extra.tracks"] == read


def test_what_needs_tracks_and_finds_only_the_truth_is_told_so() -> None:
    class Watcher(NodePlugin[Params]):
        name = "watcher"
        seen = Latest(Tracks, triggers=True)

        def step(self, tick) -> None:
            pass

    class Discovered(Discovery):
        def node(self, name):
            return Watcher if name == "watcher" else super().node(name)

    with pytest.raises(ConfigError, match=r'only platform.told publishes it.*inputs = { seen = "platform.told" }'):
        assemble(load_config("explore", [CROSSING, TOLD, "node=[{name='watcher',plugin='watcher'}]"]), Discovered())


def test_a_replay_is_the_same_bit_for_bit(tmp_path: Path) -> None:
    loaded = load_config("building", [CROSSING, "run.stop_after=6"])
    path = tmp_path / "run.mcap"
    with LockstepRecorder(RecordingWriter(path, header_of(loaded, "lockstep", {})), print) as recorder:
        run_episode(loaded, observers=[recorder])
    recording = Recording(path)
    found = list(check(Replayer(recording, assemble(recording.header.loaded(), Discovery()))))
    assert "world main" in {one.node for one in found}
    assert all(one.first is None and not one.unrecorded for one in found)


def test_an_event_lets_an_actor_appear() -> None:
    """It appears at 2 s at (0.3, 3), and walks at 1 m/s: at 4 s it is at (2.3, 3)."""
    event = "{at=2.0,do='actor',name='late',values={way=[[0.3,3.0],[5.3,3.0]],speed=1.0}}"
    episode = drive("world.ref=corridor", f"event=[{event}]")
    seen = {round(one.stamp_ns * 1e-9, 2): one for one in episode.recorder.bodies}
    assert "late" not in seen[1.95].names and seen[2.0].names == ("late", "r1")
    assert seen[4.0].poses[0].tolist() == pytest.approx([2.3, 3.0, 0.0])


@pytest.mark.parametrize(
    ("event", "said"),
    [
        ("{at=1,do='actor'}", "also needs values"),
        ("{at=1,do='actor',values={way=[[0,1]],sped=1.0}}", "event.0.values: key 'sped' does not exist"),
        ("{at=1,do='actor',values={way=[[0,1]],appears_at=1.0}}", "appears_at has no use in an event"),
        ("{at=1,do='actor',name='left wall',values={way=[[0,1]]}}", "an actor is named 'left wall', as another"),
    ],
)
def test_an_event_that_makes_no_actor_is_refused(event: str, said: str) -> None:
    with pytest.raises(ConfigError) as raised:
        assemble(load_config("building", ["world.ref=corridor", f"event=[{event}]"]), Discovery())
    assert said in str(raised.value)


def test_a_level_laser_sees_two_legs_and_a_bumper_meets_the_trunk() -> None:
    """A robot that stands at (0, 0) heading +y, and a person who rests 2 m ahead, whose legs are 0.22 m apart."""
    event = "{at=0.0,do='actor',values={body='legs',way=[[0.0,2.0]],heading_deg=90.0}}"
    episode = run_episode(
        load_config(
            "building", ["world.ref=empty", f"event=[{event}]", "event=[]", f"event=[{event}]", "run.stop_after=1"]
        ),
        reads=[("platform", "laser")],
    )
    (_, scan), *_ = episode.trail.streams["platform", "laser"]
    near = np.flatnonzero(scan.ranges < 2.5)
    assert len(np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)) == 2


def test_a_person_who_walks_into_a_standing_robot_is_the_other_s_contact() -> None:
    """From 4 m ahead at 1 m/s, at the front of a robot of 0.5 m that stops: 4 - 0.25 - 0.22 m later, at 3.5 s."""
    person = "{at=0.0,do='actor',name='p',values={body='disc',size=[0.44,0.44],way=[[0,4],[0,-4]],speed=1.0}}"
    trail = drive("world.ref=empty", f"event=[{{at=0.0,do='stop'}},{person}]", seconds=4.0).trail
    (touch,) = trail.contacts
    assert (touch.name, touch.is_own) == ("p", False)
    assert touch.time == pytest.approx(3.55, abs=0.051) and trail.clearance.min() < 0.0
    assert (own_contacts(trail), others_contacts(trail)) == (0.0, 1.0)


def test_a_run_that_the_other_s_contact_ends_says_so_and_is_no_success() -> None:
    """A person who runs at 2 m/s, from behind a robot that starts at (0, 0) and drives along +y at 0.4 m/s at most."""
    person = "{at=0.0,do='actor',name='p',values={body='disc',size=[0.44,0.44],way=[[0,-4],[0,9]],speed=2.0}}"
    episode = drive("world.ref=empty", f"event=[{person}]")
    summary = episode.summary()
    assert (summary["outcome"], summary["own_contacts"], summary["others_contacts"]) == ("collision", 0, 1)
    assert (episode.trail.outcome, episode.trail.reason) == ("struck", "p ran into the robot")
    assert not episode.trail.succeeded


@pytest.mark.parametrize(("world", "opens"), [("door_opens", 15.0), ("blocked_door", 20.0)])
def test_a_patient_robot_goes_through_the_door_when_it_is_open(world: str, opens: float) -> None:
    """The hall is closed, so that nobody can drive round: |x| stays below the wall's 3 m, and y passes 4 m after."""
    changes = [f"world.ref={world}", "avoider.plugin=orca", "navigation.patience=30"]
    trail = run_episode(load_config("explore", changes)).trail
    through = trail.time[np.flatnonzero(trail.y > 4.2)[0]]
    assert trail.succeeded and np.abs(trail.x).max() < 3.0 and through > opens


def test_an_impatient_robot_ends_before_the_door_opens() -> None:
    trail = run_episode(load_config("explore", ["world.ref=door_opens", "avoider.plugin=orca"])).trail
    assert trail.outcome == "no_path" and trail.time[-1] < 15.0


def test_a_person_s_true_track_has_the_radius_of_its_trunk() -> None:
    """0.22 m; its feet are up to 0.39 m off."""
    person = "{at=0.0,do='actor',name='p',values={body='legs',way=[[2,4],[2,-4]],speed=1.0}}"
    loaded = load_config("building", ["world.ref=empty", f"event=[{person}]", TOLD, "run.stop_after=2"])
    told = run_episode(loaded, reads=[("platform", "told")]).trail.streams["platform", "told"]
    assert {tuple(message.radii.tolist()) for _, message in told if len(message.ids)} == {(0.22,)}
