"""The paper's experiment (DECISIONS section 8): what rays hit, what is mapped, and what the printed order loses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from navloom_ipabd.lines import distances_to_segments
from navloom_ipabd.mapping import MapSettings, draw, outline
from navloom_ipabd.pressure import press
from navloom_ipabd.rules import Filters, Rule
from navloom_ipabd.track import standing

AT_S = (0.0, 0.0, np.pi / 2)
IN_A = np.column_stack([np.linspace(-1.3, 0.9, 12), np.full(12, 5.2)])
IN_B = np.column_stack([np.linspace(1.6, 3.6, 12), np.full(12, 5.2)])


def mapped(sweep, **changes):
    settings = dataclasses.replace(MapSettings(), **changes)
    shown = outline(sweep.image, standing(94, AT_S), settings)
    return shown, draw(shown, settings)


@pytest.mark.parametrize(("name", "rays"), [("girder A", 230), ("girder B", 177), ("floor", 772), ("none", 1801)])
def test_rays_of_the_noise_free_sweep(paper_sweep, name: str, rays: int) -> None:
    assert paper_sweep.image.ranges.size == 9494
    assert paper_sweep.count(name) == rays


def test_the_printed_order_maps_no_column(paper_sweep) -> None:
    barriers = press(paper_sweep.image, Filters(order="paper"))
    assert barriers.counts[Rule.KEPT] == 0
    assert barriers.counts[Rule.FLOOR] == 101
    assert sum(barriers.counts.values()) == 9494


def test_filtering_first_maps_every_column(paper_sweep) -> None:
    barriers = press(paper_sweep.image, Filters())
    assert barriers.counts[Rule.KEPT] == 101
    assert barriers.counts[Rule.NO_RETURN] == 1801
    assert sum(barriers.counts.values()) == 9494


def test_girder_a_is_mapped_and_girder_b_is_not(paper_sweep) -> None:
    shown, _ = mapped(paper_sweep)
    assert distances_to_segments(IN_A, shown.segments).max() < 0.02
    assert distances_to_segments(IN_B, shown.segments).min() > 0.15


def test_a_taller_robot_maps_girder_b_too(paper_sweep) -> None:
    shown, _ = mapped(paper_sweep, filters=Filters(z_limit=1.5))
    assert distances_to_segments(IN_B, shown.segments).max() < 0.02


def test_cells_of_both_gates(paper_sweep) -> None:
    _, grid = mapped(paper_sweep)
    column = {x: round(x / 0.4) - grid.lattice.column for x in (-0.4, 0.0, 2.4, 2.8)}
    row = 13 - grid.lattice.row  # y = 5.2
    assert [grid.cells[row, column[x]] for x in (-0.4, 0.0)] == [100, 100]
    assert [grid.cells[row, column[x]] for x in (2.4, 2.8)] == [0, 0]


def test_cells_behind_girder_a_are_unknown(paper_sweep) -> None:
    _, grid = mapped(paper_sweep)
    row, column = 17 - grid.lattice.row, -grid.lattice.column  # (0, 6.8)
    assert grid.cells[row, column] == -1


def test_noise_of_1_cm_leaves_the_gates_as_they_are(make_sweep) -> None:
    noisy = make_sweep(sigma=0.01, rng=np.random.default_rng(11))
    shown, _ = mapped(noisy)
    assert distances_to_segments(IN_A, shown.segments).max() < 0.06
    assert distances_to_segments(IN_B, shown.segments).min() > 0.15
    assert len(shown.segments) < 15


def test_without_girder_a_its_gate_is_open(make_sweep, paper_boxes) -> None:
    paper_boxes.pop("girder A")
    shown, grid = mapped(make_sweep(paper_boxes))
    assert distances_to_segments(IN_A[2:-2], shown.segments).min() > 0.15
    assert grid.cells[13 - grid.lattice.row, -grid.lattice.column] == 0


def test_a_sweep_by_rigid_pitch_is_mapped_alike(make_sweep) -> None:
    shown, _ = mapped(make_sweep(geometry="rigid_pitch"))
    assert distances_to_segments(IN_A, shown.segments).max() < 0.02
    assert distances_to_segments(IN_B, shown.segments).min() > 0.15
