"""Draws `run.png` at the end of a run, into the folder of `--out`. Every run imports this module: keep it light."""

from __future__ import annotations

from typing import Any

from navloom.plugins.hooks import hookimpl

__all__ = ["navloom_run_finished"]


@hookimpl
def navloom_run_finished(episode: Any, out: Any) -> None:
    """Draw the run."""
    if episode is None or out is None or out.folder is None:
        return
    from navloom_study.report.plotting import png_of
    from navloom_study.report.run_picture import draw_run

    out.write({"run.png": png_of(draw_run(episode))})
