"""Reports of a study: one self-contained HTML page, and the same tables as Markdown and CSV.

Begin with `study_report.py`; `study_files.py` reads and checks the folder that `navloom compare` wrote.
`report_tables.py`, `figures.py`, `track_figures.py` and `open_loop_figures.py` make its parts, `html_page.py` the page.
`run_picture.py` draws `run.png`, maps and poses, with `plan_view.py` as `track_figures.py` does.
`plotting.py` gives matplotlib without a display or global state, with reproducible bytes. It takes half a second to
import: import what draws only where something is drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom.palette import GREY as GREY
    from navloom.palette import OKABE_ITO as OKABE_ITO

    from navloom_study.report.html_page import Section as Section
    from navloom_study.report.html_page import code as code
    from navloom_study.report.html_page import figure as figure
    from navloom_study.report.html_page import heading as heading
    from navloom_study.report.html_page import listing as listing
    from navloom_study.report.html_page import page as page
    from navloom_study.report.html_page import paragraph as paragraph
    from navloom_study.report.html_page import table as table
    from navloom_study.report.plan_view import draw_cells as draw_cells
    from navloom_study.report.plan_view import draw_footprints as draw_footprints
    from navloom_study.report.plan_view import draw_outlines as draw_outlines
    from navloom_study.report.plan_view import outline_of as outline_of
    from navloom_study.report.plotting import MM as MM
    from navloom_study.report.plotting import new_figure as new_figure
    from navloom_study.report.plotting import png_of as png_of
    from navloom_study.report.plotting import styled as styled
    from navloom_study.report.plotting import svg_of as svg_of
else:
    __all__, __getattr__ = lazy_names(
        "navloom_study.report",
        {
            "navloom.palette": "GREY OKABE_ITO",
            "navloom_study.report.html_page": "Section code figure heading listing page paragraph table",
            "navloom_study.report.plan_view": "draw_cells draw_footprints draw_outlines outline_of",
            "navloom_study.report.plotting": "MM new_figure png_of styled svg_of",
        },
    )
