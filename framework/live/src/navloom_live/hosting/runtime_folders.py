"""Runtime folders of this user's robots: one each, with its processes' sockets and a description of what runs."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import stat
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from navloom.errors import NavloomError
from navloom.files import write_whole

from navloom_live.hosting.process_log import last_lines

__all__ = ["DirectoryError", "Fate", "RobotFolder", "Running", "refuse_foreign", "robots", "runtime_folder"]

LONGEST_SOCKET = 100
"""Longest path of a socket that every system accepts, in characters."""
ROBOT, STANDING = ("lock", "robot.json"), ("standing", "standing.json")
"""(lock file, description) of a supervised robot, and of a process that represents an unsupervised one."""
CLAIMS, LOCK_RETRY_INTERVAL = 3, 0.005
"""Number of attempts to lock a robot, and time between them, s: longer than another process's check of the lock."""


class DirectoryError(NavloomError, ValueError):
    """No robot, too many, or an unusable folder. The text says what to do."""


@dataclass(frozen=True)
class Running:
    """A robot that is up.

    Attributes:
        realm, robot: Its names.
        pid: Process ID of its supervisor.
        endpoints: Where its processes listen; with a router, the router's endpoint.
        via_router: Tools join as clients of a router instead of as peers of every process.
        config: Name of its config.
        barrier: It runs under the barrier.
        keys: Folder of certificates; empty for none.
        supervised: `pid` supervises it; otherwise its processes were started one by one, and `pid` represents them.
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
    """State of a supervised process.

    Attributes:
        pid: Process ID; None while it does not run.
        state: starting, running, waiting (for its restart), failed or ended.
        restarts: Number of restarts.
        why: How it ended last; empty if it never did.
        cut: Bytes of its log that were lost because it writes too much.
    """

    pid: int | None
    state: str
    restarts: int
    why: str
    cut: int = 0


def runtime_folder(environment: Mapping[str, str] | None = None) -> Path:
    """This user's folder: NAVLOOM_RUNTIME_DIR, otherwise in XDG_RUNTIME_DIR or the folder for temporary files.

    Args:
        environment: Environment of another process of this user; None for that of this one.
    """
    given = os.environ if environment is None else environment
    if given.get("NAVLOOM_RUNTIME_DIR"):
        return Path(given["NAVLOOM_RUNTIME_DIR"])
    if given.get("XDG_RUNTIME_DIR"):
        return Path(given["XDG_RUNTIME_DIR"]) / "navloom"
    temporary = tempfile.gettempdir() if environment is None else environment.get("TMPDIR", "/tmp")
    return Path(temporary) / f"navloom-{os.getuid()}"


def refuse_foreign(folder: Path) -> None:
    """Refuse a folder into which another user may write, or that another user may replace.

    What stands in it tells tools where to send an operator's stop. The temporary folder is everybody's, so another user
    can make this user's folder first.

    Args:
        folder: A folder of this user. It need not exist.

    Raises:
        DirectoryError: It, or a folder above it, belongs to another user or is writable for others.
    """
    # Who may replace a folder above can replace this one as a whole.
    for path in (folder, *folder.absolute().parents):
        try:
            # The folder itself must be no link, which another user could turn elsewhere; above it, links of root are
            # usual.
            status = path.lstat() if path == folder else path.stat()
        except OSError:
            continue  # nothing is there to be read
        own = (os.getuid(),) if path == folder else (os.getuid(), 0)
        # In a folder with the sticky bit, as /tmp, only owners rename and remove.
        is_writable = bool(status.st_mode & 0o022) and (path == folder or not status.st_mode & stat.S_ISVTX)
        if status.st_uid not in own:
            why = f"belongs to another user (uid {status.st_uid})"
        elif stat.S_ISLNK(status.st_mode):
            why = "is a symbolic link"
        elif is_writable:
            why = f"is writable for other users (mode {stat.S_IMODE(status.st_mode):o})"
        else:
            continue
        raise DirectoryError(
            f"runtime folder {folder}: {path} {why}, so it cannot be trusted; remove it, mend its owner and mode, "
            "or set NAVLOOM_RUNTIME_DIR to a folder of your own"
        )


class RobotFolder:
    """One robot's folder.

    Args:
        realm, robot: Its names.
        stands: For a process that represents a robot behind a router, of which a supervisor may run other processes.
    """

    def __init__(self, realm: str, robot: str, stands: bool = False) -> None:
        self.path = runtime_folder() / f"{realm}.{robot}"
        self._claim, self._word = STANDING if stands else ROBOT
        self._lock: int | None = None
        self._running: Running | None = None

    def make(self) -> None:
        """Create the folder, accessible only to this user. Raises DirectoryError."""
        for folder in (self.path.parent, self.path):
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            except OSError as error:
                raise DirectoryError(f"runtime folder {folder}: {error.strerror}; set NAVLOOM_RUNTIME_DIR") from None
        refuse_foreign(self.path)
        refuse_foreign(self.path.parent)
        # `mkdir` applies the umask and leaves an existing folder as it is.
        self.path.chmod(0o700)

    def lock(self) -> bool:
        """Claim the robot for this process; False if another process has it."""
        claim = os.open(self.path / self._claim, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        for left in reversed(range(CLAIMS)):
            with contextlib.suppress(OSError):
                # A lock, not a file with a process ID: the kernel releases it however its holder ends.
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
                self._lock = claim
                return True
            if left:
                time.sleep(LOCK_RETRY_INTERVAL)  # another process may only have checked the lock
        os.close(claim)
        return False

    def is_there(self) -> bool:
        """Whether the folder in which this process claimed the robot still exists."""
        try:
            # The lock is on a file that may be deleted: a new one of the same name is another claim.
            return self._lock is not None and os.path.samestat(os.fstat(self._lock), (self.path / self._claim).stat())
        except OSError:
            return False

    def renew(self) -> None:
        """Create the folder again after it was deleted, with the claim and the description of what runs.

        Raises:
            DirectoryError: It cannot be created, or another process has claimed the robot meanwhile.
            OSError: It cannot be written.
        """
        self.make()
        # The old lock is held until the new one is there: meanwhile no other process may claim the robot.
        before, self._lock = self._lock, None
        if not self.lock():
            self._lock = before
            raise DirectoryError(f"runtime folder {self.path} was deleted, and another process has claimed the robot")
        if before is not None:
            os.close(before)
        if self._running is not None:
            self.write(self._running)

    @property
    def is_held(self) -> bool:
        """Whether this process has claimed the robot."""
        return self._lock is not None

    def unlock(self) -> None:
        """Release the claim."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def leave(self) -> None:
        """Release the claim and remove this process's description."""
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
        """Endpoints of all existing sockets."""
        return [f"unixsock-stream/{path}" for path in sorted(self.path.glob("*.sock"))]

    def write(self, running: Running) -> None:
        """Write the description of what runs, atomically."""
        self._running = running
        write_whole(self.path / self._word, json.dumps(asdict(running)))

    def read(self) -> Running | None:
        """What runs here; None if nothing does any more.

        The lock decides, since its holder keeps it for as long as it lives; the process ID may belong to another
        process by now.

        Raises:
            DirectoryError: Other users can write into the folder.
        """
        self._refuse_foreign()
        held = (self.told(word) for claim, word in (ROBOT, STANDING) if _is_locked(self.path / claim))
        return next((running for running in held if running is not None), None)

    def is_claimed(self) -> bool:
        """Whether a process supervises or represents the robot now. Raises DirectoryError for a folder of others."""
        self._refuse_foreign()
        return any(_is_locked(self.path / claim) for claim, _ in (ROBOT, STANDING))

    def told(self, word: str = "robot.json") -> Running | None:
        """The written description, whether the robot still runs or not. Raises DirectoryError, as `read`."""
        self._refuse_foreign()
        try:
            found = json.loads((self.path / word).read_text("utf-8"))
            return Running(**{**found, "endpoints": tuple(found["endpoints"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def write_fates(self, fates: Mapping[str, Fate]) -> None:
        """Write the state of each process, atomically."""
        write_whole(self.path / "fates.json", json.dumps({name: asdict(fate) for name, fate in fates.items()}))

    def fates(self) -> dict[str, Fate]:
        """State of each process; empty without a supervisor. Raises DirectoryError for a folder of others."""
        self._refuse_foreign()
        try:
            found = json.loads((self.path / "fates.json").read_text("utf-8"))
            return {name: Fate(**fate) for name, fate in found.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            return {}

    def _refuse_foreign(self) -> None:
        refuse_foreign(self.path)
        refuse_foreign(self.path.parent)

    def last_words(self, process: str, lines: int = 3) -> str:
        """The last lines of a process's log."""
        return "; ".join(last_lines(self.path / f"{process}.log", lines))

    def clear(self) -> None:
        """Remove the files of a robot that has ended, but not the socket of a running node that was started by hand."""
        self.clear_sockets()
        kept = {self.path / STANDING[1]} if _is_locked(self.path / STANDING[0]) else set()
        _remove({*self.path.glob("*.json")} - kept)

    def clear_sockets(self) -> None:
        """Remove sockets without a listener, and unfinished files."""
        sockets = [*self.path.glob("*.sock"), *self.path.glob("*.door")]
        locks = {*self.path.glob("*.lock"), *(path.with_name(f"{path.name}.lock") for path in sockets)}
        # A listener that lives holds its lock; sockets of those that were killed stay as files.
        held = {path for path in locks if _is_locked(path)}
        _remove(locks - held)
        _remove(path for path in sockets if path.with_name(f"{path.name}.lock") not in held)
        _remove(self.path.glob("*.part"))


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink()


def _is_locked(path: Path) -> bool:
    """Whether another process holds an exclusive lock on a file; a listener holds one on the file beside its socket."""
    try:
        # Never created: a look must leave no file behind.
        look = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        # Shared, so that several tools can look at once; it fails only against an exclusive holder.
        fcntl.flock(look, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(look)
    return False


def robots() -> Iterator[Running]:
    """Every robot of this user that is up. Raises DirectoryError if other users can write into the folder."""
    refuse_foreign(runtime_folder())
    for path in sorted(runtime_folder().glob("*.*/")):
        realm, _, robot = path.name.partition(".")
        running = RobotFolder(realm, robot).read()
        if running is not None:
            yield running
