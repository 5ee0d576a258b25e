"""Kernels of plugins come from numba's cache or, if it cannot be used, from the compiler."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import invalidate_caches
from importlib.metadata import EntryPoint
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from navloom.kernel_cache import tell_compiled
from navloom.kernel_progress import expect_kernels, kernels_so_far
from navloom.plugins import Discovery

PLUGIN = """
import numba
from navloom import PlanFailure, Planner, Point2D, hookimpl

@numba.njit(cache=True)
def doubled(value):
    return value + value

class Kernels(Planner):
    name = "kernels"
    api = 1

    @classmethod
    def warm_up(cls):
        assert doubled(2) == 4 and doubled(0.25) == 0.5

    def plan(self, given):
        return PlanFailure(given.request.request_id, "no_path", Point2D(0.0, 0.0), "never")

@hookimpl
def navloom_register(registry):
    registry.add(Kernels)
"""

STARTING = """
import sys
from importlib.metadata import EntryPoint
from navloom.plugins import Discovery

planner = Discovery(found=[EntryPoint("planner.kernels", "fake_kernels", "navloom")]).role("planner", "kernels")
print("ready", flush=True)
sys.stdin.readline()
doubled = sys.modules["fake_kernels"].doubled
print([doubled(value) for value in eval(sys.argv[1])], flush=True)
"""

Start = Callable[[], Any]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Loads and warms up the plugin as a new process does, with the cache of this test; gives its kernel."""
    (tmp_path / "fake_kernels.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr("navloom.kernel_cache._told", set())

    def load() -> Any:
        sys.modules.pop("fake_kernels", None)
        invalidate_caches()
        found = Discovery(found=[EntryPoint("planner.kernels", "fake_kernels", "navloom")])
        found.role("planner", "kernels").warm_up()
        return sys.modules["fake_kernels"].doubled  # type: ignore[attr-defined]

    yield load
    sys.modules.pop("fake_kernels", None)


@pytest.fixture
def warnings() -> Iterator[list[str]]:
    """What the cache warns of, whether or not an earlier test has set up the log."""
    told: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: told.append(record.getMessage())  # type: ignore[method-assign]
    log = logging.getLogger("navloom.kernel_cache")
    log.addHandler(handler)
    yield told
    log.removeHandler(handler)


def files(tmp_path: Path, suffix: str) -> list[Path]:
    found = sorted((tmp_path / "cache").rglob(f"*{suffix}"))
    assert found
    return found


def loaded(kernel: Any) -> int:
    """Number of signatures that came from the cache."""
    return sum(kernel.stats.cache_hits.values())


def test_a_second_start_loads_what_the_first_one_compiled(start: Start) -> None:
    assert loaded(start()) == 0
    assert loaded(start()) == 2


def test_each_compiled_kernel_is_told_and_a_loaded_one_is_not(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("navloom.kernel_cache._compiled", 0)
    monkeypatch.setattr("navloom.kernel_cache._listener", None)
    counts: list[int] = []
    tell_compiled(lambda kernels: counts.append(kernels.compiled))
    start()
    start()
    assert counts == [1, 2]


def test_kernels_are_told_out_of_those_of_the_plugins_package(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    """`doubled` is the only kernel of the module, whatever the number of its types."""
    told: list[str] = []
    monkeypatch.setattr("navloom.kernel_progress._expected", [])
    load = Discovery.role

    def role(self: Discovery, *given: str) -> Any:
        cls = load(self, *given)
        expect_kernels([cls])
        return cls

    monkeypatch.setattr(Discovery, "role", role)
    monkeypatch.setattr("navloom.kernel_cache._listener", None)
    tell_compiled(lambda kernels: told.append(str(kernels)))
    start()
    assert told == ["kernel 1 of 1", "kernel 1 of 1"]


def test_a_kernel_loaded_from_the_cache_counts_with_those_it_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    @numba.njit
    def called(value: float) -> float:
        return value

    function = FunctionType(compile("called(1.0)", "caller", "eval"), {"called": called})
    caller = SimpleNamespace(signatures=[()], py_func=function)
    monkeypatch.setattr("navloom.kernel_progress._expected", [caller, called])
    assert kernels_so_far(0) == (0, 2, 2)


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize(
    "damage",
    [
        lambda data: os.urandom(len(data)),
        lambda data: data[: len(data) // 2],
        lambda data: b"",
        lambda data: bytes(len(data)),
        lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 1]) + data[len(data) // 2 + 1 :],
    ],
    ids=["random", "truncated", "empty", "zeroed", "one bit"],
)
def test_a_damaged_cache_is_compiled_again_and_heals(
    start: Start, tmp_path: Path, suffix: str, damage: Callable[[bytes], bytes]
) -> None:
    start()
    for path in files(tmp_path, suffix):
        path.write_bytes(damage(path.read_bytes()))
    assert loaded(start()) == 0
    assert loaded(start()) == 2


def test_plain_numba_reads_these_files_too(start: Start) -> None:
    kernel = start()
    spec = find_spec("numba.core.caching")
    assert spec is not None and spec.loader is not None
    plain = module_from_spec(spec)
    spec.loader.exec_module(plain)  # a second copy, as nothing has changed it
    files = plain.IndexDataCacheFile(
        kernel._cache.cache_path, kernel._cache._impl.filename_base, kernel._cache._impl.locator.get_source_stamp()
    )
    for signature, compiled in kernel.overloads.items():
        assert files.load(kernel._cache._index_key(signature, compiled.codegen)) is not None


def test_a_cached_kernel_of_another_signature_is_not_used(start: Start, tmp_path: Path) -> None:
    start()
    first, second = files(tmp_path, ".nbc")
    first.write_bytes(second.read_bytes())
    kernel = start()
    assert loaded(kernel) == 1
    assert kernel(3) == 6 and kernel(0.5) == 1.0
    assert loaded(start()) == 2


def test_a_cache_that_cannot_be_read_or_replaced_is_skipped_and_reported_once(
    start: Start, tmp_path: Path, warnings: list[str]
) -> None:
    start()
    for path in [*files(tmp_path, ".nbi"), *files(tmp_path, ".nbc")]:
        path.unlink()
        path.mkdir()
    assert loaded(start()) == 0
    assert len(warnings) == 1 and "Is a directory; kernels are compiled, and again at the next start" in warnings[0]
    assert str(tmp_path / "cache") in warnings[0]


def test_a_file_in_the_place_of_the_cache_folder_stops_nothing(start: Start, tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("no folder")
    assert start()(np.float32(1.0)) == 2.0


def test_a_full_disk_stops_nothing_and_is_reported_once(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warnings: list[str]
) -> None:
    import errno

    def full(path: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert loaded(start()) == 0
    assert len(warnings) == 1 and "cannot be written: No space left on device" in warnings[0]
    assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []


def test_no_folder_for_a_cache_stops_nothing(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, warnings: list[str]
) -> None:
    from numba.core import caching

    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    assert loaded(start()) == 0
    assert "there is no folder for the kernel cache" in " ".join(warnings)


def test_processes_that_start_at_once_with_a_damaged_cache_compile_it_again(start: Start, tmp_path: Path) -> None:
    start()
    for path in [*files(tmp_path, ".nbi"), *files(tmp_path, ".nbc")]:
        path.write_bytes(os.urandom(300))
    given = {"[2, 0.25]": "[4, 0.5]", "[0.25, 2]": "[0.5, 4]"}
    words = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", STARTING, values],
            env=os.environ | words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for values in given
    ]
    for process in processes:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
    for process, answer in zip(processes, given.values(), strict=True):
        out, err = process.communicate("go\n", timeout=60)
        assert (out, err, process.returncode) == (f"{answer}\n", "", 0)
    assert loaded(start()) == 2
