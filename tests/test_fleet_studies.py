"""Studies of fleets: the fleet is the row and the unit of pairing, with a row for each member beside it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from navloom.config import ConfigError
from navloom.runs.contacts import Touch
from navloom.runs.episode_trail import Trail
from navloom.runs.fleet import load_fleet, run_fleet
from navloom.runs.fleet_metrics import FLEET_METRICS, fleet_trail
from navloom.runs.metrics import measure
from navloom_study import plan_study, run_study
from navloom_study.study_request import Study, StudyResult
from navloom_study.tracks import encoded_together, file_of, read_track

Plan = Callable[..., Study]
FLEET = """
[run]
seed = 1
stop_after = 0.5

[world]
ref = "fleet:circle#1?robots=4"

[mapper]
plugin = "known_map"  # the goals of three are occupied by others at first

[[member]]
name = "r"
config = "explore"
count = 2

[[member]]
name = "last"
config = "explore"
set = { avoider.plugin = "vff" }
"""


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    path = tmp_path / "fleet.toml"
    path.write_text(FLEET)
    return lambda *vary, **given: plan_study(str(path), vary, **given)


@pytest.fixture
def studied(plan: Plan, tmp_path: Path) -> StudyResult:
    with ThreadPoolExecutor(1) as executor:
        return run_study(plan("avoider=vff,vfh", seeds=[0, 1]), tmp_path / "out", executor=executor)


def test_a_fleet_is_a_row_a_pair_and_one_value_of_an_interval(studied: StudyResult) -> None:
    """Three members and two seeds are two episodes a method and two pairs, not six."""
    assert [(row.key.method, row.key.seed) for row in studied.rows] == [("vff", 0), ("vff", 1), ("vfh", 0), ("vfh", 1)]
    assert studied.comparison.summary("vff", "arrived").episodes == 2
    assert studied.comparison.difference("vfh", "arrived").estimate.episodes == 2


def test_each_member_has_a_row_in_the_journal_and_in_the_table(studied: StudyResult, tmp_path: Path) -> None:
    names = ["r1", "r2", "last"]
    assert [one.name for one in studied.rows[0].members] == names
    assert list(studied.members()["vfh"]) == names
    assert studied.members()["vfh"]["last"]["outcomes"] == {"timeout": 2}
    lines = list(csv.DictReader((tmp_path / "out" / "members.csv").open()))
    assert [line["member"] for line in lines] == names * 4
    assert float(lines[0]["path_length"]) == pytest.approx(studied.rows[0].members[0].metrics["path_length"])


def test_a_row_is_the_run_of_the_same_fleet(plan: Plan, studied: StudyResult, tmp_path: Path) -> None:
    fleet = run_fleet(load_fleet(str(tmp_path / "fleet.toml"), ["avoider.plugin=vfh"], seed=1))
    assert studied.rows[-1].trace_sha256 == fleet.trace_sha256
    assert [one.trace_sha256 for one in studied.rows[-1].members] == [
        episode.log.trace_sha256 for episode in fleet.episodes.values()
    ]


def test_the_default_seed_is_that_of_the_fleet(plan: Plan) -> None:
    assert plan().seeds == (1,)


def test_the_same_command_continues_a_study_of_fleets(plan: Plan, studied: StudyResult, tmp_path: Path) -> None:
    journal = tmp_path / "out" / "journal.jsonl"
    first, *_ = journal.read_text().splitlines(keepends=True)
    journal.write_text(first)
    with ThreadPoolExecutor(1) as executor:
        again = run_study(plan("avoider=vff,vfh", seeds=[0, 1]), tmp_path / "out", executor=executor)
    assert again.before == 1
    assert [row.members for row in again.rows] == [row.members for row in studied.rows]


def test_a_report_tells_the_members_and_what_counts_as_one(studied: StudyResult, tmp_path: Path) -> None:
    from navloom_study.report.study_report import write_report

    text = write_report(tmp_path / "out").markdown
    assert "2 methods × 1 worlds × 2 seeds: 4 closed-loop fleets" in text
    assert "The members of one fleet depend on each other" in text
    assert "| last | 0 of 2 |" in text


def test_a_member_alone_is_varied_by_its_name(plan: Plan, tmp_path: Path) -> None:
    study = plan("member.r2.avoider=vff,vfh", "controller.look_ahead_time=1.0")
    assert [method.name for method in study.methods] == [
        "r2.avoider=vff+look_ahead_time=1.0", "r2.avoider=vfh+look_ahead_time=1.0",
    ]  # fmt: skip
    second = study.methods[1]
    assert [one.config.avoider.plugin for one in second.members] == ["dwa", "vfh", "vff"]
    # The changes of the method give the same fleet to `navloom run`.
    again = load_fleet(str(tmp_path / "fleet.toml"), second.changes)
    assert [one.sha256() for one in again] == [one.sha256() for one in second.members]


def test_a_plugin_that_one_member_has_already_is_changed_in_the_others(plan: Plan) -> None:
    (method,) = plan("avoider=vff").methods
    assert [one.config.avoider.plugin for one in method.members] == ["vff", "vff", "vff"]
    assert 'member.r1.avoider.plugin="vff"' in method.changes


def test_members_take_the_tasks_of_each_world(plan: Plan) -> None:
    study = plan(worlds=["fleet:circle#0-1?robots=4"])
    assert [world.values for world in study.worlds] == [
        {"world.ref": "fleet:circle#0?robots=4"}, {"world.ref": "fleet:circle#1?robots=4"},
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("vary", "given", "said"),
    [
        (["avoider=vff,vfh"], {"open_loop": True}, "--open-loop: the config is of a fleet"),
        ([], {"is_live": True}, "--live: the config is of a fleet"),
        (["member.r3.avoider=vff"], {}, "no member r3; known are last, r1, r2"),
        (["member.r2.method=a"], {}, "expected member.NAME.PLACE, as in member.r2.avoider=a,b"),
        ([], {"changes": ["member.r2=3"]}, "expected member.NAME.PLACE=VALUE"),
        ([], {"worlds": ["fleet:circle#0?robots=2"]}, "has tasks for 2 robots, and last is number 3"),
        ([], {"primary": ["spl"]}, "--primary spl: no such metric"),
    ],
)
def test_what_does_not_fit_a_fleet_is_refused(plan: Plan, vary: list[str], given: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        plan(*vary, **given)


def drove(outcome: str, seconds: int, speed: float = 0.5, **more: object) -> Trail:
    """A drive along x in ticks of 1 s, with a limit of 60 s."""
    time = np.arange(seconds + 1.0)
    flat, never = np.zeros_like(time), np.zeros(time.size, dtype=np.bool_)
    return Trail(
        time=time, x=speed * time, y=flat, heading=flat, vx=flat, wz=flat, clearance=flat + 1.0, cross_track=flat,
        command_vx=flat, command_wz=flat, engaged=never, stopped_by_gate=never, outcome=outcome, reason="",
        touches=len(more.get("contacts", ())), recoveries=0, gate_stops=0, period=1.0, optimal=None, goal_distance=0.0,
        limit=60.0, max_linear=0.5, max_deceleration=1.0, reaction=0.1, tick_ns=np.full(time.size, 1000), **more,
    )  # fmt: skip


def found(**members: Trail) -> tuple[str, dict[str, float | None]]:
    trail = fleet_trail(members)
    return trail.outcome, measure(trail, FLEET_METRICS)


def test_a_fleet_succeeds_with_its_last_member() -> None:
    outcome, values = found(a=drove("succeeded", 12), b=drove("succeeded", 30))
    assert (outcome, values["success"], values["arrived"], values["makespan"]) == ("succeeded", 1.0, 1.0, 30.0)
    outcome, values = found(a=drove("succeeded", 12), b=drove("timeout", 60))
    assert (outcome, values["success"], values["arrived"], values["makespan"]) == ("timeout", 0.0, 0.5, 60.0)


@pytest.mark.parametrize(
    ("member", "deadlock"),
    [
        (drove("timeout", 60, speed=0.0), 1.0),
        (drove("timeout", 60, speed=0.09), 1.0),  # 0.9 m in the last 10 s
        (drove("timeout", 60, speed=0.11), 0.0),
        (drove("succeeded", 60, speed=0.0), 0.0),
        (drove("collision", 60, speed=0.0, contacts=(Touch(1.0, "wall", 0.0, 0.0, True),)), 0.0),
    ],
)
def test_a_deadlock_is_one_that_no_longer_gets_on_without_a_contact(member: Trail, deadlock: float) -> None:
    outcome, values = found(a=drove("succeeded", 12), b=member)
    assert values["deadlock"] == deadlock and (outcome == "deadlock") == bool(deadlock)


def test_contacts_between_members_count_for_both_and_others_are_collisions_only() -> None:
    """a drives into b, which stands; c touches a wall."""
    _, values = found(
        a=drove("collision", 9, contacts=(Touch(9.0, "b", 0.0, 0.0, True),)),
        b=drove("collision", 9, contacts=(Touch(9.0, "a", 0.0, 0.0, False),)),
        c=drove("collision", 9, contacts=(Touch(9.0, "wall", 0.0, 0.0, True),)),
    )
    assert (values["own_contacts"], values["others_contacts"], values["collisions"]) == (1.0, 1.0, 3.0)


def test_the_tracks_of_members_are_in_one_file(studied: StudyResult, tmp_path: Path) -> None:
    track = read_track(tmp_path / "out", studied.rows[0].key)
    assert track is not None and len(track.others) == 2
    # Four starts on a circle of 3 m, each moved by at most 0.15 m in x and y.
    assert np.hypot(*track.others[0].points[0]) == pytest.approx(3.0, abs=0.22)


def test_the_track_of_one_that_arrived_is_told_apart(tmp_path: Path) -> None:
    from navloom_study.episode_key import EpisodeKey

    there, short = drove("succeeded", 10), drove("timeout", 8)
    key = EpisodeKey("m", "w", 0)
    (tmp_path / "trails").mkdir()
    ways = [(there, (5.0, 0.0), 0.2), (short, (5.0, 0.0), 0.2)]
    (tmp_path / "trails" / file_of(key)).write_bytes(encoded_together(ways))
    track = read_track(tmp_path, key)
    assert track is not None and (track.is_there, track.others[0].is_there) == (True, False)


def test_the_command_prints_fleets_then_members(in_process, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "fleet.toml"
    path.write_text(FLEET)
    code, out, err = in_process("compare", str(path), "--seeds", "0:2", "--jobs", "1", "--json")
    told = json.loads(out)
    assert code == 0, err
    assert list(told["episodes"][0]["members"]) == ["r1", "r2", "last"]
    assert told["member_summary"]["as_configured"]["r1"]["episodes"] == 2
