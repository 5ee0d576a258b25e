"""Invalid numbers on the command line: one message that names the option, exit 2, nothing run or written."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import typer
from navloom.cli.distribution_commands import AddedCommand
from navloom.entry_kinds import added_commands
from typer.core import TyperGroup

CommandLine = Callable[..., tuple[int, str, str]]
NEEDED = {
    "run": ["paper"],
    "compare": ["paper"],
    "up": ["paper"],
    "goal": ["1", "2"],
    "swap": ["avoider", "vff"],
    "echo": ["gate/status"],
    "hz": ["gate/status"],
    "node": ["paper", "gate"],
    "replay": ["no.mcap"],
    "map": ["no.npz"],
    "import": ["no.log", "--out", "no.mcap"],
    "keys new": ["no-folder"],
    "keys add": ["no-folder", "alice", "--kind", "operator"],
    "plan": ["empty", "--from", "0,0", "--to", "1,1"],
}
"""Further arguments that commands need beside their numbers."""
BAD = {float: ["nan", "inf", "much"], int: ["nan", "1.5", ""]}


def commands(known: Any, name: str) -> Iterator[tuple[str, Callable[..., None]]]:
    """A command, or every command of a group, by its words."""
    if not isinstance(known, TyperGroup):
        yield name, known.callback
        return
    for word, command in known.commands.items():
        yield from commands(command, f"{name} {word}")


def numbers() -> Iterator[tuple[str, str, str]]:
    """Every option and argument that is a number, with values that are not numbers."""
    every = (commands(AddedCommand([point]).made(), point.name) for point in added_commands())
    for name, callback in itertools.chain.from_iterable(every):
        for key, hint in get_type_hints(callback, include_extras=True).items():
            annotated, *extra = get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
            kind = next((kind for kind in BAD if annotated in (kind, kind | None)), None)
            if kind is not None:
                given = getattr(extra[0], "param_decls", None) if extra else None
                is_option = isinstance(extra[0], typer.models.OptionInfo)
                option = (given or [f"--{key.replace('_', '-')}"])[0] if is_option else key
                yield from ((name, option, value) for value in BAD[kind])


ALL = list(numbers())


def test_the_table_has_the_commands_that_take_numbers() -> None:
    assert {"run", "up", "compare", "plan", "goal", "teleop", "hz", "keys new"} <= {name for name, _, _ in ALL}


@pytest.mark.parametrize(("name", "option", "value"), ALL)
def test_a_value_that_is_no_number_is_refused(in_process: CommandLine, name: str, option: str, value: str) -> None:
    words = list(NEEDED.get(name, []))
    if option.startswith("-"):
        words += [option, value]
    else:
        words = [value if key == option else "1" for key in ("x", "y", "heading")]
    code, said, error = in_process(*name.split(), *words)
    assert (code, said) == (2, "")
    assert (option if option.startswith("-") else option.upper()) in error and "Traceback" not in error


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "paper", "--seed", "-1"], "--seed -1: expected a whole number of 0 to 9223372036854775807"),
        (["run", "paper", "--seed", "9" * 30], "expected a whole number of 0 to"),
        (["up", "paper", "--seed", "-1"], "--seed -1: expected a whole number"),
        (["node", "paper", "gate", "--seed", "-1"], "--seed -1: expected a whole number"),
        (["compare", "paper", "--seeds", "nan"], "--seeds nan: expected FIRST:END or a list"),
        (["compare", "paper", "--seeds", "-1"], "--seeds -1: expected FIRST:END or a list"),
        (["compare", "paper", "--seeds", "0:9999999999"], "--seeds 0:9999999999"),
        (["compare", "paper", "--jobs", "0"], "--jobs"),
        (["compare", "paper", "--hang-after", "-1"], "--hang-after"),
        (["echo", "gate/status", "--count", "-1"], "--count"),
        (["hz", "gate/status", "--for", "-1"], "--for"),
        (["record", "--seconds", "-1"], "--seconds"),
        (["view", "--seconds", "0"], "--seconds"),
        (["teleop", "--vx", "0.1", "--for", "-1"], "--for"),
        (["swap", "avoider", "vff", "--timeout", "0"], "--timeout"),
        (["goal", "1", "2", "--timeout", "-1"], "--timeout"),
        (["goal", "1", "2", "--via", "nan,1"], "--via nan,1: expected two finite numbers"),
        (["replay", "no.mcap", "--speed", "0"], "--speed"),
        (["keys", "new", "no-folder", "--days", "0"], "--days"),
        (["keys", "new", "no-folder", "--days", "-3"], "--days"),
        (["keys", "new", "no-folder", "--days", "99999999999"], "--days"),
        (["import", "no.bag", "--out", "no.mcap", "--mount", "laser=nan,0,0"], "--mount"),
        (["paper", "--seed", "-1", "--out", "no-folder"], "--seed -1: expected a whole number"),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, list) else "",
)
def test_a_number_out_of_bounds_is_refused(
    in_process: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, error = in_process(*words)
    assert (code, out) == (2, "")
    assert said in error and "Traceback" not in error
    assert list(tmp_path.iterdir()) == []


PLAN = ["plan", "empty", "--from", "0,0", "--to", "1,1"]


@pytest.mark.parametrize("option", ["--from", "--to", "--size"])
@pytest.mark.parametrize("value", ["nan,1", "1,inf", "-inf,1", "1", "1,2,3", "", "a,b", ","])
def test_a_pair_of_plan_is_two_numbers(in_process: CommandLine, option: str, value: str) -> None:
    code, said, error = in_process(*PLAN, option, value)
    assert (code, said) == (2, "")
    assert error.startswith(f"navloom: {option} {value}: expected ") and error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--size", "-1,1"], "--size -1,1: expected a length and a width of 0 to 100 m; 0,0 is a point"),
        (["--size", "1,1e9"], "--size 1,1e+09: expected"),
        (["--resolution", "-1"], "--resolution -1: expected 0.005 to 1 m"),
        (["--resolution", "0"], "--resolution 0: expected 0.005 to 1 m"),
        (["--resolution", "1e-9"], "--resolution 1e-09: expected 0.005 to 1 m"),
        (["--to", "1e300,1"], "--to 1e+300,1: outside the map"),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, list) else "",
)
def test_a_size_of_plan_has_bounds(in_process: CommandLine, words: list[str], said: str) -> None:
    code, out, error = in_process(*PLAN, *words)
    assert (code, out) == (2, "") and error.startswith(f"navloom: {said}")


def test_plan_takes_a_map_file_with_and_without_its_scheme(in_process: CommandLine, tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(b"P5\n100 100\n255\n" + bytes([254]) * 10000)
    text = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "m.yaml").write_text(text, "utf-8")
    for reference in (str(tmp_path / "m.yaml"), f"rosmap:{tmp_path / 'm.yaml'}"):
        code, said, error = in_process("plan", reference, "--from", "1,1", "--to", "4,4")
        assert code == 0, error
        assert said.startswith("4.2")  # 3 m along both axes: 4.243 m


def test_plan_tells_an_unknown_place_from_an_obstacle(in_process: CommandLine, tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(b"P5\n100 100\n255\n" + bytes([205]) * 10000)
    text = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "m.yaml").write_text(text, "utf-8")
    ends = ("--from", "1,1", "--to", "4,4")
    code, said, _ = in_process("plan", str(tmp_path / "m.yaml"), *ends)
    assert code == 1 and "m.yaml is unknown there, which counts as an obstacle; m.yaml?unknown=free" in said
    assert in_process("plan", f"{tmp_path / 'm.yaml'}?unknown=free", *ends)[0] == 0


def test_plan_prints_few_corners_and_json_has_every_point(in_process: CommandLine) -> None:
    code, said, _ = in_process("plan", "paper_gates", "--from", "0,0", "--to", "0,7.6")
    assert code == 0
    head, path = said.splitlines()
    shown, points = path.count("("), int(head.split(", ")[-1].removesuffix(" points"))
    assert 2 <= shown <= 8 < points and path.endswith("; --json has every point")
    assert path.startswith("(0.00, 0.00)") and "(0.00, 7.60)" in path


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["goal", "2", "6", "--wait"], "no option --wait; did you mean --no-wait?"),
        (["teleop", "--at=1"], "no option --at"),
    ],
)
def test_a_command_that_takes_negative_numbers_refuses_an_unknown_option(
    in_process: CommandLine, words: list[str], text: str
) -> None:
    code, _, error = in_process(*words)
    assert code == 2 and text in error and "Traceback" not in error
