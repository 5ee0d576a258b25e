"""Two robots in two realms on one host: each obeys only its own commands."""

from __future__ import annotations

from pathlib import Path

import pytest
from live_rig import Up, runtime_folder
from motor_log import install
from motor_words import MotorWords

CONFIG = """
[robot]
realm = "{realm}"

[world]
ref = "empty"

[platform]
plugin = "motor_log"
motor_log = "{log}"

[[sensor]]
name = "sonars"
kind = "sonar_ring"

[mapper]
plugin = "known_map"

[navigation]
drive = false
start = {{ x = 0.0, y = 0.0 }}
"""
REALMS = ("north", "south")


@pytest.mark.slow
def test_two_robots_reach_their_goals_and_neither_obeys_the_others_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", install(tmp_path / "plugins"))
    logs = {realm: MotorWords(tmp_path / f"{realm}.log") for realm in REALMS}
    with runtime_folder() as folder:
        robots: dict[str, Up] = {}
        try:
            for realm in REALMS:
                config = tmp_path / f"{realm}.toml"
                config.write_text(CONFIG.format(realm=realm, log=tmp_path / f"{realm}.log"), "utf-8")
                robots[realm] = Up(folder, [str(config)])
            for robot in robots.values():
                robot.wait_for("every node is there")

            alone = robots["north"].run("goal", "1.0", "0.0", "--robot", "north/r1", timeout=90)
            assert alone.returncode == 0, alone.stdout + alone.stderr
            assert max(speed for _, speed, _ in logs["north"].look().words) > 0.15
            assert not any(speed or turn for _, speed, turn in logs["south"].look().words)

            unnamed = robots["north"].run("goal", "1.0", "1.0")
            assert unnamed.returncode == 2 and "several robots are up: north/r1, south/r1" in unnamed.stderr

            # both at once, to opposite places
            said = {realm: len(robot.said) for realm, robot in robots.items()}
            for realm, x in (("north", "2.5"), ("south", "-1.5")):
                accepted = robots[realm].run("goal", x, "0.0", "--no-wait", "--robot", f"{realm}/r1")
                assert accepted.returncode == 0, accepted.stderr
            for realm, goal in (("north", 2.5), ("south", -1.5)):
                robots[realm].wait_for("goal reached", 60, robots[realm].wait_for("driving", 60, said[realm]))
                place = logs[realm].look().place
                assert abs(place[0] - goal) < 0.25 and abs(place[1]) < 0.25, (realm, place)
        finally:
            codes = [robot.end() for robot in robots.values()]
        assert codes == [0, 0]
