"""Hooks of several distributions: observers of runs, tracing, and commands; a failing one does not affect others."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from navloom.entry_kinds import TRACE_HOOKS
from navloom.messages import Contact, Envelope
from navloom.plugins import Discovery, RunInfo
from navloom.plugins.run_observers import Onlookers
from navloom.runs.episode import run_episode
from toys import discovery, toy_config

Install = Callable[..., None]
InProcess = Callable[..., tuple[int, str, str]]

OBSERVER = """
from navloom import hookimpl

seen = []

class Ours:
    wants = {("gate", "command"), ("platform", "contact")}

    def on_message(self, role, instance, active, port, message, at):
        seen.append((role, instance, active, port, at.tick))

@hookimpl
def navloom_run_started(run):
    seen.append(("started", run.kind, run.name, run.config["run"]["seed"]))
    run.config.clear()

@hookimpl
def navloom_observe():
    return Ours()

@hookimpl
def navloom_run_finished(run, summary):
    seen.append(("finished", summary and summary["outcome"]))
"""
RUN = RunInfo("lockstep", "c.toml", {"run": {"seed": 7}}, "ab", "lab", "r1", 7)
AT = Envelope("k", 1, 4, 0, 0, 0)
PLANNER = """
from navloom import Planner, hookimpl

class Nowhere(Planner):
    name = "nowhere"

    def plan(self, given):
        raise NotImplementedError

@hookimpl
def navloom_register(registry):
    registry.add(Nowhere)
"""


def seen_by(name: str) -> list[Any]:
    seen: list[Any] = sys.modules[name].seen
    return seen


def test_observers_are_notified_of_a_run_and_get_the_messages_they_want(install: Install) -> None:
    install("fake_one", OBSERVER, ["observer.one"])
    install("fake_two", OBSERVER, ["observer.two"])
    said: list[str] = []
    with Onlookers(Discovery(), said.append) as onlookers:
        for one in onlookers.begin(RUN):
            assert one.wants == {("gate", "command"), ("platform", "contact")}
            one.on_message("platform", "main", True, "contact", Contact(True), AT)
        onlookers.finish({"outcome": "succeeded"})
    told = [("started", "lockstep", "c.toml", 7), ("platform", "main", True, "contact", 4), ("finished", "succeeded")]
    assert seen_by("fake_one") == seen_by("fake_two") == told
    assert RUN.config == {"run": {"seed": 7}} and said == []


def test_a_run_that_is_cut_short_is_finished_without_a_summary(install: Install) -> None:
    install("fake_one", OBSERVER, ["observer.one"])
    with pytest.raises(KeyboardInterrupt), Onlookers(Discovery(), print) as onlookers:
        onlookers.begin(RUN)
        raise KeyboardInterrupt
    assert seen_by("fake_one")[-1] == ("finished", None)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("run.config.clear()", "1 / 0", "in navloom_run_started"),
        ("return Ours()", "raise SystemExit('no licence')", "in navloom_observe"),
        ("return Ours()", "return 3", "in on_message"),
        ("seen.append((role", "raise RuntimeError((role", "in on_message"),
        ("summary and", "summary.gone and", "in navloom_run_finished"),
        ("seen = []", "seen = nothing", "fails on import: NameError: name 'nothing' is not defined"),
        ("navloom_observe()", "navloom_observe(robot)", "'robot'"),
    ],
)
def test_an_observer_that_fails_is_reported_once_and_does_not_affect_others(
    install: Install, old: str, new: str, told: str
) -> None:
    install("fake_bad", OBSERVER.replace(old, new), ["observer.bad"])
    install("fake_good", OBSERVER, ["observer.good"])
    said: list[str] = []
    with Onlookers(Discovery(), said.append) as onlookers:
        looking = onlookers.begin(RUN)
        for _ in range(3):
            for one in looking:
                one.on_message("gate", "main", True, "command", Contact(True), AT)
        onlookers.finish({"outcome": "succeeded"})
    (line,) = said
    assert told in line and "fake_bad" in line.replace("-", "_") and line.endswith("; the run goes on without it")
    assert "(fake_bad.py:" in line or "'int' object" in line or "'robot'" in line  # the others have no line of it
    assert seen_by("fake_good") == [
        ("started", "lockstep", "c.toml", 7),
        *[("gate", "main", True, "command", 4)] * 3,
        ("finished", "succeeded"),
    ]


def test_a_run_is_the_same_with_and_without_observers(install: Install, tmp_path: Path) -> None:
    install("fake_one", OBSERVER, ["observer.one"])
    install("fake_all", OBSERVER.replace('{("gate", "command"), ("platform", "contact")}', "None"), ["observer.all"])
    install("fake_bad", OBSERVER.replace("seen.append((role", "raise RuntimeError((role"), ["observer.bad"])
    said: list[str] = []
    loaded = toy_config(tmp_path)
    alone = run_episode(loaded, discovery=discovery())
    with Onlookers(Discovery(), said.append) as onlookers:
        seen = run_episode(loaded, discovery=discovery(), onlookers=onlookers)
    assert seen.log.trace_sha256 == alone.log.trace_sha256
    assert len(said) == 1 and len(seen_by("fake_one")) > 100
    ports = {entry[3] for entry in seen_by("fake_all") if len(entry) == 5}
    assert {"odometry", "pose", "map", "path", "reference", "command", "status"} <= ports


def test_a_blocked_observer_is_not_imported(install: Install) -> None:
    install("fake_one", OBSERVER, ["observer.one"])
    assert Onlookers(Discovery(["observer.one"]), print).begin(RUN) == []
    assert "fake_one" not in sys.modules


def test_an_observer_is_listed(install: Install, in_process: InProcess) -> None:
    install("fake_one", "raise RuntimeError('imported')", ["observer.one"], "2.5")
    code, out, _ = in_process("plugins")
    assert code == 0 and ["observer", "one", "fake-one", "2.5"] in [line.split() for line in out.splitlines()]


def test_every_hook_call_is_traced_with_its_implementations(
    install: Install, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install("fake_one", OBSERVER + PLANNER, ["observer.one", "planner.nowhere"])
    monkeypatch.setenv(TRACE_HOOKS, "1")
    found = Discovery()
    found.role("planner", "nowhere")
    Onlookers(found, print).begin(RUN)
    line = OBSERVER.splitlines().index("def navloom_run_started(run):")
    register = len(OBSERVER.splitlines()) + PLANNER.splitlines().index("@hookimpl")
    assert capsys.readouterr().err.splitlines() == [
        f"navloom: hook navloom_register: planner.nowhere of fake-one (fake_one.py:{register + 1})",
        f"navloom: hook navloom_register: observer.one of fake-one (fake_one.py:{register + 1})",
        f"navloom: hook navloom_run_started: observer.one of fake-one (fake_one.py:{line})",
        f"navloom: hook navloom_observe: observer.one of fake-one (fake_one.py:{line + 5})",
    ]


def test_the_option_traces_the_hooks_of_a_command(
    install: Install, in_process: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(TRACE_HOOKS, "")  # the option sets it; the end of the test restores it
    install("fake_one", PLANNER, ["planner.nowhere"])
    code, _, err = in_process("--trace-hooks", "plugins", "planner.nowhere")
    assert code == 0 and "hook navloom_register: planner.nowhere of fake-one (fake_one.py:" in err


# --- commands -------------------------------------------------------------------------------------------------------

COMMAND = """
import typer
from navloom import hookimpl

def greet(name: str, times: int = 1) -> None:
    \"\"\"Greet somebody.\"\"\"
    if times < 0:
        raise RuntimeError("less than never")
    typer.echo(" ".join(["hello", name] * times))

several = typer.Typer(help="Several.")
several.command("one")(greet)
several.command("two")(greet)

@hookimpl
def navloom_register(registry):
    registry.command("greet", greet)
    registry.command("several", several)
"""


def test_a_distributions_command_is_listed_by_its_metadata_and_imported_when_it_is_used(
    install: Install, in_process: InProcess
) -> None:
    install("fake_greeter", COMMAND, ["command.greet", "command.several", "command.run"])
    code, out, _ = in_process("--help")
    told = [line.split() for line in out.splitlines()]
    assert code == 0 and all([name, "What", "fake-greeter", "is", "for."] in told for name in ("greet", "several"))
    assert "fake_greeter" not in sys.modules
    assert in_process("greet", "Ann", "--times", "2") == (0, "hello Ann hello Ann\n", "")
    assert in_process("several", "two", "Bob") == (0, "hello Bob\n", "")
    code, out, _ = in_process("greet", "--help")
    assert code == 0 and "Greet somebody." in out and "--times" in out
    code, _, err = in_process("greet")
    assert code == 2 and "Missing argument 'name'" in err
    code, _, err = in_process("greet", "Ann", "--times=-1")
    assert (code, err.splitlines()) == (
        1, ["navloom: command.greet of fake-greeter failed: RuntimeError: less than never (fake_greeter.py:8)"]
    )  # fmt: skip


def test_a_command_of_navloom_itself_is_not_replaced_and_that_is_reported(
    install: Install, in_process: InProcess
) -> None:
    install("fake_greeter", COMMAND, ["command.run"])
    code, out, _ = in_process("run", "--help")
    assert code == 0 and "Run a config in simulated time" in out and "fake_greeter" not in sys.modules
    code, _, err = in_process("plugins")
    assert code == 0 and err == (
        "navloom: entry point 'command.run' of fake-greeter: navloom has a command of that name; rename it\n"
    )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("import typer", "import typewriter", "ModuleNotFoundError: No module named 'typewriter' (fake_greeter.py:2)"),
        ("times: int", "times: int | bytes", "command 'greet': typer cannot make a command of it"),
        ('"greet", greet', '"greet", "greet"', "expected a function, a typer.Typer or MODULE:NAME"),
        ('command("greet"', 'command("great"', "registers command.great, command.several, expected command.greet"),
    ],
)
def test_a_broken_command_gives_one_line_and_is_fatal_only_if_used(
    install: Install, in_process: InProcess, old: str, new: str, told: str
) -> None:
    install("fake_greeter", COMMAND.replace(old, new), ["command.greet"])
    code, out, _ = in_process("--help")
    assert code == 0 and "  greet  " in out
    code, _, err = in_process("greet", "Ann")
    assert code == 2 and told in err and len(err.splitlines()) == 1


def test_the_list_of_plugins_loads_no_compiler() -> None:
    words = [sys.executable, "-X", "importtime", "-m", "navloom", "plugins"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "navloom.plugins.discovery" in imported and "numba" not in imported


def test_observers_do_not_import_the_network_in_lockstep() -> None:
    code = "import sys, navloom.runs.episode, navloom.plugins.run_observers; sys.exit('zenoh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
