"""`uv.py`, which both commands of the README run: Python with and without pip and venv; pip installs a fake uv."""

from __future__ import annotations

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

TOP = Path(__file__).resolve().parents[1]
SCRIPT = TOP / "uv.py"
FAKE_PIP = """
import pathlib, sys
if "--target" not in sys.argv:
    sys.exit("error: externally-managed-environment")
program = pathlib.Path(sys.argv[sys.argv.index("--target") + 1], "bin", "uv")
program.parent.mkdir(parents=True)
program.write_text('#!/bin/sh\\necho "$@"\\necho "$UV_PYTHON|${VIRTUAL_ENV-none}|${UV_CACHE_DIR-none}"\\n')
program.chmod(0o755)
"""
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Runs a copy of the script, with other modules in place of pip and venv."""
    checkout, modules = tmp_path / "checkout", tmp_path / "modules"
    checkout.mkdir()
    modules.mkdir()
    shutil.copy(SCRIPT, checkout)

    def run(*words: str, pip: str = "", venv: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
        for name, source in (("pip", pip), ("venv", venv)):
            (modules / f"{name}.py").unlink(missing_ok=True)
            if source:
                (modules / f"{name}.py").write_text(source, "utf-8")
        given = {"PATH": os.environ["PATH"], "PYTHONPATH": str(modules), "PYTHONDONTWRITEBYTECODE": "1", **environment}
        command = [sys.executable, "-S", str(checkout / "uv.py"), *words]
        return subprocess.run(command, env=given, cwd=checkout, capture_output=True, text=True, timeout=60)

    return run


def test_uv_is_installed_where_the_systems_packages_are_managed_and_gets_the_arguments(
    run: Run, tmp_path: Path
) -> None:
    done = run("run", "navloom", "--x", "a b", pip=FAKE_PIP, HOME=str(tmp_path), VIRTUAL_ENV="/elsewhere")
    said = done.stdout.splitlines()
    assert (done.returncode, said[0]) == (0, "run navloom --x a b"), done.stderr
    python, active, cache = said[1].split("|")
    assert Path(python).samefile(sys._base_executable) and (active, cache) == ("none", "none")  # type: ignore[attr-defined]


def test_the_second_call_installs_nothing(run: Run, tmp_path: Path) -> None:
    run(pip=FAKE_PIP, HOME=str(tmp_path))
    done = run("--version", pip="raise SystemExit(1)", HOME=str(tmp_path))
    assert (done.returncode, done.stdout.splitlines()[0], done.stderr) == (0, "--version", "")


def test_without_a_home_the_cache_is_in_the_checkout(run: Run, tmp_path: Path) -> None:
    done = run(pip=FAKE_PIP, HOME="/dev/null/none")
    assert done.stdout.strip().endswith(str(tmp_path / "checkout" / ".uv" / "cache")), done.stderr
    assert sorted(path.name for path in (tmp_path / "checkout").iterdir()) == [".uv", "uv.py"]


def test_without_pip_and_venv_one_sentence_says_what_to_install(run: Run, tmp_path: Path) -> None:
    done = run("run", venv="raise SystemExit(1)", HOME=str(tmp_path))
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 2 and "`apt install python3-venv`" in last and "Traceback" not in done.stderr
    assert not (tmp_path / "checkout" / ".uv").exists()


def test_where_pip_fails_its_reason_is_kept_and_nothing_is_left(run: Run, tmp_path: Path) -> None:
    done = run("run", pip="raise SystemExit('ERROR: no network')", HOME=str(tmp_path))
    assert done.returncode == 2 and "ERROR: no network" in done.stderr and "Traceback" not in done.stderr
    assert [path.name for path in (tmp_path / "checkout").iterdir()] == ["uv.py"]


def test_an_older_python_gets_one_sentence_that_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ast.parse(SCRIPT.read_text("utf-8"), feature_version=(3, 6))
    old = SimpleNamespace(version_info=(3, 8, 18), version="3.8.18 (x)", executable="/p/python3", argv=["uv.py", "run"])
    main = runpy.run_path(str(SCRIPT))["main"]
    monkeypatch.setitem(main.__globals__, "sys", SimpleNamespace(stderr=sys.stderr, **vars(old)))
    assert main() == 2
    assert capsys.readouterr().err == (
        "error: navloom needs Python 3.11 or newer, and /p/python3 is Python 3.8.18; "
        "run the command with a newer one, for example `python3.12 uv.py run`\n"
    )


def test_hosted_ci_runs_the_readmes_two_commands_on_every_python() -> None:
    readme = (TOP / "README.md").read_text("utf-8")
    commands = re.findall(r"<!-- (?:run|test) -->\n```sh\n(.*?)\n```", readme, re.DOTALL)
    job = yaml.safe_load((TOP / ".github" / "workflows" / "ci.yml").read_text("utf-8"))["jobs"]["commands"]
    assert [step["run"] for step in job["steps"] if "run" in step] == commands and len(commands) == 2
    assert job["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13", "3.14"]
