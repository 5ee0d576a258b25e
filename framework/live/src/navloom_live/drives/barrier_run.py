"""A run of a robot in its processes under the barrier, which has the trace of the same run in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import IO

from navloom.config import Loaded
from navloom.engine.build import assemble
from navloom.engine.event_schedule import schedule
from navloom.engine.task_checks import check_task
from navloom.engine.trace import TraceWriter
from navloom.plugins.run_observers import Onlookers
from navloom.runs.episode import Episode, run_info
from navloom.runs.episode_recorder import Recorder

from navloom_live.drives.live_warnings import LiveWarnings
from navloom_live.hosting.live_robot import Beside, LiveRobot
from navloom_live.hosting.network import network_of
from navloom_live.live.conductor import BarrierError, Conductor
from navloom_live.live.process_streams import Switchboard
from navloom_live.timing import START_LIMIT

__all__ = ["run_barrier"]


def run_barrier(
    loaded: Loaded,
    *,
    trace: IO[bytes] | None = None,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[float, float], None] | None = None,
    ends: Callable[[], bool] = lambda: False,
    beside: Beside | None = None,
    onlookers: Onlookers | None = None,
) -> Episode:
    """Run a config in its processes under the barrier: the same trace as in lockstep. See `LiveRun` for the rest.

    Raises:
        ConfigError, PluginError: The request was wrong; StartError: the robot did not come up;
        BarrierError: a node did not report a tick.
    """
    system = assemble(loaded)
    check_task(system)
    recorder, run = Recorder(), loaded.config.run
    with LiveRobot(system, network_of(loaded.config, None, False), None, True, say) as robot, ExitStack() as attending:
        robot.wait_complete(START_LIMIT, ends=ends)
        if beside is not None:
            attending.enter_context(beside(robot))

        def check() -> None:
            if ends():
                raise KeyboardInterrupt
            for child in robot.supervisor.poll(restarts=False):
                raise BarrierError(
                    f"process {child.task.name} {child.why} in the run. "
                    f"Its last message: {robot.supervisor.tail(child)}"
                )

        board = Switchboard(robot.bus, robot.keys, lossless=True)
        shown = [] if onlookers is None else onlookers.begin(run_info(loaded, "barrier"))
        conductor = Conductor(
            system, board, schedule(loaded.config, system.goal), [recorder, *shown], TraceWriter(trace), check
        )
        board.connect()
        ticks = system.longest_run
        tell = None if progress is None else (lambda tick: progress(tick * run.period, system.time_limit))
        log = conductor.run(ticks, tell)
        return Episode(system, log, recorder, warnings=LiveWarnings(robot.bus, robot.keys).look())
