"""The built-in panels: how each type of message is drawn, and its largest rate."""

from __future__ import annotations

import math

from navloom.messages import (
    AvoiderStatus,
    Bodies,
    Command,
    Feedback,
    GateStatus,
    GoalResult,
    HandOver,
    Hypotheses,
    MapUpdate,
    Path,
    PlanFailure,
    PoseEstimate,
    RangeScan,
    RecoveryRequest,
    Reference,
    Selection,
    Sweep,
    TrackingCommand,
    Tracks,
    Trajectory,
    Truth,
)

from navloom_viewer import draw_behaviour, draw_motion, draw_sensing
from navloom_viewer.panels import Panel

__all__ = ["BUILT_IN"]

ALL = math.inf
BUILT_IN: tuple[Panel, ...] = (
    Panel("avoider", AvoiderStatus, draw_behaviour.avoider_status, ALL),
    Panel("bodies", Bodies, draw_motion.bodies, 20.0),
    Panel("command", Command, draw_motion.command, 10.0),
    Panel("tracking", TrackingCommand, draw_motion.tracking_command, 10.0),
    Panel("goal", Feedback, draw_behaviour.feedback, ALL),
    Panel("gate", GateStatus, draw_behaviour.gate_status, ALL),
    Panel("result", GoalResult, draw_behaviour.goal_result, ALL),
    Panel("handover", HandOver, draw_behaviour.handover, ALL),
    Panel("hypotheses", Hypotheses, draw_motion.hypotheses, 5.0),
    Panel("map", MapUpdate, draw_sensing.map_update, 2.0),
    Panel("path", Path, draw_motion.path, ALL),
    Panel("failure", PlanFailure, draw_motion.plan_failure, ALL),
    Panel("pose", PoseEstimate, draw_motion.pose, 20.0),
    Panel("scan", RangeScan, draw_sensing.range_scan, 5.0),
    Panel("recovery", RecoveryRequest, draw_behaviour.recovery_request, ALL),
    Panel("reference", Reference, draw_motion.reference, 10.0),
    Panel("selection", Selection, draw_behaviour.selection, ALL),
    Panel("sweep", Sweep, draw_sensing.sweep, ALL),
    Panel("tracks", Tracks, draw_sensing.tracks, 10.0),
    Panel("trajectory", Trajectory, draw_motion.trajectory, ALL),
    Panel("truth", Truth, draw_motion.truth, 20.0),
)
"""The built-in panels. Other types of message are drawn only by panels of plugins."""
