"""Worlds, robots and time for the tests of the simulated robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from navloom import (
    Box,
    Context,
    Cylinder,
    Disturbance,
    Place,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    RobotSpec,
    SensorSpec,
    SweepRequest,
    Twist2D,
    World,
)
from navloom.geometry.moving_world import MovingWorld, moves, standing
from navloom_sensors_sim.adapter import SensorsSim
from navloom_sensors_sim.casting import Obstacles
from navloom_sensors_sim.scene import Scene

TICK_NS = 50_000_000
ORIGIN = Place(0.0, 0.0)
FOOTPRINT = np.array([[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]])
PAPER_GATES = (
    Box("back wall", (-4.6, 7.2), (9.2, 9.4)),
    Box("left wall", (-4.4, -4.2), (-1.0, 9.4)),
    Box("right wall", (6.8, 7.0), (-1.0, 9.4)),
    Box("gate wall left", (-4.4, -1.4), (5.2, 5.4)),
    Box("girder A", (-1.4, 1.0), (5.2, 5.4), (0.90, 1.10)),
    Box("post A/B", (1.0, 1.4), (5.2, 5.4)),
    Box("girder B", (1.4, 3.8), (5.2, 5.4), (1.40, 1.60)),
    Box("partition", (3.8, 4.2), (5.2, 6.8)),
)


class Bench:
    """A platform with its clock: each call of `step` is one tick of 50 ms."""

    def __init__(
        self,
        params: dict[str, Any],
        sensors: tuple[SensorSpec, ...],
        world: World | None,
        start: Place,
        seed: int,
        disturbances: tuple[Disturbance, ...] = (),
    ):
        footprint = FOOTPRINT.copy()
        footprint.flags.writeable = False  # as the framework provides it
        spec = RobotSpec(footprint, 1.2, 0.05, 0.3, 0.5, math.radians(25.0), 0.5, 1.0)
        self.streams: dict[str, np.random.Generator] = {}
        pose = Pose2D(start.x, start.y, start.heading)
        there = standing(world)
        context = Context(
            "main", 0.05, spec, lambda name: self._stream(seed, name), pose, sensors, there, disturbances=disturbances
        )
        self.moving = MovingWorld(world, (), 0.05) if moves(world) else None
        self.platform = SensorsSim(SensorsSim.Params(**params), context)
        self.ticks = 0
        self.first = self._advance(Twist2D(0.0, 0.0, 0.0), None)

    def _stream(self, seed: int, name: str) -> np.random.Generator:
        """The random stream of a name; the same name continues the same stream, as in the framework."""
        return self.streams.setdefault(name, np.random.default_rng([seed, *name.encode()]))

    def step(self, vx: float = 0.0, wz: float = 0.0, request: int = 0, count: int = 1) -> PlatformOutput:
        """`count` ticks with one command; the request goes with the first of them."""
        for k in range(count):
            self.ticks += 1
            asked = SweepRequest(request) if request and k == 0 else None
            out = self._advance(Twist2D(vx, 0.0, wz), asked)
        return out

    def _advance(self, twist: Twist2D, asked: SweepRequest | None) -> PlatformOutput:
        time_ns = self.ticks * TICK_NS
        bodies = None if self.moving is None else self.moving.advance(time_ns, ())
        return self.platform.advance(PlatformInput(twist, asked, time_ns, bodies))


@pytest.fixture(scope="session")
def bench() -> Callable[..., Bench]:
    """Makes a bench: parameters, sensors as (name, kind, settings), obstacles, raster, start, seed."""

    def make(
        params: dict[str, Any] | None = None,
        sensors: tuple[tuple[str, str, dict[str, Any]], ...] = (),
        obstacles: tuple[Any, ...] = (),
        raster: Any = None,
        start: Place = ORIGIN,
        seed: int = 1,
        disturbances: tuple[Disturbance, ...] = (),
    ) -> Bench:
        world = World("test", obstacles, raster)
        return Bench(params or {}, tuple(SensorSpec(*sensor) for sensor in sensors), world, start, seed, disturbances)

    return make


@pytest.fixture(scope="session")
def paper_gates() -> tuple[Box, ...]:
    """The boxes of the paper's experiment."""
    return PAPER_GATES


@pytest.fixture(scope="session")
def footprint() -> np.ndarray:
    """(4, 2) the paper's robot, 0.8 m square."""
    return FOOTPRINT


@pytest.fixture(scope="session")
def mujoco_world() -> Callable[..., tuple[mujoco.MjModel, mujoco.MjData, Obstacles]]:
    """Makes the same random boxes, two of three turned, and cylinders for MuJoCo and for us, 3 to 12 m away."""

    def make(rng: np.random.Generator, boxes: int, cylinders: int) -> tuple[mujoco.MjModel, mujoco.MjData, Obstacles]:
        geoms, ours = [], []
        for k in range(boxes + cylinders):
            angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(3.0, 12.0)
            x, y = away * math.cos(angle), away * math.sin(angle)
            z, yaw = float(rng.uniform(0, 1)), rng.uniform(-3, 3) if k % 3 else 0.0
            hx, hy, hz = rng.uniform(0.1, 1.0, 3).tolist()
            place = f'pos="{x!r} {y!r} {z + hz!r}" quat="{math.cos(yaw / 2)!r} 0 0 {math.sin(yaw / 2)!r}"'
            if k < boxes:
                geoms.append(f'<geom type="box" size="{hx!r} {hy!r} {hz!r}" {place}/>')
                ours.append(Box(f"b{k}", (x - hx, x + hx), (y - hy, y + hy), (z, z + 2 * hz), yaw))
            else:
                geoms.append(f'<geom type="cylinder" size="{hx!r} {hz!r}" {place}/>')
                ours.append(Cylinder(f"c{k}", x, y, hx, (z, z + 2 * hz)))
        model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(geoms)}</worldbody></mujoco>")
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        return model, data, Scene(ours, None, sweeps=False).obstacles

    return make
