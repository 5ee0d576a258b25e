"""The plugins of each distribution of the project, so that a message can say what to install."""

from __future__ import annotations

__all__ = ["SHIPPED", "distribution_of", "shipped_names"]

SHIPPED = {
    "navloom-astar": (
        "planner.astar",
        "planner.dijkstra",
        "planner.jps",
    ),
    "navloom-benchmarks": ("command.bench",),
    "navloom-calibration": ("command.calibrate",),
    "navloom-carmen": ("command.import",),
    "navloom-check": ("command.check",),
    "navloom-dashboard": ("command.dashboard",),
    "navloom-dwa": ("avoider.dwa",),
    "navloom-hoang2013": ("command.paper",),
    "navloom-hybrid-astar": ("planner.hybrid_astar",),
    "navloom-improved-vfh": ("avoider.improved_vfh",),
    "navloom-ipabd": (
        "mapper.ipabd",
        "mapper.union",
    ),
    "navloom-known-map": ("mapper.known_map",),
    "navloom-live": (
        "command.cancel",
        "command.doctor",
        "command.down",
        "command.echo",
        "command.export",
        "command.goal",
        "command.hz",
        "command.keys",
        "command.list",
        "command.metrics",
        "command.node",
        "command.params",
        "command.place",
        "command.record",
        "command.relocalise",
        "command.resume",
        "command.router",
        "command.status",
        "command.stop",
        "command.swap",
        "command.teleop",
        "command.up",
    ),
    "navloom-lyapunov-tracker": ("controller.lyapunov_tracker",),
    "navloom-maps": (
        "scheme.barn",
        "scheme.crowd",
        "scheme.dynabarn",
        "scheme.fleet",
        "scheme.floor",
        "scheme.movingai",
        "scheme.people",
        "scheme.people_flow",
        "scheme.rosmap",
        "world.crowd_flow",
    ),
    "navloom-mcl": ("localizer.global_matching", "localizer.mcl"),
    "navloom-mppi": ("avoider.mppi",),
    "navloom-orca": ("avoider.orca",),
    "navloom-people-tracker": ("node.people_tracker",),
    "navloom-recording": ("command.replay",),
    "navloom-recoveries": ("recovery.look_around", "recovery.retrace"),
    "navloom-ros": (
        "command.ros",
        "mapper.ros_map",
        "planner.ros_path",
        "platform.ros2_base",
    ),
    "navloom-scan-grid": (
        "mapper.layered",
        "mapper.scan_grid",
    ),
    "navloom-scan-localizer": (
        "localizer.scan_matching",
        "localizer.scan_odometry",
    ),
    "navloom-sensors-sim": ("platform.sensors_sim",),
    "navloom-study": (
        "command.compare",
        "command.map",
        "command.report",
        "command.results",
        "observer.picture",
        "suite.barn-1",
        "suite.crowd-1",
        "suite.doors-1",
        "suite.dynamic-1",
        "suite.localise-1",
        "suite.paper-1",
        "suite.sensors-1",
        "suite.start-1",
        "suite.static-1",
    ),
    "navloom-theta-star": (
        "planner.lazy_theta_star",
        "planner.theta_star",
    ),
    "navloom-trackers": (
        "controller.fierro_lewis",
        "controller.graceful",
        "controller.kanayama",
        "controller.pure_pursuit",
        "controller.ramsete",
        "controller.regulated_pure_pursuit",
    ),
    "navloom-vff": ("avoider.vff",),
    "navloom-vfh": (
        "avoider.vfh",
        "avoider.vfh_plus",
        "avoider.vfh_star",
        "avoider.vfh_swept",
    ),
    "navloom-viewer": ("command.view",),
}
"""Plugins of each distribution of the extra `all`, as `role.name`; a test compares them with the entry points."""


def distribution_of(key: str) -> str | None:
    """The distribution of the project with a plugin, given as `role.name`; None for a plugin from elsewhere."""
    return next((distribution for distribution, keys in SHIPPED.items() if key in keys), None)


def shipped_names(role: str) -> list[str]:
    """Names of one role's plugins in the project's distributions, sorted."""
    parts = (key.partition(".") for keys in SHIPPED.values() for key in keys)
    return sorted(name for owner, _, name in parts if owner == role)
