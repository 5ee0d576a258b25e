"""`navloom list`, `status`, `echo`, `hz`, `graph` and `doctor` on a live robot of toy plugins in several processes."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import toys
from described import BusInWords, client, described, everyone, heard
from live_rig import COMMAND, Up, up
from navloom.cli import main
from navloom.cli.output import print_table
from navloom.messages import Feedback, GateStatus, GoalResult, Parameters, Point2D, StopReason
from navloom_live.cli.listing import state
from navloom_live.cli.status import rows as status_rows
from navloom_live.operating.introspection import changed_parameters, last_words
from navloom_live.operating.robot_nodes import Node, listing

TEXT = f"""{toys.TEXT}
drive = false
[[alternative]]
name = "shy"
role = "avoider"
plugin = "toy_bystander"
shadow = true
[[alternative]]
name = "spare"
role = "controller"
plugin = "toy_chaser"
shadow = false
"""
SHARES = {
    "robot": ["platform toy_robot", "localizer odometry"],
    "think": ["mapper toy_blank", "goal main", "planner toy_straight"],
    "drive": ["reference main", "controller toy_chaser", "controller spare", "avoider toy_bystander", "avoider shy",
              "recovery wait_and_replan"],
    "safe": ["gate main"],
}  # fmt: skip
NODES = [name for share in SHARES.values() for name in share]
pytestmark = pytest.mark.slow  # its robots take longer to start than all its tests


def install(folder: Path) -> str:
    """Install the toys as a distribution that child processes discover; gives the PYTHONPATH for them."""
    dist = folder / "navloom_toys-1.0.dist-info"
    dist.mkdir(parents=True)
    shutil.copy(toys.__file__, folder / "navloom_toys.py")
    (dist / "METADATA").write_text("Metadata-Version: 2.1\nName: navloom-toys\nVersion: 1.0\n", "utf-8")
    lines = [f"{name} = navloom_toys" for name in toys.NAMES]
    (dist / "entry_points.txt").write_text("\n".join(["[navloom]", *lines, ""]), "utf-8")
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Config of the robot, whose plugins every process started meanwhile can import."""
    folder = tmp_path_factory.mktemp("toys")
    path = folder / "toys.toml"
    path.write_text(TEXT, "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", install(folder / "plugins"))
        yield path


@pytest.fixture(scope="module")
def robot(config: Path) -> Iterator[Up]:
    with up(str(config)) as found:
        found.wait_for("every node is there")
        yield found


Look = Callable[..., tuple[int, str, str]]


@pytest.fixture
def look(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Look:
    """Runs a command in this process; gives exit code, standard output and standard error."""

    def run(where: Up | Path, *words: str) -> tuple[int, str, str]:
        folder = where.environment["NAVLOOM_RUNTIME_DIR"] if isinstance(where, Up) else str(where)
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", folder)
        monkeypatch.setattr(sys, "argv", ["navloom", *words])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert "Traceback" not in err and "internal error" not in err, err
        return int(ended.value.code or 0), out, err

    return run


def as_json(look: Look, robot: Up, *words: str) -> Any:
    code, out, err = look(robot, *words, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


# --- a healthy robot ------------------------------------------------------------------------------------------------


def test_list_has_every_node_with_its_process(robot: Up, look: Look) -> None:
    nodes = as_json(look, robot, "list")
    assert {f"{node['role']} {node['instance']}": node["process"] for node in nodes} == {
        name: process for process, share in SHARES.items() for name in share
    }
    assert len({node["pid"] for node in nodes}) == 4
    assert [node["instance"] for node in nodes if not node["active"]] == ["spare", "shy"]
    assert all(node["host"] and node["answers"] for node in nodes)
    assert not {"streams", "places", "hosts"} & set(nodes[0])

    code, out, err = look(robot, "list")
    lines = out.splitlines()
    assert (code, err, len(lines)) == (0, "", 1 + len(NODES))
    assert lines[0].split() == ["role", "instance", "plugin", "process", "pid", "host", "tick", "state"]
    rows = {" ".join(line.split()[:2]): line for line in lines[1:]}
    assert rows["avoider shy"].endswith("shadow") and rows["controller spare"].endswith("-     waiting")
    assert rows["gate main"].endswith("active")


def test_status_says_who_is_active_and_why_it_is_stopped(robot: Up, look: Look) -> None:
    found = as_json(look, robot, "status")
    assert (found["robot"], found["nodes"]) == ("lab/r1", len(NODES))
    assert found["missing_nodes"] == found["silent_nodes"] == []
    assert found["gate_status"]["stopped"] and "navloom" in found["remedy"]
    assert "avoider toy_bystander" in found["gate_selection"]["instances"]
    assert found["goal_result"] is None and found["run_clock_s"] > 0.0

    code, out, err = look(robot, "status")
    rows = dict(re.split(" {2,}", line, maxsplit=1) for line in out.splitlines())
    assert (code, err) == (0, "")
    assert rows["robot"].startswith("lab/r1, run clock ") and rows["goal"] == "none"
    assert "controller toy_chaser" in rows["active"] and "missing" not in rows


def test_echo_prints_as_many_messages_as_asked_for(robot: Up, look: Look) -> None:
    code, out, err = look(robot, "echo", "platform/odometry", "--count", "2")
    heads = [line for line in out.splitlines() if not line.startswith(" ")]
    assert (code, err, len(heads)) == (0, "", 2)
    assert all(re.match(r"platform/toy_robot/odometry  number \d+  tick \d+  stamp [\d.]+ s  from", h) for h in heads)
    assert "  pose      (x 0, y 0, heading 0)" in out.splitlines()


def test_echo_of_a_map_prints_the_last_one_at_once_with_a_summary_of_its_cells(robot: Up, look: Look) -> None:
    found = as_json(look, robot, "echo", "mapper/map", "--count", "1")
    assert (found["stream"], found["envelope"]["sequence"]) == ("mapper/toy_blank/map", 1)
    cells = found["message"]["grid"]["cells"]
    assert cells == {"dtype": "int8", "shape": [40, 40], "min": 0, "mean": 0.0, "max": 0, "first": [0] * 4}
    whole = as_json(look, robot, "echo", "mapper/map", "--count", "1", "--whole")
    assert whole["message"]["grid"]["cells"] == [[0] * 40] * 40


def test_echo_prints_chosen_fields_as_a_json_object_a_line(robot: Up, look: Look) -> None:
    code, out, err = look(
        robot, "echo", "platform/ear", "--count", "3", "--json", "--fields", "ranges.first.0,range_min,ranges.infinite"
    )
    lines = [json.loads(line) for line in out.splitlines()]
    assert (code, err, len(lines)) == (0, "", 3)
    # no echo is an infinite range, which JSON cannot express
    assert [line["message"] for line in lines] == [
        {"ranges.first.0": None, "range_min": 0.1, "ranges.infinite": 1}
    ] * 3  # fmt: skip
    numbers = [line["envelope"]["sequence"] for line in lines]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["echo", "gate/comand"], "no stream 'gate/comand': expected role/port or role/instance/port; did you mean "
                                  "'gate/command'?"),
        (["hz", "wheels"], "no stream 'wheels': expected role/port or role/instance/port; there are avoider, "),
        (["echo", "platform/ear", "--fields", "ranges.frst"], "--fields ranges.frst: there is no 'frst'; there are "
                                                              "dtype, shape, infinite, first"),
        (["echo", "platform/ear", "--fields", "ranges.first.9"], "it is a list of 1 entries, from 0"),
        (["echo", "platform/ear", "--fields", "range_max.x"], "there is no 'x'; it has no parts"),
        (["echo", "platform/ear", "--count", "0"], "--count': Input should be greater than or equal to 1"),
        (["hz", "platform/ear", "--for", "0"], "--for': Input should be greater than or equal to 0.1"),
        (["list", "--robot", "lab/r2"], "--robot lab/r2: it is not up on this host; up are lab/r1; did you mean"),
        (["status", "--connect", "127.0.0.1"], "endpoint '127.0.0.1': unknown protocol '127.0.0.1', expected tls/"),
        (["doctor", "--connect", "tcp/127.0.0.1:9", "--robot", "r1"], "expected REALM/NAME of letters, digits"),
    ],
    ids=["stream", "role", "field", "entry", "part", "count", "for", "robot", "endpoint", "name"],
)  # fmt: skip
def test_a_wrong_request_is_refused_with_the_nearest_fix(
    words: list[str], complaint: str, robot: Up, look: Look
) -> None:
    code, out, err = look(robot, *words)
    assert (code, out) == (2, "")
    assert complaint in err


def test_hz_measures_every_stream_and_lists_the_silent_ones_apart(robot: Up, look: Look) -> None:
    found = as_json(look, robot, "hz", "platform", "--for", "1.5")
    assert set(found) == {f"platform/toy_robot/{port}" for port in
                          ("odometry", "ear", "contact", "truth", "step", "parameters")}  # fmt: skip
    odometry = found["platform/toy_robot/odometry"]
    assert odometry["messages"] > 3 and odometry["malformed"] == 0
    assert 0.0 <= odometry["age_p50_s"] <= odometry["age_p99_s"]
    assert odometry["interval_max_s"] >= 0.04  # the longest of intervals whose mean is a tick of 0.05 s
    assert found["platform/toy_robot/parameters"]["messages"] == 0

    code, out, err = look(robot, "hz", "*/odometry/*", "--for", "0.5")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split() == ["jitter", "max", "age50", "age99"]
    assert lines[1].split() == ["stream", "count", "Hz", "ms", "ms", "ms", "ms", "kB/s", "lost", "bad"]
    assert [line.split()[0] for line in lines[2:-1]] == ["localizer/odometry/pose", "localizer/odometry/step"]
    assert lines[-1] == "nothing came on localizer/odometry/parameters"


def test_graph_has_every_node_and_the_messages_received(robot: Up, look: Look) -> None:
    found = as_json(look, robot, "graph")
    assert [f"{node['role']} {node['instance']}" for node in found["nodes"]] == NODES
    edges = {(edge["from"], edge["port"], edge["to"]): edge["received"] for edge in found["edges"]}
    assert edges["platform/toy_robot", "ear", "mapper/toy_blank"] > 0
    assert edges["operator/main", "command", "gate/main"] == 0

    code, out, err = look(robot, "graph")
    assert (code, err) == (0, "")
    entry = out[out.index("mapper/toy_blank (active; process think on ") :].splitlines()
    assert entry[1] == "  receives platform/toy_robot/ear, localizer/odometry/pose"
    assert entry[2] == "  has not received goal/main/clear"

    code, out, err = look(robot, "graph", "--dot")
    assert (code, err) == (0, "") and out.startswith("digraph navloom {") and out.rstrip().endswith("}")
    assert out.count("subgraph cluster_") == 4 and out.count("{") == out.count("}")
    assert '"platform/toy_robot" -> "mapper/toy_blank" [label="ear"];' in out
    assert '"operator/main" -> "gate/main" [label="command", style=dotted];' in out


def test_doctor_finds_nothing_but_a_busy_computer(robot: Up, look: Look) -> None:
    code, out, err = look(robot, "doctor", "--json")
    found = json.loads(out)
    assert (found["robot"], found["nodes"], err) == ("lab/r1", len(NODES), "")
    problems = [finding["what"] for finding in found["findings"] if finding["severity"] == "problem"]
    busy = re.compile(r"ticks since its start came late|dropped unread|the robot is stopped|in one step for|only .* MB")
    assert [what for what in problems if not busy.search(what)] == []
    assert (code, found["healthy"]) == ((0, True) if not problems else (1, False))


def test_ctrl_c_ends_echo_without_an_error(robot: Up) -> None:
    child = subprocess.Popen(
        [*COMMAND, "echo", "platform/odometry"],
        env=robot.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert child.stdout is not None
        assert child.stdout.readline().startswith("platform/toy_robot/odometry  number ")
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=20)
    finally:
        child.kill()
        child.wait()
    assert (child.returncode, err) == (0, "")


def test_a_closed_pipe_ends_echo_silently(robot: Up) -> None:
    child = subprocess.Popen(
        [*COMMAND, "echo", "platform/odometry"], env=robot.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        assert child.stdout is not None and child.stderr is not None
        child.stdout.readline()
        child.stdout.close()  # as `| head -1` does
        assert child.wait(20) == 1
        assert b"Traceback" not in child.stderr.read()
    finally:
        child.kill()
        child.wait()
        child.stderr.close()


# --- without a robot ------------------------------------------------------------------------------------------------

LOOKS = [["list"], ["status"], ["echo", "gate/status"], ["hz", "gate/status"], ["graph"]]


@pytest.mark.parametrize("words", LOOKS, ids=lambda words: words[0])
def test_without_a_robot_every_command_says_how_to_start_one(words: list[str], look: Look, tmp_path: Path) -> None:
    for more in ([], ["--json"]):
        code, out, err = look(tmp_path, *words, *more)
        assert (code, out) == (2, "")
        assert err == (
            "navloom: no robot of this user is up on this host: start one with `navloom up CONFIG`, or reach one "
            "elsewhere with --connect ENDPOINT\n"
        )


def test_without_a_robot_doctor_reports_that(look: Look, tmp_path: Path) -> None:
    code, out, err = look(tmp_path, "doctor")
    assert (code, err) == (1, "")
    assert out == (
        "problem: no robot of this user is up on this host\n"
        "    start one with `navloom up CONFIG`, or reach one elsewhere with --connect ENDPOINT\n"
    )
    found = json.loads(look(tmp_path, "doctor", "--json")[1])
    assert (found["robot"], found["healthy"], found["nodes"], len(found["findings"])) == (None, False, 0, 1)


def test_an_endpoint_without_a_listener_is_reported(look: Look, tmp_path: Path) -> None:
    code, out, err = look(tmp_path, "doctor", "--connect", f"unixsock-stream/{tmp_path}/nobody.sock")
    assert (code, err) == (1, "")
    assert "cannot be joined" in out and "nothing listens there" in out and "navloom router" in out


# --- tables ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "active"),
        ({"active": False}, "shadow"),
        ({"active": False, "enabled": False}, "waiting"),
        ({"busy_s": 0.5}, "active"),
        ({"busy_s": 0.75}, "active, 0.8 s in one step"),
        ({"faulted": 4, "active": False, "busy_s": 2.0}, "shadow, failed 4 times in a row, 2.0 s in one step"),
    ],
    ids=["active", "shadow", "spare", "quick", "slow", "failing"],
)
def test_the_state_of_a_node_in_words(changes: dict[str, Any], words: str) -> None:
    [node] = heard([described("avoider", "vfh", **changes)])
    assert state(node) == words


def test_a_node_without_a_description_says_why() -> None:
    assert state(Node("avoider", "vfh", "drive", None)) == "does not answer"
    assert state(Node("avoider", "vfh", "drive", None, "of a later version")) == "of a later version"


def rows(bus: BusInWords) -> dict[str, str]:
    """Rows of `navloom status` for a described robot."""
    asked = client(bus)
    return dict(status_rows("lab/r1", listing(asked), last_words(asked), changed_parameters(asked)))


def test_status_says_why_the_platform_cannot_be_driven() -> None:
    failing = {"faulted": 3, "fault": "RosError: /odom has no message yet"}
    assert rows(BusInWords(everyone(platform=failing)))["platform"] == (
        "cannot be driven: RosError: /odom has no message yet"
    )


def test_status_of_a_robot_that_drives() -> None:
    last = {
        "goal/main/feedback": Feedback(3, "driving", 1.5, 4.0, -0.012, 2),
        "goal/main/result": GoalResult(2, "stuck", "trapped", Point2D(1.0, 2.0)),
        "gate/main/status": GateStatus("avoider", "vfh", False, False, None, ("controller other",)),
        "controller/law/parameters": Parameters(2, ("k1 = 0.8", "k3 = 1.0")),
    }
    assert rows(BusInWords(everyone(gate={"silence_s": 0.031}), last=last)) == {
        "robot": "lab/r1, run clock 5.0 s",
        "goal": "3: driving, 1.50 m and 4 s left, recoveries 2, cross-track -0.01 m",
        "last goal": "2: stuck, trapped, at (1.00, 2.00)",
        "drives": "avoider vfh",
        "platform": "last message 0.03 s ago",
        "waits to take over": "controller other",
        "changed, controller law": "k1 = 0.8, k3 = 1.0",
    }


def test_status_of_a_robot_that_lacks_much() -> None:
    far = {"think": "brain"}
    nodes = [replace(node, hosts=far) for node in everyone() if node.process not in ("think", "drive")]
    last = {"gate/main/status": GateStatus("none", "", True, True, StopReason("contact"), ())}
    assert rows(BusInWords(nodes, silent=["avoider vfh"], last=last)) == {
        "robot": "lab/r1, run clock 5.0 s",
        "goal": "unknown: its goal node does not answer",
        "stopped": "it touched something; `navloom resume` when the way is clear",
        "platform": "last message 0.02 s ago",
        "missing": "mapper grid (process think on brain), goal main (process think on brain), "
                   "controller law (process drive)",
        "does not answer": "avoider vfh",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("tick", "words"), [(7, "at tick 8, in simulated time"), (-2, "no message so far")], ids=["barrier", "never"]
)
def test_status_without_a_run_clock(tick: int, words: str) -> None:
    changes = {"silence_s": None, "clock_ns": -1, "tick": tick}  # one more by the time it is asked
    found = rows(BusInWords(everyone(**{node.role: changes for node in everyone()})))
    assert found == {
        "robot": "lab/r1",
        "goal": "none",
        "drives": "unknown: its gate has said nothing so far",
        "platform": words,
    }


def test_a_table_is_as_wide_as_its_longest_entries_and_brackets_are_no_markup(
    capsys: pytest.CaptureFixture[str],
) -> None:
    print_table(("name", "value"), [("a", "[bold]x[/bold]"), ("long name", None), ("b", 0.123456)])
    assert capsys.readouterr().out.splitlines() == [
        "name       value", "a          [bold]x[/bold]", "long name  -", "b          0.1235",
    ]  # fmt: skip
    print_table(("", ""), [("goal", "none")])
    assert capsys.readouterr().out == "goal  none\n"


# --- a sick robot ---------------------------------------------------------------------------------------------------


def until(claim: Callable[[], Any], what: str) -> Any:
    """Poll until a condition without an event holds."""
    limit = time.monotonic() + 60.0
    while not (found := claim()):
        assert time.monotonic() < limit, what
        time.sleep(0.05)
    return found


def test_a_process_stopped_by_a_signal_is_reported_with_the_command_that_continues_it(robot: Up, look: Look) -> None:
    pid = next(node["pid"] for node in as_json(look, robot, "list") if node["process"] == "think")
    os.kill(pid, signal.SIGSTOP)
    try:
        code, out, err = look(robot, "doctor")
        lines = out.splitlines()
        [said] = [number for number, line in enumerate(lines) if "of process think" in line]
        assert (code, err) == (1, "")
        assert lines[said].startswith("problem: mapper toy_blank, goal main, planner toy_straight: ")
        assert lines[said].endswith(f"of process think: it is suspended (pid {pid})")
        assert lines[said + 1] == f"    `kill -CONT {pid}` continues it"
    finally:
        os.kill(pid, signal.SIGCONT)
    until(lambda: all(node["answers"] for node in as_json(look, robot, "list")), "everybody answers again")


def test_a_killed_process_is_noted_after_its_restart(robot: Up, look: Look) -> None:
    before = len(robot.said)
    pid = next(node["pid"] for node in as_json(look, robot, "list") if node["process"] == "drive")
    os.kill(pid, signal.SIGKILL)
    robot.wait_for("process drive was ended by SIGKILL", after=before)

    def again() -> str:
        out = look(robot, "doctor")[1]
        return out if "note: process drive was restarted once: it was ended by SIGKILL" in out else ""

    assert "drive.log" in until(again, "the restart is noted")
    until(lambda: len(as_json(look, robot, "list")) == len(NODES), "everybody is back")


def test_under_the_barrier_every_node_is_listed_and_echo_ends_with_the_robot(config: Path, look: Look) -> None:
    roles = list(dict.fromkeys(name.split()[0] for name in NODES))
    values = [
        "navigation.drive=true",
        "navigation.speed=[0.001, 0.001]",  # 60000 ticks, longer than this test may take
        "run.stop_after=1e6",
        f"live.processes={{ all = {json.dumps(roles)} }}",
    ]
    with up(str(config), "--barrier", *(word for value in values for word in ("--set", value))) as short:

        def steps() -> bool:
            code, out, _ = look(short, "list", "--json")
            nodes = json.loads(out) if code == 0 else []
            return len(nodes) == len(NODES) and any(node["tick"] > 0 for node in nodes if node["role"] == "platform")

        until(steps, "the robot steps")
        child = subprocess.Popen(
            [*COMMAND, "echo", "platform/odometry"],
            env=short.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert child.stdout is not None
            assert child.stdout.readline().startswith("platform/toy_robot/odometry")
            short.end()
            _, err = child.communicate(timeout=20)
        finally:
            child.kill()
            child.wait()
        assert child.returncode == 1 and "navloom: robot lab/r1 has gone" in err
