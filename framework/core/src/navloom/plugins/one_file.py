"""Plugins in one Python file, without a distribution: `--plugin my_avoider.py`."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import json
import os
import re
import signal
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

from navloom.entry_kinds import GROUP, installed_points
from navloom.messages import Message
from navloom.plugins.error_origin import raised_in
from navloom.plugins.hooks import HookSpecs, hookimpl
from navloom.plugins.loading import owner_of
from navloom.plugins.registry import NODE, PluginError, Registry
from navloom.roles import ROLES, Role

__all__ = ["available_points", "files_in_use", "replaced_by", "use_files"]

FILES = "NAVLOOM_PLUGIN_FILES"
"""Environment variable: JSON list of [path, SHA-256]. Child processes inherit it, so they load the same plugins."""
LONGEST_IMPORT = 60.0
"""Longest import of a file, s."""
_LOADED: dict[Path, list[FilePoint]] = {}
"""Entry points of the files that this process has imported."""


@dataclass(frozen=True)
class FileOrigin:
    """Replaces the distribution in lists, messages and recordings.

    Attributes:
        name: Path of the file.
        version: Hash of its content.
    """

    name: str
    version: str


class ImportTimeout(BaseException):
    """An import took too long. No `except Exception` of the file catches it."""


class FilePoint(EntryPoint):
    """An entry point of a class in a file: it holds the hooks, so there is no module left to import."""

    def __init__(self, name: str, module: str, origin: FileOrigin, hooks: object) -> None:
        super().__init__(name, module, GROUP)
        vars(self).update(dist=origin, hooks=hooks)

    def load(self) -> Any:
        """The object with the hook implementations; the file is already imported."""
        return vars(self)["hooks"]


class Listed:
    """The hook of a file that defines none: it registers the classes found in the file."""

    def __init__(self, classes: Iterable[type[Any]]) -> None:
        self.classes = tuple(classes)

    @hookimpl
    def navloom_register(self, registry: Registry) -> None:
        """Add each class to the registry as a message, a node or a role's plugin."""
        for cls in self.classes:
            if issubclass(cls, Message):
                registry.message(cls)
            elif issubclass(cls, Role) and cls.role == NODE:
                registry.node(cls)
            else:
                registry.add(cls)


def available_points() -> list[EntryPoint]:
    """The entry points of the installed distributions and of the plugin files in use.

    A file's plugin replaces an installed one of the same name: who names a file means it, and a plugin that ships later
    must not take the name from it. A command cannot be replaced.

    Raises:
        PluginError: A file cannot be used, or has changed since the command started.
    """
    of_files = [point for path, digest in _in_use() for point in _points_of(path, digest)]
    taken = {point.name for point in of_files if point.name.partition(".")[0] in ROLES}
    return [*(point for point in installed_points() if point.name not in taken), *of_files]


def replaced_by(files: Iterable[Path]) -> list[str]:
    """A line for each installed plugin that one of these files in use replaces."""
    used, installed = dict(_in_use()), {point.name: point for point in installed_points()}
    return [
        f"{point.name}: that of {file} replaces the one of {owner_of(installed[point.name])}"
        for file in files
        for point in _points_of(file.resolve(), used[file.resolve()])
        if point.name in installed and point.name.partition(".")[0] in ROLES
    ]


def use_files(files: Iterable[Path]) -> None:
    """Import plugin files, for this process and those that it starts later.

    Raises:
        PluginError: A file cannot be read or imported, or has no plugin; the message names the file and line.
    """
    used = dict(_in_use())
    for file in files:
        path = file.resolve()
        used[path] = _digest_of(path)
        _points_of(path, used[path])
    os.environ[FILES] = json.dumps([(str(path), digest) for path, digest in used.items()])


def files_in_use() -> list[str]:
    """Absolute paths of the files, for commands that are to find the same plugins."""
    return [str(path) for path, _ in _in_use()]


def _in_use() -> list[tuple[Path, str]]:
    return [(Path(path), digest) for path, digest in json.loads(os.environ.get(FILES, "[]"))]


def _digest_of(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise PluginError(f"--plugin {path}: {error.strerror}; expected a Python file with a plugin") from error


def _points_of(path: Path, digest: str) -> list[FilePoint]:
    if path not in _LOADED:
        # Processes of one run must have the same plugin, also those that start later.
        if _digest_of(path) != digest:
            raise PluginError(f"--plugin {path}: the file changed after the command started; start the command again")
        module = _imported(path)
        origin = FileOrigin(str(path), f"sha256:{digest[:16]}")
        try:
            _LOADED[path] = [FilePoint(name, module.__name__, origin, hooks) for name, hooks in _plugins_in(module)]
        except BaseException:
            sys.modules.pop(module.__name__, None)
            raise
    return _LOADED[path]


def _imported(path: Path) -> ModuleType:
    """The file, imported as a module of the same name."""
    name = re.sub(r"\W", "_", path.stem)
    if path.suffix != ".py" or not name.isidentifier():
        raise PluginError(f"--plugin {path}: expected the name of a Python file, as my_avoider.py")
    _refuse_taken(name, path)
    from navloom.kernel_cache import harden_kernel_cache  # which imports numba

    harden_kernel_cache()
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Before it runs, as importlib does: dataclasses look their module up.
    sys.modules[name] = module
    try:
        Beside.add(path.parent)
        with _bounded():
            spec.loader.exec_module(module)
    except BaseException as error:
        # Half a module must not be found by the next import.
        del sys.modules[name]
        if not isinstance(error, (Exception, SystemExit, ImportTimeout)):
            raise
        raise PluginError(f"--plugin {path}: the import fails: {raised_in(error, name)}") from error
    return module


IMPORTING = ("importlib", "_frozen_importlib")
"""Modules whose frames lie between an import and its finder."""


class Beside:
    """Finds the modules that lie beside a plugin file, for imports that are written in that folder.

    It is the last finder, so that a folder hides no installed module. An import in a function finds them too, and each
    folder its own: with the folder on `sys.path`, a plugin would get the `helpers.py` of another.
    """

    folders: ClassVar[set[Path]] = set()

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module of a name, if the importing code lies in such a folder or below; else None."""
        if path is not None:  # a package looks for its own modules
            return None
        frame = sys._getframe(1)
        while frame.f_back is not None and str(frame.f_globals.get("__name__")).startswith(IMPORTING):
            frame = frame.f_back
        importing = Path(frame.f_globals.get("__file__") or "")
        folder = next((folder for folder in importing.parents if folder in cls.folders), None)
        return PathFinder.find_spec(name, [str(folder)]) if folder is not None else None

    @classmethod
    def add(cls, folder: Path) -> None:
        """Let the code in a folder import its modules."""
        for file in folder.glob("*.py"):
            held = Path(getattr(sys.modules.get(file.stem), "__file__", None) or "")
            # Two folders may each have a `helpers.py`: each plugin file gets its own.
            if held.parent in cls.folders - {folder} and held not in _LOADED:
                del sys.modules[file.stem]
        cls.folders.add(folder)
        if cls not in sys.meta_path:
            sys.meta_path.append(cls)


@contextmanager
def _bounded() -> Iterator[None]:
    """Raise ImportTimeout in an import that does not end. Code in C that holds the GIL is not interrupted."""
    if threading.current_thread() is not threading.main_thread():  # which alone handles signals
        yield
        return

    def over(*_: object) -> None:
        raise ImportTimeout(f"not over after {LONGEST_IMPORT:g} s; long work belongs in warm_up()")

    handler = signal.signal(signal.SIGALRM, over)
    left, interval = signal.setitimer(signal.ITIMER_REAL, LONGEST_IMPORT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, left, interval)
        signal.signal(signal.SIGALRM, handler)


def _refuse_taken(name: str, path: Path) -> None:
    """Refuse a file whose module name belongs to another module."""
    held = sys.modules.get(name)
    try:
        spec = None if held is not None else importlib.util.find_spec(name)
    except (ImportError, ValueError):
        spec = None
    other = getattr(held, "__file__", None) or "a module of Python" if held is not None else spec and spec.origin
    if other and Path(other) != path:
        raise PluginError(f"--plugin {path}: a module {name!r} exists already ({other}); rename the file")


def _plugins_in(module: ModuleType) -> Iterator[tuple[str, object]]:
    """Names of a file's entry points, each with the object that implements its hooks."""
    own = {name for name in vars(HookSpecs) if hasattr(vars(module).get(name), "navloom_impl")}
    hooks: object = module
    if own - {"navloom_register"}:
        yield f"observer.{module.__name__}", module
    elif not own:
        hooks = Listed(_classes_in(module))
    registry = _registered(module, hooks)
    yield from ((f"{role}.{name}", hooks) for role, name in registry.roles)
    named: dict[str, Iterable[str]] = {
        "node": registry.nodes,
        "message": registry.messages,
        "world": registry.worlds,
        "scheme": registry.schemes,
        "metric": registry.metrics,
        "panel": registry.panels,
    }
    yield from ((f"{kind}.{name}", hooks) for kind, names in named.items() for name in names)


def _classes_in(module: ModuleType) -> list[type[Any]]:
    """The plugin and message classes that a file defines. A class without a `name` counts as a base of others."""
    kinds = (*ROLES.values(), Message)
    own = [cls for cls in vars(module).values() if inspect.isclass(cls) and cls.__module__ == module.__name__]
    parts = [cls for cls in dict.fromkeys(own) if issubclass(cls, kinds) or getattr(cls, "role", "") == NODE]
    named = [cls for cls in parts if cls.__dict__.get("name") or cls.__dict__.get("schema_name")]
    if named:
        return named
    if parts:
        raise PluginError(f"{_place(parts[0])}: class {parts[0].__name__} has no `name`: give it one, as name = 'mine'")
    raise PluginError(
        f"--plugin {module.__file__}: there is no plugin in it; expected a subclass of a role ({', '.join(ROLES)}), of "
        "NodePlugin or of Message, or a function navloom_register(registry) marked @hookimpl"
    )


def _registered(module: ModuleType, hooks: Any) -> Registry:
    """The registry that a file fills."""
    registry = Registry()
    parts = [Listed([cls]) for cls in hooks.classes] if isinstance(hooks, Listed) else [hooks]
    for part in parts:
        place = _place(part.classes[0]) if isinstance(part, Listed) else f"--plugin {module.__file__}"
        try:
            if hasattr(part, "navloom_register"):
                part.navloom_register(registry=registry)
        except PluginError as error:
            raise PluginError(f"{place}: {error}") from error
        except (Exception, SystemExit) as error:
            raise PluginError(f"{place}: navloom_register fails: {raised_in(error, module.__name__)}") from error
    return registry


def _place(cls: type) -> str:
    """File and line of a class."""
    file = getattr(sys.modules[cls.__module__], "__file__", cls.__module__)
    try:
        return f"--plugin {file}:{inspect.getsourcelines(cls)[1]}"
    except (OSError, TypeError):
        return f"--plugin {file}"
