"""Refuses a replay whose plugins are not installed here, and says what can be done."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from navloom.config.schema import Config
from navloom.plugins import Discovery, PluginError
from navloom.plugins.one_file import files_in_use
from navloom.roles import FIXED, ROLES

from navloom_recording.reader import Recording

__all__ = ["TRIED", "option_of", "refuse_missing"]

TRIED = ("avoider", "controller", "planner", "mapper", "localizer")
"""Roles in which `navloom replay` tries another plugin by an option of the role's name; in others, by `--node`."""
OWN = ("python", "navloom", "numpy", "numba")
"""Recorded versions that are of no plugin."""


def option_of(role: str, name: str) -> str:
    """The option of `navloom replay` that tries a plugin in a role or node."""
    return f"--{role} {name}" if role in TRIED else f"--node {role}={name}"


def refuse_missing(recording: Recording, config: Config, tried: str = "") -> None:
    """Refuse to replay a recording whose roles have plugins that are not installed here.

    Args:
        recording: The recording.
        config: Its config.
        tried: Role in which the replay tries another plugin; the active one of the recording is not needed there.

    Raises:
        PluginError: Plugins are missing. It names them and the distributions and files they were recorded with.
    """
    discovery = Discovery(config.plugins.blocked)
    named = dict.fromkeys(
        (role, table.plugin) for place, role, table in config.role_tables() if role in ROLES and place != tried
    )
    missing = [
        (role, name)
        for role, name in named
        if name not in discovery.names(role) and f"{role}.{name}" not in discovery.blocked
    ]
    if not missing:
        return
    file, role = recording.path, missing[0][0]
    names = " and ".join(".".join(one) for one in missing)
    text = f"{file}: the recorded config has {names}, not installed here: {_remedy(recording.header.versions)}"
    if len(missing) == 1 and role not in FIXED:
        text += f"; `{option_of(role, 'NAME')}` tries another plugin in its place"
    raise PluginError(f"{text}; `navloom view {file}` and `navloom replay {file} --live` need no plugins")


def _remedy(versions: dict[str, str]) -> str:
    """What to install or pass, by the recorded distributions and files that are not here."""
    files = [name for name in versions if name.endswith(".py") and name not in files_in_use()]
    lacking = [f"{name}=={version}" for name, version in versions.items() if not _is_here(name)]
    found = [f"pip install {' '.join(lacking)}"] if lacking else []
    for name in files:
        is_found = Path(name).is_file()
        found.append(f"add --plugin {name}" if is_found else f"add --plugin FILE.py, which was {name} when recorded")
    return ", and ".join(found) or "install the distribution that it comes with, or add --plugin FILE.py"


def _is_here(name: str) -> bool:
    """Whether a recorded name is of no plugin, of a file, or of a distribution that is installed."""
    if name in OWN or name.endswith(".py"):
        return True
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True
