"""`navloom plugins new`: creates a distribution with one plugin from the templates beside this file."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from string import Template

from navloom.plugins.discovery import Discovery
from navloom.plugins.registry import PluginError, nearest
from navloom.plugins.shipped_plugins import shipped_names
from navloom.roles import ROLES

__all__ = ["KINDS", "Made", "new_distribution"]

TEMPLATES = Path(__file__).parent / "templates"
LONGEST = 30
"""Longest name of a plugin, characters."""


@dataclass(frozen=True)
class PluginKind:
    """The parts of a template that differ between kinds of plugin.

    Attributes:
        about: First paragraph of the README.
        pure: Module with the maths.
        commands: Commands that show the plugin at work.
        more: Paragraph below these commands.
        points: Names of the entry points.
    """

    about: str
    pure: str
    commands: tuple[str, ...]
    more: str
    points: tuple[str, ...] = ("$kind.$name",)


_DRIVE = "navloom run paper --set $kind.plugin=$name"
_STUDY = " --seeds 0:2 --out study"
_BESIDE = "`navloom compare` compares it with another $kind and writes `study/report.html`."


def _of_role(about: str, pure: str, other: str) -> PluginKind:
    study = f"navloom compare paper --vary $kind=$name,{other}{_STUDY}"
    return PluginKind(f"The $kind `$name` for navloom: {about}.", pure, (_DRIVE, study), _BESIDE)


KINDS = {
    "avoider": _of_role(
        "it drives along the free direction that deviates least from the target", "directions", "improved_vfh"
    ),
    "controller": _of_role("it steers towards a point ahead on the reference", "law", "lyapunov_tracker"),
    "planner": _of_role("shortest paths of a disc on the raster map (A*)", "search", "astar"),
    "mapper": _of_role(
        "it counts where the beams of lasers and sweeps end, and where they pass", "counting", "ipabd"
    ),
    "localizer": _of_role("dead reckoning with a growing variance", "frames", "odometry"),
    "recovery": _of_role("it backs up along its own track, and requests a new map", "backing", "wait_and_replan"),
    "platform": PluginKind(
        "The platform `$name` for navloom: a simulated unicycle with motor lag, a laser, sonars and a pitched laser.",
        "rays",
        (_DRIVE, f"navloom compare paper --set platform.plugin=$name --vary avoider=improved_vfh,vff{_STUDY}"),
        "To make it a driver, let `advance` talk to the motors and sensors, set `is_simulated` to False, and give\n"
        "no truth.",
    ),
    "node": PluginKind(
        "The node `$name` for navloom: it reads range sensors and publishes the nearest echo.",
        "nearest",
        ("navloom run robot.toml", "navloom run robot.toml --record run.mcap && navloom replay run.mcap --check"),
        "`robot.toml` has the node in a table `[[node]]`. Live, `navloom echo nearest/echo` prints what it publishes.",
        ("node.$name", "message.${Name}Echo"),
    ),
    "metric": PluginKind(
        "The metric `$name` for navloom: the share of the ticks in which the robot turns.",
        "turning",
        (f"navloom compare paper --vary avoider=improved_vfh,vff{_STUDY}",),
        "Every study now has a column for it.",
    ),
    "panel": PluginKind(
        "The viewer panel `$name` for navloom: the nearest echo of each range sensor, as a dot.",
        "nearest",
        ("navloom run paper --view",),
        "Every viewer now draws it.",
    ),
    "world": PluginKind(
        "The world `$name` for navloom: a room with two rows of posts.",
        "layout",
        ("navloom run building --set world.ref=$name", f"navloom compare building --worlds $name{_STUDY}"),
        "It has its own start and goal.",
    ),
    "scheme": PluginKind(
        "The world scheme `$name` for navloom: worlds from files with one post per line.",
        "reading",
        ("navloom run building --set world.ref=$name:posts.txt",
         f"navloom compare building --worlds $name:posts.txt{_STUDY}"),
        "`posts.txt` is an example.",
    ),
    "message": PluginKind(
        "The message `$Name` for navloom: detected objects with weights.",
        "messages",
        ("navloom messages $package.$Name",),
        "Sensors and nodes of other distributions can import and publish it.",
        ("message.$Name",),
    ),
}  # fmt: skip
"""Template parts of each kind, in the order in which messages list the kinds."""


@dataclass(frozen=True)
class Made:
    """A distribution that was written.

    Attributes:
        folder: Its folder.
        distribution, package: Its names.
        plugin: Its name for `navloom check`, as `avoider.demo`.
        files: Paths relative to the folder, sorted.
        commands: Commands to type next.
    """

    folder: Path
    distribution: str
    package: str
    plugin: str
    files: tuple[str, ...]
    commands: tuple[str, ...]


def new_distribution(kind: str, name: str, where: Path, discovery: Discovery | None = None) -> Made:
    """Write a distribution with one plugin into a new folder.

    Args:
        kind: A role, node, metric, panel, world, scheme or message.
        name: Name of the plugin, in lower case with underscores; a message's class gets it in CamelCase.
        where: Parent of the new folder.
        discovery: The plugins that are installed.

    Raises:
        PluginError: Unknown kind, invalid or taken name, or the folder exists.
    """
    if kind not in KINDS:
        raise PluginError(f"kind {kind!r} does not exist{nearest(kind, list(KINDS))}")
    name = _checked(kind, name)
    values = _values(kind, name)
    _refuse_taken(kind, values, discovery or Discovery())
    folder = where / values["distribution"]
    if folder.exists():
        raise PluginError(f"{folder}: exists already; choose another name, another --out, or remove it")
    if where.exists() and not where.is_dir():
        raise PluginError(f"--out {where}: is a file, expected a folder")
    texts = {path: Template(text).substitute(values) for path, text in _files(kind, values)}
    for path, text in texts.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, "utf-8")
    (folder / "src" / values["package"] / "py.typed").touch()
    commands = tuple(Template(command).substitute(values) for command in KINDS[kind].commands)
    install = "pip install" if find_spec("pip") else "uv pip install"  # uv makes environments without pip
    first = (f"{install} -e '.[test]'", "pytest", f"navloom check {values['check']}")
    return Made(folder, values["distribution"], values["package"], values["check"], tuple(sorted(texts)),
                (f"cd {folder}", *first, *commands))  # fmt: skip


def _checked(kind: str, name: str) -> str:
    """The name in lower case with underscores; a message's name may be given in CamelCase."""
    if kind == "message":
        name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or len(name) > LONGEST or keyword.iskeyword(name):
        raise PluginError(
            f"name {name!r}: expected at most {LONGEST} lower case letters, digits and single underscores, a letter "
            "first, and no Python keyword, as my_avoider"
        )
    return name


def _values(kind: str, name: str) -> dict[str, str]:
    """Values of the placeholders in the templates."""
    words = name.split("_")
    tail = [] if words[-1] == kind else [kind]
    camel = "".join(word.capitalize() for word in words)
    major, minor = version("navloom").split(".")[:2]
    package = "_".join(["navloom", *words, *tail])
    values = {
        "kind": kind,
        "name": name,
        "Name": camel,
        "NAME": name.upper(),
        "package": package,
        "distribution": package.replace("_", "-"),
        "bound": f"{major}.{minor}",
        "everything": "navloom[all,view]" if kind == "panel" else "navloom[all]",
        "pure": KINDS[kind].pure,
    }
    points = [Template(point).substitute(values) for point in KINDS[kind].points]
    values |= {
        "check": points[0] if kind != "message" else f"message.{package}.{camel}",
        "points": "\n".join(f'"{point}" = "{package}"' for point in points),
        "first_point": points[0],
    }
    texts = {"about": KINDS[kind].about, "more": KINDS[kind].more, "commands": "\n".join(KINDS[kind].commands)}
    return (
        values | {key: Template(text).substitute(values) for key, text in texts.items()} | {"layout": _layout(values)}
    )


def _layout(values: dict[str, str]) -> str:
    """Paragraph of the README that describes the modules."""
    package, pure, kind = values["package"], values["pure"], values["kind"]
    if kind == "message":
        return f"The class is in `src/{package}/messages.py`."
    has_params = (TEMPLATES / kind / "params.py.txt").exists()
    params = " `params.py` holds the parameters with their bounds and units." if has_params else ""
    maths = f"The maths is in `src/{package}/{pure}.py`, which imports no navloom."
    return f"{maths} `adapter.py` connects it to\nnavloom.{params}"


def _files(kind: str, values: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Paths in the new folder, each with its template text."""
    common, own, package = TEMPLATES / "common", TEMPLATES / kind, f"src/{values['package']}"
    places = {
        "test.yml": ".github/workflows/test.yml",
        "gitignore": ".gitignore",
        "pyproject.toml.txt": "pyproject.toml",
    }
    for path in common.iterdir():
        if path.name != "__init__.py.txt":
            yield places.get(path.name, path.name), path.read_text("utf-8")
    hook = own / "__init__.py.txt"
    yield f"{package}/__init__.py", (hook if hook.exists() else common / hook.name).read_text("utf-8")
    for path in own.iterdir():
        name = path.name.removesuffix(".txt")
        if not name.endswith(".py"):
            yield path.name if path.suffixes == [".txt"] else name, path.read_text("utf-8")
        elif name != "__init__.py":
            yield f"{'tests' if name.startswith('test_') else package}/{name}", path.read_text("utf-8")


def _refuse_taken(kind: str, values: dict[str, str], discovery: Discovery) -> None:
    """Refuse a name that an installed plugin or one of the project's plugins has."""
    point = values["first_point"]
    owners = [info.distribution for info in discovery.infos() if f"{info.role}.{info.name}" == point]
    if not owners and kind in ROLES and values["name"] in shipped_names(kind):
        owners = ["the project"]
    if owners:
        raise PluginError(f"{point} is taken, by {owners[0]}; choose another name")
