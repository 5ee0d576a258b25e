"""Settings of all tests: properties try the same examples each time; `--hypothesis-profile=explore` tries new ones."""

import fcntl
import os
import signal
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from importlib import invalidate_caches
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from navloom.cli import main
from navloom.cli.main import app
from navloom.messages import SCHEMAS
from numba.core.caching import FunctionCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from typer.main import get_command

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")

TOP = Path(__file__).resolve().parent
LONG = {TOP / "tests" / name for name in ("live", "hosts", "faults", "strangers")}
"""Folders of tests that drive live robots."""


def pytest_configure(config: pytest.Config) -> None:
    """Obey Ctrl-C as at a terminal.

    A script that runs the tests in the background starts them with SIGINT ignored. Their child processes would inherit
    that, and tests that end a command with Ctrl-C would wait for ever.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Tests start hundreds of processes: each would compile our sources again.
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if hasattr(config, "workerinput"):
        _compile_each_kernel_once(config.rootpath / ".pytest_cache")


def _compile_each_kernel_once(folder: Path) -> None:
    """Let a worker that needs a kernel which another one compiles wait, and load it from the cache."""
    compile_kernel = Dispatcher.compile
    folder.mkdir(exist_ok=True)
    file = (folder / "kernels.lock").open("w")

    def compile_alone(self: Dispatcher, signature: Any) -> Any:
        if not isinstance(self._cache, FunctionCache):  # it is compiled again in each process anyway
            return compile_kernel(self, signature)
        place = zlib.crc32(f"{self.py_func.__module__}.{self.py_func.__qualname__}".encode())
        # Kernels are locked in the order in which they call each other, and threads by the compiler's own lock first.
        with global_compiler_lock:
            fcntl.lockf(file, fcntl.LOCK_EX, 1, place)
            try:
                return compile_kernel(self, signature)
            finally:
                fcntl.lockf(file, fcntl.LOCK_UN, 1, place)

    Dispatcher.compile = compile_alone


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Workers of `-n auto`: two more than processors, because tests that drive live robots mostly wait."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return usable + 2


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Spread tests by who is idle; as an option it would be set without `-n` too, and switch benchmarks off."""
    if config.getoption("numprocesses", None) and config.option.dist == "no":
        config.option.dist = "worksteal"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Where tests are spread, let half of the workers begin with live robots, and the others compute meanwhile.

    A worker begins with an equal part of the list, and takes over tests from the end of another's part when it is done.
    """
    if not hasattr(config, "workerinput"):
        return
    workers = config.workerinput["workercount"]
    waiting = [item for item in items if item.path.parent in LONG]
    others = [item for item in items if item.path.parent not in LONG]
    streams, part = max(1, workers // 2), len(items) // workers
    ordered: list[pytest.Item] = []
    for stream in range(streams):
        live = waiting[len(waiting) * stream // streams : len(waiting) * (stream + 1) // streams]
        count = max(0, part - len(live))
        ordered += [*live, *others[:count]]
        others = others[count:]
    items[:] = ordered + others


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """The ratios that benchmarks found."""
    session = getattr(config, "_benchmarksession", None)
    for bench in session.benchmarks if session else ():
        for name, value in bench.extra_info.items():
            terminalreporter.write_line(f"{bench.name}: {name} = {value:.3g}")


@pytest.fixture
def in_process(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """The command line in this process: takes its words; gives exit code, output and errors."""

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["navloom", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, out, err

    return run


@pytest.fixture(scope="session")
def every_command() -> dict[str, Any]:
    """Every command of the installed distributions, as typer made it, by the words typed after `navloom`."""
    listed: dict[str, Any] = {}
    root: Any = get_command(app)
    for name, command in root.whole().items():
        inner = getattr(command, "commands", {})
        listed |= {f"{name} {word}": each for word, each in inner.items()} if inner else {name: command}
    return listed


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Installs a distribution of one module for this test: name, source, entry points, version."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before, schemas = set(sys.modules), dict(SCHEMAS)

    def add(module: str, source: str, points: Sequence[str], version: str = "1.0") -> None:
        name = module.replace("_", "-")
        info = folder / f"{module}-{version}.dist-info"
        info.mkdir()
        head = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\nSummary: What {name} is for.\n"
        (info / "METADATA").write_text(head, "utf-8")
        lines = ["[navloom]", *(f"{point} = {module}" for point in points), ""]
        (info / "entry_points.txt").write_text("\n".join(lines), "utf-8")
        (folder / f"{module}.py").write_text(source, "utf-8")
        invalidate_caches()

    yield add
    for name in set(sys.modules) - before:
        if (folder / f"{name}.py").exists():
            del sys.modules[name]
    SCHEMAS.clear()
    SCHEMAS.update(schemas)
    invalidate_caches()
