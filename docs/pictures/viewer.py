"""Take docs/pictures/viewer.png, without a screen: `uv run --group view python docs/pictures/viewer.py run.rrd`.

The file is that of `navloom run paper --rerun run.rrd`. A software Vulkan driver is enough (docs/viewing.md).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from navloom_viewer.program import Program
from PIL import Image
from rerun.experimental import ViewerClient

AT = 12.0
"""s of run time: the robot passes the obstacle."""
SHOWN = (0, 37, 1600, 1000)
"""Pixels that are kept: all but the bar that says on what machine it was drawn."""
SIZE = (1120, 674)
SETTLED = 25.0
"""s for a viewer without a graphics card to draw all of it."""


def main() -> None:
    """Open the file, go to the moment, and keep the picture with few colours."""
    picture = Path(__file__).with_suffix(".png").resolve()
    program = Program(options=("--headless", "--window-size", "1600x1000"))
    try:
        client = ViewerClient.connect(program.url)
        client.open(str(Path(sys.argv[1]).resolve()))
        client.set_time("run_time", duration=AT, play_state="paused")
        time.sleep(SETTLED)
        client.save_screenshot(str(picture))
    finally:
        program.end()
    with Image.open(picture) as found:
        small = found.convert("RGB").crop(SHOWN).resize(SIZE, Image.Resampling.LANCZOS)
    small.quantize(128).save(picture, optimize=True)


if __name__ == "__main__":
    main()
