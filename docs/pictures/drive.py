"""Draw docs/pictures/drive.png and drive.webp: `uv run python docs/pictures/drive.py`.

Both show the run of `navloom run paper`. The still is the README's picture: plan and track, who drove each part, and
when. The loop is the front page's.
"""

from __future__ import annotations

import io
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from navloom.config import load_config
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners
from navloom.geometry.world import Box
from navloom.runs.episode import Episode, run_episode
from numpy.typing import ArrayLike
from PIL import Image

INK, PAPER, GROUND = "#16262e", "#ffffff", "#eef2f3"
WHO = {"controller": "#0b6e6e", "avoider": "#e4572e"}
"""The site's two colours, by the role that drives."""
MAPPED = ListedColormap([PAPER, "#9fb0b6"])
"""Free and occupied cells of the robot's map."""
LABELS = {
    (0.0, 0.7): "start",
    (7.6, 0.75): "goal",
    (6.4, 1.2): "gate A:\ntoo low",
    (6.2, -3.2): "gate B",
    (2.6, -0.45): "not on\nthe map",
    (3.9, -2.75): "plan",
    (0.3, -3.2): "not seen",
}
"""Where words stand in the picture, m."""
AHEAD, LEFT = (-0.8, 9.0), (-4.5, 2.6)
"""m: what is shown of the room, along y of the map frame and along -x, which point right and up."""
SIZE, DOTS = (8.0, 6.5), 100
"""Inches, and dots per inch of the loop; the still has twice as many."""
FRAMES, STEP = 60, 80
"""Frames of the loop, and ms between them; the last one stays for `REST`."""
REST = 2500


def main() -> None:
    """Run the paper's experiment, and draw it."""
    episode = run_episode(load_config("paper"))
    here = Path(__file__).parent
    truth = np.array(episode.recorder.truth)
    whole = draw(episode, truth, len(truth) - 1, 2 * DOTS)
    whole.quantize(96).save(here / "drive.png", optimize=True)
    frames = [
        draw(episode, truth, int(row), DOTS).quantize(32, dither=Image.Dither.NONE).convert("RGB")
        for row in np.linspace(0, len(truth) - 1, FRAMES)
    ]
    stays = [STEP] * (FRAMES - 1) + [REST]
    frames[0].save(
        here / "drive.webp", save_all=True, append_images=frames[1:], duration=stays, loop=0, lossless=True, method=6
    )
    for name in ("drive.png", "drive.webp"):
        print(name, (here / name).stat().st_size // 1000, "kB")


def draw(episode: Episode, truth: np.ndarray, row: int, dots: int) -> Image.Image:
    """The drive up to a row of the truth."""
    with mpl.rc_context({"font.size": 16, "text.color": INK, "axes.linewidth": 0}):
        figure = Figure(SIZE, dpi=dots, facecolor=PAPER)
        room = figure.add_axes((0.0, 0.13, 1.0, 0.87))
        draw_room(room, episode)
        draw_track(room, episode, truth, row)
        draw_times(figure.add_axes((0.04, 0.02, 0.92, 0.09)), episode, truth, row)
        buffer = io.BytesIO()
        figure.savefig(buffer, dpi=dots)
    return Image.open(buffer).convert("RGB")


def turned(points: ArrayLike) -> np.ndarray:
    """Points of the map frame, (n, 2) m, as drawn: y points right and x down, so that the picture is a wide one."""
    x, y = np.asarray(points, dtype=float).T
    return np.column_stack([y, -x])


def draw_room(room: Axes, episode: Episode) -> None:
    """What stands in the world, what the robot mapped, and its plan."""
    room.set(xlim=AHEAD, ylim=LEFT, aspect="equal", xticks=(), yticks=(), facecolor=GROUND)
    recorder, system = episode.recorder, episode.system
    assert recorder.map is not None and system.world is not None and system.goal is not None
    grid = recorder.map.grid
    rows, cols = grid.cells.shape
    x, y = grid.origin.x, grid.origin.y
    seen = np.where(grid.cells >= 50, 2.0, np.where(grid.cells >= 0, 1.0, np.nan))
    reach = (y, y + rows * grid.resolution, -x - cols * grid.resolution, -x)
    room.imshow(seen.T[::-1], cmap=MAPPED, vmin=1, vmax=2, origin="lower", extent=reach, interpolation="nearest")
    for box in system.world.obstacles:
        assert isinstance(box, Box)
        hangs, is_above = box.z[0] > 0.0, box.z[0] >= system.robot.height
        looks = (
            {"fill": False, "linestyle": "--"} if is_above else {"facecolor": PAPER, "hatch": "////"} if hangs else {}
        )
        room.add_patch(Polygon(turned(box_corners(box)), edgecolor=INK, linewidth=1.2, **({"facecolor": INK} | looks)))
    for path in recorder.plans:
        room.plot(*turned(path.points).T, color="#7a8b91", linewidth=2.5, linestyle=(0, (1, 1.5)))
    (goal,) = turned([(system.goal.x, system.goal.y)])
    room.add_patch(Circle(goal, system.goal_tolerance, fill=False, edgecolor=INK, linewidth=2))
    for place, words in LABELS.items():
        room.text(*place, words, ha="center", va="center")


def stretches(episode: Episode, end: float) -> list[tuple[float, float, str]]:
    """Who drove from when until when, s."""
    changes = [(since, who) for since, who in episode.recorder.drivers if since < end]
    return [(since, until, who) for (since, who), (until, _) in pairwise([*changes, (end, "")])]


def draw_track(room: Axes, episode: Episode, truth: np.ndarray, row: int) -> None:
    """The track so far, in the colours of its drivers, and the robot."""
    for since, until, who in stretches(episode, truth[row, 0]):
        part = truth[(truth[:, 0] >= since) & (truth[:, 0] <= until)]
        room.plot(*turned(part[:, 1:3]).T, color=WHO.get(who, INK), linewidth=5, solid_capstyle="round")
    outline = transform(truth[row, 1:4], episode.system.robot.footprint)
    room.add_patch(Polygon(turned(outline), facecolor="#ffd166", edgecolor=INK, linewidth=1.5, zorder=5))
    nose = transform(truth[row, 1:4], np.array([(0.0, 0.0), (0.4, 0.0)]))
    room.plot(*turned(nose).T, color=INK, linewidth=2, zorder=6)


def draw_times(bar: Axes, episode: Episode, truth: np.ndarray, row: int) -> None:
    """A bar of time: who drove, and when."""
    end = truth[-1, 0]
    bar.set(xlim=(0, end), ylim=(-1.1, 1.0), xticks=(), yticks=(), facecolor=PAPER)
    bar.add_patch(Rectangle((0, 0), end, 1, color=GROUND))
    for since, until, who in stretches(episode, truth[row, 0]):
        bar.add_patch(Rectangle((since, 0), until - since, 1, color=WHO.get(who, INK)))
        if until - since > 4.0:
            bar.text((since + until) / 2, 0.47, who, color=PAPER, ha="center", va="center", weight="bold")
        bar.text(since, -0.2, f"{since:.1f} s", ha="left", va="top")
    if row == len(truth) - 1:
        bar.text(end, -0.2, f"{end:.1f} s", ha="right", va="top")


if __name__ == "__main__":
    main()
