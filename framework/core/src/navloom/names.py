"""The public names of navloom, and the module that each is imported from."""

from __future__ import annotations

__all__ = ["NAMES"]

NAMES = {
    "navloom.engine.nodes.node_plugin": (
        "AvoiderPorts ControllerPorts GatePorts GoalPorts Latest LocalizerPorts MapperPorts New NodePlugin "
        "OperatorPorts PlannerPorts PlatformPorts Publishes Quality RecoveryPorts ReferencePorts Sensors Tick "
        "Track"
    ),
    "navloom.errors": "NavloomError",
    "navloom.geometry.actors": "Actor Body Course Walk",
    "navloom.geometry.world": "Box Cylinder Material Obstacle Place Raster World position_at read_only",
    "navloom.messages": (
        "Array Avoidance AvoiderDiagnostics AvoiderStatus Bodies ClearRequest Command Contact Count Drive Envelope "
        "Feedback GateStatus Goal GoalResult GoalState HandOver Heading Hypotheses InputRead MapUpdate Message "
        "MessageError Most Name NotNegative OUTCOMES OccupancyGrid Odometry OperatorRequest Outcome "
        "Parameters Path PlanFailure PlanRequest Point2D PortMark Pose2D PoseEstimate PoseTrack Positive "
        "RangeScan ReasonCode RecoveryRequest RecoveryStep Reference SCHEMAS Selection Stamp StepRecord "
        "StepReport StopReason Sweep SweepRequest TrackingCommand Tracks Trajectory Truth Twist2D Unbounded "
        "Words message"
    ),
    "navloom.plugins": ("Discovery HookSpecs MessageObserver PluginError PluginInfo Registry RunInfo hookimpl"),
    "navloom.roles": (
        "ANYWHERE Avoider AvoiderInput Claim Context Controller ControllerInput Disturbance Extra Extras InputError "
        "Localizer LocalizerInput Mapper MapperInput Params Planner PlannerInput Platform PlatformInput PlatformOutput "
        "Preset ROLES ROLE_API Recovery RecoveryInput RobotSpec Role SensorSpec verb_of"
    ),
    "navloom.runs.metrics": "METRICS Metric",
    "navloom.runs.episode_trail": "Trail",
    "navloom_live.operating.navigator": "GoalHandle Navigator",
    "navloom_viewer.panels": "Panel Seen",
}
"""Names that `from navloom import NAME` gives, by their module."""
