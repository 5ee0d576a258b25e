"""Which modules import a module, and which tests are near it."""

from __future__ import annotations

import ast
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

__all__ = ["Tree"]

OF_PROCESSES = ("live", "hosts", "faults", "strangers", "hostile")
"""Folders of `tests` whose tests start many processes; they count only where they import the module itself."""
LEFT_OUT = ("_speed.py", "_benchmark.py", "_readme.py")
"""Ends of test files that do not count: they depend on how busy the machine is, or compare tables of texts."""


@dataclass(frozen=True)
class Tree:
    """A checkout: sources in `framework/*/src` and `plugins/*/src`, tests in `tests` folders.

    Attributes:
        top: Its folder.
    """

    top: Path
    _imports: dict[Path, frozenset[str]] = field(default_factory=dict)

    @cached_property
    def roots(self) -> list[Path]:
        """Folders with packages."""
        return [
            path
            for path in sorted([*self.top.glob("framework/*/src"), *self.top.glob("plugins/*/src")])
            if path.is_dir()
        ]

    @cached_property
    def modules(self) -> dict[str, Path]:
        """Files of all modules by name."""
        return {_module_name(root, path): path for root in self.roots for path in sorted(root.rglob("*.py"))}

    @cached_property
    def tests(self) -> list[Path]:
        folders = (
            self.top / "tests",
            *sorted([*self.top.glob("framework/*/tests"), *self.top.glob("plugins/*/tests")]),
        )
        found = (path for folder in folders for path in sorted(folder.rglob("test_*.py")))
        return [path for path in found if not path.name.endswith(LEFT_OUT)]

    def files(self, name: str) -> list[Path]:
        """Files that a name stands for: a plugin's folder, a module or package, or a path below the top."""
        if (self.top / "plugins" / name / "src").is_dir():
            return sorted((self.top / "plugins" / name / "src").rglob("*.py"))
        if name in self.modules:
            path = self.modules[name]
            return sorted(path.parent.rglob("*.py")) if path.name == "__init__.py" else [path]
        if (self.top / name).is_file():
            return [(self.top / name).resolve()]
        raise SystemExit(f"error: --modules: {name} is no plugin, module or file of {self.top}")

    def name(self, path: Path) -> str:
        """Module name of a file."""
        return _module_name(next(root for root in self.roots if root in path.parents), path)

    def importers(self, name: str) -> list[str]:
        """The module, and all modules that import it, also by way of others."""
        found, waiting = {name}, [name]
        while waiting:
            wanted = waiting.pop()
            for other, path in self.modules.items():
                if other not in found and wanted in self._imported(path):
                    found.add(other)
                    waiting.append(other)
        return sorted(found)

    def uncached(self, path: Path) -> list[str]:
        """Modules whose kernels must not come from the cache while a file is mutated.

        For a plugin it is the same for all its modules, so that its tests run once without a mutant, and not once for
        each module.
        """
        root = next(root for root in self.roots if root in path.parents)
        if root.parents[1].name == "framework":
            return self.importers(self.name(path))
        own = [name for name, other in self.modules.items() if root in other.parents]
        return sorted({name for module in own for name in self.importers(module)})

    def tiers(self, path: Path) -> list[list[Path]]:
        """Test files, nearest to a module first: of its name or importing it; of its distribution or part of the
        framework; importing it by way of others, or naming its distribution."""
        name = self.name(path)
        stem, near = path.stem, self._folder_of_tests(path)
        through = set(self.importers(name))
        word = name.split(".")[0].removeprefix("navloom_") if name.startswith("navloom_") else stem
        tiers: list[list[Path]] = [[], [], []]
        for test in self.tests:
            imported, is_near = self._imported(test) | self._of_its_aids(test), near in test.parents
            if name in imported or (is_near and test.stem.endswith(f"_{stem}")):
                tiers[0].append(test)
            elif is_near:
                tiers[1].append(test)
            elif test.parent.name not in OF_PROCESSES and (imported & through or word in test.read_text("utf-8")):
                tiers[2].append(test)
        # Presets reach the tests by way of the plugin that has them, so no test is nearer to them than another.
        return [[*tiers[0], *tiers[1]], [], tiers[2]] if stem == "params" else tiers

    def _folder_of_tests(self, path: Path) -> Path:
        root = next(root for root in self.roots if root in path.parents)
        tests = root.parent / "tests"
        part = path.relative_to(root).parts[1]  # of the framework: the tests of the same package
        return tests / part if root.parents[1].name == "framework" and (tests / part).is_dir() else tests

    def _imported(self, path: Path) -> frozenset[str]:
        """Modules that a file imports by name, and names in them that may be modules."""
        if path not in self._imports:
            names: set[str] = set()
            for node in ast.walk(ast.parse(path.read_bytes())):
                if isinstance(node, ast.Import):
                    names.update(alias.name for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.module:
                    names.add(node.module)
                    names.update(f"{node.module}.{alias.name}" for alias in node.names)
            self._imports[path] = frozenset(names)
        return self._imports[path]

    def _of_its_aids(self, test: Path) -> frozenset[str]:
        """What the modules beside the tests that a test imports, import themselves."""
        aids = (self._aids[name] for name in self._imported(test) if name in self._aids)
        return frozenset().union(*(self._imported(aid) for aid in aids))

    @cached_property
    def _aids(self) -> dict[str, Path]:
        folders = {test.parent for test in self.tests}
        return {path.stem: path for folder in folders for path in folder.glob("*.py") if path.stem[:5] != "test_"}


def _module_name(root: Path, path: Path) -> str:
    return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
