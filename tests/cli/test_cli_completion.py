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
from navloom.installed import candidates, shipped_names
from navloom.plugins import Discovery
from navloom.roles import ROLES
from navloom_live.hosting.runtime_folders import RobotFolder, Running

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
    show_completion(here / "navloom.bash", "bash")

    def ask(*words: str) -> list[str]:
        typed = " ".join(map(shlex.quote, words))
        script = (
            f"source navloom.bash; COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _navloom_completion navloom; "
            'printf "%s\\n" "${COMPREPLY[@]}"'
        )
        return said("bash", "--norc", "-c", script)

    return ask


def show_completion(file: Path, shell: str) -> None:
    """Write the script that a shell loads."""
    environment = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    words = ["navloom", "--show-completion", shell]
    file.write_bytes(subprocess.run(words, env=environment, capture_output=True, timeout=30, check=True).stdout)


def said(*command: str) -> list[str]:
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return sorted(line for line in done.stdout.splitlines() if line)


def test_bash_completes_commands_groups_and_options(complete: Complete) -> None:
    assert complete("navloom", "re") == ["record", "relocalise", "replay", "report", "results", "resume"]
    assert complete("navloom", "params", "") == ["get", "set"]
    assert complete("navloom", "run", "paper", "--se") == ["--seed", "--set"]
    assert complete("navloom", "--v") == ["--version"]


def test_bash_completes_configs_and_leaves_what_fits_none_to_files(complete: Complete) -> None:
    assert complete("navloom", "run", "") == sorted(shipped_names())
    assert complete("navloom", "run", "--seed", "3", "--json", "pa") == ["paper"]
    assert complete("navloom", "config", "show", "my") == []


def test_bash_completes_values_of_options(complete: Complete) -> None:
    assert complete("navloom", "status", "--robot", "") == ["lab/r2"]
    assert complete("navloom", "replay", "run.mcap", "--avoider", "v") == [
        "vff",
        "vfh",
        "vfh_plus",
        "vfh_star",
        "vfh_swept",
    ]
    assert complete("navloom", "run", "paper", "--seed", "") == []


def test_bash_completes_plugins_roles_and_worlds(complete: Complete) -> None:
    assert complete("navloom", "plugins", "planner.as") == ["planner.astar"]
    assert complete("navloom", "swap", "av") == ["avoider"]
    assert complete("navloom", "swap", "avoider", "") == []
    assert complete("navloom", "plan", "u_") == ["u_trap"]


def test_candidates_are_what_the_framework_discovers() -> None:
    found = Discovery()
    roles = [info for info in found.infos() if info.role in ROLES]
    assert candidates("plugins") == sorted(f"{info.role}.{info.name}" for info in roles)
    assert candidates("worlds") == found.names("world")
    assert candidates("controller") == found.names("controller")
    assert candidates("roles") == sorted({info.role for info in roles})


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
def test_zsh_completes(here: Path) -> None:
    """Runs in a terminal, because zsh completes nothing without one."""
    (here / "functions").mkdir()
    show_completion(here / "functions" / "_navloom", "zsh")
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
    """The first press of the key loads typer's functions and proposes nothing; later ones complete."""
    ask("navloom re")
    assert ask("navloom re") == ["record", "relocalise", "replay", "report", "results", "resume"]
    assert ask("navloom params ") == ["get", "set"]
    assert ask("navloom run paper --se") == ["--seed", "--set"]
    assert {"paper", "explore"} <= set(ask("navloom run "))
    assert ask("navloom run my") == [r"my\ robot.toml"]
    assert ask("navloom status --robot ") == ["lab/r2"]
    assert ask("navloom replay run.mcap --avoider vfh") == ["vfh", "vfh_plus", "vfh_star", "vfh_swept"]


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
    show_completion(here / "navloom.fish", "fish")

    def ask(line: str) -> list[str]:
        out = said("fish", "--no-config", "-c", f"source navloom.fish; complete -C {shlex.quote(line)}")
        return [entry.partition("\t")[0] for entry in out]

    assert ask("navloom re") == ["record", "relocalise", "replay", "report", "results", "resume"]
    assert ask("navloom params ") == ["get", "set"]
    assert ask("navloom run paper --se") == ["--seed", "--set"]
    assert "paper" in ask("navloom run ") and ask("navloom run my") == ["my robot.toml"]
    assert ask("navloom status --robot ") == ["lab/r2"]
    assert ask("navloom replay run.mcap --avoider vfh") == ["vfh", "vfh_plus", "vfh_star", "vfh_swept"]
