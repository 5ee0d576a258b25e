"""The paper's experiment with false echoes, in which only the consistency rule reaches the goal."""

from concurrent.futures import ProcessPoolExecutor

import pytest
from navloom.config import load_config
from navloom.runs.episode import run_episode


def drive(seed, crosstalk, consistency):
    """Whether the goal was truly reached, the number of contacts, and the duration, s."""
    told = run_episode(
        load_config(
            "paper", [f"run.seed={seed}", f"sensor.1.crosstalk={crosstalk}", f"avoider.consistency={consistency}"]
        )
    ).summary()
    return bool(told["truly_reached"]), told["collisions"], told["sim_time_s"]


def test_a_drive_with_crosstalk_takes_little_longer_than_one_without():
    """Without crosstalk the drive takes 32 s; with it, the paper's grid was trapped after 109 s."""
    reached, contacts, seconds = drive(0, 0.05, 1)
    assert reached and contacts == 0
    assert seconds < 45.0


@pytest.mark.slow
@pytest.mark.parametrize(("crosstalk", "least"), [(0.05, 18), (0.1, 15)])
def test_twenty_drives_with_crosstalk(crosstalk, least):
    with ProcessPoolExecutor(2) as pool:
        endings = list(pool.map(drive, range(20), [crosstalk] * 20, [1] * 20))
    assert sum(contacts for _, contacts, _ in endings) == 0
    assert sum(reached for reached, _, _ in endings) >= least
