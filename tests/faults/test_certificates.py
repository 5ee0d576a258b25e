"""Certificates change while the robot drives: nothing restarts, the goal is kept, and a revoked client can do nothing.

`certificate_campaign.py` measures whether it stops for a moment; here other tests share the processors.
"""

from __future__ import annotations

import pytest
from certificate_campaign import KINDS, certificates


@pytest.mark.slow
def test_a_driving_robot_takes_new_certificates_and_rules_without_a_restart() -> None:
    with certificates() as running:
        for kind in ("renew all", "replace nodes", "revoke an operator"):
            assert kind in KINDS
            outcome = running.change(kind)
            assert outcome.restarts == 0 and not outcome.touched, (kind, outcome)
            assert outcome.locked_out is None or outcome.locked_out < 20.0, outcome
        notes = [note for note in running.robot.driver.notes if note.kind in ("result", "error")]
        assert notes == []
        assert running.robot.reach_a_goal() == "succeeded: the goal was reached"
