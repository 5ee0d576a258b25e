"""Robots that start beside a mapped wall without room to turn: they touch nothing, drive out, and arrive."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from navloom.config import load_config
from navloom.runs.episode import run_episode

BODIES = {
    "0.5 x 0.5": ("{length=0.5, width=0.5}", 0.25),
    "0.7 x 0.5": ("{length=0.7, width=0.5}", 0.25),
    "1.2 x 0.4": ("{length=1.2, width=0.4}", 0.2),
    "Jackal": ("{length=0.508, width=0.43}", 0.215),
    "0.7 m tail": ("{polygon=[[0.25, 0.25], [-0.7, 0.25], [-0.7, -0.25], [0.25, -0.25]]}", 0.25),
}
"""Footprint, and half its width, m, by name."""
GAPS = (0.02, 0.05, 0.1, 0.2, 0.45)
GOALS = {"ahead": (3.0, 0.55), "behind": (0.9, 0.55), "across": (1.8, 4.0)}
LASERS = (270, 360)
AVOIDERS = ("dwa", "improved_vfh", "improved_vfh@printed", "vfh_plus", "vfh_plus@printed", "vfh_star",
            "vfh_star@printed", "vfh_swept")  # fmt: skip
"""Those that claim to spare the footprint, with their presets."""


@dataclass(frozen=True)
class End:
    """How a drive ended: outcome, number of contacts, and the result's reason and place."""

    outcome: str
    contacts: int
    reason: str


def room(folder: Path) -> Path:
    """A room of 8 x 5 m, walls included, with a wall up to 3.5 m in its middle, as a map of 5 cm cells."""
    picture = np.full((100, 160), 254, np.uint8)
    picture[:2], picture[-2:], picture[:, :2], picture[:, -2:] = 0, 0, 0, 0
    picture[30:, 78:82] = 0
    (folder / "room.pgm").write_bytes(b"P5\n160 100\n255\n" + picture.tobytes())
    found = folder / "room.yaml"
    found.write_text(
        "image: room.pgm\nmode: trinary\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        "utf-8",
    )
    return found


def drive(world: Path, avoider: str, body: str, gap: float, goal: str, laser: int) -> End:
    """One drive of the config `building` from beside the lower wall, whose surface is at y = 0.1 m."""
    footprint, half = BODIES[body]
    x, y = GOALS[goal]
    overrides = [
        f"world.ref=rosmap:{world}",
        f"robot.footprint={footprint}",
        f"avoider.plugin={avoider}",
        f"navigation.start={{x=1.8, y={0.1 + half + gap}, heading_deg=0}}",
        f"navigation.goal={{x={x}, y={y}}}",
        f"sensor.0.field_of_view_deg={min(laser, 359)}",
        f"sensor.0.beams={laser + laser % 360 // 270}",
        "run.stop_after=300.0",
    ]
    episode = run_episode(load_config("building", overrides, seed=1))
    return End(episode.result.outcome, episode.recorder.touches, episode.result.reason)


def test_a_long_robot_behind_whose_laser_is_a_mapped_wall_drives_out_and_arrives(tmp_path: Path) -> None:
    """Before the map limited its turn, the rear corner hit the wall after 0.55 s."""
    assert drive(room(tmp_path), "dwa", "1.2 x 0.4", 0.1, "across", 270) == End("succeeded", 0, "the goal was reached")


@pytest.mark.slow
@pytest.mark.parametrize("avoider", AVOIDERS)
def test_no_body_touches_a_wall_that_it_turns_beside(avoider: str, tmp_path: Path) -> None:
    """From 5 cm up all arrive; at 2 cm the gate's margin of 1 cm and the noise of the laser hold some."""
    world, arrived, contacts, others = room(tmp_path), dict[tuple[str, float], int](), 0, list[str]()
    for body, gap, goal, laser in product(BODIES, GAPS, GOALS, LASERS):
        end = drive(world, avoider, body, gap, goal, laser)
        arrived[body, gap] = arrived.get((body, gap), 0) + (end.outcome == "succeeded")
        contacts += end.contacts
        if end.outcome != "succeeded":
            others.append(f"{body}, {gap:g} m, {goal}, {laser} degrees: {end.outcome}: {end.reason}")
    print(f"\n{avoider}: arrived of {len(GOALS) * len(LASERS)} by gap, m; contacts: {contacts}")
    print(" " * 12 + "".join(f"{gap:>6g}" for gap in GAPS))
    for body in BODIES:
        print(f"{body:12s}" + "".join(f"{arrived[body, gap]:>6d}" for gap in GAPS))
    print("\n".join(others))
    assert contacts == 0
    assert all(count == len(GOALS) * len(LASERS) for (_, gap), count in arrived.items() if gap >= 0.05)
