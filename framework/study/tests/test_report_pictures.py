"""The pictures of a report: what they show of a world, that they fill the page, and the gallery of failures."""

from __future__ import annotations

import re

import numpy as np
import pytest
from navloom.geometry.world import Box, Place, Raster, World
from navloom_study import Trail
from navloom_study.report import html_page
from navloom_study.report.extent import extent_of
from navloom_study.report.study_files import StudyFiles, read_study
from navloom_study.report.study_report import build_report
from navloom_study.report.track_figures import ways_figures, ways_in
from study_rig import straight, study_folder

ALONG = np.array([(0.0, 0.0), (0.0, 8.0)])
EVERYWHERE = (-50.0, -50.0, 50.0, 50.0)


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> StudyFiles:
    """`good` always arrives, `bad` is stuck in one world and times out in the other."""

    def trail_of(method: str, world: str, seed: int) -> Trail:
        if method == "good":
            return straight("succeeded")
        return straight("stuck" if world == "a" else "timeout", 10, 0.2)

    return read_study(
        study_folder(tmp_path_factory.mktemp("mixed") / "s", ("good", "bad"), ("a", "b"), (0, 1), trail_of)
    )


@pytest.mark.parametrize("wall", [1.0, 2.5, 5.5])
def test_the_walls_of_a_corridor_are_shown(wall: float) -> None:
    walls = tuple(Box(f"w{side}", tuple(sorted((side * wall, side * (wall + 0.2)))), (-30.0, 30.0)) for side in (-1, 1))
    x0, y0, x1, y1 = extent_of(ALONG, World("corridor", walls, bounds=EVERYWHERE), 1.5)
    assert x0 <= -wall - 0.2 and x1 >= wall + 0.2
    # 6 m and 0.3 m beyond the ends of the track, not the whole wall of 60 m.
    assert (y0, y1) == pytest.approx((-6.3, 14.3))


def test_what_is_far_away_does_not_shrink_the_tracks() -> None:
    far = Box("far", (20.0, 21.0), (0.0, 1.0))
    assert extent_of(ALONG, World("hall", (far,), bounds=EVERYWHERE), 1.5) == (-1.5, -1.5, 1.5, 9.5)


def test_without_a_world_the_extent_is_that_of_the_tracks() -> None:
    assert extent_of(ALONG, None, 1.5) == (-1.5, -1.5, 1.5, 9.5)


def test_a_study_has_one_larger_picture_of_all_methods_and_one_of_each(mixed: StudyFiles) -> None:
    sizes = [figure.get_size_inches()[0] for figure in ways_figures(mixed, ways_in(mixed, "a"))]
    assert len(sizes) == 3 and sizes[0] > sizes[1] == sizes[2]


def test_tracks_of_several_methods_on_one_line_have_different_widths(mixed: StudyFiles) -> None:
    overlay = ways_figures(mixed, ways_in(mixed, "a"))[0]
    widths = {line.get_color(): line.get_linewidth() for line in overlay.axes[0].lines if len(line.get_xdata()) > 1}
    widths.pop("white")
    assert len(set(widths.values())) == 2 and max(widths.values()) >= 2.0 * min(widths.values())


def test_every_failure_kind_is_in_the_gallery_with_its_command(mixed: StudyFiles) -> None:
    report = build_report(mixed)
    page = report.html
    gallery = page[page.index(">Failures</h2>") : page.index(">Worst worlds</h2>")]
    for world, outcome in (("a", "stuck"), ("b", "timeout")):
        assert f"bad, {world}, seed 0: {outcome}, because {outcome}" in gallery
        assert html_page.code(mixed.command("bad", world, 0)) in gallery
        assert f"`{mixed.command('bad', world, 0)}`" in report.markdown
    assert gallery.count("<svg") == 2 and "good, " not in gallery


def test_the_first_words_of_a_report_say_who_is_better(mixed: StudyFiles) -> None:
    page = build_report(mixed).html
    summary = page[page.index(">Summary</h2>") : page.index(">Outcomes</h2>")]
    # 4 pairs that all differ: 2 / 2^4.
    assert re.findall(r"<p[^>]*>", summary)[0] == '<p class="verdict">'
    assert "no p below 0.125 is attainable" in summary


def test_what_differs_is_folded(mixed: StudyFiles) -> None:
    assert "<details><summary>Differs (1 settings)</summary>" in build_report(mixed).html


def test_a_picture_is_scaled_no_further_than_its_texts_are_legible() -> None:
    def svg(width: float) -> str:
        return f'<svg width="{width}pt" height="9pt"></svg>'

    # Text of 8 points at 0.8 of its size is 8.5 pixels high.
    assert "min-width:193pt" in html_page.figure(svg(241.0), "Narrow.")
    assert "min-width:408pt" in html_page.figure(svg(510.0), "Wide.")
    assert html_page.panels([(svg(241.0), "")] * 3, "Three.").count('class="panel"') == 3


def test_a_raster_counts_with_its_occupied_cells() -> None:
    occupied = np.zeros((10, 100), dtype=np.bool_)
    occupied[:, 45] = True
    # The cells of column 45 reach from 4.5 m to 4.6 m; a half turn puts them on the other side.
    for heading, side in ((0.0, 2), (np.pi, 0)):
        raster = Raster("map", occupied, 0.1, Place(0.0, 0.0, heading))
        world = World("map", (), raster, bounds=EVERYWHERE)
        assert abs(extent_of(ALONG, world, 1.5)[side]) == pytest.approx(4.9)
