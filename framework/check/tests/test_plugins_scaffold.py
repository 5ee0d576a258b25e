"""`navloom plugins new`: what it writes and refuses. tests/test_new_plugins.py installs and drives the plugins."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from navloom.messages import SCHEMAS
from navloom.plugins import Discovery, PluginError
from navloom_check import scaffold
from navloom_check.scaffold import KINDS, Made, new_distribution

NOTHING = Discovery(found=[])
TOP = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def every_kind(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Made]:
    folder = tmp_path_factory.mktemp("new")
    return {kind: new_distribution(kind, "follow_the_gap_of_many_words", folder, NOTHING) for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
def test_its_entry_points_register_what_they_name(
    kind: str, every_kind: dict[str, Made], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = every_kind[kind]
    monkeypatch.syspath_prepend(str(made.folder / "src"))
    project = tomllib.loads((made.folder / "pyproject.toml").read_text("utf-8"))["project"]
    points = [EntryPoint(name, target, "navloom") for name, target in project["entry-points"]["navloom"].items()]
    discovery = Discovery(found=points)
    assert made.plugin in {f"{role}.{name}" for role in ("message", *KINDS) for name in discovery.names(role)}
    for point in points:
        role, _, name = point.name.partition(".")
        discovery.load(role, f"{made.package}.{name}" if role == "message" else name)
    for name in [name for name in sys.modules if name.partition(".")[0] == made.package]:
        del sys.modules[name]
    for schema in [schema for schema in SCHEMAS if schema.startswith(made.package)]:
        del SCHEMAS[schema]


def test_every_kind_is_clean_and_formatted(every_kind: dict[str, Made], tmp_path: Path) -> None:
    folder = str(next(iter(every_kind.values())).folder.parent)
    for words in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *words, "--no-cache", folder], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout


def test_short_names_are_formatted_too(tmp_path: Path) -> None:
    for kind in KINDS:
        new_distribution(kind, "d", tmp_path, NOTHING)
    for words in (["check"], ["format", "--check"]):
        words = [sys.executable, "-m", "ruff", *words, "--no-cache", str(tmp_path)]
        assert subprocess.run(words, capture_output=True).returncode == 0


@pytest.mark.parametrize("kind", KINDS)
def test_no_placeholder_is_left(kind: str, every_kind: dict[str, Made]) -> None:
    made = every_kind[kind]
    assert {"pyproject.toml", "README.md", ".gitignore", ".github/workflows/test.yml"} < set(made.files)
    assert any(file.startswith("tests/test_") for file in made.files)
    for file in made.files:
        text = (made.folder / file).read_text("utf-8")
        assert "$" not in text.replace("${{ matrix.python }}", ""), file


def test_it_requires_a_compatible_release_of_this_framework(every_kind: dict[str, Made]) -> None:
    framework = tomllib.loads((TOP / "framework" / "core" / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    text = (every_kind["avoider"].folder / "pyproject.toml").read_text("utf-8")
    assert "navloom~=" + ".".join(framework.split(".")[:2]) in tomllib.loads(text)["project"]["dependencies"]


def test_a_name_that_ends_with_the_role_does_not_get_it_twice(tmp_path: Path) -> None:
    made = new_distribution("avoider", "my_avoider", tmp_path, NOTHING)
    assert (made.distribution, made.package, made.plugin) == (
        "navloom-my-avoider",
        "navloom_my_avoider",
        "avoider.my_avoider",
    )


def test_a_message_may_be_named_as_its_class(tmp_path: Path) -> None:
    made = new_distribution("message", "SeenThings", tmp_path, NOTHING)
    assert made.plugin == "message.navloom_seen_things_message.SeenThings"


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    made = new_distribution("avoider", "mine", tmp_path, NOTHING)
    (made.folder / "README.md").write_text("kept", "utf-8")
    with pytest.raises(PluginError, match="exists already"):
        new_distribution("avoider", "mine", tmp_path, NOTHING)
    assert (made.folder / "README.md").read_text("utf-8") == "kept"


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        ("avodier", "mine", "did you mean 'avoider'"),
        ("avoider", "My-Avoider", "expected at most 30 lower case letters"),
        ("avoider", "class", "no Python keyword"),
        ("avoider", "../mine", "expected at most"),
        ("avoider", "a" * 31, "expected at most 30"),
        ("avoider", "vff", "avoider.vff is taken"),
    ],
)
def test_a_bad_or_taken_name_writes_nothing(tmp_path: Path, kind: str, name: str, said: str) -> None:
    with pytest.raises(PluginError, match=said):
        new_distribution(kind, name, tmp_path)
    with pytest.raises(PluginError, match=said):
        new_distribution(kind, name, tmp_path, NOTHING)  # a name of the project, though it is not installed
    assert list(tmp_path.iterdir()) == []


def test_without_pip_the_instructions_use_uv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, (found, told) in enumerate(((object(), "pip install -e"), (None, "uv pip install -e"))):
        monkeypatch.setattr(scaffold, "find_spec", lambda name, found=found: found)
        assert new_distribution("avoider", "mine", tmp_path / str(number), NOTHING).commands[1].startswith(told)


def test_the_folder_of_out_is_created_and_a_file_is_refused(tmp_path: Path) -> None:
    made = new_distribution("avoider", "mine", tmp_path / "far" / "away", NOTHING)
    assert (made.folder / "pyproject.toml").is_file()
    (tmp_path / "taken").touch()
    with pytest.raises(PluginError, match=r"--out .*taken: is a file, expected a folder"):
        new_distribution("avoider", "mine", tmp_path / "taken", NOTHING)
