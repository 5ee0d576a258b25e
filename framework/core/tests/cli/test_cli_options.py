"""Options of every command: level of the log, and JSON lines; groups of options."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
import typer
from navloom.cli.command import App, with_groups_within
from navloom.cli.options import RobotOptions
from typer.testing import CliRunner

Run = Callable[..., tuple[int, str, str]]
REPLACED = ("config", "check", "paper", "--set", "planner.plugin=theta_star")


def test_every_command_has_the_options_of_the_log(every_command: dict[str, Any]) -> None:
    assert {"run", "config show"} <= every_command.keys()
    for name, command in every_command.items():
        assert {"--log-level", "--log-json"} <= {word for param in command.params for word in param.opts}, name


def test_with_json_an_error_is_one_json_object(in_process: Run) -> None:
    code, out, err = in_process("run", "nothing", "--log-json")
    (line,) = map(json.loads, err.splitlines())
    assert (code, out) == (2, "")
    assert line["level"] == "error" and line["logger"] == "navloom.cli" and "'nothing'" in line["message"]


def test_the_log_level_drops_notes_but_not_the_answer(in_process: Run) -> None:
    words = ("run", "paper", "--set", "planner.plugin=theta_star", "--set", "run.stop_after=0.1")
    told = in_process(*words)
    quiet = in_process(*words, "--log-level", "warning")
    assert "navloom: " in told[2] and "belong" in told[2]
    assert quiet[2] == "" and quiet[1].splitlines()[0] == told[1].splitlines()[0]


def test_an_unknown_level_is_refused_with_the_known_ones(in_process: Run) -> None:
    code, _, err = in_process("worlds", "--log-level", "loud")
    assert code == 2 and "warning" in err


def test_a_group_is_one_parameter_of_a_function_and_its_options_are_sections_of_the_help() -> None:
    given: list[Any] = []
    own = App(rich_markup_mode=None)

    @own.command()
    def look(robot: RobotOptions, deep: bool = False) -> None:
        given.append((robot, deep))

    done = CliRunner().invoke(own, ["--robot", "lab/r2", "--insecure"])
    assert done.exit_code == 0 and given == [(RobotOptions("lab/r2", None, None, True), False)]
    text = CliRunner().invoke(own, ["--help"]).output
    assert text.index("Options:") < text.index("Which robot:") < text.index("--robot") < text.index("Every command:")


def test_a_distributions_command_keeps_its_own_option_of_the_same_name() -> None:
    given: list[str] = []
    theirs = typer.Typer()

    @theirs.command()
    def act(log_level: str = "theirs") -> None:
        given.append(log_level)

    done = CliRunner().invoke(with_groups_within(theirs), ["--log-level", "mine", "--log-json"])
    assert done.exit_code == 0 and given == ["mine"]


def test_what_moves_the_cursor_is_escaped_in_the_log_and_in_tables(capsys: pytest.CaptureFixture[str]) -> None:
    from navloom.cli.output import print_table, say_so
    from navloom.logs import Level, set_up_logging

    set_up_logging(Level.INFO, False)
    say_so("node \x1b[2J of \u202eevil")
    assert capsys.readouterr().err == "navloom: node \\x1b[2J of \\u202eevil\n"
    print_table(("node", "state"), [("one\ntwo", "fine")])
    assert capsys.readouterr().out.splitlines()[1:] == [r"one\ntwo  fine"]


@pytest.mark.parametrize("text", ["100 %d of it", "two\nlines"])
def test_a_logged_text_is_not_read_as_a_format(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    from navloom.cli.output import say_so
    from navloom.logs import Level, set_up_logging

    set_up_logging(Level.INFO, False)
    say_so(text)
    assert capsys.readouterr().err == "".join(f"navloom: {line}\n" for line in text.splitlines())
