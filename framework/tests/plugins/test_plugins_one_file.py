"""`--plugin FILE.py`: what a file gives, in this process and in those it starts, and what its errors say."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from navloom.config import load_config
from navloom.hosting.provenance import distributions
from navloom.plugins import Discovery, PluginError, one_file
from navloom.plugins.one_file import FILES, use_files

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
    assert Discovery().role("avoider", "vff").name == "vff"  # beside those that are installed


def test_a_file_may_hold_nodes_and_messages(tmp_path: Path) -> None:
    use_files([kept(tmp_path, "my_heart.py", MIXED)])
    assert Discovery().node("heart").name == "heart"
    assert Discovery().message("my_heart.Beat").schema_name == "my_heart.Beat"


def test_a_file_with_hooks_of_its_own_registers_by_them(tmp_path: Path) -> None:
    use_files([kept(tmp_path, "my_hooks.py", OWN_HOOK)])
    assert Discovery().metric("halves").name == "halves"
    assert "my_hooks" in Discovery().names("observer")


def test_a_process_that_is_started_has_the_same_plugins(tmp_path: Path) -> None:
    use_files([kept(tmp_path, "for_children.py", AVOIDER)])
    ask = "from navloom.plugins import Discovery; print(Discovery().role('avoider', 'slow').speed)"
    assert subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout == "0.1\n"


def test_a_recording_says_which_file_was_used(tmp_path: Path) -> None:
    file = kept(tmp_path, "recorded_avoider.py", AVOIDER)
    use_files([file])
    used = distributions(load_config("paper", ["avoider.plugin=slow"]).config)
    assert used[str(file)].startswith("sha256:") and "navloom-astar" in used


def test_a_file_that_changes_under_way_is_refused(tmp_path: Path) -> None:
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


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match=r"away\.py: No such file"):
        use_files([tmp_path / "away.py"])


def test_a_name_that_is_taken_is_refused_with_both_owners(tmp_path: Path) -> None:
    file = kept(tmp_path, "second_vff.py", AVOIDER.replace('"fast"', '"vff"'))
    use_files([file])
    with pytest.raises(PluginError, match=rf"two plugins are named 'avoider.vff', from {file} and navloom-vff"):
        Discovery().role("avoider", "vff")
