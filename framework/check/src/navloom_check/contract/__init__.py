"""The contract tier: what every plugin of a kind must pass, whatever its method.

Begin with the list in this file: each check with the kinds of plugins that it concerns; one module a subject.
`determinism.py` and `instance_isolation.py` protect replay, `resource_use.py` the loop, `plausibility.py` the units.
A check yields findings with the plugin's own line; `navloom_check.checks` says how to add one.
"""

from __future__ import annotations

from navloom_check.contract import (
    answer_types,
    avoider_steering,
    beam_order,
    controller_reference,
    determinism,
    global_access,
    instance_isolation,
    late_start,
    long_drives,
    message_docstrings,
    panel_side_effects,
    parameter_bounds,
    planner_alignment,
    planner_maps,
    platform_consistency,
    platform_truth,
    plausibility,
    plugin_declarations,
    recovery_attempts,
    resource_use,
    verbless_plugins,
    world_schemes,
)

__all__ = ["CHECKS"]

CHECKS = (
    *plugin_declarations.CHECKS,
    *message_docstrings.CHECKS,
    *answer_types.CHECKS,
    *plausibility.CHECKS,
    *planner_alignment.CHECKS,
    *planner_maps.CHECKS,
    *global_access.CHECKS,
    *platform_truth.CHECKS,
    *platform_consistency.CHECKS,
    *recovery_attempts.CHECKS,
    *avoider_steering.CHECKS,
    *controller_reference.CHECKS,
    *beam_order.CHECKS,
    *determinism.CHECKS,
    *instance_isolation.CHECKS,
    *parameter_bounds.CHECKS,
    *resource_use.CHECKS,
    *long_drives.CHECKS,
    *late_start.CHECKS,
    *verbless_plugins.CHECKS,
    *world_schemes.CHECKS,
    *panel_side_effects.CHECKS,
)
"""Contract checks in running order: those without an object first, then those that say most about a broken plugin."""
