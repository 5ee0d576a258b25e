"""A deleted runtime folder is restored, with a link to every socket in use."""

from __future__ import annotations

import os
import shutil
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from navloom_live.hosting.folder_keeper import FolderKeeper
from navloom_live.hosting.runtime_folders import RobotFolder, Running, robots

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux leads to a file without a name")
UP = Running("lab", "r1", os.getpid(), ("unixsock-stream//x",), False, "paper", False)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RobotFolder]:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "rt"))
    made = RobotFolder("lab", "r1")
    made.make()
    assert made.lock()
    made.write(UP)
    yield made
    made.unlock()


def listening(path: Path) -> socket.socket:
    end = socket.socket(socket.AF_UNIX)
    end.bind(str(path))
    end.listen()
    return end


def called(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as end:
        return end.connect_ex(str(path)) == 0


def test_a_deleted_folder_is_restored_with_its_claim_its_robot_and_its_sockets(folder: RobotFolder) -> None:
    said: list[str] = []
    keeper, path = FolderKeeper(folder, ["drive"], said.append), folder.path / "drive.sock"
    with listening(path):
        assert not keeper.look()
        shutil.rmtree(folder.path.parent)
        assert list(robots()) == [] and not called(path)
        assert keeper.look()
        assert list(robots()) == [UP] and called(path) and folder.is_claimed()
        assert not keeper.look() and called(path)
        assert said == [f"runtime folder {folder.path} was deleted and is made again; the robot continues"]
        # a restarted one listens under its own name
        keeper.forget("drive")
        assert not path.is_symlink()
    with listening(path):
        assert not keeper.look() and not path.is_symlink() and called(path)
    keeper.close()


def test_a_single_deleted_socket_is_restored(folder: RobotFolder) -> None:
    keeper, path = FolderKeeper(folder, ["drive"], print), folder.path / "drive.sock"
    with listening(path):
        keeper.look()
        path.unlink()
        keeper.look()
        assert called(path)
    keeper.close()


def test_a_folder_that_cannot_be_restored_is_reported_once_and_retried(folder: RobotFolder) -> None:
    said: list[str] = []
    keeper, above = FolderKeeper(folder, [], said.append), folder.path.parent
    shutil.rmtree(above)
    above.write_text("in the way", "utf-8")
    assert not keeper.look() and not keeper.look()
    assert len(said) == 1 and said[0].endswith(
        f"set NAVLOOM_RUNTIME_DIR; the robot continues, but no command finds it: `kill {os.getpid()}` ends it"
    )
    above.unlink()
    assert keeper.look() and list(robots()) == [UP]


def test_a_robot_of_the_same_name_that_came_up_meanwhile_keeps_its_folder(folder: RobotFolder) -> None:
    said: list[str] = []
    keeper = FolderKeeper(folder, [], said.append)
    shutil.rmtree(folder.path)
    other = RobotFolder("lab", "r1")
    other.make()
    assert other.lock()
    assert not keeper.look() and not folder.is_there() and other.is_there()
    assert "was deleted, and another process has claimed the robot" in said[0]
    other.unlock()
