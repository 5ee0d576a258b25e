"""Fleets: robots in one world that see and touch each other, and that drive as alone where the others are far away."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from navloom.cli import main
from navloom.config import ConfigError, load_config
from navloom.runs.episode import run_episode
from navloom.runs.fleet import Fleet, load_fleet, run_fleet

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


def test_run_prints_a_row_a_member_and_refuses_a_recording(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], fleet_of, tmp_path: Path
) -> None:
    fleet_of(member("a", 0.0, 0.0), member("b", 3.0, 180.0))

    def run(*options: str) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["navloom", "run", str(tmp_path / "fleet.toml"), *options])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return ended.value.code, out, err

    code, out, _ = run()
    head, first, second, last, *_ = out.splitlines()
    assert (code, head.split()[:2]) == (1, ["member", "outcome"])
    assert [row.split()[:2] for row in (first, second)] == [["a", "stopped"], ["b", "stopped"]]
    assert last.startswith("0 of 2 reached their goals; 0 collisions; robot time 1 s in ")
    code, _, err = run("--record", str(tmp_path / "run.mcap"))
    assert code == 2 and "a fleet is neither recorded nor shown" in err


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
