"""The mutation script on a toy project: a mutant that a test notices, one that none does, and nothing left behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.once
SCRIPT = Path(__file__).parent / "mutate.py"
MODULE = '''"""A toy."""

from navloom_toy.params import LIMIT


def clipped(value: float) -> float:
    return min(value, LIMIT)


def unseen(value: float) -> float:
    return value * 2.0
'''
PARAMS = '''"""Its parameters."""

LIMIT = 3.0


class ToyParams:
    limit: float = 3.0
    speed: float = 0.5
'''
TEST = """from navloom_toy.params import ToyParams
from navloom_toy.toy import clipped


def test_the_limit_is_3():
    assert ToyParams.limit == 3.0 and clipped(4.0) == 3.0 and clipped(2.0) == 2.0


def test_that_fails_anyway():
    assert False
"""


Verdicts = list[dict[str, str]]


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Verdicts, str, bool]]:
    """Verdicts and output of a run on a checkout with one plugin, and whether its files are still the same."""
    top = tmp_path_factory.mktemp("toy")
    source, tests = top / "plugins/toy/src/navloom_toy", top / "plugins/toy/tests"
    for path, text in (
        (source / "__init__.py", ""),
        (source / "toy.py", MODULE),
        (source / "params.py", PARAMS),
        (tests / "test_toy.py", TEST),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    before, found = {path: path.read_bytes() for path in top.rglob("*.py")}, top / "found.json"
    command = [sys.executable, str(SCRIPT), "--top", str(top), "--modules", "toy", "--json", str(found)]
    done = subprocess.run([*command, "--lines", "9", "--constants"], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1, done.stderr
    is_unchanged = {path: path.read_bytes() for path in top.rglob("*.py")} == before
    yield json.loads(found.read_text("utf-8")), done.stdout, is_unchanged


def test_lines_that_no_test_reaches_survive(toy: tuple[Verdicts, str, bool]) -> None:
    verdicts, output, _ = toy
    lines = [v for v in verdicts if v["kind"] == "line"]
    assert [(v["place"].rpartition(":")[2], v["result"], v["by"]) for v in lines] == [
        ("7", "noticed", "plugins/toy/tests/test_toy.py::test_the_limit_is_3"),
        ("11", "survived", ""),
    ]
    assert "toy line: 1 of 2 noticed (50.0 %)" in output


def test_a_constant_is_noticed_where_a_test_needs_it(toy: tuple[Verdicts, str, bool]) -> None:
    found = [(v["change"].partition("=")[0], v["result"]) for v in toy[0] if v["kind"] == "constant"]
    assert found == [("limit", "noticed"), ("speed", "survived")]


def test_no_file_is_changed(toy: tuple[Verdicts, str, bool]) -> None:
    assert toy[2]


def test_the_same_seed_changes_the_same_lines() -> None:
    lists = [
        subprocess.run(
            [sys.executable, str(SCRIPT), "--modules", "vff", "--lines", "7", "--seed", seed, "--list"],
            capture_output=True, text=True, timeout=60, check=True,
        ).stdout.splitlines()
        for seed in ("4", "4", "5")
    ]  # fmt: skip
    assert len(lists[0]) == 7 and lists[0] == lists[1] != lists[2]


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are found in /proc")
def test_a_run_that_is_ended_leaves_nothing(tmp_path: Path) -> None:
    """Neither a process nor a file: the mutant of the first line is under test when the run is ended."""
    command = [sys.executable, str(SCRIPT), "--modules", "vff", "--lines", "3"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as run:
        deadline = time.monotonic() + 60.0
        while not list(tmp_path.glob("mutant*/mutant.json")) and time.monotonic() < deadline:
            time.sleep(0.05)
        run.terminate()
        assert run.wait(20.0) == 143
    assert list(tmp_path.iterdir()) == []
    assert not [path for path in Path("/proc").glob("[0-9]*/environ") if str(tmp_path).encode() in read(path)]


def read(path: Path) -> bytes:
    """Contents, or nothing where the process has ended or is another user's."""
    try:
        return path.read_bytes()
    except OSError:
        return b""
