"""`navloom up` compares the shadows of a live robot, and `navloom status` shows the comparison."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from live_rig import up
from navloom_live.operating.navigator import Navigator
from test_live_swaps import CONFIG

SOON = 30.0


def test_up_compares_a_shadow_by_tick_and_status_shows_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = tmp_path / "shadow.toml"
    config.write_text(CONFIG.format(speed=0.2, handover="when_blocked"), "utf-8")
    with up(str(config)) as robot:
        robot.wait_for("every node is there")
        (before,) = robot.json("status")["shadows"]
        assert (before["role"], before["instance"], before["ticks"]) == ("avoider", "forces", 0)
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", robot.environment["NAVLOOM_RUNTIME_DIR"])
        with Navigator() as navigator:
            handle = navigator.go(0.0, 2.0)
            limit = time.monotonic() + SOON
            while robot.json("status")["shadows"][0]["ticks"] < 20:
                assert time.monotonic() < limit
            line = next(line for line in robot.run("status").stdout.splitlines() if "in shadow" in line)
            assert line.startswith("in shadow, avoider forces") and "differs from improved_vfh in" in line
            navigator.swap("avoider", "forces")
            robot.wait_for("avoider: forces is active instead of improved_vfh (selection 1)")
            assert handle.wait(60).outcome == "succeeded"
        (after,) = robot.json("status")["shadows"]
        assert (after["instance"], after["against"]) == ("improved_vfh", "forces")
        assert 0.0 <= after["differing_share"] <= 1.0 and set(after["mean"]) == {"vx", "vy", "wz"}
