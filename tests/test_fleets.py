"""Fleets: robots in one world that see and touch each other, and that drive as alone where the others are far away."""

from __future__ import annotations

import json
import multiprocessing
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from navloom.cli import main
from navloom.config import ConfigError, load_config
from navloom.engine.trace import read_trace
from navloom.plugins import one_file
from navloom.runs.episode import run_episode
from navloom.runs.fleet import Fleet, FleetError, load_fleet, run_fleet

HEAD = '[run]\nstop_after = {seconds}\nseed = 3\n\n[world]\nref = "{world}"\n'
HALLS = """
bounds = [-5.0, -5.0, 70.0, 5.0]
[[box]]
x = [-3.0, 5.0]
y = [-2.0, -1.0]
[[box]]
x = [57.0, 65.0]
y = [-2.0, -1.0]
"""
"""Two walls, 52 m apart: the laser reaches 20 m, and the true clearance of each robot is that to its wall."""
MEMBER = """
[[member]]
name = "{name}"
config = "building"
start = {{ x = {x}, y = 0.0, heading_deg = {heading} }}
set = {{ {set} }}
"""
STANDS = "event = [{ at = 0.0, do = 'stop' }], navigation.goal = { x = 0.0, y = 3.0 }"
BLIND = "mapper.plugin = 'known_map', gate.monitor = false, navigation.handover = 'never'"


def member(name: str, x: float, heading: float, changes: str = STANDS) -> str:
    return MEMBER.format(name=name, x=x, heading=heading, set=changes)


@pytest.fixture
def fleet_of(tmp_path: Path):
    def load(*members: str, seconds: float = 1.0, world: str = "empty"):
        path = tmp_path / "fleet.toml"
        (tmp_path / "halls.toml").write_text(HALLS)
        path.write_text(HEAD.format(seconds=seconds, world=world) + "".join(members))
        return load_fleet(str(path))

    return load


def drive(members, **given) -> Fleet:
    return run_fleet(members, **given)


def test_each_sees_the_other_where_it_is(fleet_of) -> None:
    """Robots of 0.5 m, 3 m apart: a gap of 2.5 m; the beam ahead ends at the other's front, 3 - 0.25 m away."""
    fleet = drive(fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 180.0)), reads=[("platform", "laser")])
    for name, other in (("a", "b"), ("b", "a")):
        recorder = fleet.episodes[name].recorder
        assert (recorder.nearest, recorder.min_clearance) == (other, pytest.approx(2.5))
        ahead = [scan.ranges[135] for _, scan in recorder.streams["platform", "laser"]]
        assert np.mean(ahead) == pytest.approx(2.75, abs=0.03)
        assert recorder.bodies[-1].names == ("a", "b") and recorder.bodies[-1].robots == 2


def test_equal_robots_with_lasers_on_top_see_each_other(fleet_of) -> None:
    """The Jackal of `explore` is 0.3 m high and 0.458 m long, and so high is its laser; 2 m apart."""
    jackals = [member(n, x, h).replace("building", "explore") for n, x, h in (("a", 0.0, 0.0), ("b", 2.0, 180.0))]
    fleet = drive(fleet_of(*jackals, seconds=0.2), reads=[("platform", "laser")])
    for name in "ab":
        ahead = [scan.ranges[180] for _, scan in fleet.episodes[name].recorder.streams["platform", "laser"]]
        assert np.mean(ahead) == pytest.approx(2.0 - 0.229, abs=0.1)


def test_who_drives_blindly_touches_the_one_that_stands(fleet_of) -> None:
    """The contact is the driver's own, and the other's contact for the robot that stands."""
    goal = "navigation.goal = { x = 4.0, y = 0.0 }"
    fleet = drive(fleet_of(member("a", 0.0, 0.0, f"{BLIND}, {goal}"), member("b", 1.5, 180.0), seconds=6.0))
    ours, theirs = (fleet.episodes[name].trail.contacts for name in "ab")
    assert {(touch.name, touch.is_own) for touch in ours} == {("b", True)}
    assert {(touch.name, touch.is_own) for touch in theirs} == {("a", False)}
    assert [touch.time for touch in ours] == [touch.time for touch in theirs]


FAR = [
    member("a", 0.0, 0.0, "navigation.goal = { x = 2.0, y = 0.0 }"),
    member("b", 60.0, 0.0, "navigation.goal = { x = 62.0, y = 0.0 }"),
]


IN_HALLS = {"seconds": 3.0, "world": "halls.toml"}


@pytest.fixture
def far_apart(fleet_of) -> Fleet:
    return drive(fleet_of(*FAR, **IN_HALLS))


def test_out_of_reach_it_drives_as_alone(fleet_of, far_apart, tmp_path: Path) -> None:
    (alone,) = fleet_of(FAR[0], **IN_HALLS)
    hashed = drive([alone]).episodes["a"].log.trace_sha256
    assert far_apart.episodes["a"].log.trace_sha256 == hashed
    # Also as the config by itself, whose world has no node, and whose gate reads no stamp of it.
    single = run_episode(load_config(
        "building",
        ["run.stop_after=3.0", f"run.seed={alone.config.run.seed}", "robot.name=a",
         f"world.ref={tmp_path / 'halls.toml'}",
         "navigation.start={x=0.0,y=0.0,heading_deg=0.0}", "navigation.goal={x=2.0,y=0.0}"],
    ))  # fmt: skip
    assert single.recorder.truth == far_apart.episodes["a"].recorder.truth
    assert single.log.trace_sha256 == hashed


def test_a_fleet_is_repeatable_and_its_hash_covers_each_member(fleet_of, far_apart) -> None:
    again = drive(fleet_of(*FAR, **IN_HALLS))
    assert again.trace_sha256 == far_apart.trace_sha256
    moved = FAR[1].replace("62.0", "61.5")
    other = drive(fleet_of(FAR[0], moved, **IN_HALLS))
    assert other.episodes["a"].log.trace_sha256 == again.episodes["a"].log.trace_sha256
    assert other.trace_sha256 != again.trace_sha256


def test_one_that_has_arrived_stands_in_the_way_of_the_others(fleet_of) -> None:
    """a is at its goal from the start and ends early; b drives blindly into it, and only b has that contact."""
    fleet = drive(
        fleet_of(
            member("a", 0.0, 0.0, "navigation.goal = { x = 0.05, y = 0.0 }"),
            member("b", 2.0, 180.0, BLIND + ", navigation.goal = { x = -2.0, y = 0.0 }"),
            seconds=8.0,
        )
    )
    ended = fleet.episodes["a"]
    assert ended.result.outcome == "succeeded" and ended.log.ticks < fleet.episodes["b"].log.ticks
    assert {(touch.name, touch.is_own) for touch in fleet.episodes["b"].trail.contacts} == {("a", True)}
    last = fleet.episodes["b"].recorder.bodies[-1]
    assert last.poses[0, :2] == pytest.approx(ended.recorder.driven[-1])
    assert last.velocities[0].tolist() == [0.0, 0.0, 0.0]


def test_members_that_touch_at_their_starts_are_refused(fleet_of) -> None:
    with pytest.raises(ConfigError, match="member a: start: touches b there"):
        drive(fleet_of(member("a", 0.0, 0.0), member("b", 0.4, 0.0)))


def test_equal_robots_have_different_noise(fleet_of) -> None:
    first, second = fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 0.0))
    assert first.config.run.seed != second.config.run.seed
    (alone,) = fleet_of(member("b", 3.0, 0.0))
    assert alone.config.run.seed == second.config.run.seed


def test_no_other_command_takes_a_fleet_for_one_robot(fleet_of, tmp_path: Path) -> None:
    fleet_of(*FAR)
    with pytest.raises(ConfigError, match="member: several robots, which only `navloom run` and `compare` drive"):
        load_config(str(tmp_path / "fleet.toml"))


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ('[[member]]\nconfig = "building"', "member.0.name: is missing"),
        ('[[member]]\nname = "a"\nstrat = 1', "member a: member.0.strat"),
        ('[[member]]\nname = "a"\nconfig = "bilding"', "bilding.*no such file"),
        ('[[member]]\nname = "a"\nconfig = "building"\nset = 3', "member a: member.0.set"),
        ('[[member]]\nname = "a"\nset = { robot.hight = 1.0 }', "member a: robot.hight"),
        ('[[member]]\nname = "a"\n[[member]]\nname = "a"', r"two tables \[\[member\]\] are named"),
        (
            '[[member]]\nname = "a"\n[[member]]\nname = "b"\nset = { run.period = 0.1 }',
            "member b: run.period: is another one than that of a",
        ),
    ],
)
def test_members_that_do_not_fit_are_refused(tmp_path: Path, tables: str, said: str) -> None:
    path = tmp_path / "fleet.toml"
    path.write_text(tables)
    with pytest.raises(ConfigError, match=said):
        load_fleet(str(path))


def test_the_fleet_s_tables_lie_over_a_member_s_config_and_its_own_over_both(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text('[planner]\nplugin = "astar"\ninflation_margin = 0.2\n[robot]\nheight = 0.5\n')
    path = tmp_path / "fleet.toml"
    path.write_text(
        '[robot]\nheight = 0.7\n[world]\nref = "here.toml"\n[[member]]\nname = "a"\nconfig = "one.toml"\n'
        'set = { robot.wheel_radius = 0.11 }\n[[member]]\nname = "b"\nset = { run.seed = 5 }\n'
    )
    first, second = load_fleet(str(path), ["robot.realm=yard"])
    assert (first.config.robot.height, first.config.robot.wheel_radius, first.config.robot.name) == (0.7, 0.11, "a")
    assert first.config.planner.params == {"inflation_margin": 0.2}
    assert first.base_of("world.ref") == second.base_of("world.ref") == tmp_path
    assert (second.config.robot.realm, second.config.run.seed) == ("yard", 5)


@pytest.fixture
def run_of(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    """`navloom run` of the fleet: exit code, output, errors. Plugin files are forgotten afterwards."""
    monkeypatch.setenv(one_file.FILES, "[]")
    monkeypatch.setattr(one_file, "_LOADED", {})

    def run(*options: str) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["navloom", "run", str(tmp_path / "fleet.toml"), *options])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return ended.value.code, out, err

    yield run
    for path in one_file._LOADED:
        sys.modules.pop(path.stem, None)


def test_run_prints_a_row_a_member(run_of, fleet_of) -> None:
    fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 180.0))
    code, out, _ = run_of()
    head, first, second, last, *_ = out.splitlines()
    assert (code, head.split()[:2]) == (1, ["member", "outcome"])
    assert [row.split()[:2] for row in (first, second)] == [["a", "stopped"], ["b", "stopped"]]
    assert last.startswith("0 of 2 reached their goals; 0 collisions; robot time 1 s in ")


def test_each_member_is_recorded_and_its_recording_replays(run_of, fleet_of, in_process, tmp_path: Path) -> None:
    fleet_of(*NEAR[:2])
    _, out, _ = run_of("--record", str(tmp_path / "run.mcap"), "--json")
    told = json.loads(out)["written"]["record"]
    assert [(Path(file["file"]).name, file["complete"]) for file in told] == [
        ("run.a.mcap", True),
        ("run.b.mcap", True),
    ]
    code, out, err = in_process("replay", told[1]["file"], "--check")
    assert code == 0, err
    assert "could be compared are those recorded, bit for bit" in out


@pytest.mark.parametrize("option", ["--record", "--rerun"])
def test_what_needs_every_message_is_refused_with_several_processes(run_of, fleet_of, tmp_path: Path, option) -> None:
    fleet_of(*NEAR[:2])
    code, _, err = run_of(option, str(tmp_path / "file"), "--processes", "2")
    assert code == 2 and "need all members in one process" in err


def test_two_that_drive_blindly_at_each_other_both_have_a_contact_of_their_own(fleet_of) -> None:
    """Robots of 0.5 m from x = 0 and x = 3 m, equally fast: they meet at x = 1.5 m, to within a tick of 25 mm each."""
    fleet = drive(
        fleet_of(
            member("a", 0.0, 0.0, BLIND + ", navigation.goal = { x = 4.0, y = 0.0 }"),
            member("b", 3.0, 180.0, BLIND + ", navigation.goal = { x = -1.0, y = 0.0 }"),
            seconds=6.0,
        )
    )
    for name, other in (("a", "b"), ("b", "a")):
        (touch,) = fleet.episodes[name].trail.contacts
        assert (touch.name, touch.is_own, touch.x) == (other, True, pytest.approx(1.5, abs=0.025))


NEAR = [
    member("a", 0.0, 0.0, "navigation.goal = { x = 4.0, y = 0.0 }"),
    member("b", 3.0, 180.0, "navigation.goal = { x = -1.0, y = 0.0 }"),
    member("c", 1.5, 90.0, BLIND + ", navigation.goal = { x = 1.5, y = 3.0 }"),
    member("d", -2.0, 0.0, "navigation.goal = { x = -1.95, y = 0.0 }"),
]


def test_the_number_of_processes_changes_nothing(fleet_of, tmp_path: Path) -> None:
    """Robots that see and hinder each other, one of which ends early: the same hashes, files, contacts and trails."""
    members = fleet_of(*NEAR, seconds=3.0)
    fleets, traces = [], []
    for processes in (1, 2, 4):
        folder = tmp_path / str(processes)
        folder.mkdir()
        with ExitStack() as files:
            opened = {one.member: files.enter_context((folder / one.member).open("wb")) for one in members}
            fleets.append(drive(members, traces=opened, processes=processes, reads=[("platform", "laser")]))
        traces.append([(folder / one.member).read_bytes() for one in members])
    alone, *spread = fleets
    for fleet, written in zip(spread, traces[1:], strict=True):
        assert fleet.trace_sha256 == alone.trace_sha256
        assert written == traces[0]
        for name, episode in alone.episodes.items():
            other = fleet.episodes[name]
            assert other.log.trace_sha256 == episode.log.trace_sha256
            assert other.recorder.truth == episode.recorder.truth
            assert other.recorder.contacts == episode.recorder.contacts
            assert len(other.recorder.bodies) == len(episode.recorder.bodies) == episode.log.ticks
            scans, others = (one.recorder.streams["platform", "laser"] for one in (episode, other))
            assert [time for time, _ in others] == [time for time, _ in scans]


def test_what_a_plugin_refuses_in_another_process_is_said_once(fleet_of) -> None:
    refused = "[{ name = 'laser', kind = 'laser_2d', rate_hz = 7.0 }]"
    members = fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 0.0, f"{STANDS}, sensor = {refused}"))
    with pytest.raises(ConfigError) as alone:
        drive(members)
    with pytest.raises(ConfigError) as spread:
        drive(members, processes=2)
    assert str(spread.value) == str(alone.value)
    assert not multiprocessing.active_children()


def test_a_process_that_dies_ends_the_run_with_one_message(fleet_of) -> None:
    def kill(done: float, total: float) -> None:
        for child in multiprocessing.active_children():
            child.kill()

    with pytest.raises(FleetError, match=r"fleet: the process of b was killed by SIGKILL"):
        drive(fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 0.0), seconds=60.0), processes=2, progress=kill)
    assert not multiprocessing.active_children()


def test_ctrl_c_ends_every_process(fleet_of, tmp_path: Path) -> None:
    """The traces up to there are whole files."""

    def interrupt(done: float, total: float) -> None:
        raise KeyboardInterrupt

    members = fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 0.0), seconds=60.0)
    with ExitStack() as files:
        opened = {name: files.enter_context((tmp_path / name).open("wb")) for name in "ab"}
        with pytest.raises(KeyboardInterrupt):
            drive(members, traces=opened, processes=2, progress=interrupt)
    assert not multiprocessing.active_children()
    ticks = [[entry.tick for entry in read_trace(tmp_path / name)] for name in "ab"]
    assert ticks[0] and ticks[0][-1] == ticks[1][-1]


OBSERVER = """
import json, pathlib
from navloom import hookimpl

class Truths:
    wants = {("platform", "truth")}
    def __init__(self):
        self.count = 0
    def on_message(self, role, instance, active, port, message, at):
        self.count += 1

SEEN = {}

@hookimpl
def navloom_register(registry):
    pass

@hookimpl
def navloom_observe(run):
    return SEEN.setdefault(run.robot, Truths())

@hookimpl
def navloom_run_finished(run, summary, out):
    told = {"heard": SEEN[run.robot].count, "ticks": summary["ticks"], "out": out.folder.name}
    pathlib.Path(__file__).with_name(f"{run.robot}.json").write_text(json.dumps(told))
"""


def test_observers_of_plugins_follow_each_member(run_of, fleet_of, tmp_path: Path) -> None:
    fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 180.0))
    (tmp_path / "counting.py").write_text(OBSERVER)
    run_of("--plugin", str(tmp_path / "counting.py"), "--out", str(tmp_path / "out"))
    for name in "ab":
        told = json.loads((tmp_path / f"{name}.json").read_text())
        assert told == {"heard": told["ticks"], "ticks": told["ticks"], "out": name} and told["ticks"] >= 20


def test_observers_are_told_of_members_elsewhere_without_their_messages(run_of, fleet_of, tmp_path: Path) -> None:
    fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 180.0))
    (tmp_path / "counting.py").write_text(OBSERVER)
    _, _, err = run_of("--plugin", str(tmp_path / "counting.py"), "--processes", "2", "--out", str(tmp_path / "out"))
    assert err.count("--processes 2: observers got no messages of b: use one process") == 1
    here, there = (json.loads((tmp_path / f"{name}.json").read_text()) for name in "ab")
    assert (here["heard"], there["heard"]) == (here["ticks"], 0)


def test_one_robot_has_one_process(run_of, tmp_path: Path) -> None:
    (tmp_path / "fleet.toml").write_text("")
    code, _, err = run_of("--processes", "2")
    assert code == 2 and "has no [[member]], and one robot has one process" in err


@pytest.mark.slow
def test_fifty_robots_have_the_same_hashes_on_one_two_and_four_processes(fleet_of) -> None:
    """A row of robots, 1.2 m apart, each of which drives past its neighbour."""
    crowd = [
        member(f"r{k}", 1.2 * k, 180.0 * (k % 2),
               f"avoider.plugin = 'improved_vfh', navigation.goal = {{ x = {1.2 * k + 2.4 * (-1) ** k}, y = 1.0 }}")
        for k in range(50)
    ]  # fmt: skip
    members = fleet_of(*crowd, seconds=10.0, world="halls.toml")
    fleets = [drive(members, processes=processes) for processes in (1, 2, 4)]
    hashes = [[episode.log.trace_sha256 for episode in fleet.episodes.values()] for fleet in fleets]
    assert len(set(hashes[0])) == 50 and hashes == [hashes[0]] * 3
    assert len({fleet.trace_sha256 for fleet in fleets}) == 1
