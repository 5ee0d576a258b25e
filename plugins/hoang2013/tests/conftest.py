"""What the tests of the reproduction share."""

from __future__ import annotations

import pytest
from navloom_hoang2013 import reproduction
from navloom_hoang2013.plates import Reproduction


@pytest.fixture(scope="session")
def made() -> Reproduction:
    """Results of everything that the command runs without options, computed once."""
    return reproduction.reproduce()
