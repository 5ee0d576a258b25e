"""Shows a lockstep run of one config in a viewer."""

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
    """The viewer's observers of one run; empty if the run is not shown.

    Attributes:
        observers: Observers for the run.
        showing: The showing, or None.
    """

    observers: Sequence[Gathering] = ()
    showing: Showing | None = None

    def between(self, progress: Progress) -> Progress:
        """A progress function that also passes the collected messages on between ticks."""
        if not self.observers:
            return progress

        def tell(done: float, total: float) -> None:
            self.drain()
            progress(done, total)

        return tell

    def finish(self) -> None:
        """Pass on the remaining messages and draw them, after the run."""
        self.drain()
        if self.showing is not None:
            self.showing.finish()

    def drain(self) -> None:
        """Pass on the collected messages."""
        for observer in self.observers:
            observer.drain()


@contextmanager
def watch_run(loaded: Loaded, where: Where | None, say: Callable[[str], None]) -> Iterator[Watch]:
    """Show a run of a config. The trace does not change; without a viewer there is no cost.

    Args:
        loaded: The config.
        where: Where to show it; None for nowhere.
        say: Receives messages for the user.

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
