"""Findings of the doctor, from the descriptions of nodes and from what a robot leaves over on its host."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from described import BusInWords, client, counts, described, everyone
from navloom.messages import Feedback, GateStatus, StopReason
from navloom_live.hosting.runtime_folders import DirectoryError, Fate, RobotFolder, Running
from navloom_live.live.description import Description, StreamSummary
from navloom_live.operating import diagnosis
from navloom_live.operating.diagnosis import diagnose, examine
from navloom_live.operating.health_findings import (
    Finding,
    differing,
    doubled,
    failing,
    flowing,
    lagging,
    loop_rate,
    sharing,
    unheard,
)
from navloom_live.operating.host_faults import fate_in_words, is_stopped, left_behind, restarting
from navloom_live.transport.links import LinkError


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "rt"))
    # A node that does not step is queried twice, without the two seconds between.
    monkeypatch.setattr(diagnosis, "STEP_WAIT", 0.01)
    return tmp_path / "rt"


def only(found: list[Finding]) -> Finding:
    assert len(found) == 1, found
    return found[0]


def said(found: list[Finding]) -> list[str]:
    return [finding.what for finding in found]


# --- descriptions of nodes ------------------------------------------------------------------------------------------


def test_a_healthy_robot_has_no_findings() -> None:
    nodes = everyone()
    assert [check(nodes) for check in (failing, flowing, differing, unheard, sharing)] == [[]] * 5
    assert examine(client(BusInWords(nodes)), None, "robot.toml") == (7, [])


def test_a_plugin_that_raises_is_named_with_its_cause_and_a_substitute_is_advised() -> None:
    other = described("avoider", "forces", active=False)
    once = only(failing([*everyone(avoider={"faulted": 1, "fault": "ValueError: no ranges"}), other]))
    assert once.severity == "problem"
    assert once.what == "avoider vfh failed in its last step: ValueError: no ranges"
    assert once.remedy == "fix the plugin; `navloom swap avoider forces` makes another active"
    often = only(failing(everyone(avoider={"faulted": 3, "fault": "ValueError: no ranges"})))
    assert often.what == "avoider vfh failed 3 steps in a row: ValueError: no ranges"


@pytest.mark.parametrize(
    ("role", "changes", "advice"),
    [
        (
            "avoider",
            {},
            "the config has no other avoider to swap to: restart the robot with another plugin in [avoider]",
        ),
        ("platform", {}, "a platform cannot be swapped: restart the robot with another plugin in [platform]"),
        ("avoider", {"active": False}, "it is not active, so the robot drives without it"),
        ("goal", {"plugin": None}, "it is a node of navloom itself: report this with the log of its process"),
    ],
    ids=["no alternative", "platform", "shadow", "own node"],
)
def test_the_advice_about_a_plugin_that_raises_can_be_followed(role: str, changes: dict[str, Any], advice: str) -> None:
    found = only(failing(everyone(**{role: {"faulted": 2, "fault": "E", **changes}})))
    assert found.remedy == f"fix the plugin; {advice}"


def test_a_plugin_slower_than_its_period_is_named_with_both_times_and_what_to_do() -> None:
    found = only(failing(everyone(controller={"step_s": 0.0824})))
    assert found.what == "controller law takes 82 ms per step, longer than its period of 50 ms"
    assert found.remedy.startswith("make it faster, or run.period longer; the config has no other controller")
    assert only(failing(everyone(controller={"step_s": 0.0824, "active": False}))).severity == "note"
    assert failing(everyone(controller={"step_s": 0.05}, mapper={"step_s": 0.4})) == []  # no node waits for a mapper


def test_a_command_far_beyond_the_limits_is_a_note() -> None:
    note = "avoider vfh asked for 46 times the turn limit: degrees?"
    found = only(failing(everyone(avoider={"notes": [note]})))
    assert (found.severity, found.what) == ("note", note) and "rad/s" in found.remedy


def test_ticks_late_because_of_a_slow_platform_are_reported_once() -> None:
    found = only(failing(everyone(platform={"step_s": 0.08, "late_ticks": 90, "ticks": 100})))
    assert found.what.startswith("platform sim takes 80 ms per step")


@pytest.mark.parametrize("goal_id", [0, 3], ids=["without a goal", "with a goal"])
def test_a_localizer_that_is_lost_is_a_problem_with_what_helps(goal_id: int) -> None:
    lost = Feedback(goal_id, "searching" if goal_id else "idle", 0.0, 0.0, 0.0, 0, "lost: 24% of the echoes fit")
    last = {"gate/main/status": status("no_trajectory"), "goal/main/feedback": lost}
    found = only(examine(client(BusInWords(everyone(), last=last)), None, "robot.toml")[1])
    assert (found.severity, found.what) == ("problem", "the localizer is lost: 24% of the echoes fit")
    assert "`navloom place X Y HEADING` tells it where it is" in found.remedy


def test_a_stop_for_a_slow_plugin_is_not_reported_twice() -> None:
    last = {"gate/main/status": status("stale: controller law")}
    nodes = everyone(controller={"step_s": 0.3, "streams": {"a": counts(dropped=500)}})
    assert said(examine(client(BusInWords(nodes, last=last)), None, "robot.toml")[1]) == [
        "controller law takes 300 ms per step, longer than its period of 50 ms"
    ]


@pytest.mark.parametrize(
    "reason",
    ["stale: controller law", "gone: localizer odometry", "gone: goal main does not step", "stale: goal main",
     "silent: platform", "silent: sensor sonars", "silent: avoider", "old_selection: avoider vfh", "ending",
     "of a later version"],
)  # fmt: skip
def test_the_advice_of_the_doctor_is_not_to_run_the_doctor(reason: str) -> None:
    bus = BusInWords(everyone(), last={"gate/main/status": status(reason)})
    found = only(examine(client(bus), None, "robot.toml")[1])
    assert "doctor" not in found.remedy and found.remedy
    assert ("`navloom hz platform/sonars`" in found.remedy) == (reason == "silent: sensor sonars")


def test_consequences_of_a_broken_platform_are_reported_with_it() -> None:
    broken = {"faulted": 40, "fault": "OSError: no such port", "tick": -1}
    rest = {role: {"tick": -1} for role in ("localizer", "goal", "gate")}
    last = {"gate/main/status": status("silent: platform")}
    nodes = [*everyone(platform=broken, **rest), described("reference", "main", tick=-1)]
    found = only(examine(client(BusInWords(nodes, last=last, steps=0)), None, "robot.toml")[1])
    assert found.what == (
        "platform sim failed 40 steps in a row: OSError: no such port; "
        "localizer odometry, goal main, gate main, reference main wait for it"
    )
    assert "swap" not in found.remedy.replace("cannot be swapped", "")


def test_a_node_that_does_not_step_is_reported_beside_a_late_platform() -> None:
    class OneStands(BusInWords):
        def _description(self, node: Any) -> Any:
            self.steps = 0 if node.role == "localizer" else 1
            return super()._description(node)

    nodes = everyone(platform={"late_ticks": 90, "ticks": 100})
    assert said(examine(client(OneStands(nodes)), None, "robot.toml")[1]) == [
        "platform sim: 90 of 100 ticks since its start came late",
        "localizer odometry has not stepped since tick 100 (robot on base)",
    ]


def test_a_slow_node_of_the_framework_is_not_reported_as_a_slow_plugin() -> None:
    found = only(failing(everyone(goal={"plugin": None, "step_s": 0.08})))
    assert found.remedy == "its host is overloaded: end other programs there, or make run.period longer"


def test_nodes_that_wait_for_a_missing_process_are_reported_with_it() -> None:
    nodes = without("robot", tick=-1)
    found = only(examine(client(BusInWords(nodes, steps=0)), None, "robot.toml")[1])
    assert found.what == (
        "platform sim, localizer odometry: missing; of process robot; goal main, gate main wait for it"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("role", "seconds", "is_said"),
    [("avoider", 0.4, False), ("avoider", 0.6, True), ("mapper", 4.9, False), ("mapper", 5.1, True)],
)
def test_a_step_may_take_half_a_second_and_that_of_a_mapper_five(role: str, seconds: float, is_said: bool) -> None:
    found = failing(everyone(**{role: {"busy_s": seconds}}))
    assert said(found) == ([f"{role} {'vfh' if role == 'avoider' else 'grid'} has been in one step for "
                            f"{seconds:.1f} s"] if is_said else [])  # fmt: skip


@pytest.mark.parametrize(
    ("late", "ticks", "is_said"), [(20, 100, False), (21, 100, True), (100, 10_000, False), (101, 10_000, True)]
)
def test_ticks_may_be_late_twenty_times_or_in_one_of_a_hundred(late: int, ticks: int, is_said: bool) -> None:
    found = failing(everyone(platform={"late_ticks": late, "ticks": ticks}))
    assert said(found) == ([f"platform sim: {late} of {ticks} ticks since its start came late"] if is_said else [])


@pytest.mark.parametrize(
    ("driven", "own", "is_said"), [(0, 0, False), (100, 80, False), (100, 79, True), (10_000, 9_500, False),
                                   (10_000, 9_499, True)]
)  # fmt: skip
def test_one_tick_in_twenty_may_be_driven_by_an_old_command(driven: int, own: int, is_said: bool) -> None:
    found = lagging(everyone(platform={"driven_ticks": driven, "own_ticks": own}))
    what = f"{driven - own} of {driven} ticks were driven by the command of an earlier tick"
    assert said(found) == ([what] if is_said else [])


def test_a_robot_that_lags_gets_the_rate_that_it_can_hold() -> None:
    gate = {"chain_p50_s": 0.006, "chain_p99_s": 0.016}
    nodes = everyone(platform={"driven_ticks": 1000, "own_ticks": 400}, gate=gate)
    assert only(lagging(nodes)).what == (
        "600 of 1000 ticks were driven by the command of an earlier tick; a tick's commands take 6.0 ms "
        "(99 %: 16.0 ms): these processes sustain up to 25 Hz"
    )
    rate = loop_rate(nodes)
    assert rate is not None and rate.holds_hz == 25.0
    assert loop_rate(everyone()) is None


def test_malformed_messages_are_reported_with_reader_and_reason() -> None:
    streams = {"mapper/grid/map": counts(malformed=3, complaint="shape is (2,), expected (n, 2)")}
    found = only(flowing(everyone(goal={"streams": streams})))
    assert found.what == (
        "goal main: 3 malformed messages on mapper/grid/map: shape is (2,), expected (n, 2)"
    )  # fmt: skip
    assert "same version of navloom" in found.remedy


@pytest.mark.parametrize(
    ("misrouted", "severity", "advice"),
    [
        (1, "note", "Zenoh can confuse two streams when a process restarts; "
         "nothing to do while the count does not rise"),
        (20, "note", "Zenoh can confuse two streams when a process restarts; "
         "nothing to do while the count does not rise"),
        (21, "problem", "find the publisher, such as a replay or a second robot of this name; if there is none, "
         "restart the router, or the robot if it has no router"),
    ],
)  # fmt: skip
def test_messages_of_another_stream_are_not_blamed_on_versions(misrouted: int, severity: str, advice: str) -> None:
    streams = {"avoider/vfh/command": counts(misrouted=misrouted, origin="lab/r1/goal/main/step")}
    found = only(flowing(everyone(gate={"streams": streams})))
    assert found == Finding(severity, (  # type: ignore[arg-type]
        f"gate main: {misrouted} messages on avoider/vfh/command belong to another stream and were refused, the last "
        "to lab/r1/goal/main/step"
    ), advice)  # fmt: skip


@pytest.mark.parametrize(
    ("given", "is_said"),
    [
        (counts(dropped=101), True),
        (counts(dropped=100), False),
        (counts(received=30, dropped=20), False),
        (counts(received=30, dropped=21), True),
        (counts(dropped=900, latest=True), False),
    ],
    ids=["above a tenth", "a tenth", "few", "not few", "only the newest counts"],
)
def test_messages_dropped_unread_are_reported_where_each_counts(given: StreamSummary, is_said: bool) -> None:
    found = flowing(everyone(mapper={"streams": {"platform/sim/sonars": given}}))
    words = f"mapper grid: {given.dropped} of {given.received} messages on platform/sim/sonars dropped unread"
    assert said(found) == ([words] if is_said else [])


def test_different_versions_are_reported_by_process_and_host() -> None:
    other = {"versions": {"navloom": "1.1", "numpy": "2.0"}, "host": "brain"}
    found = only(differing(everyone(mapper=other, goal=other)))
    assert found.what == (
        "navloom has different versions: "
        "1.0 in drive on base, robot on base, safe on base; 1.1 in think on brain"
    )  # fmt: skip
    assert found.remedy == "install the same version on every host"


def test_a_package_that_one_lacks_differs_too() -> None:
    found = only(differing([described("goal", "main"), described("gate", "main", versions={"navloom": "1.0"})]))
    assert found.what == "numpy has different versions: 2.0 in think on base; none in safe on base"


def test_different_configs_are_reported_by_their_hash() -> None:
    found = only(differing(everyone(gate={"config_sha256": "b" * 64})))
    assert found.what == (
        "the processes have different configs: "
        "aaaaaaaa in drive on base, robot on base, think on base; bbbbbbbb in safe on base"
    )  # fmt: skip
    assert "navloom config check --json" in found.remedy


def test_a_process_that_alone_receives_nothing_from_the_platform_is_reported() -> None:
    deaf = {"silence_s": 2.5, "host": "brain"}
    found = only(unheard(everyone(mapper=deaf, goal=deaf)))
    assert found.what == "process think on brain has not received a platform message for 2.5 s"
    assert found.remedy.startswith("the network between them")
    here = only(unheard(everyone(mapper={"silence_s": 2.5}, goal={"silence_s": 2.5})))
    assert here.remedy == "it hangs, or its host gives it no CPU time: `kill -KILL 4711` restarts it"
    everybody = everyone(**{node.role: {"silence_s": 2.5} for node in everyone()})
    assert unheard(everybody) == []  # the platform is silent then
    assert unheard(everyone(**{node.role: {"silence_s": None} for node in everyone()})) == []


@pytest.mark.parametrize(
    ("free", "severity", "words"),
    [
        (None, "problem", "base has no shared memory: a process that starts there cannot join"),
        (5.0, "problem", "base has only 5.0 MB of shared memory left: a process that starts there cannot join"),
        (12.0, "note", "base has 12 MB of shared memory left"),
    ],
    ids=["none", "short", "little"],
)
def test_short_shared_memory_is_reported_once_for_each_host(free: float | None, severity: str, words: str) -> None:
    found = only(sharing(everyone(**{node.role: {"shared_memory_mb": free} for node in everyone()})))
    assert (found.severity, found.what) == (severity, words)
    assert found.remedy == "give /dev/shm 16 MB for each process there (containers: --shm-size)"


def test_large_messages_that_leave_their_host_are_noted_and_small_ones_are_not() -> None:
    streams = {
        "platform/sim/sonars": counts(),
        "platform/sim/odometry": counts(),
        "localizer/odometry/pose": counts(),
        "platform/sim/camera": counts(received=0),
    }
    found = only(sharing(everyone(mapper={"host": "brain", "streams": streams})))
    assert found.severity == "note"
    assert found.what == "mapper grid on brain gets platform/sim/sonars over the network, from base"


# --- missing nodes --------------------------------------------------------------------------------------------------


def without(process: str, **changes: Any) -> list[Description]:
    return [replace(node, **changes) for node in everyone() if node.process != process]


def made(fates: dict[str, Fate], pid: int | None = None, robot: str = "r1") -> RobotFolder:
    folder = RobotFolder("lab", robot)
    folder.make()
    assert folder.lock()
    folder.write(Running("lab", robot, pid or os.getpid(), ("unixsock-stream//x",), False, "robot.toml", False))
    folder.write_fates(fates)
    return folder


def test_missing_nodes_are_reported_by_process_with_the_command_that_starts_it() -> None:
    count, found = examine(client(BusInWords(without("think"))), None, "robot.toml")
    assert count == 5
    assert only(found) == Finding(
        "problem", "mapper grid, goal main: missing; of process think", "`navloom node robot.toml think` starts it"
    )


def test_missing_nodes_of_another_host_are_started_there() -> None:
    nodes = without("think", hosts={"think": "brain", "robot": "base"})
    found = only(examine(client(BusInWords(nodes)), None, "robot.toml")[1])
    assert found.what == "mapper grid, goal main: missing; of process think on host brain"
    assert found.remedy.startswith("`navloom up robot.toml --host brain` there")


def test_the_last_output_of_a_supervised_process_is_reported() -> None:
    folder = made({"think": Fate(None, "waiting", 1, "ended with code 1")})
    (folder.path / "think.log").write_text("loading\nout of memory\n", "utf-8")
    found = only(examine(client(BusInWords(without("think"))), folder, "robot.toml")[1])
    assert found.what.endswith(
        "of process think: it ended with code 1 and its last message was: loading; out of memory"
    )
    assert found.remedy.startswith("`navloom up` restarts it") and "think.log" in found.remedy


def test_a_process_that_stays_down_is_reported_once_with_its_nodes() -> None:
    folder = made({"think": Fate(None, "failed", 5, "ended with code 1"), "safe": Fate(1, "running", 0, "")})
    found = only(examine(client(BusInWords(without("think"))), folder, "robot.toml")[1])
    assert found.what == (
        "mapper grid, goal main: missing; of process think: it ended with code 1; it stays down"
    )  # fmt: skip
    assert found.remedy == "fix what it reports, then `navloom down` and `navloom up`"


def test_nodes_that_are_announced_but_silent_are_reported_by_process() -> None:
    bus = BusInWords(without("drive"), silent=["controller law", "avoider vfh"])
    count, found = examine(client(bus), None, "robot.toml")
    assert count == 7
    what = "controller law, avoider vfh: announced, but not answering; of process drive"
    assert only(found).what == what
    folder = made({"drive": Fate(os.getpid(), "running", 0, "")})
    here = only(examine(client(bus), folder, "robot.toml")[1])
    assert here.what == f"{what}: it runs (pid {os.getpid()}) but is not ready, or hangs"
    assert f"`kill -KILL {os.getpid()}`" in here.remedy


def test_without_a_node_the_robots_that_are_up_are_named() -> None:
    bus = BusInWords([], others=["lab/r2/gate/main/alive/1"])
    count, found = examine(client(bus), None, "robot.toml")
    assert (count, only(found).what) == (
        0, "the network is up, but no node of robot lab/r1 is; there are lab/r2: choose with --robot",
    )  # fmt: skip


# --- stops and clocks -----------------------------------------------------------------------------------------------


def test_a_platform_that_does_not_tick_is_the_only_finding() -> None:
    found = only(examine(client(BusInWords(everyone(), steps=0)), None, "robot.toml")[1])
    assert found.what == (
        "platform sim has not stepped since tick 100 (robot on base); "
        "localizer odometry, goal main, gate main wait for it"
    )
    assert "it may wait for its hardware" in found.remedy and "`kill -KILL 4711`" in found.remedy


def test_a_single_node_that_does_not_step_is_reported() -> None:
    class OneStands(BusInWords):
        def _description(self, node: Any) -> Any:
            self.steps = 0 if node.role == "localizer" else 1
            return super()._description(node)

    found = only(examine(client(OneStands(everyone())), None, "robot.toml")[1])
    assert found.what == "localizer odometry has not stepped since tick 100 (robot on base)"


def status(reason: str, latched: bool = False) -> GateStatus:
    return GateStatus("none", "", True, latched, StopReason.parse(reason), ())


def test_a_latched_stop_is_reported_with_the_command_that_releases_it() -> None:
    bus = BusInWords(everyone(), last={"gate/main/status": status("operator", latched=True)})
    found = only(examine(client(bus), None, "robot.toml")[1])
    assert found.what == "the robot is stopped: by an operator"
    assert found.remedy == "`navloom resume` lets it drive again"


def test_a_stopped_robot_is_a_finding_only_if_it_has_a_goal() -> None:
    last: dict[str, Any] = {"gate/main/status": status("no_trajectory")}
    assert examine(client(BusInWords(everyone(), last=last)), None, "robot.toml")[1] == []
    last["goal/main/feedback"] = Feedback(1, "driving", 2.0, 5.0, 0.0, 0)
    found = only(examine(client(BusInWords(everyone(), last=last)), None, "robot.toml")[1])
    assert found.what == "the robot is stopped: its new path is not followed yet"


def test_a_stop_for_a_missing_node_is_not_reported_twice() -> None:
    bus = BusInWords(without("drive"), last={"gate/main/status": status("gone: controller law")})
    assert said(examine(client(bus), None, "robot.toml")[1]) == [
        "controller law, avoider vfh: missing; of process drive"
    ]


def test_a_latched_stop_is_reported_beside_a_missing_node() -> None:
    bus = BusInWords(without("drive"), last={"gate/main/status": status("contact", latched=True)})
    assert said(examine(client(bus), None, "robot.toml")[1]) == [
        "controller law, avoider vfh: missing; of process drive",
        "the robot is stopped: it touched something",
    ]


def test_different_clocks_of_two_hosts_are_reported() -> None:
    ahead = {"host": "brain", "wall_ns": 3_000_000_000}
    found = only(examine(client(BusInWords(everyone(mapper=ahead, goal=ahead))), None, "robot.toml")[1])
    assert found.what.startswith("the wall clock of brain is +3.00 s (± 0.0")
    assert "chrony" in found.remedy
    near = {"host": "brain", "wall_ns": 300_000_000}
    assert examine(client(BusInWords(everyone(mapper=near, goal=near))), None, "robot.toml")[1] == []


# --- this host ------------------------------------------------------------------------------------------------------


@pytest.fixture
def asleep() -> Iterator[subprocess.Popen[bytes]]:
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def ended() -> int:
    with subprocess.Popen(["true"]) as child:
        return child.pid


def test_a_folder_of_a_robot_that_died_is_noted_and_that_of_one_that_lives_is_not(runtime: Path) -> None:
    made({}).unlock()
    dead = ended()
    folder = made({}, pid=dead)
    assert left_behind() == []
    folder.unlock()
    found = only(left_behind())
    assert found.severity == "note"
    assert found.what == f"robot lab/r1 died without a shutdown: its process {dead} is gone, but its folder remains"
    assert f"`rm -r {folder.path}`" in found.remedy
    (folder.path / "robot.json").write_text("{", "utf-8")
    assert only(left_behind()).what == f"{runtime / 'lab.r1' / 'robot.json'} cannot be read"


def test_a_restarted_process_is_noted() -> None:
    folder = made(
        {
            "drive": Fate(1, "running", 1, "was ended by SIGKILL"),
            "think": Fate(1, "running", 3, "ended with code 1"),
            "safe": Fate(1, "running", 0, ""),
            "router": Fate(None, "failed", 5, "ended with code 2"),
        }
    )
    found = restarting(folder, told=())
    assert [(finding.severity, finding.what) for finding in found] == [
        ("note", "process drive was restarted once: it was ended by SIGKILL"),
        ("note", "process think was restarted 3 times: it ended with code 1"),
        ("problem", "process router: it ended with code 2; it stays down"),
    ]
    assert len(restarting(folder, told={"router"})) == 2


def test_a_process_stopped_by_a_signal_is_distinguished_from_a_running_one(asleep: subprocess.Popen[bytes]) -> None:
    fate = Fate(asleep.pid, "running", 0, "")
    folder = made({"think": fate})
    assert not is_stopped(asleep.pid)
    assert fate_in_words(folder, "think", fate)[0] == f"it runs (pid {asleep.pid}) but is not ready, or hangs"
    asleep.send_signal(signal.SIGSTOP)
    os.waitpid(asleep.pid, os.WUNTRACED)
    assert is_stopped(asleep.pid)
    assert fate_in_words(folder, "think", fate) == (
        f"it is suspended (pid {asleep.pid})", f"`kill -CONT {asleep.pid}` continues it",
    )  # fmt: skip
    assert not is_stopped(ended())


# --- finding the robot ----------------------------------------------------------------------------------------------


def test_without_a_robot_that_is_the_finding_and_leftovers_are_noted() -> None:
    made({}, pid=ended()).unlock()
    found = diagnose()
    assert (found.robot, found.nodes, found.is_healthy) == ("", 0, False)
    assert [finding.severity for finding in found.findings] == ["problem", "note"]
    assert found.findings[0].what == "no robot of this user is up on this host"
    assert found.findings[0].remedy == (
        "start one with `navloom up CONFIG`, or reach one elsewhere with --connect ENDPOINT"
    )  # fmt: skip


def test_a_robot_that_is_not_up_by_that_name_is_a_finding() -> None:
    found = diagnose("lab/r9")
    assert (found.robot, found.is_healthy) == ("lab/r9", False)
    assert only(list(found.findings)).what == "--robot lab/r9: it is not up on this host; none is up"


def test_of_several_robots_one_must_be_named() -> None:
    made({})
    made({}, robot="r2")
    with pytest.raises(DirectoryError, match="several robots are up: lab/r1, lab/r2; choose one with --robot"):
        diagnose()


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp/10.1.1.1:7447", "tls/127.0.0.1:7447"])
def test_an_impossible_request_is_refused(endpoint: str) -> None:
    with pytest.raises(LinkError):
        diagnose(connect=endpoint)


def test_doctor_names_both_processes_that_publish_one_stream() -> None:
    first = described("gate", "main", host="base", pid=12, wall_ns=10**9 * 1000, up_s=100.0)
    second = described("gate", "main", host="copy", pid=13, wall_ns=10**9 * 1000, up_s=10.0)
    (finding,) = doubled([first, second, described("goal", "main")])
    assert finding.severity == "problem" and finding.what.startswith("gate main: several processes publish its streams")
    assert "on host base (process 12, since " in finding.what and "and on host copy (process 13" in finding.what


def test_two_hosts_of_one_name_and_process_number_are_told_apart_by_their_start() -> None:
    same = {"host": "pi", "pid": 12, "wall_ns": 10**9 * 1000}
    assert (
        len(doubled([described("gate", "main", **same, up_s=900.0), described("gate", "main", **same, up_s=2.0)])) == 1
    )


def test_one_process_that_answers_twice_is_no_second_one() -> None:
    same = {"host": "pi", "pid": 12}
    first = described("gate", "main", **same, wall_ns=10**9 * 1000, up_s=20.0)
    assert doubled([first, described("gate", "main", **same, wall_ns=10**9 * 1001, up_s=20.5)]) == []
