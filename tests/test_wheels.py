"""Every distribution as users get it: the wheels are complete, and work in an environment of nothing else."""

from __future__ import annotations

import email
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder
from navloom.parts import PARTS

TOP = Path(__file__).resolve().parents[1]
CORE = TOP / "framework" / "core"
OTHERS = [path.parent for path in (*TOP.glob("framework/*/pyproject.toml"), *TOP.glob("plugins/*/pyproject.toml"))]
HOUSES = [CORE, *sorted({TOP / "benchmarks", *OTHERS} - {CORE}, key=lambda path: path.name)]
PROJECTS = {house: tomllib.loads((house / "pyproject.toml").read_text("utf-8"))["project"] for house in HOUSES}
TINY = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "my-plugins"
version = "0.1.0"
dependencies = ["navloom~=0.1"]

[project.entry-points.navloom]
"controller.proportional" = "my_plugins"

[tool.hatch.build.targets.wheel]
only-include = ["my_plugins.py"]
"""


@pytest.mark.parametrize("house", HOUSES, ids=lambda house: house.name)
def test_a_wheel_has_every_file_of_its_package_its_licence_and_its_authors(house: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(next(WheelBuilder(str(house)).build(directory=str(tmp_path)))) as wheel:
        packed = set(wheel.namelist())
        (named,) = (name for name in packed if name.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(wheel.read(named))
        licence = wheel.read(named.replace("METADATA", "licenses/LICENSE"))
    source = house / "src"
    files = (path for path in source.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    assert {path.relative_to(source).as_posix() for path in files} <= packed
    assert (metadata["License-Expression"], metadata["Author"]) == ("Apache-2.0", "The navloom authors")
    assert metadata["Summary"] and licence == (TOP / "LICENSE").read_bytes()


@pytest.mark.parametrize("builder", [WheelBuilder, SdistBuilder])
def test_the_stored_results_are_in_the_study_without_their_pictures(builder: Any, tmp_path: Path) -> None:
    """Who installs navloom-study has a row beside ours: `suites/rows` is a link, and a package needs the files."""
    versions = {"versions": ["standard"]}
    shutil.unpack_archive(
        next(builder(str(TOP / "framework" / "study")).build(directory=str(tmp_path), **versions)),
        tmp_path / "package", "zip" if builder is WheelBuilder else "gztar",
    )  # fmt: skip
    (rows,) = (tmp_path / "package").glob("**/suites/rows")
    stored = {path.relative_to(TOP / "docs" / "results") for path in (TOP / "docs" / "results").glob("*/*.json")}
    assert {path.relative_to(rows) for path in rows.rglob("*") if path.is_file()} == stored
    assert Path("barn-1", "dwa.json") in stored


def test_the_extra_all_is_every_plugin_of_the_project() -> None:
    framework, *plugins = PROJECTS.values()
    named = [re.split("[~=<>]", entry)[0] for entry in framework["optional-dependencies"]["all"]]
    assert named == [project["name"] for project in plugins]


def test_distributions_of_the_project_ask_for_compatible_releases_of_each_other() -> None:
    for project in PROJECTS.values():
        extras = project.get("optional-dependencies", {})
        for entry in [*project["dependencies"], *(entry for extra in extras.values() for entry in extra)]:
            if entry.startswith("navloom"):
                assert re.fullmatch(r"navloom[a-z0-9-]*(\[[a-z]+\])?~=\d+\.\d+(\.\d+)?", entry), (
                    project["name"],
                    entry,
                )


class Site:
    """A virtual environment in a folder of its own, with what pip installs there from the wheels of the project.

    Attributes:
        took: Seconds of each step, by its name.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.took: dict[str, float] = {}
        drop = ("PYTHON", "VIRTUAL_ENV", "NAVLOOM")
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith(drop)}
        venv.create(folder / "venv", with_pip=True)

    def ended(self, program: str, *words: object) -> subprocess.CompletedProcess[str]:
        command = [str(self.folder / "venv" / "bin" / program), *map(str, words)]
        return subprocess.run(
            command, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=900
        )

    def run(self, what: str, program: str, *words: object) -> str:
        begun = time.monotonic()
        done = self.ended(program, *words)
        self.took[what] = round(time.monotonic() - begun, 1)
        assert done.returncode == 0, (program, words, done.stdout[-2000:], done.stderr[-2000:])
        return done.stdout

    def pip(self, what: str, *words: object) -> None:
        self.run(what, "python", "-m", "pip", "--disable-pip-version-check", *words)

    def install(self, *names: str) -> None:
        self.pip(f"install {' '.join(names)}", "install", "-q", "--find-links", self.folder.parent / "dist", *names)

    def size(self) -> str:
        files = (path for path in (self.folder / "venv").rglob("*") if path.is_file())
        return f"{sum(path.lstat().st_size for path in files) / 1e6:.0f} MB"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the folder `dist` of all wheels."""
    folder = tmp_path_factory.mktemp("wheels")
    for house in HOUSES:
        next(WheelBuilder(str(house)).build(directory=str(folder / "dist")))
    assert len(list((folder / "dist").glob("*.whl"))) == len(HOUSES)
    return folder


@pytest.fixture
def site(built: Path) -> Iterator[Site]:
    folder = Path(tempfile.mkdtemp(dir=built))
    site = Site(folder)
    yield site
    print("\n" + json.dumps(site.took, indent=1))
    shutil.rmtree(folder)


def commands_of(project: dict[str, Any]) -> list[str]:
    points = project.get("entry-points", {}).get("navloom", {})
    return [point.removeprefix("command.") for point in points if point.startswith("command.")]


EVERY_COMMAND = {command for project in PROJECTS.values() for command in commands_of(project)}
MINIMAL = """
[run]
stop_after = 20.0

[world]
ref = "empty"

[robot]
footprint = { length = 0.8, width = 0.8 }

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[mapper]
plugin = "known_map"

[planner]
plugin = "astar"

[controller]
plugin = "lyapunov_tracker"

[avoider]
plugin = "vff"

[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 1.0 }
"""
NAMED = ("navloom-astar", "navloom-known-map", "navloom-lyapunov-tracker", "navloom-sensors-sim", "navloom-vff")


def listed(site: Site) -> set[str]:
    """The commands that the help lists."""
    text = site.run("--help", "navloom", "--help")
    return {found[1] for line in text.splitlines() if (found := re.match(r"[│ ]{2,}([a-z]+)\b", line))} & EVERY_COMMAND


def test_the_core_has_at_most_nine_dependencies() -> None:
    assert len(PROJECTS[CORE]["dependencies"]) <= 9


@pytest.mark.slow
def test_the_core_alone_runs_a_config_with_the_plugins_that_it_names(site: Site) -> None:
    site.install("navloom")
    print(f"\nnavloom alone: {site.size()}")
    assert listed(site) == set(commands_of(PROJECTS[CORE]))
    (site.folder / "minimal.toml").write_text(MINIMAL, "utf-8")
    site.install(*NAMED)
    output = site.run("run", "navloom", "run", "minimal.toml", "--json", "--out", "out")
    assert json.loads(output)["truly_reached"]
    assert sorted(path.name for path in (site.folder / "out").iterdir()) == [
        "map.pgm", "map.yaml", "result.json", "trace.bin",
    ]  # fmt: skip
    names = {path.name.partition("-")[0] for path in site.folder.glob("venv/lib/*/site-packages/navloom*.dist-info")}
    assert names == {"navloom", "navloom_avoidance", *(name.replace("-", "_") for name in NAMED)}


@pytest.mark.slow
def test_what_the_core_alone_lacks_is_named_in_one_line_with_what_to_install(site: Site) -> None:
    site.install("navloom")
    (site.folder / "minimal.toml").write_text(MINIMAL, "utf-8")
    words = {(command,): project["name"] for project in PROJECTS.values() for command in commands_of(project)}
    words = {given: name for given, name in words.items() if name != "navloom"}
    run = ("run", "minimal.toml")
    words |= {(*run, "--record", "a.mcap"): "navloom-recording", ("graph", "--robot", "r1"): "navloom-live"}
    words |= {(*run, *option): "'navloom[view]'" for option in (("--view",), ("--web",), ("--rerun", "a.rrd"))}
    for given, name in words.items():
        done = site.ended("navloom", *given)
        (line,) = done.stderr.splitlines()
        assert (done.returncode, done.stdout) == (2, "") and line.endswith(
            f"which is not installed: pip install {name}"
        )
        assert line.startswith(f"navloom: `navloom {given[0]}`" if len(given) == 1 else "navloom: "), line
    for name, package in (("Navigator", "navloom_live"), ("Panel", "navloom_viewer")):
        done = site.ended("python", "-c", f"from navloom import {name}")
        part = PARTS[package]
        said = f"navloom.{name} needs {part}, which is not installed: pip install {part}"
        assert done.stderr.splitlines()[-1] == f"navloom.parts.MissingPartError: {said}"


@pytest.mark.slow
def test_all_wheels_drive_compare_and_take_a_plugin(site: Site) -> None:
    """With pip alone, which takes the wheels of other projects from the index: minutes."""
    site.install("navloom[all]")
    print(f"\nnavloom[all]: {site.size()}")
    assert listed(site) == EVERY_COMMAND
    assert json.loads(site.run("run paper", "navloom", "run", "paper", "--json"))["truly_reached"]
    assert "navloom-vfh" in site.run("plugins", "navloom", "plugins")
    study = ("--worlds", "door:2.0", "--seeds", "0:2", "--jobs", 1, "--out", "study")
    site.run("compare", "navloom", "compare", "paper", "--vary", "avoider=improved_vfh,vff", *study)
    assert (site.folder / "study" / "report.html").exists()

    mine = site.folder / "mine"
    mine.mkdir()
    (mine / "pyproject.toml").write_text(TINY, "utf-8")
    page = (TOP / "docs" / "writing-a-plugin.md").read_text("utf-8")
    block = re.search(r"^## The class\n.*?```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert block is not None
    (mine / "my_plugins.py").write_text(block[1], "utf-8")
    site.pip("install a plugin", "install", "-q", "--no-deps", "./mine")
    assert "gain" in site.run("plugins", "navloom", "plugins", "controller.proportional")
    driven = site.run("run a plugin", "navloom", "run", "building", "--set", "controller.plugin=proportional", "--json")
    assert json.loads(driven)["truly_reached"]


@pytest.mark.slow
def test_an_editable_core_takes_parts_from_wheels_and_the_reverse(site: Site) -> None:
    site.install("navloom[all]", "hatchling", "editables")
    wheels = sorted((site.folder.parent / "dist").glob("*.whl"))
    (core,) = (wheel for wheel in wheels if wheel.name.startswith("navloom-"))
    editable = ("install", "-q", "--no-deps", "--no-build-isolation")
    others = [word for house in HOUSES if house != CORE for word in ("-e", house)]
    in_wheel, in_checkout = site.folder / "venv", CORE / "src"
    for what, words, place in (
        ("core editable", ("-e", CORE), in_checkout),
        ("parts editable", ("--force-reinstall", core, *others), in_wheel),
    ):
        site.pip(what, *editable, *words)
        where = [
            site.run(what, "python", "-c", f"import {name}; print({name}.__file__)")
            for name in ("navloom", "navloom_study")
        ]
        assert [str(place) in one for one in where] == [True, False]
        assert listed(site) == EVERY_COMMAND
        driven = site.run(f"{what}: run", "navloom", "run", "paper", "--json", "--out", what.replace(" ", "_"))
        assert json.loads(driven)["truly_reached"] and (site.folder / what.replace(" ", "_") / "run.png").exists()
