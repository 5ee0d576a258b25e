"""The default recovery: stay stopped for a while so that moving obstacles can leave, then plan on a fresh map."""

from __future__ import annotations

from pydantic import Field

from navloom.messages import RecoveryStep, Twist2D
from navloom.plugins.hooks import hookimpl
from navloom.plugins.registry import Registry
from navloom.roles import Context, Params, Recovery, RecoveryInput

__all__ = ["WaitAndReplan"]


class WaitParams(Params):
    """How long to wait."""

    wait: float = Field(2.0, ge=0.0, le=600.0, description="how long the robot stays stopped, s")
    clear_map: bool = Field(True, description="clear the map afterwards, and request a sweep if the mapper needs one")


class WaitAndReplan(Recovery[WaitParams]):
    """Stays stopped: a robot without sensors at the back would drive blind if it backed up."""

    name = "wait_and_replan"
    accepts = ()

    def __init__(self, params: WaitParams, context: Context) -> None:
        super().__init__(params, context)
        self._until_ns = 0

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        # One object serves all attempts of a run.
        if given.starts:
            self._until_ns = given.stamp_ns + round(self.params.wait * 1e9)
        is_over = given.stamp_ns >= self._until_ns
        # The map is cleared at the end only: what left meanwhile must not be marked again.
        return RecoveryStep(Twist2D(0.0, 0.0, 0.0), "done" if is_over else "running", is_over and self.params.clear_map)


# In the core, although only an entry point refers to it: it is the recovery that a robot has without any further
# distribution.
@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the recovery."""
    registry.add(WaitAndReplan)
