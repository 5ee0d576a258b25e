"""Speed as a ratio within one run: the fused pass compared with the plain numpy pipeline."""

from __future__ import annotations

import timeit

import numpy as np
import pytest
from navloom_ipabd.pressure import press, warm_up
from navloom_ipabd.pressure_numpy import press_numpy
from navloom_ipabd.rules import Filters


@pytest.mark.benchmark
def test_the_fused_pass_is_ten_times_as_fast_as_numpy(paper_sweep, benchmark) -> None:
    warm_up()
    image, filters = paper_sweep.image, Filters()
    benchmark(press, image, filters)
    fused = min(timeit.repeat(lambda: press(image, filters), number=200, repeat=9)) / 200
    plain = min(timeit.repeat(lambda: press_numpy(image, filters), number=10, repeat=9)) / 10
    benchmark.extra_info["numpy_over_fused"] = plain / fused
    assert np.isfinite(press(image, filters).ranges).all()
    assert plain / fused >= 10.0
