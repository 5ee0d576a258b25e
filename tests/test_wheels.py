"""Every distribution as users get it: the wheels are complete, and work in an environment of nothing else."""

from __future__ import annotations

import email
import json
import os
import re
import shutil
import subprocess
import time
import tomllib
import venv
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

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


@pytest.mark.slow
def test_wheels_alone_drive_compare_and_take_a_plugin(tmp_path: Path) -> None:
    """Builds and installs with pip alone, which takes the wheels of other projects from the index: minutes."""
    took: dict[str, float] = {}
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}

    def run(what: str, *command: object) -> str:
        begun = time.monotonic()
        words = [str(word) for word in command]
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=900)
        took[what] = time.monotonic() - begun
        assert done.returncode == 0, (words, done.stdout[-2000:], done.stderr[-2000:])
        return done.stdout

    def in_environment(name: str) -> Callable[[str], Path]:
        venv.create(tmp_path / name, with_pip=True)
        return lambda program: tmp_path / name / "bin" / program

    def size(name: str) -> str:
        return f"{sum(path.lstat().st_size for path in (tmp_path / name).rglob('*') if path.is_file()) / 1e6:.0f} MB"

    alone = in_environment("alone")
    pip = (alone("python"), "-m", "pip", "--disable-pip-version-check")
    run("build wheels", *pip, "wheel", "-q", "--no-deps", "-w", "dist", *HOUSES)
    assert len(list((tmp_path / "dist").glob("*.whl"))) == len(HOUSES)
    run("install navloom", *pip, "install", "-q", "--find-links", "dist", "navloom")
    sizes = {"navloom": size("alone")}
    refused = subprocess.run(
        [str(alone("navloom")), "run", "paper"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert refused.returncode == 2 and "pip install 'navloom[all]'" in refused.stderr, refused.stderr

    run("install navloom[all]", *pip, "install", "-q", "--find-links", "dist", "navloom[all]")
    sizes["navloom[all]"] = size("alone")
    navloom = alone("navloom")
    assert json.loads(run("run paper", navloom, "run", "paper", "--json"))["truly_reached"]
    assert "navloom-vfh" in run("plugins", navloom, "plugins")
    study = ("--worlds", "door:2.0", "--seeds", "0:2", "--jobs", 1, "--out", "study")
    run("compare", navloom, "compare", "paper", "--vary", "avoider=improved_vfh,vff", *study)
    assert (tmp_path / "study" / "report.html").exists()

    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "pyproject.toml").write_text(TINY, "utf-8")
    page = (TOP / "docs" / "writing-a-plugin.md").read_text("utf-8")
    block = re.search(r"## The class\n+```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert block is not None
    (tmp_path / "mine" / "my_plugins.py").write_text(block[1], "utf-8")
    run("install a plugin", *pip, "install", "-q", "--no-deps", "./mine")
    assert "gain" in run("plugins", navloom, "plugins", "controller.proportional")
    driven = run("run a plugin", navloom, "run", "building", "--set", "controller.plugin=proportional", "--json")
    assert json.loads(driven)["truly_reached"]
    print("\n" + json.dumps({"sizes": sizes, "seconds": {what: round(s, 1) for what, s in took.items()}}, indent=1))
    shutil.rmtree(tmp_path / "alone")
