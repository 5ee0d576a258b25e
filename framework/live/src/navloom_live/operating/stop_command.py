"""`navloom stop`: sends the stop before anything is loaded that it does not need.

The command line itself takes longer to load than a stop takes to arrive, so `navloom stop` with plain options does not
wait for it, see `read_options`. On a loaded computer that is the difference between an instant and seconds.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from navloom.errors import NavloomError
from navloom.logs import Level, set_up_logging

from navloom_live.hosting.node_claims import elsewhere
from navloom_live.hosting.runtime_folders import DirectoryError, robots
from navloom_live.operating.robot_lookup import find_robot, join

__all__ = ["read_options", "stop_at_once", "stop_robots"]

VALUES = {"--robot": "robot", "--connect": "connect", "--keys": "keys"}
FLAGS = {"--insecure": "insecure", "--all": "every"}
STOPPED = "stopped; `navloom resume` lets it drive again"


def read_options(words: Sequence[str]) -> dict[str, Any] | None:
    """Arguments of `stop_robots` from the words after `navloom stop`.

    None if the whole command line must read them: for its help, its errors and the options of every command.
    """
    found: dict[str, Any] = {}
    rest = iter(words)
    for word in rest:
        option, equals, value = word.partition("=")
        if word in FLAGS:
            found[FLAGS[word]] = True
        elif option in VALUES:
            given = value if equals else next(rest, "")
            if not given or given.startswith("-"):
                return None
            found[VALUES[option]] = given
        else:
            return None
    return found


def stop_at_once(options: dict[str, Any]) -> int | None:
    """Stop without the command line, and return its exit code; None for an unexpected error: it can be tried again."""
    set_up_logging(Level.INFO, as_json=False)
    try:
        return stop_robots(**options)
    except NavloomError as error:
        print(f"navloom: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("navloom: interrupted", file=sys.stderr)
        return 1
    except Exception:
        return None


def stop_robots(
    robot: str | None = None,
    connect: str | None = None,
    keys: str | None = None,
    insecure: bool = False,
    every: bool = False,
) -> int:
    """Stop a robot, or every robot of this user on this host, and print what happened.

    Args:
        robot, connect, keys, insecure: See `join`.
        every: Every robot; then `robot` and `connect` must not be given.

    Returns:
        Exit code: 1 if one of several robots could not be stopped.

    Raises:
        NavloomError: The one robot could not be stopped, or none is up.
    """
    if every and (robot is not None or connect is not None):
        raise DirectoryError("--all: it means every robot on this host; leave --robot and --connect out")
    if not every:
        with join(robot, connect, keys, insecure=insecure) as client:
            client.stop()
        print(STOPPED, flush=True)
        return 0
    own, others = [f"{one.realm}/{one.robot}" for one in robots()], elsewhere()
    if not own and not others:
        find_robot(None)  # which says that none is up
    stops = _stop_each(own, keys, insecure)
    for name, folder in others.items():
        with _in_folder(folder):
            stops += _stop_each([name], keys, insecure)
    return int(any(stop.outcome != STOPPED for stop in stops))


def _stop_each(names: Sequence[str], keys: str | None, insecure: bool) -> list[_Stop]:
    """Stop robots of one runtime folder, and print what happened to each."""
    stops = [_Stop(name, keys, insecure) for name in names]
    for stop in stops:  # at the same time: one that does not answer must not delay the others
        stop.start()
    for stop in stops:
        stop.join()
        print(f"{stop.name}: {stop.outcome}", flush=True)
    return stops


@contextmanager
def _in_folder(folder: Path) -> Iterator[None]:
    """Use another runtime folder of this user."""
    before = os.environ.get("NAVLOOM_RUNTIME_DIR")
    os.environ["NAVLOOM_RUNTIME_DIR"] = str(folder)
    try:
        yield
    finally:
        del os.environ["NAVLOOM_RUNTIME_DIR"]
        if before is not None:
            os.environ["NAVLOOM_RUNTIME_DIR"] = before


class _Stop(threading.Thread):
    """Stops one of several robots.

    Attributes:
        outcome: What happened.
    """

    def __init__(self, name: str, keys: str | None, insecure: bool) -> None:
        super().__init__(name=name, daemon=True)
        self.outcome = "not stopped"
        self._keys, self._insecure = keys, insecure

    def run(self) -> None:
        try:
            with join(self.name, None, self._keys, insecure=self._insecure) as client:
                client.stop()
            self.outcome = STOPPED
        except NavloomError as error:
            self.outcome = f"not stopped: {error}"
        except Exception as error:
            self.outcome = f"not stopped: {type(error).__name__}: {error}"
