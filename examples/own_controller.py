"""A plugin in one file, without packaging: a controller that steers by bearing, run with the shipped config `building`.

    python examples/own_controller.py

An installed distribution has an entry point that names its module. Here the script creates that entry point itself and
passes it to the run together with the installed ones. `examples/turtle` is the packaged form.
"""

import math
import sys
from importlib.metadata import EntryPoint, entry_points

from navloom import Controller, ControllerInput, Params, Registry, TrackingCommand, Twist2D, hookimpl
from navloom.config import load_config
from navloom.plugins import Discovery
from navloom.runs import run_episode
from pydantic import Field


class BearingParams(Params):
    """Parameters in the table [controller] of a config."""

    gain: float = Field(1.5, gt=0.0, le=10.0, description="Turn rate per heading error, 1/s.")
    reach: float = Field(0.5, gt=0.0, le=5.0, description="Length over which it steers back to the reference, m.")


class Bearing(Controller[BearingParams]):
    """Steers to a point `reach` ahead on the reference, and slows down while it points elsewhere."""

    name = "bearing"
    accepts = ()  # needs no sensor

    def control(self, given: ControllerInput) -> TrackingCommand:
        """One command per tick, from the pose estimate and the reference."""
        pose, reference = given.estimate.pose, given.reference
        if reference.turn_to is not None:  # at the goal position: only the heading remains
            error = math.remainder(reference.turn_to - pose.heading, math.tau)
            return TrackingCommand(Twist2D(0.0, 0.0, self.params.gain * error), 0.0, 0.0, error)
        back = math.atan2(reference.cross_track, self.params.reach)
        error = math.remainder(reference.pose.heading - back - pose.heading, math.tau)
        speed = reference.speed * max(0.2, math.cos(error))
        turn = reference.turn_rate + self.params.gain * error
        return TrackingCommand(Twist2D(speed, 0.0, turn), 0.0, -reference.cross_track, error)


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the controller; navloom calls this hook through the entry point."""
    registry.add(Bearing)


def main() -> int:
    """Drive once with this controller and once with the config's own."""
    own = EntryPoint("controller.bearing", __name__, "navloom")
    discovery = Discovery(found=[*entry_points(group="navloom"), own])
    reached = True
    for plugin in ("bearing", "lyapunov_tracker"):
        loaded = load_config("building", [f"controller.plugin={plugin}"])
        result = run_episode(loaded, discovery=discovery).summary()
        reached = reached and result["truly_reached"]
        print(
            f"{plugin}: {result['outcome']} after {result['sim_time_s']:.1f} s and {result['path_length_m']:.2f} m, "
            f"at most {result['cross_track_max_m']:.2f} m beside its trajectory"
        )
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
