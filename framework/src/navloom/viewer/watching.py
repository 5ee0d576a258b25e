"""Watching lockstep runs: of one config, or of several methods that drive the same world side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from navloom.config import Loaded
from navloom.engine.build import assemble
from navloom.viewer.facts import facts_of
from navloom.viewer.observe import Gathering
from navloom.viewer.showing import Showing, Where, showing

__all__ = ["Watch", "watch_run"]

Progress = Callable[[float, float], None]


@dataclass(eq=False)
class Watch:
    """What looks on at one run; nothing at all where nobody wants to see it.

    Attributes:
        observers: For the run.
        showing: Where it goes.
    """

    observers: Sequence[Gathering] = ()
    showing: Showing | None = None

    def between(self, progress: Progress) -> Progress:
        """A progress function that hands on, between two ticks, what was gathered."""
        if not self.observers:
            return progress

        def tell(done: float, total: float) -> None:
            self.drain()
            progress(done, total)

        return tell

    def finish(self) -> None:
        """The run is over: hand on the rest, and let it be drawn."""
        self.drain()
        if self.showing is not None:
            self.showing.finish()

    def drain(self) -> None:
        """Hand on the rest."""
        for observer in self.observers:
            observer.drain()


@contextmanager
def watch_run(loaded: Loaded, where: Where | None, say: Callable[[str], None]) -> Iterator[Watch]:
    """Watch a run of a config. The trace is the same; a run that nobody watches pays nothing.

    Args:
        loaded: The config.
        where: Where to show it; None for nowhere.
        say: Told what the user should know.

    Raises:
        ViewerError: It cannot be shown there.
    """
    if where is None:
        yield Watch()
        return
    name = loaded.config.robot.name
    facts = facts_of({name: assemble(loaded)}, f"{loaded.name}, seed {loaded.config.run.seed}")
    blocked = frozenset(loaded.config.plugins.blocked)
    with showing(facts, where, recording_id=loaded.sha256(), blocked=blocked, say=say) as shown:
        watch = Watch([Gathering(name, shown.bridge.put_all)], shown)
        try:
            yield watch
        finally:
            watch.drain()
