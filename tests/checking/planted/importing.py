"""A plugin whose module reads the environment when it is imported; alone, since a module is imported once."""

from __future__ import annotations

import os

from navloom import Avoidance, AvoiderInput

from planted import Entries
from planted.sound import Gap

ENTRIES = Entries()
IS_BLIND = os.environ.get("GAP_BLIND", "") == "1"


@ENTRIES.plant("blind_by_environment", caught_by="environment")
class BlindByEnvironment(Gap):
    """Drives as told if a variable says so."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(given.desired, "clear") if IS_BLIND else super().avoid(given)
