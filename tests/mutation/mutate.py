"""Change the code a little, one place at a time, and list what no test notices: `tests/mutation/mutate.py --help`.

Each mutant runs in a fork of this process, which has imported the slow libraries once; the nearest tests run first, and
the first that fails ends it. Tests that fail or take long without a mutant are left out. No file of the checkout is
written, so nothing is left behind where the run is stopped.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import itertools
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from mutant_import import VARIABLE, install, tell_children
from mutants import Mutant, constants_of, lines_of, preset_change, sampled
from nearest_tests import Tree
from watched_tests import BUDGET, Outcomes, run_tests

TOP = Path(__file__).resolve().parents[2]
PAPER = ("improved_vfh", "vfh", "vff", "ipabd", "astar", "lyapunov_tracker")
LIBRARIES = (
    "numpy", "scipy.ndimage", "numba", "pydantic", "pytest", "hypothesis", "pytest_benchmark.plugin",
    "navloom.messages", "navloom_check.pytest_plugin",
)  # fmt: skip
COMPILING = 90.0
"""Time that a test may take to compile kernels, s."""
SLACK = 20.0
"""Time that a run of tests may take beyond three times that of the same tests without a mutant, s."""


@dataclass(frozen=True)
class Verdict:
    """What became visible of one mutant.

    Attributes:
        place: Path and line. change: Before and after. kind: `line` or `constant`.
        result: `noticed`, `timed out` (noticed too: a test ran too long) or `survived`.
        by: The test that failed. seconds: Time it took.
    """

    place: str
    change: str
    kind: str
    result: str
    by: str
    seconds: float


class Course:
    """Runs tests against mutants, and remembers how the tests do without one."""

    def __init__(self, tree: Tree, slowest: float, tiers: int, compiles: bool, tests: Sequence[Path] = ()) -> None:
        self.tree, self.slowest, self.tiers, self.compiles = tree, slowest, tiers, compiles
        self.tests = [test.resolve() for test in tests]
        self._known: dict[tuple[str, bool, Path], dict[str, float]] = {}

    def verdict(self, mutant: Mutant) -> Verdict:
        """Run the tests near a mutant until one fails."""
        began = time.monotonic()
        result, by = next(self._failures(mutant), ("survived", ""))
        place = f"{mutant.path.relative_to(self.tree.top)}:{mutant.line}"
        change = f"{mutant.before} -> {mutant.after}"
        return Verdict(place, change, mutant.kind, result, by, round(time.monotonic() - began, 1))

    def _failures(self, mutant: Mutant) -> Iterator[tuple[str, str]]:
        """Run tests with kernels in plain Python, then those that pass with compiled ones only."""
        tiers = [self.tests] if self.tests else [t for t in self.tree.tiers(mutant.path)[: self.tiers] if t]
        for is_pure, tests in itertools.product((True, False) if self.compiles else (True,), tiers):
            sound = [self._baseline(mutant.path, test, is_pure) for test in tests]
            chosen = {name: took for passed in sound for name, took in passed.items()}
            if not chosen:
                continue
            limit = 3.0 * sum(chosen.values()) + SLACK + (0.0 if is_pure else 2.0 * COMPILING)
            files = [test for test, passed in zip(tests, sound, strict=True) if passed]
            outcomes = self._run(mutant.path, mutant.source(), files, chosen, is_pure, limit)
            if outcomes is None:
                yield "timed out", "all tests together"
            elif outcomes.failed:
                yield ("timed out" if outcomes.ran_long else "noticed"), outcomes.failed

    def _baseline(self, path: Path, test: Path, is_pure: bool) -> dict[str, float]:
        """Tests of a file that pass without a mutant, and how long each takes, s; compiled: only those that pass no
        other way."""
        uncached = self.tree.uncached(path)
        key = uncached[0], is_pure, test
        if key not in self._known:
            outcomes = self._run(path, None, [test], None, is_pure, 120.0 + BUDGET * self.slowest)
            passed = outcomes.passed if outcomes else {}
            if not is_pure:
                plain = self._baseline(path, test, True)
                passed = {name: took for name, took in passed.items() if name not in plain}
            self._known[key] = passed
        return self._known[key]

    def _run(
        self, path: Path, source: str | None, tests: list[Path], chosen: dict[str, float] | None, is_pure: bool,
        limit: float,
    ) -> Outcomes | None:  # fmt: skip
        """Run tests in a fork; None where it does not end in time, s."""
        name = self.tree.name(path)
        uncached = self.tree.uncached(path)
        with tempfile.TemporaryDirectory(prefix="mutant") as scratch:
            answer = Path(scratch, "outcomes.json")
            child = os.fork()
            if child == 0:
                signal.signal(signal.SIGTERM, signal.SIG_DFL)
                os.setsid()
                die_with_parent()
                try:
                    tell_children(Path(scratch), name, source, uncached, is_pure)
                    for module in uncached:
                        sys.modules.pop(module, None)
                    install(name, source, uncached, is_pure)
                    outcomes = run_tests(
                        self.tree.top,
                        tests,
                        chosen,
                        self.slowest,
                        0.0 if is_pure else COMPILING,
                        Path(scratch, "output.txt"),
                    )
                    answer.write_text(json.dumps(asdict(outcomes)), "utf-8")
                finally:
                    os._exit(0)
            try:
                ended = wait(child, limit)
            finally:
                end_all(scratch)
            if answer.exists():
                return Outcomes(**json.loads(answer.read_text("utf-8")))
            return Outcomes({}, "the test process ended") if ended else None


def die_with_parent() -> None:
    """Ask the kernel to end this process when its parent is gone, as after kill -9."""
    import ctypes

    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def end_all(scratch: str) -> None:
    """End the processes that a test left, such as a live robot: they know the scratch folder from their environment."""
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if f"{VARIABLE}={scratch}/".encode() in path.read_bytes():
                os.kill(int(path.parent.name), signal.SIGKILL)


def wait(child: int, limit: float) -> bool:
    """Whether a process ends within a time, s; its group is killed in the end, also where this is interrupted."""
    deadline, is_gone = time.monotonic() + limit, False
    try:
        while not is_gone and time.monotonic() < deadline:
            is_gone = os.waitpid(child, os.WNOHANG)[0] != 0
            time.sleep(0.01)
        return is_gone
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        if not is_gone:
            os.waitpid(child, 0)


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add(
        "--modules",
        nargs="+",
        default=list(PAPER),
        metavar="NAME",
        help="plugins by the name of their folder, modules or packages by import name, or files (default: the paper's)",
    )
    add("--constants", action="store_true", help="change each constant of the presets in params.py")
    add("--lines", type=int, default=0, metavar="N", help="change N random lines, one at a time")
    add("--every", action="store_true", help="make every change of every line, one at a time")
    add("--change", nargs="+", default=[], metavar="NAME=VALUE", help="set constants of the presets, each alone")
    add("--together", action="store_true", help="make all changes of --change at once")
    add("--seed", type=int, default=1, help="of the choice of lines and of the direction of constants (default: 1)")
    add("--slowest", type=float, default=2.0, metavar="S", help="leave out tests that take longer, s (default: 2)")
    add(
        "--tiers",
        type=int,
        default=2,
        choices=(1, 2, 3),
        help="1: tests of the module; 2: of its distribution too; 3: all that reach it (default: 2)",
    )
    add("--tests", nargs="+", type=Path, default=[], metavar="FILE", help="run these test files, not the nearest")
    add(
        "--compiled",
        action="store_true",
        help="try survivors again with compiled kernels, in tests that need them; it takes minutes each",
    )
    add("--only", default="", metavar="TEXT", help="only mutants whose place and change contain it")
    add("--json", type=Path, metavar="FILE", help="write every verdict to a file")
    add("--list", action="store_true", help="print the mutants and run nothing")
    add("--top", type=Path, default=TOP, metavar="DIR", help="folder of the checkout (default: this one)")
    given = parser.parse_args(words)
    if not (given.constants or given.lines or given.every or given.change):
        parser.error("nothing to change: expected --constants, --lines, --every or --change")
    return given


def mutants_of(given: argparse.Namespace, tree: Tree) -> list[Mutant]:
    """The mutants that the command line asks for."""
    rng = random.Random(given.seed)
    files = [path for name in given.modules for path in tree.files(name)]
    presets = [path for path in files if path.name == "params.py"]
    found: list[Mutant] = []
    if given.change:
        changes = dict(change.split("=", 1) for change in given.change)
        sets = [changes] if given.together else [{name: value} for name, value in changes.items()]
        found += [preset_change(path, change) for path in presets for change in sets]
    if given.constants:
        found += [mutant for path in presets for mutant in constants_of(path, rng)]
    if given.lines or given.every:
        lines = [mutant for path in files if path.name != "params.py" for mutant in lines_of(path)]
        some = lines if given.every else sampled(lines, given.lines, rng)
        found += sorted(some, key=lambda mutant: (mutant.path, mutant.line))
    return [m for m in found if given.only in f"{m.path}:{m.line} {m.before} -> {m.after}"]


def summary(verdicts: Sequence[Verdict]) -> str:
    """Totals by distribution and kind, and the survivors."""
    counts: dict[tuple[str, str], Counter[str]] = {}
    for verdict in verdicts:
        parts = verdict.place.split("/")
        part = parts[1] if parts[0] == "plugins" else parts[0]
        counts.setdefault((part, verdict.kind), Counter())[verdict.result] += 1
    counts["all", ""] = Counter(verdict.result for verdict in verdicts)
    rows = []
    for (part, kind), count in counts.items():
        total, missed = count.total(), count["survived"]
        share = 100.0 * (total - missed) / max(1, total)
        rows.append(f"{part} {kind}: {total - missed} of {total} noticed ({share:.1f} %), {count['timed out']} by time")
    missed_ones = [f"  {v.place}  {v.change}" for v in verdicts if v.result == "survived"]
    return "\n".join([*rows, "survivors:", *(missed_ones or ["  none"])])


def main(words: Sequence[str] | None = None) -> int:
    """Exit code 0: every mutant was noticed; 1: some were not."""
    given = arguments(words)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the scratch folder is removed
    tree = Tree(given.top.resolve())
    mutants = mutants_of(given, tree)
    if given.list:
        print(*(f"{m.path.relative_to(tree.top)}:{m.line}  {m.before} -> {m.after}" for m in mutants), sep="\n")
        return 0
    sys.path[:0] = [str(root) for root in tree.roots]
    for library in LIBRARIES:
        importlib.import_module(library)
    gc.freeze()  # so that pytest's collections in the forks do not look at these modules
    course = Course(tree, given.slowest, given.tiers, given.compiled, given.tests)
    verdicts = list[Verdict]()
    for mutant in mutants:
        verdict = course.verdict(mutant)
        verdicts.append(verdict)
        told = f"{verdict.result}: {verdict.by}" if verdict.by else verdict.result
        print(f"{verdict.place}  {verdict.change}  {told}  ({verdict.seconds:.1f} s)", flush=True)
        if given.json:
            given.json.write_text(json.dumps([asdict(v) for v in verdicts], indent=1), "utf-8")
    print(summary(verdicts))
    return int(any(verdict.result == "survived" for verdict in verdicts))


if __name__ == "__main__":
    sys.exit(main())
