"""Runs an episode twice in one process and finds the first stream that differs."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from navloom.config import Loaded
from navloom.engine.nondeterminism import every_tick, some_ticks
from navloom.engine.run_warnings import RunWarning
from navloom.engine.trace import TraceEntry, read_trace
from navloom.messages.codec import encode
from navloom.plugins import Discovery
from navloom.runs.episode import Episode, run_episode
from navloom_recording.message_comparison import first_difference

__all__ = ["Divergence", "run_twice"]


@dataclass(frozen=True)
class Divergence:
    """The first difference between two runs of an episode.

    Attributes:
        tick: Tick of the message.
        role, instance, plugin, port: The stream; if several differ in that tick, the first in the graph's order.
        what: Field and both values, in words.
    """

    tick: int
    role: str
    instance: str
    plugin: str
    port: str
    what: str

    @property
    def text(self) -> str:
        """The difference in words that follow the node's name."""
        return f"differs first when the same episode runs twice: in tick {self.tick}, {self.port}{self.what}"


def run_twice(
    loaded: Loaded,
    discovery: Discovery | None = None,
    progress: Callable[[], None] = lambda: None,
    reads: Iterable[tuple[str, str]] = (),
) -> tuple[Episode, Divergence | None, list[RunWarning]]:
    """Run an episode twice, with different global random states.

    Returns:
        The first episode; the first difference of the second, or None; and warnings of the kinds `clock` and `random`
        from the second run, in which every step is inspected.

    Raises:
        ConfigError, PluginError: Nothing ran.
    """
    with TemporaryDirectory() as folder:
        traces = [Path(folder) / name for name in ("first.bin", "second.bin")]
        episodes = []
        for number, path in enumerate(traces):
            # A plugin that draws from the global generators would otherwise repeat itself and pass.
            random.seed(number)
            np.random.seed(number)  # noqa: NPY002  (plugins should not use the global state: it differs in each run)
            with path.open("wb") as file:
                episodes.append(
                    run_episode(
                        loaded,
                        discovery=discovery,
                        trace=file,
                        say=lambda text: progress(),
                        progress=lambda done, total: progress(),
                        # Inspecting every step is slow; one of the two runs is enough.
                        looks_at=every_tick if number else some_ticks,
                        reads=reads,
                    )
                )
        divergence = _first_divergence(episodes[0], *traces)
    seen = [warning for warning in episodes[1].warnings if warning.kind in ("clock", "random")]
    return episodes[0], divergence, seen


def _first_divergence(episode: Episode, first: Path, second: Path) -> Divergence | None:
    # The usual case, without decoding anything.
    if episode.log.trace_sha256 and first.read_bytes() == second.read_bytes():
        return None
    order = {spec.role: number for number, spec in enumerate(episode.system.specs)}
    ours, theirs = _ticks(first), _ticks(second)
    # Not strict: one run may end earlier, which is itself a difference.
    for (tick, was), (other, now) in zip(ours, theirs, strict=False):
        if tick != other:
            return Divergence(min(tick, other), "gate", "main", "", "command", ": one of them ended")
        # In the graph's order, so the cause is named and not a stream that merely follows from it.
        keys = sorted({*was, *now}, key=lambda key: (order.get(key[0], len(order)), key))
        for key in keys:
            told = _difference(was.get(key), now.get(key))
            if told is not None:
                part = episode.system.parts.get((key[0], key[1]))
                return Divergence(tick, key[0], key[1], "" if part is None else part.cls.name, key[2], told)
    return Divergence(episode.log.ticks, "goal", "main", "", "result", ": one of them ended earlier")


Key = tuple[str, str, str]


def _ticks(path: Path) -> Iterator[tuple[int, dict[Key, list[TraceEntry]]]]:
    """Messages of each stream, by tick."""
    for tick, entries in groupby(read_trace(path), lambda one: one.tick):
        found: dict[Key, list[TraceEntry]] = {}
        for entry in entries:
            found.setdefault((entry.role, entry.instance, entry.port), []).append(entry)
        yield tick, found


def _difference(was: list[TraceEntry] | None, now: list[TraceEntry] | None) -> str | None:
    """Difference of one stream in one tick, in words that follow its name; None if it is equal."""
    if was is None or now is None or len(was) != len(now):
        return f": {len(was or ())} messages, then {len(now or ())}"
    for one, other in zip(was, now, strict=True):
        # Bytes, as traces hold them: a comparison of floats takes -0.0 for 0.0 and NaN as different from NaN.
        if encode(one.message, one.envelope) != encode(other.message, other.envelope):
            found = first_difference(one.message, other.message)
            return ": other bytes" if found is None else f".{found[0]}: {found[1]}, then {found[2]}"
    return None
