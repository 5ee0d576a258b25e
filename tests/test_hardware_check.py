"""`navloom check platform.X --hardware`: nothing moves unless asked, and faults of a base are found."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from dist_rig import put_on_path
from navloom_check import hardware_check

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "serial_base"
sys.path.insert(0, str(FOLDER))

from play_base import PlayedBase  # noqa: E402

Command = Callable[..., tuple[int, str, str]]


class Watched(PlayedBase):
    """A base that keeps the highest wheel speed that was commanded, m/s."""

    fastest = 0.0

    def _obey(self, now: float) -> None:
        super()._obey(now)
        self.fastest = max(self.fastest, *map(abs, self.wanted))


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Watched]:
    put_on_path(FOLDER, tmp_path / "site", monkeypatch)
    monkeypatch.setattr(hardware_check, "LISTENING", 1.0)
    monkeypatch.setattr(hardware_check, "DRIVING", 1.0)
    played = Watched(tmp_path / "base")
    yield played
    played.close()


def checked(in_process: Command, base: PlayedBase, *words: str) -> tuple[int, dict[str, Any]]:
    """Exit code, and result by check."""
    config = str(FOLDER / "serial_base.toml")
    port = ("--set", f'port="{base.port}"')
    code, said, errors = in_process("check", "platform.serial_base", "--hardware", config, *port, *words, "--json")
    assert said, errors
    return code, {result["check"]: result for result in json.loads(said)["results"]}


def test_nothing_moves_unless_it_is_asked_for(base: Watched, in_process: Command) -> None:
    code, found = checked(in_process, base)
    assert code == 0 and base.fastest == 0.0
    assert {name for name, one in found.items() if one["outcome"] == "passed"} == {
        "reports", "timely", "fresh", "stands", "sensors", "closes"
    }  # fmt: skip
    assert found["drives"]["reason"] == "it would move the robot: add --drive"


def test_a_drive_is_short_slow_and_ends(base: Watched, in_process: Command) -> None:
    code, found = checked(in_process, base, "--drive")
    assert code == 0, [one["findings"] for one in found.values()]
    assert 0.09 < base.fastest < 0.11 and base.wanted == (0.0, 0.0)
    assert found["drives"]["shown"][0]["text"].startswith("odometry shows ")
    assert found["stops_alone"]["outcome"] == "passed"


def test_a_mute_base_is_named_with_the_drivers_reason(base: Watched, in_process: Command) -> None:
    base.fault = "mute"
    code, found = checked(in_process, base)
    (finding,) = found["reports"]["findings"]
    assert code == 1 and "no status with a right checksum" in finding["problem"]


def test_another_platform_than_the_configs_and_a_simulated_one_are_refused(in_process: Command) -> None:
    code, _, errors = in_process("check", "platform.sensors_sim", "--hardware", "paper")
    assert code == 2 and "is simulated and has no hardware" in errors
    code, _, errors = in_process("check", "platform.sensors_sim", "--drive")
    assert code == 2 and "--drive: moves real hardware, so it needs --hardware CONFIG" in errors
