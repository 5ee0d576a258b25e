"""The engine's share of a run in lockstep: its CPU time without plugins, hand-over and reference.

    python benchmarks/engine_share.py [CONFIG] [--set A.B=V] [--seeds A:B] [--beside PYTHON] [--json]

Each seed is driven three times in one process, with compiled kernels and without observers:

1. recorded: every answer of a verb, of the hand-over and of the reference is recorded, and the call is timed;
2. plain: nothing is replaced. This is the time of the run, from the first tick to the closed trace;
3. fed: stand-ins return the recorded answers in order. This time minus the cost of the stand-ins is the engine's share.

All three must give the same trace. `--beside` runs each seed in this interpreter and in another in turn, for example in
one with an older navloom. It works with the layout of navloom before and after `navloom.engine`.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import json
import math
import statistics
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from time import process_time_ns
from typing import Any

from beside import arguments, clean_environment, in_turns, set_options
from navloom.config import ConfigError, load_config
from navloom.plugins import PluginError
from navloom.roles import ROLES

__all__ = ["Share", "ShareError", "measured"]

PARTS = ("verbs", "handover", "reference")
FIELDS = ("run_us", "verbs_us", "handover_us", "reference_us", "engine_us")
EMPTY_CALLS = 2001
"""Number of clock readings from which the cost of one is measured."""


class ShareError(RuntimeError):
    """The share cannot be measured; the message says why."""


@dataclass(frozen=True)
class Share:
    """Where the CPU time of one seed's run goes, µs a tick except where the name says otherwise.

    Attributes:
        seed: Seed of the run.
        ticks: Number of ticks of the run.
        run_ms: CPU time of the plain run from the first tick to the closed trace, ms.
        run_us: The same per tick.
        verbs_us, handover_us, reference_us: Within the plugins' verbs, the hand-over and the reference.
        engine_us: The engine's share: the fed run minus the cost of the stand-ins.
        standins_us: Cost of the stand-ins.
        calls: Number of recorded answers.
        trace_sha256: Hash of the trace, the same of all three runs.
    """

    seed: int
    ticks: int
    run_ms: float
    run_us: float
    verbs_us: float
    handover_us: float
    reference_us: float
    engine_us: float
    standins_us: float
    calls: int
    trace_sha256: str

    @property
    def rest_us(self) -> float:
        """Time of the run outside the parts: the effect of caches and of the load of the host."""
        return self.run_us - self.verbs_us - self.handover_us - self.reference_us - self.engine_us


LAYOUTS = (
    ("engine.build", "engine.plugin_factory", "engine.lockstep_builder", "engine.trace",
     "engine.nodes.avoider_node", "engine.nodes.reference_node"),
    ("engine.build", "engine.making", "engine.assembly", "engine.trace", "engine.nodes.avoider",
     "engine.nodes.reference"),
    ("engine.build", "engine.making", "engine.assembly", "engine.trace", "engine.role_nodes", "engine.reference"),
    ("engine.build", "engine.build", "engine.assembly", "engine.trace", "engine.role_nodes", "engine.reference"),
    ("runtime.build", "runtime.build", "runtime.executor", "runtime.trace", "dataflow.nodes", "dataflow.reference"),
)  # fmt: skip
"""Modules of this version and of older ones, in the order of the fields of `Layout`."""


@dataclass(frozen=True)
class Layout:
    """The modules of the installed navloom, which have other names in older versions."""

    build: Any
    making: Any
    assembly: Any
    trace: Any
    nodes: Any
    reference: Any

    @classmethod
    def found(cls) -> Layout:
        """The layout of this interpreter's navloom."""
        for names in LAYOUTS:
            try:
                return cls(*(importlib.import_module(f"navloom.{name}") for name in names))
            except ModuleNotFoundError as error:
                if not str(error.name).startswith("navloom."):
                    raise
        raise ModuleNotFoundError("no known layout of navloom")


@dataclass(frozen=True)
class Site:
    """One call that does not belong to the engine: the attribute `name` of `owner`, and the part it counts for."""

    part: str
    owner: Any
    name: str


class Answers:
    """What each site returned in a run, in order, with the CPU time of the calls by part, ns."""

    def __init__(self) -> None:
        self.of_site: dict[int, list[Any]] = defaultdict(list)
        self.spent_ns: dict[str, int] = dict.fromkeys(PARTS, 0)
        self.clock_ns = _clock_cost_ns()

    def recorder(self, number: int, site: Site) -> Callable[..., Any]:
        """Wrap the site's function so that its answers and times are recorded."""
        function, part, kept = getattr(site.owner, site.name), site.part, self.of_site[number]
        spent_ns, clock_ns = self.spent_ns, self.clock_ns

        def record(*given: Any) -> Any:
            before = process_time_ns()
            answer = function(*given)
            spent_ns[part] += process_time_ns() - before - clock_ns
            kept.append(answer)
            return answer

        return record

    def standin(self, number: int, site: Site) -> Callable[..., Any]:
        """A function that returns the recorded answers in order."""
        following = iter(self.of_site[number]).__next__

        def recall(*given: Any) -> Any:
            return following()

        return recall

    def standins_ns(self) -> int:
        """CPU time of one run's calls of the stand-ins, in a loop of their own."""
        total = 0
        for number, kept in self.of_site.items():
            recall, rounds = self.standin(number, Site("", None, "")), range(len(kept))
            before = process_time_ns()
            for _ in rounds:
                recall(None)
            called = process_time_ns()
            for _ in rounds:
                pass
            total += 2 * called - before - process_time_ns()
        return max(0, total)


class Run:
    """One executor of a config, whose sites may be replaced."""

    def __init__(self, layout: Layout, loaded: Any) -> None:
        self.layout = layout
        self.system = layout.build.assemble(loaded)
        layout.making.make_plugins(self.system)
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  (`drive` closes it)
        self.executor = layout.assembly.lockstep_of(self.system, (), layout.trace.TraceWriter(self._file))
        self.nodes = [one.node for one in getattr(self.executor, "steppers", None) or self.executor.instances]
        self._before: list[tuple[Any, str, Any]] = []

    def sites(self) -> list[Site]:
        """All calls that do not belong to the engine, in the order of the nodes."""
        verbs = {role: next(iter(abc.__abstractmethods__)) for role, abc in ROLES.items()}  # in older versions too
        found = [Site("verbs", part.plugin, verbs[part.role]) for part in self.system.parts.values()]
        for node in self.nodes:
            if hasattr(node, "rule"):
                found.append(Site("handover", node.rule, "step"))
            if isinstance(node, self.layout.reference.ReferenceNode):
                found.append(Site("reference", node, "_reference"))
        if hasattr(self.layout.nodes, "own_way"):  # older hand-overs look only along the trajectory
            found.append(Site("handover", self.layout.nodes, "own_way"))
        found.append(Site("reference", self.layout.reference, "trajectory_of"))
        return found

    def replace(self, make: Callable[[int, Site], Callable[..., Any]]) -> None:
        """Put another function at each site until the run ends."""
        for number, site in enumerate(self.sites()):
            self._before.append((site.owner, site.name, vars(site.owner).get(site.name)))
            setattr(site.owner, site.name, make(number, site))

    def drive(self) -> tuple[Any, int]:
        """Run it. Returns the log, and the CPU time from the first tick to the closed trace, ns.

        Raises:
            ShareError: A plugin broke.
        """
        period = self.system.config.run.period
        ticks = math.ceil(round(self.system.time_limit / period, 6)) + 2
        gc.collect()
        if gc.get_freeze_count():
            gc.freeze()  # a navloom that freezes loaded objects must not collect the recorded answers either
        try:
            before = process_time_ns()
            log = self.executor.run(ticks)
            self._file.close()
            spent_ns = process_time_ns() - before
        finally:
            for owner, name, function in self._before:
                delattr(owner, name) if function is None else setattr(owner, name, function)
        if log.faults:
            raise ShareError(f"{log.faults[0]}; expected a run in which no plugin breaks")
        return log, spent_ns


def measured(config: str, seed: int, changes: tuple[str, ...] = ()) -> Share:
    """Where the CPU time of one seed's run goes.

    Args:
        config: Path or shipped name.
        seed: Seed of all random streams.
        changes: Changes of the config, as `A.B=V`.

    Raises:
        ShareError: A plugin broke, or the three runs do not agree.
        ConfigError, PluginError: The config is invalid.
    """
    loaded = load_config(config, changes, seed)
    layout, answers = Layout.found(), Answers()
    recorded, plain, fed = (Run(layout, loaded) for _ in range(3))
    recorded.replace(answers.recorder)
    log, _ = recorded.drive()
    plain_log, run_ns = plain.drive()
    fed.replace(answers.standin)
    fed_log, fed_ns = fed.drive()
    if not log.trace_sha256 == plain_log.trace_sha256 == fed_log.trace_sha256:
        raise ShareError(
            f"seed {seed}: the traces of the recorded, the plain and the fed run are {log.trace_sha256[:12]}, "
            f"{plain_log.trace_sha256[:12]} and {fed_log.trace_sha256[:12]}, expected the same of all"
        )
    standins_ns, tick_us = answers.standins_ns(), 1e-3 / log.ticks
    return Share(
        seed=seed,
        ticks=log.ticks,
        run_ms=run_ns * 1e-6,
        run_us=run_ns * tick_us,
        verbs_us=answers.spent_ns["verbs"] * tick_us,
        handover_us=answers.spent_ns["handover"] * tick_us,
        reference_us=answers.spent_ns["reference"] * tick_us,
        engine_us=(fed_ns - standins_ns) * tick_us,
        standins_us=standins_ns * tick_us,
        calls=sum(len(kept) for kept in answers.of_site.values()),
        trace_sha256=log.trace_sha256,
    )


def _clock_cost_ns() -> int:
    """Median difference between two consecutive readings of the clock, ns."""
    times = [process_time_ns() for _ in range(EMPTY_CALLS)]
    return round(statistics.median(after - before for before, after in pairwise(times)))


def in_other(python: str, config: str, seed: int, changes: list[str]) -> Share:
    """Run `measured` in a process of another interpreter. Raises ShareError with the last line that it printed."""
    asked = [config, *set_options(changes), "--seeds", f"{seed}:{seed + 1}", "--json"]
    command = [python, str(Path(__file__).resolve()), *asked]
    done = subprocess.run(command, capture_output=True, text=True, env=clean_environment(), check=False)
    if done.returncode:
        raise ShareError(f"{python}: {(done.stderr.strip().splitlines() or ['no output'])[-1]}")
    found: dict[str, Any] = json.loads(done.stdout)["here"][0]
    return Share(**{name: found[name] for name in Share.__dataclass_fields__})


def summary(found: dict[str, list[Share]]) -> dict[str, Any]:
    """The figures of each seed; with another interpreter also the ratios here / beside, with median, min and max."""
    told: dict[str, Any] = {
        side: [{**asdict(share), "rest_us": share.rest_us} for share in shares] for side, shares in found.items()
    }
    if "beside" in found:
        told["ratios"] = {}
        for name in ("run_ms", *FIELDS):
            pairs = zip(found["here"], found["beside"], strict=True)
            ratios = [getattr(here, name) / getattr(beside, name) for here, beside in pairs]
            told["ratios"][name] = {
                "median": statistics.median(ratios), "min": min(ratios), "max": max(ratios), "seeds": ratios,
            }  # fmt: skip
    return told


def show(found: dict[str, list[Share]]) -> None:
    """Print a row for each seed and side, the medians, and the ratios."""
    heads = "".join(f" {name.removesuffix('_us'):>10}" for name in (*FIELDS, "rest_us"))
    print(f"µs of CPU a tick\n{'seed':<6} {'':<7} {'ticks':>6}{heads}  trace")
    for number in range(len(found["here"])):
        for side, shares in found.items():
            one = shares[number]
            row = "".join(f" {getattr(one, name):>10.1f}" for name in (*FIELDS, "rest_us"))
            print(f"{one.seed:<6} {side:<7} {one.ticks:>6}{row}  {one.trace_sha256[:12]}")
    for side, shares in found.items():
        medians = [statistics.median(getattr(share, name) for share in shares) for name in (*FIELDS, "rest_us")]
        print(f"{'median':<6} {side:<7} {'':>6}" + "".join(f" {value:>10.1f}" for value in medians))
    for name, ratio in summary(found).get("ratios", {}).items():
        least, most = ratio["min"], ratio["max"]
        print(f"here / beside, {name}: median {ratio['median']:.3f}, min {least:.3f}, max {most:.3f}")


def seed_range(text: str) -> range:
    """Parse `A:B` to the seeds A to B - 1."""
    first, _, end = text.partition(":")
    try:
        seeds = range(int(first), int(end))
    except ValueError:
        seeds = range(0)
    if not seeds or seeds[0] < 0:
        raise argparse.ArgumentTypeError(f"seeds {text!r}: expected A:B with 0 <= A < B, as 0:10")
    return seeds


def main() -> None:
    """Measure what the command line asks for."""
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=seed_range, default=range(1), metavar="A:B", help="A to B - 1 (default 0:1)")
    given = parser.parse_args()
    try:
        if given.beside:
            found = in_turns(
                given.beside,
                given.seeds,
                lambda python, seed: in_other(python, given.config, seed, given.set),
                lambda one: f"seed {one.seed}, {one.run_us:.0f} µs a tick",
            )
        else:
            found = {"here": [measured(given.config, seed, tuple(given.set)) for seed in given.seeds]}
    except (ConfigError, PluginError, ShareError) as error:
        sys.exit(f"engine_share: {error}")
    if given.json:
        print(json.dumps(summary(found)))
    else:
        show(found)


if __name__ == "__main__":
    main()
