"""Plugins that `navloom plugins new` writes, in an environment of the built wheels alone: 20 minutes on two cores.

Each kind is made, installed, checked by its own tools and by `navloom check`, and used: a role drives `paper`
and is in the table of `navloom compare`.
"""

from __future__ import annotations

import json
import os
import subprocess
import tomllib
import venv
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom_check.scaffold import KINDS

TOP = Path(__file__).resolve().parents[1]
HOUSES = [
    *sorted((TOP / "framework").iterdir()),
    TOP / "benchmarks",
    *(path.parent for path in (TOP / "plugins").glob("*/pyproject.toml")),
]
ROLES = ["avoider", "controller", "planner", "mapper", "localizer", "recovery"]
Run = Callable[..., str]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs a program of an environment with the wheels, in its folder; gives what it prints."""
    top = tmp_path_factory.mktemp("wheels")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    links = f"{top / 'dist'} {environment.get('PIP_FIND_LINKS', '')}".strip()
    environment |= {"PIP_FIND_LINKS": links, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}

    def run(program: str, *words: object, within: str = ".", exit_code: int = 0) -> str:
        command = [str(top / "env" / "bin" / program), *map(str, words)]
        done = subprocess.run(
            command, cwd=top / within, env=environment, capture_output=True, text=True, timeout=1200
        )  # fmt: skip
        assert done.returncode == exit_code, (command, done.stdout[-3000:], done.stderr[-3000:])
        return done.stdout

    venv.create(top / "env", with_pip=True)
    run("python", "-m", "pip", "wheel", "-q", "--no-deps", "-w", "dist", *HOUSES)
    run("python", "-m", "pip", "install", "-q", "navloom[all]")
    return run


@pytest.fixture(scope="module")
def made(run: Run) -> Callable[[str], str]:
    """Generates and installs a plugin `demo` of a kind, once; gives its folder."""
    folders: dict[str, str] = {}

    def made(kind: str) -> str:
        if kind not in folders:
            folders[kind] = json.loads(run("navloom", "plugins", "new", kind, "demo", "--json"))["folder"]
            run("python", "-m", "pip", "install", "-q", f"./{folders[kind]}[test]")
        return folders[kind]

    return made


@pytest.mark.parametrize("kind", KINDS)
def test_as_generated_it_passes_its_own_checks(kind: str, run: Run, made: Callable[[str], str]) -> None:
    folder = made(kind)
    run("ruff", "check", ".", within=folder)
    run("ruff", "format", "--check", ".", within=folder)
    run("mypy", within=folder)
    run("pytest", "-q", within=folder)


@pytest.mark.parametrize("kind", KINDS)
def test_as_generated_it_passes_navloom_check(kind: str, run: Run, made: Callable[[str], str]) -> None:
    top = Path(run("python", "-c", "import os; print(os.getcwd())").strip())
    project = tomllib.loads((top / made(kind) / "pyproject.toml").read_text("utf-8"))["project"]
    plugin = next(iter(project["entry-points"]["navloom"]))
    if kind == "message":
        plugin = "message.navloom_demo_message.Demo"
    run("navloom", "check", plugin)


@pytest.mark.parametrize("role", [*ROLES, "platform"])
def test_a_new_plugin_drives_the_papers_config(role: str, run: Run, made: Callable[[str], str]) -> None:
    made(role)
    assert json.loads(run("navloom", "run", "paper", "--set", f"{role}.plugin=demo", "--json"))["truly_reached"]


@pytest.mark.parametrize("role", ROLES)
def test_compare_shows_a_new_plugin(role: str, run: Run, made: Callable[[str], str]) -> None:
    made(role)
    study = ("--seeds", "0:1", "--worlds", "doorway", "--jobs", 1, "--out", f"study-{role}")
    table = run("navloom", "compare", "paper", "--vary", f"{role}=demo", *study)
    assert table.splitlines()[2].split()[0] == "demo"


def test_the_other_kinds_are_used(run: Run, made: Callable[[str], str]) -> None:
    for kind in ("node", "metric", "world", "scheme", "message"):
        made(kind)
    assert json.loads(run("navloom", "run", "robot.toml", "--json", within=made("node")))["truly_reached"]
    for reference in ("demo", "demo:posts.txt"):
        words = ("--set", f"world.ref={reference}", "--json")
        assert json.loads(run("navloom", "run", "building", *words, within=made("scheme")))["truly_reached"]
    study = ("--vary", "avoider=vff", "--seeds", "0:1", "--worlds", "empty", "--jobs", 1, "--out", "study-metric")
    told = json.loads(run("navloom", "compare", "paper", *study, "--json"))
    assert "demo" in json.dumps(told)
    assert "weights" in run("navloom", "messages", "navloom_demo_message.Demo")
