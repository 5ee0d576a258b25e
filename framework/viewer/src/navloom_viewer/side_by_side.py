"""Shows several methods in the same world side by side: lockstep runs in threads, paced to the wall clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from navloom.config import Loaded
from navloom.engine.build import assemble
from navloom.errors import NavloomError
from navloom.messages import Envelope, Message
from navloom.runs.episode import Episode, run_episode

from navloom_viewer.bridge import BridgeCounts
from navloom_viewer.drawing import Shown
from navloom_viewer.lockstep_viewing import Gathering
from navloom_viewer.picture_setup import facts_of
from navloom_viewer.viewer_session import Showing, Where, showing

__all__ = ["Pace", "drive_side_by_side"]

Say = Callable[[str], None]


class Stopped(NavloomError):
    """The user ended the run."""


class Pace:
    """Starts several runs together and keeps them from running ahead of the wall clock.

    Args:
        runs: Number of runs.
        clock, sleep: Monotonic wall clock, s, and sleep function.
    """

    def __init__(
        self, runs: int, clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._ready = threading.Barrier(runs, self._begin)
        self._clock, self._sleep = clock, sleep
        self._began = 0.0
        self.is_stopped = False

    def begin(self) -> None:
        """Wait until every run is ready for its first tick."""
        self._ready.wait()

    def abort(self) -> None:
        """End all waiting runs with an error."""
        self.is_stopped = True
        self._ready.abort()

    def wait_until(self, stamp_ns: int) -> None:
        """Return no sooner than `stamp_ns` after the beginning, ns. Raises Stopped."""
        if self.is_stopped:
            raise Stopped
        left = self._began + stamp_ns * 1e-9 - self._clock()
        if left > 0.0:
            self._sleep(left)

    def _begin(self) -> None:
        self._began = self._clock()


class _Paced(Gathering):
    """Passes the messages of each tick on when the next tick begins, paced to the wall clock."""

    def __init__(self, variant: str, take: Callable[[Shown], None], pace: Pace) -> None:
        super().__init__(variant, take)
        self._pace, self._tick = pace, -1

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Store a message; at a new tick wait for its time first."""
        if at.tick > self._tick:
            if self._tick < 0:
                self._pace.begin()
            self._tick = at.tick
            self.drain()
            self._pace.wait_until(at.stamp_ns)
        super().on_message(role, instance, active, port, message, at)


@dataclass(eq=False)
class _Run:
    loaded: Loaded
    episode: Episode | None = None
    error: BaseException | None = None


def drive_side_by_side(
    methods: Mapping[str, Loaded], where: Where, title: str, say: Say, tell: Callable[[Mapping[str, Episode]], None]
) -> BridgeCounts:
    """Drive every method in the world of its config, and show them in one picture until all have ended.

    The runs are paced to the wall clock if a viewer shows them, and unpaced if only a file is written.

    Args:
        methods: Config by name.
        where: Where to show them.
        title: Title of the recording.
        say: Receives messages for the user.
        tell: Called with the episodes once all have ended, before a web server waits for its user.

    Returns:
        Counts of messages drawn and dropped.

    Raises:
        ConfigError, PluginError: The request was wrong; ViewerError: the runs cannot be shown.
    """
    facts = facts_of({name: assemble(loaded) for name, loaded in methods.items()}, title)
    identity = "-".join(loaded.sha256()[:8] for loaded in methods.values())
    runs = {name: _Run(loaded) for name, loaded in methods.items()}
    with showing(facts, where, recording_id=identity, say=say) as shown:
        if where.opens or where.url:
            _drive_paced(runs, shown)
        else:
            for name, run in runs.items():
                gathering = Gathering(name, shown.bridge.put_all)
                run.episode = run_episode(
                    run.loaded, observers=[gathering], progress=lambda done, total, g=gathering: g.drain()  # type: ignore[misc]
                )  # fmt: skip
                gathering.drain()
        shown.finish()
        tell({name: run.episode for name, run in runs.items() if run.episode is not None})
    return shown.counts


def _drive_paced(runs: Mapping[str, _Run], shown: Showing) -> None:
    pace = Pace(len(runs))

    def drive(name: str, run: _Run) -> None:
        gathering = _Paced(name, shown.bridge.put_all, pace)
        try:
            run.episode = run_episode(run.loaded, observers=[gathering])
            gathering.drain()
        except BaseException as error:
            run.error = error
            pace.abort()

    threads = [threading.Thread(target=drive, args=one, name=one[0], daemon=True) for one in runs.items()]
    for thread in threads:
        thread.start()
    try:
        while any(thread.is_alive() for thread in threads):
            if shown.is_closed:
                pace.abort()
            for thread in threads:
                thread.join(0.1)
    except KeyboardInterrupt:
        pace.abort()
        raise
    errors = [run.error for run in runs.values() if run.error is not None]
    for error in errors:
        if not isinstance(error, (Stopped, threading.BrokenBarrierError)):
            raise error
