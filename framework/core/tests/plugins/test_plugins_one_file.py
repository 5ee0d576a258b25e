"""`--plugin FILE.py`: the plugins of a file, in this process and in those it starts, and its errors."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest
from navloom.config import load_config
from navloom.plugins import Discovery, PluginError, one_file
from navloom.plugins.one_file import FILES, replaced_by, use_files
from navloom.runs.provenance import distributions
from navloom.testing import avoider_input, make

AVOIDER = """
from navloom import Avoidance, Avoider, Twist2D


class Base(Avoider):
    speed = 0.1

    def avoid(self, given):
        return Avoidance(Twist2D(self.speed, 0.0, 0.0), "clear")


class Slow(Base):
    name = "slow"


class Fast(Base):
    name = "fast"
    speed = 0.5
"""
MIXED = """
from navloom import Message, NodePlugin, Publishes, Stamp, Tick, message


@message
class Beat(Message):
    stamp_ns: Stamp


class Heart(NodePlugin):
    name = "heart"
    ticks = True
    beats = Publishes(Beat)

    def step(self, tick: Tick) -> None:
        self.beats.put(Beat(tick.time_ns))
"""
OWN_HOOK = """
from navloom import Metric, hookimpl


@hookimpl
def navloom_register(registry):
    registry.metric(Metric("halves", "1", None, lambda trail: 0.5, "Always the half."))


@hookimpl
def navloom_run_started(run):
    pass
"""


@pytest.fixture(autouse=True)
def no_files_afterwards(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv(FILES, "[]")
    monkeypatch.setattr(one_file, "_LOADED", {})
    yield
    for path in one_file._LOADED:
        sys.modules.pop(path.stem, None)


def kept(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, "utf-8")
    return path


def test_every_named_class_of_a_file_is_a_plugin_of_its_role(tmp_path: Path) -> None:
    file = kept(tmp_path, "two_avoiders.py", AVOIDER)
    use_files([file])
    found = {(info.role, info.name): info for info in Discovery().infos() if info.distribution == str(file)}
    assert set(found) == {("avoider", "slow"), ("avoider", "fast")}
    assert Discovery().role("avoider", "fast").__module__ == "two_avoiders"
    assert Discovery().role("avoider", "vff").name == "vff"  # in addition to the installed ones


def test_a_file_may_hold_nodes_and_messages(tmp_path: Path) -> None:
    use_files([kept(tmp_path, "my_heart.py", MIXED)])
    assert Discovery().node("heart").name == "heart"
    assert Discovery().message("my_heart.Beat").schema_name == "my_heart.Beat"


def test_a_file_with_its_own_hooks_registers_by_them(tmp_path: Path) -> None:
    use_files([kept(tmp_path, "my_hooks.py", OWN_HOOK)])
    assert Discovery().metric("halves").name == "halves"
    assert "my_hooks" in Discovery().names("observer")


def test_a_child_process_has_the_same_plugins(tmp_path: Path) -> None:
    use_files([kept(tmp_path, "for_children.py", AVOIDER)])
    ask = "from navloom.plugins import Discovery; print(Discovery().role('avoider', 'slow').speed)"
    assert subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout == "0.1\n"


def test_a_recording_says_which_file_was_used(tmp_path: Path) -> None:
    file = kept(tmp_path, "recorded_avoider.py", AVOIDER)
    use_files([file])
    used = distributions(load_config("paper", ["avoider.plugin=slow"]).config)
    assert used[str(file)].startswith("sha256:") and "navloom-astar" in used


def test_a_file_that_changes_during_the_run_is_refused(tmp_path: Path) -> None:
    file = kept(tmp_path, "changing.py", AVOIDER)
    use_files([file])
    file.write_text(AVOIDER.replace("0.1", "0.3"), "utf-8")
    one_file._LOADED.clear()  # as in another process
    with pytest.raises(PluginError, match="changed after the command started"):
        Discovery()


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("broken.py", "import math\n\nmath.nothing\n",
         r"broken\.py: the import fails: AttributeError.*\(broken\.py:3\)"),
        ("torn.py", "import math\nclass X(\n", r"SyntaxError.*torn\.py, line 2"),
        ("leaving.py", "import sys\nsys.exit(3)\n", r"leaving\.py: the import fails: SystemExit: 3 \(leaving\.py:2\)"),
        ("nothing.py", "x = 1\n", r"nothing\.py: there is no plugin in it; expected a subclass of a role"),
        ("nameless.py", AVOIDER.partition("class Slow")[0], r"nameless\.py:5: class Base has no `name`"),
        ("verbless.py", "from navloom import Avoider\n\n\nclass A(Avoider):\n    name = 'a'\n",
         r"verbless\.py:4: avoider\.a does not implement avoid"),
        ("json.py", AVOIDER, r"a module 'json' exists already .*rename the file"),
        ("my-plugin.txt", AVOIDER, r"expected the name of a Python file"),
    ],
)  # fmt: skip
def test_an_error_names_the_file_and_the_line(tmp_path: Path, name: str, text: str, said: str) -> None:
    with pytest.raises(PluginError, match=said):
        use_files([kept(tmp_path, name, text)])
    assert not any(info.distribution.startswith(str(tmp_path)) for info in Discovery().infos())


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match=r"away\.py: No such file"):
        use_files([tmp_path / "away.py"])


def test_a_file_replaces_an_installed_plugin_of_its_name_and_says_so(tmp_path: Path) -> None:
    file = kept(tmp_path, "second_vff.py", AVOIDER.replace('"fast"', '"vff"'))
    use_files([file])
    assert Discovery().role("avoider", "vff").__module__ == "second_vff"
    assert replaced_by([file]) == [f"avoider.vff: that of {file} replaces the one of navloom-vff"]


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    first, second = (kept(tmp_path, name, AVOIDER.replace('"fast"', '"vff"')) for name in ("one_vff.py", "two_vff.py"))
    use_files([first, second])
    with pytest.raises(PluginError, match=rf"two plugins are named 'avoider.vff', from {first} and {second}"):
        Discovery().role("avoider", "vff")


LOOP = """
def search():
    while True:
        try:
            while True:
                pass
        except Exception:
            pass


search()
"""


def test_an_import_that_does_not_end_is_ended_with_its_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_file, "LONGEST_IMPORT", 0.2)
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(
        PluginError, match=r"loop\.py: the import fails: ImportTimeout: not over after 0\.2 s; .* \(loop\.py:[4567]\)"
    ):
        use_files([kept(tmp_path, "loop.py", LOOP)])
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0) and signal.getsignal(signal.SIGALRM) is before


def test_an_import_that_breaks_the_process_is_named_with_its_line(tmp_path: Path) -> None:
    file = kept(tmp_path, "torn.py", "import ctypes\n\nctypes.string_at(0)\n")
    command = [sys.executable, "-m", "navloom", "run", "paper", "--plugin", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == -signal.SIGSEGV
    (line,) = done.stderr.splitlines()
    assert line.startswith("navloom: ") and "Segmentation fault at torn.py:3, in <module>" in line


EVERYTHING = f"""{AVOIDER}
import numpy as np
from navloom import Message, Path, Planner, Stamp, hookimpl, message
from navloom.geometry.world import World


class Straight(Planner):
    name = "straight"

    def plan(self, given):
        start, goal = given.request.start, given.request.goal
        points = np.array([(start.x, start.y), (goal.x, goal.y)])
        return Path(given.request.request_id, points, float(np.hypot(*(points[1] - points[0]))), None)


@message
class Beat(Message):
    \"\"\"A beat of a heart.\"\"\"

    stamp_ns: Stamp


@hookimpl
def navloom_register(registry):
    registry.add(Slow)
    registry.add(Straight)
    registry.message(Beat)
    registry.world("nowhere", lambda: World("nowhere", ()))
"""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("graph", "paper", "--set", "avoider.plugin=slow"), "avoider (slow)"),
        (("plan", "empty", "--from", "0,0", "--to", "3,4", "--planner", "straight"), "5.000 m in"),
        (("worlds",), "nowhere"),
        (("messages", "Beat"), "everything.Beat/1 of"),
    ],
)
def test_a_command_that_uses_plugins_takes_files(
    tmp_path: Path, in_process: Callable[..., tuple[int, str, str]], words: tuple[str, ...], said: str
) -> None:
    code, out, err = in_process(*words, "--plugin", str(kept(tmp_path, "everything.py", EVERYTHING)))
    assert code == 0 and said in out, out + err


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("return None", r"TypeError: plan\(\) gives NoneType, expected Path or PlanFailure"),
        ("return 1 / 0", r"ZeroDivisionError: division by zero \(everything\.py:\d+\)"),
    ],
)
def test_a_planner_that_fails_is_blamed_by_plan(
    tmp_path: Path, in_process: Callable[..., tuple[int, str, str]], wrong: str, said: str
) -> None:
    file = kept(
        tmp_path, "everything.py", EVERYTHING.replace("start, goal = given", f"{wrong}\n        start, goal = given")
    )
    words = ("plan", "empty", "--from", "0,0", "--to", "3,4", "--planner", "straight", "--plugin", str(file))
    code, _, err = in_process(*words)
    assert code == 2 and re.fullmatch(rf"navloom: planner straight failed: {said}\n", err), err


def test_a_file_imports_a_module_beside_it_here_and_in_a_child_process(tmp_path: Path) -> None:
    (tmp_path / "beside_it.py").write_text(AVOIDER, "utf-8")
    file = tmp_path / "uses_beside.py"
    file.write_text("from beside_it import Fast\n\n\nclass Faster(Fast):\n    name = 'faster'\n", "utf-8")
    use_files([file])
    # What it imports is not its own: only the class that the file defines is a plugin.
    assert Discovery().plugin("avoider", "faster").speed == 0.5
    assert "fast" not in Discovery().names("avoider")
    code = "from navloom.plugins import Discovery; print(Discovery().plugin('avoider', 'faster').speed)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120.0, check=False)
    assert done.stdout.strip() == "0.5", done.stderr


def test_each_file_imports_the_module_of_its_own_folder(tmp_path: Path) -> None:
    for number, name in enumerate(("one_folder", "other_folder")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "shared_name.py").write_text(f"{AVOIDER}\n\nSPEED = {number}\n", "utf-8")
        text = f"from shared_name import SPEED, Base\n\n\nclass Own(Base):\n    name = '{name}'\n    speed = SPEED\n"
        (tmp_path / name / f"plugin_of_{name}.py").write_text(text, "utf-8")
    use_files([tmp_path / name / f"plugin_of_{name}.py" for name in ("one_folder", "other_folder")])
    speeds = [Discovery().plugin("avoider", name).speed for name in ("one_folder", "other_folder")]
    assert speeds == [0, 1]


BESIDE = """
from navloom import Avoidance, Avoider, Twist2D


class Own(Avoider):
    name = "{0}"

    def avoid(self, given):
        import beside_{0}

        return Avoidance(Twist2D(beside_{0}.speed(), 0.0, 0.0), "clear")
"""


def test_an_import_in_a_function_finds_the_module_beside_the_file(tmp_path: Path) -> None:
    for number, name in enumerate(("early", "late")):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"own_{name}.py").write_text(BESIDE.format(name), "utf-8")
        helper = f"def speed():\n    import deeper_{name}\n\n    return deeper_{name}.SPEED\n"
        (tmp_path / name / f"beside_{name}.py").write_text(helper, "utf-8")
        (tmp_path / name / f"deeper_{name}.py").write_text(f"SPEED = 0.{number}\n", "utf-8")
    use_files([tmp_path / name / f"own_{name}.py" for name in ("early", "late")])
    answers = [make(Discovery().plugin("avoider", name)).avoid(avoider_input()) for name in ("early", "late")]
    assert [answer.twist.vx for answer in answers] == [0.0, 0.1]


def test_what_lies_beside_a_plugin_file_is_not_found_by_other_code(tmp_path: Path) -> None:
    (tmp_path / "only_beside.py").write_text("", "utf-8")
    use_files([kept(tmp_path, "has_neighbour.py", AVOIDER)])
    with pytest.raises(ModuleNotFoundError):
        import_module("only_beside")
