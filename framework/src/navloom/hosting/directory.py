"""Where the robots of this user are: one folder each, with the sockets of its processes and what runs it."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from navloom.errors import NavloomError
from navloom.files import write_whole
from navloom.hosting.process_log import last_lines

__all__ = ["DirectoryError", "Fate", "RobotFolder", "Running", "robots", "runtime_folder"]

LONGEST_SOCKET = 100
"""Characters of a socket's path that every system takes."""
ROBOT, STANDING = ("lock", "robot.json"), ("standing", "standing.json")
"""File that is locked by who runs a robot, or stands for it, and the one that says what runs."""
CLAIMS, LOOK = 3, 0.005
"""Times a robot is claimed, and s between them: longer than a look at the lock lasts."""


class DirectoryError(NavloomError, ValueError):
    """No robot, too many, or a folder that cannot be used; the text says what to do."""


@dataclass(frozen=True)
class Running:
    """A robot that is up.

    Attributes:
        realm, robot: Its names.
        pid: Of what supervises it.
        endpoints: Where its processes listen; of one with a router, the router's.
        via_router: Tools join as clients of a router instead of as peers of every process.
        config: What it was started with.
        barrier: It runs under a barrier.
        keys: Folder of certificates, empty for none.
        supervised: By `pid`; else its processes were started one by one, and `pid` is the one that stands for them.
    """

    realm: str
    robot: str
    pid: int
    endpoints: tuple[str, ...]
    via_router: bool
    config: str
    barrier: bool
    keys: str = ""
    supervised: bool = True


@dataclass(frozen=True)
class Fate:
    """What has become of a process that is supervised.

    Attributes:
        pid: None while there is none.
        state: starting, running, waiting (for its restart), failed or ended.
        restarts: How often it was started again.
        why: How it ended last; empty where it never did.
        cut: Bytes of its log that were not kept, since it writes so much.
    """

    pid: int | None
    state: str
    restarts: int
    why: str
    cut: int = 0


def runtime_folder() -> Path:
    """This user's folder: NAVLOOM_RUNTIME_DIR, else within XDG_RUNTIME_DIR or the folder for temporary files."""
    given = os.environ.get("NAVLOOM_RUNTIME_DIR")
    if given:
        return Path(given)
    base = os.environ.get("XDG_RUNTIME_DIR")
    return Path(base) / "navloom" if base else Path(tempfile.gettempdir()) / f"navloom-{os.getuid()}"


class RobotFolder:
    """One robot's folder.

    Args:
        realm, robot: Its names.
        stands: For a process that stands for a robot which another may bring up beside it, behind a router.
    """

    def __init__(self, realm: str, robot: str, stands: bool = False) -> None:
        self.path = runtime_folder() / f"{realm}.{robot}"
        self._claim, self._word = STANDING if stands else ROBOT
        self._lock: int | None = None
        self._running: Running | None = None

    def make(self) -> None:
        """Make it, for this user alone."""
        for folder in (self.path.parent, self.path):
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                status = folder.stat()
            except OSError as error:
                raise DirectoryError(f"runtime folder {folder}: {error.strerror}; set NAVLOOM_RUNTIME_DIR") from None
            if status.st_uid != os.getuid():
                raise DirectoryError(f"runtime folder {folder} belongs to another user; set NAVLOOM_RUNTIME_DIR")
        self.path.chmod(0o700)

    def lock(self) -> bool:
        """Claim the robot for this process; False where another has it."""
        claim = os.open(self.path / self._claim, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        for left in reversed(range(CLAIMS)):
            with contextlib.suppress(OSError):
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
                self._lock = claim
                return True
            if left:
                time.sleep(LOOK)  # somebody may only have looked whether it is claimed
        os.close(claim)
        return False

    def is_there(self) -> bool:
        """The folder is the one in which this process has claimed the robot: nobody has deleted it."""
        try:
            return self._lock is not None and os.path.samestat(os.fstat(self._lock), (self.path / self._claim).stat())
        except OSError:
            return False

    def renew(self) -> None:
        """Make the folder again after it was deleted, with the claim and the word of what runs here.

        Raises:
            DirectoryError: It cannot be made, or another process has claimed the robot meanwhile.
            OSError: It cannot be written.
        """
        self.make()
        before, self._lock = self._lock, None
        if not self.lock():
            self._lock = before
            raise DirectoryError(f"runtime folder {self.path} was deleted, and another process is this robot now")
        if before is not None:
            os.close(before)
        if self._running is not None:
            self.write(self._running)

    @property
    def is_held(self) -> bool:
        """This process has claimed the robot."""
        return self._lock is not None

    def unlock(self) -> None:
        """Leave the robot to another process."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def leave(self) -> None:
        """Leave the robot to another process, with no word of this one."""
        with contextlib.suppress(OSError):
            (self.path / self._word).unlink()
        self.unlock()

    def socket(self, process: str) -> str:
        """Endpoint of a process's socket."""
        path = self.path / f"{process}.sock"
        if len(str(path)) > LONGEST_SOCKET:
            raise DirectoryError(
                f"{path}: {len(str(path))} characters are too long for a socket; "
                "set NAVLOOM_RUNTIME_DIR to a shorter path"
            )
        return f"unixsock-stream/{path}"

    def sockets(self) -> list[str]:
        """Endpoints of all sockets that are there."""
        return [f"unixsock-stream/{path}" for path in sorted(self.path.glob("*.sock"))]

    def write(self, running: Running) -> None:
        """Say what runs here, at once or not at all."""
        self._running = running
        write_whole(self.path / self._word, json.dumps(asdict(running)))

    def read(self) -> Running | None:
        """What runs here; None where nothing does any more.

        The lock tells, since what runs a robot holds it for as long as it lives; its number may be another's by now.
        """
        held = (self.told(word) for claim, word in (ROBOT, STANDING) if _is_locked(self.path / claim))
        return next((running for running in held if running is not None), None)

    def is_claimed(self) -> bool:
        """Whether a process has the robot now, or stands for it."""
        return any(_is_locked(self.path / claim) for claim, _ in (ROBOT, STANDING))

    def told(self, word: str = "robot.json") -> Running | None:
        """What was written here, whether it still runs or not."""
        try:
            found = json.loads((self.path / word).read_text("utf-8"))
            return Running(**{**found, "endpoints": tuple(found["endpoints"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def write_fates(self, fates: Mapping[str, Fate]) -> None:
        """Say what has become of each process."""
        write_whole(self.path / "fates.json", json.dumps({name: asdict(fate) for name, fate in fates.items()}))

    def fates(self) -> dict[str, Fate]:
        """What has become of each process; empty where nobody supervises any."""
        try:
            found = json.loads((self.path / "fates.json").read_text("utf-8"))
            return {name: Fate(**fate) for name, fate in found.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            return {}

    def last_words(self, process: str, lines: int = 3) -> str:
        """The last lines a process wrote."""
        return "; ".join(last_lines(self.path / f"{process}.log", lines))

    def clear(self) -> None:
        """Remove what a robot that ended has left; not the socket of a node that was started by hand and is there."""
        self.clear_sockets()
        kept = {self.path / STANDING[1]} if _is_locked(self.path / STANDING[0]) else set()
        _remove({*self.path.glob("*.json")} - kept)

    def clear_sockets(self) -> None:
        """Remove the sockets that nobody listens at, and files that were being written."""
        sockets = [*self.path.glob("*.sock"), *self.path.glob("*.door")]
        locks = {*self.path.glob("*.lock"), *(path.with_name(f"{path.name}.lock") for path in sockets)}
        held = {path for path in locks if _is_locked(path)}
        _remove(locks - held)
        _remove(path for path in sockets if path.with_name(f"{path.name}.lock") not in held)
        _remove(self.path.glob("*.part"))


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink()


def _is_locked(path: Path) -> bool:
    """Another process has the file to itself, as each that listens at a socket has the one beside it."""
    try:
        look = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(look, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(look)
    return False


def robots() -> Iterator[Running]:
    """Every robot of this user that is up."""
    for path in sorted(runtime_folder().glob("*.*/")):
        realm, _, robot = path.name.partition(".")
        running = RobotFolder(realm, robot).read()
        if running is not None:
            yield running
