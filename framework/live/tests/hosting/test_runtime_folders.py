"""Runtime folders: each is private to one user and one robot, and free again once its robot has ended."""

from __future__ import annotations

import fcntl
import os
import stat
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder, Running, robots
from navloom_live.operating.robot_lookup import find_robot


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "rt"))
    return tmp_path / "rt"


def running(robot: str, pid: int, realm: str = "lab") -> Running:
    return Running(realm, robot, pid, ("unixsock-stream//x",), False, "paper", False)


def made(robot: str, pid: int, is_up: bool = True, realm: str = "lab") -> RobotFolder:
    place = RobotFolder(realm, robot)
    place.make()
    assert place.lock()
    place.write(running(robot, pid, realm))
    if not is_up:
        place.unlock()
    return place


def test_a_robot_is_found_while_its_process_lives() -> None:
    place = made("r1", os.getpid())
    assert place.read() == running("r1", os.getpid())
    assert list(robots()) == [running("r1", os.getpid())]
    assert find_robot(None).robot == find_robot("lab/r1").robot == "r1"


def test_a_folder_whose_process_died_is_no_robot() -> None:
    child = os.fork()
    if child == 0:
        made("r1", os.getpid())
        os._exit(0)
    os.waitpid(child, 0)
    assert RobotFolder("lab", "r1").told() == running("r1", child)
    assert list(robots()) == []
    with pytest.raises(DirectoryError, match="no robot of this user is up on this host: start one with"):
        find_robot(None)


def test_a_dead_robot_is_not_up_though_its_process_number_is_in_use_again() -> None:
    place = made("r1", os.getpid(), is_up=False)
    assert place.told() == running("r1", os.getpid())
    assert place.read() is None and list(robots()) == []


def test_looking_for_a_robot_does_not_prevent_its_claim() -> None:
    place = made("r1", os.getpid(), is_up=False)
    look = os.open(place.path / "lock", os.O_RDONLY)
    fcntl.flock(look, fcntl.LOCK_SH)
    threading.Timer(0.002, os.close, [look]).start()
    assert place.lock()


def test_with_several_robots_a_name_is_required_and_a_wrong_one_gets_the_nearest() -> None:
    made("r1", os.getpid())
    made("r2", os.getpid())
    with pytest.raises(DirectoryError, match="several robots are up: lab/r1, lab/r2; choose one with --robot"):
        find_robot(None)
    with pytest.raises(DirectoryError, match="--robot lab/r22: it is not up on this host; up are lab/r1, lab/r2; did"):
        find_robot("lab/r22")


def test_a_name_without_its_realm_is_enough_where_one_robot_has_it() -> None:
    made("r1", os.getpid())
    made("r2", os.getpid())
    assert find_robot("r2") == find_robot("lab/r2") == running("r2", os.getpid())
    with pytest.raises(DirectoryError, match=r"--robot r3: it is not up on this host; up are lab/r1, lab/r2$"):
        find_robot("r3")


def test_a_name_that_several_realms_have_is_answered_with_all_of_them() -> None:
    made("r1", os.getpid())
    made("r1", os.getpid(), realm="field")
    wanted = r"^--robot r1: several robots of that name are up: field/r1, lab/r1; add the realm$"
    with pytest.raises(DirectoryError, match=wanted):
        find_robot("r1")
    assert find_robot("field/r1").realm == "field"


def test_the_folder_is_for_this_user_alone(folder: Path) -> None:
    place = made("r1", 1)
    assert stat.S_IMODE(place.path.stat().st_mode) == 0o700


def test_a_robot_is_claimed_once() -> None:
    first, second = made("r1", 1), RobotFolder("lab", "r1")
    assert not second.lock()
    first.unlock()
    assert second.lock()


def test_a_path_too_long_for_a_socket_says_what_to_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / ("x" * 90)))
    with pytest.raises(DirectoryError, match="too long for a socket; set NAVLOOM_RUNTIME_DIR to a shorter path"):
        RobotFolder("lab", "r1").socket("drive")


def test_clearing_removes_what_a_robot_leaves_over() -> None:
    place = made("r1", 1)
    (place.path / "drive.sock").touch()
    place.clear()
    assert place.read() is None and place.sockets() == []


def test_clearing_keeps_the_socket_of_a_running_node() -> None:
    place = made("r1", 1)
    for name in ("gone", "there"):
        (place.path / f"{name}.sock").touch()
        (place.path / f"{name}.sock.lock").touch()
    with (place.path / "there.sock.lock").open("rb") as held:  # as Zenoh holds it while it listens
        fcntl.flock(held, fcntl.LOCK_EX)
        place.clear()
    assert [Path(end).name for end in place.sockets()] == ["there.sock"]
    assert (place.path / "there.sock.lock").exists() and not (place.path / "gone.sock.lock").exists()


def another_users(folder: Path) -> None:
    os.chown(folder, 65534, 65534)


def open_to_all(folder: Path) -> None:
    folder.chmod(0o777)


IS_ROOT = pytest.mark.skipif(os.getuid() != 0, reason="only root gives folders to other users")


@pytest.mark.parametrize("level", ["parent", "runtime", "robot"])
@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        pytest.param(another_users, "belongs to another user (uid 65534)", marks=IS_ROOT),
        (open_to_all, "is writable for other users (mode 777)"),
    ],
)
def test_a_folder_that_others_may_write_to_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, level: str, spoil: Callable[[Path], None], why: str
) -> None:
    """Another user could make a robot there whose gate answers that it has stopped."""
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "above" / "navloom"))
    folder = RobotFolder("lab", "r1")
    folder.make()
    assert folder.lock()
    folder.write(Running("lab", "r1", os.getpid(), ("unixsock-stream/x",), False, "paper", False))
    spoil({"parent": tmp_path / "above", "runtime": tmp_path / "above" / "navloom", "robot": folder.path}[level])
    reads = [folder.read, folder.told, folder.fates, folder.is_claimed, folder.make]
    if level != "robot":
        reads.append(lambda: list(robots()))  # the folder of one robot may be spoiled while others are not
    for read in reads:
        with pytest.raises(DirectoryError) as caught:
            read()
        assert why in str(caught.value) and "NAVLOOM_RUNTIME_DIR" in str(caught.value)
    folder.unlock()


def test_a_runtime_folder_that_is_a_link_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "navloom"))
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / "navloom").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DirectoryError, match="is a symbolic link"):
        list(robots())


def test_a_folder_below_a_sticky_one_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As /tmp: everybody writes, but only owners rename and remove."""
    (tmp_path / "tmp").mkdir()
    (tmp_path / "tmp").chmod(0o1777)
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "tmp" / "navloom-0"))
    RobotFolder("lab", "r1").make()
    assert list(robots()) == []
