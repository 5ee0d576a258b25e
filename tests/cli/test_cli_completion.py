"""Shell completion: the candidates at a place of the command line, in the shells themselves."""

from __future__ import annotations

import os
import pty
import re
import select
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom.cli.main import app
from navloom.cli.shells.scripts import SCRIPTS
from navloom.cli.shells.tree import commands
from navloom.installed import candidates, shipped_names
from navloom.plugins import Discovery
from navloom.roles import ROLES
from navloom_live.hosting.runtime_folders import RobotFolder, Running
from typer.main import get_command

Complete = Callable[..., list[str]]

ZSHRC = r"""
PROMPT= RPROMPT=
fpath=($ZDOTDIR/functions $fpath)
autoload -U compinit
compinit -u -d $ZDOTDIR/.dump
compadd() { # print what would be proposed
    local -a hits
    [[ ${@[1,(i)(-|--)]} == *-(O|A|D)\ * ]] && { builtin compadd "$@"; return }
    builtin compadd -A hits "$@"
    (($#hits)) && print -rn -- "<${(j:><:)hits}>"
    builtin compadd "$@"
}
complete-and-say() { zle complete-word; print -n END; print ED }
zle -N complete-and-say
bindkey '^I' complete-and-say
print -n REA; print DY
"""
"""Start file of a zsh that prints its candidates, each in angle brackets."""
PROGRAM = f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m navloom "$@"\n'


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with the program `navloom`, a config, another file, a folder, and a robot `lab/r2`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / ".rt"))
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "navloom").write_text(PROGRAM)
    (tmp_path / "bin" / "navloom").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "my robot.toml").touch()
    (tmp_path / "notes.txt").touch()
    robot = RobotFolder("lab", "r2")
    robot.make()
    assert robot.lock()
    robot.write(Running("lab", "r2", os.getpid(), (), False, "paper", False))
    return tmp_path


@pytest.fixture
def complete(here: Path) -> Complete:
    """Candidates of bash after these words, the last of which is being typed."""
    (here / "navloom.bash").write_text(SCRIPTS["bash"](commands(get_command(app))), "utf-8")

    def ask(*words: str) -> list[str]:
        typed = " ".join(map(shlex.quote, words))
        script = (
            f"source navloom.bash; COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _navloom; "
            'printf "%s\\n" "${COMPREPLY[@]}"'
        )
        return said("bash", "--norc", "-c", script)

    return ask


def said(*command: str) -> list[str]:
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return sorted(line for line in done.stdout.splitlines() if line)


def test_bash_completes_commands_groups_and_options(complete: Complete) -> None:
    assert complete("navloom", "re") == ["record", "replay", "report", "resume"]
    assert complete("navloom", "params", "") == ["get", "set"]
    assert complete("navloom", "run", "paper", "--se") == ["--seed", "--set"]
    assert complete("navloom", "--v") == ["--version"]


def test_bash_completes_configs_by_name_and_by_path(complete: Complete) -> None:
    assert complete("navloom", "run", "") == sorted([".rt", "bin", "my robot.toml", *shipped_names()])
    assert complete("navloom", "run", "--seed", "3", "--json", "pa") == ["paper"]
    assert complete("navloom", "config", "show", "my") == ["my robot.toml"]


def test_bash_completes_values_of_options_with_and_without_an_equals_sign(complete: Complete) -> None:
    assert complete("navloom", "status", "--robot", "") == ["lab/r2"]
    assert complete("navloom", "status", "--robot", "=", "lab") == ["lab/r2"]
    assert complete("navloom", "status", "--robot", "=") == ["lab/r2"]
    assert complete("navloom", "replay", "run.mcap", "--avoider", "v") == ["vff", "vfh", "vfh_plus", "vfh_star"]
    assert complete("navloom", "run", "paper", "--out", "b") == ["bin"]
    assert complete("navloom", "run", "paper", "--seed", "") == []


def test_bash_completes_plugins_roles_worlds_and_shells(complete: Complete) -> None:
    assert complete("navloom", "plugins", "planner.as") == ["planner.astar"]
    assert complete("navloom", "swap", "av") == ["avoider"]
    assert complete("navloom", "swap", "avoider", "") == []
    assert complete("navloom", "plan", "u_") == ["u_trap"]
    assert complete("navloom", "completion", "") == ["bash", "fish", "zsh"]


def test_an_unknown_shell_is_refused_with_the_known_ones(in_process: Callable[..., tuple[int, str, str]]) -> None:
    code, out, err = in_process("completion", "tcsh")
    assert (code, out) == (2, "") and "shell 'tcsh': expected bash, zsh, fish" in err
    code, out, _ = in_process("completion", "bash")
    assert code == 0 and out.endswith("complete -F _navloom navloom\n")


def test_candidates_are_what_the_framework_discovers() -> None:
    found = Discovery()
    roles = [info for info in found.infos() if info.role in ROLES]
    assert candidates("plugins") == sorted(f"{info.role}.{info.name}" for info in roles)
    assert candidates("worlds") == found.names("world")
    assert candidates("controller") == found.names("controller")
    assert candidates("roles") == sorted({info.role for info in roles})


def test_completion_does_not_import_the_framework(here: Path) -> None:
    for kind in ("configs", "robots", "plugins", "worlds"):
        done = subprocess.run(
            [sys.executable, "-X", "importtime", "-m", "navloom", "__complete", kind],
            capture_output=True, text=True, timeout=30, check=True,
        )  # fmt: skip
        imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
        assert imported.isdisjoint({"typer", "rich", "numpy", "numba", "pydantic", "zenoh", "navloom.cli"}), kind
        assert done.stdout.splitlines() == candidates(kind)


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
def test_zsh_completes(here: Path) -> None:
    """Runs in a terminal, because zsh completes nothing without one."""
    (here / "functions").mkdir()
    (here / "functions" / "_navloom").write_text(SCRIPTS["zsh"](commands(get_command(app))), "utf-8")
    (here / ".zshrc").write_text(ZSHRC)

    reader, writer = pty.openpty()
    environment = {**os.environ, "ZDOTDIR": str(here)}
    shell = subprocess.Popen(["zsh", "-i"], stdin=writer, stdout=writer, stderr=writer, env=environment)
    os.close(writer)

    def ask(line: str) -> list[str]:
        os.write(reader, f"\x15{line}\t".encode())  # after Ctrl-U, which empties the line
        return sorted(set(re.findall(r"<(.*?)>", wait_for(reader, "ENDED"))))

    try:
        wait_for(reader, "READY")
        check_zsh(ask)
    finally:
        shell.kill()
        shell.wait()
        os.close(reader)


def check_zsh(ask: Complete) -> None:
    """Check a first completion, which loads the functions, and later ones."""
    assert ask("navloom re") == ["record", "replay", "report", "resume"]
    assert ask("navloom params ") == ["get", "set"]
    assert ask("navloom run paper --se") == ["--seed", "--set"]
    assert {"paper", "explore", r"my\ robot.toml"} <= set(ask("navloom run "))
    assert ask("navloom status --robot ") == ["lab/r2"]
    assert ask("bin/navloom status --robot ") == ["lab/r2"]
    assert ask("navloom replay run.mcap --avoider=vfh") == ["vfh", "vfh_plus", "vfh_star"]


def wait_for(terminal: int, text: str) -> str:
    """Output of a terminal up to a text."""
    shown = ""
    while text not in shown:
        ready, _, _ = select.select([terminal], [], [], 20.0)
        assert ready, shown
        shown += os.read(terminal, 4096).decode()
    return shown


@pytest.mark.skipif(shutil.which("fish") is None, reason="needs fish")
def test_fish_completes(here: Path) -> None:
    (here / "navloom.fish").write_text(SCRIPTS["fish"](commands(get_command(app))), "utf-8")

    def ask(line: str) -> list[str]:
        out = said("fish", "--no-config", "-c", f"source navloom.fish; complete -C {shlex.quote(line)}")
        return [entry.partition("\t")[0] for entry in out]

    assert ask("navloom re") == ["record", "replay", "report", "resume"]
    assert ask("navloom params ") == ["get", "set"]
    assert ask("navloom run paper --se") == ["--seed", "--set"]
    assert "paper" in ask("navloom run ") and "my robot.toml" in ask("navloom run ")
    assert ask("navloom status --robot ") == ["lab/r2"]
    assert ask("navloom replay run.mcap --avoider vfh") == ["vfh", "vfh_plus", "vfh_star"]
