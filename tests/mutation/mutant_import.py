"""Import of a mutated module, in this process and in every Python process that it starts.

The mutated source is compiled when the module is imported; its file is never written. numba's cache knows a kernel by
the time stamp of its file and does not see changed callees in other files, so kernels of the mutated module and of all
modules that import it never come from the cache: they run as plain Python functions, which needs no compilation, or are
compiled again without a cache. All other kernels come from the warm cache as always.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import CodeType
from typing import Any

__all__ = ["VARIABLE", "install", "tell_children"]

VARIABLE = "NAVLOOM_MUTANT"
"""Environment variable that names the JSON file of the mutant."""


class MutantFinder(importlib.abc.MetaPathFinder):
    """Finds one module, and loads another source for it."""

    def __init__(self, name: str, source: str) -> None:
        self.name, self.source = name, source

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: Any = None) -> Any:
        if fullname != self.name:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        assert spec is not None and spec.origin is not None, fullname
        loader = MutantLoader(fullname, spec.origin)
        loader.source = self.source
        spec.loader = loader
        return spec


class MutantLoader(importlib.machinery.SourceFileLoader):
    """Compiles the mutated source under the name of the file, without a bytecode cache."""

    source = ""

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.source, self.path, "exec", dont_inherit=True)


def install(name: str, source: str | None, uncached: Sequence[str], is_pure: bool) -> None:
    """Mutate a module that is not imported yet.

    Args:
        name: Module. source: Its mutated source; None: as it is.
        uncached: Modules whose kernels must not come from the cache: the module, and all that import it.
        is_pure: Whether their kernels run as plain Python; else they are compiled.
    """
    assert name not in sys.modules, name
    if source is not None:
        sys.meta_path.insert(0, MutantFinder(name, source))
    import numba

    compiled, names = numba.njit, frozenset(uncached)

    def njit(*args: Any, **options: Any) -> Any:
        def decorate(function: Callable[..., Any]) -> Any:
            if function.__module__ not in names:
                return compiled(*args[1:], **options)(function)
            return function if is_pure else compiled(**{**options, "cache": False})(function)

        return decorate(args[0]) if args and callable(args[0]) else decorate

    numba.njit = njit


def tell_children(folder: Path, name: str, source: str | None, uncached: Sequence[str], is_pure: bool) -> None:
    """Make every Python process that this one starts mutate the module too; `folder` is a scratch folder."""
    told = folder / "mutant.json"
    told.write_text(json.dumps([name, source, list(uncached), is_pure]), "utf-8")
    here = str(Path(__file__).parent)
    start = f"import sys\nsys.path.append({here!r})\nimport mutant_import\nmutant_import.obey()\n"
    (folder / "sitecustomize.py").write_text(start, "utf-8")
    os.environ[VARIABLE] = str(told)
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH"))))


def obey() -> None:
    """Mutate as the process that started this one was told to; called when Python starts."""
    told = os.environ.get(VARIABLE)
    if told:
        name, source, uncached, is_pure = json.loads(Path(told).read_text("utf-8"))
        install(name, source, uncached, is_pure)
