"""Names of installed plugins, shipped configs and running robots, for help texts and shell completion.

Nothing listed is imported. Every start of the command line imports this module, so it imports inside its functions.
"""

from __future__ import annotations

from pathlib import Path

from navloom.entry_kinds import OTHERS, installed_points
from navloom.parts import has_part, part

__all__ = [
    "candidates",
    "config_help",
    "framework_version",
    "plugin_distributions",
    "print_versions",
    "shipped_names",
]


def shipped_names() -> list[str]:
    """Names of the configs shipped with navloom."""
    return sorted(path.stem for path in (Path(__file__).parent / "config" / "shipped").glob("*.toml"))


def config_help() -> str:
    """Help text of an argument that takes a config."""
    return f"Path of a config, or a shipped name: {', '.join(shipped_names())}."


def plugin_distributions() -> dict[str, str]:
    """Version of each installed distribution with plugins, without the framework."""
    found = {point.dist.name: point.dist.version for point in installed_points() if point.dist is not None}
    return {name: found[name] for name in sorted(found) if name != "navloom"}


def framework_version() -> str:
    """Version of the framework."""
    from importlib.metadata import version

    return version("navloom")


def print_versions(as_json: bool) -> None:
    """Print the versions of the framework, Python and the distributions with plugins."""
    import json
    import platform

    python, plugins = platform.python_version(), plugin_distributions()
    if as_json:
        print(json.dumps({"navloom": framework_version(), "python": python, "plugins": plugins}, indent=2))
        return
    for name, number in {"navloom": framework_version(), "Python": python, **plugins}.items():
        print(name, number)


def candidates(kind: str) -> list[str]:
    """Candidates for completing a word on the command line.

    Args:
        kind: configs, robots, plugins, roles, worlds, or a role name for the names of its plugins.
    """
    if kind == "configs":
        return shipped_names()
    if kind == "robots":
        if not has_part("navloom_live"):
            return []
        return [f"{running.realm}/{running.robot}" for running in part("navloom_live.hosting.runtime_folders").robots()]
    names = sorted(point.name for point in installed_points())
    plugins = [name for name in names if name.partition(".")[0] not in OTHERS]
    if kind == "plugins":
        return plugins
    if kind == "roles":
        return list(dict.fromkeys(name.partition(".")[0] for name in plugins))
    role = "world" if kind == "worlds" else kind
    return [name.partition(".")[2] for name in names if name.partition(".")[0] == role]
