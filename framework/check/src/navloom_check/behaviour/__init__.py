"""The behaviour tier: small exact scenes in which plugins are measured against what they claim.

Begin with `behaviour_tier.py`; `obstacle_scene.py` is a scene, `scene_drives.py` drives a robot through it.
`avoider_scenes.py`, `planner_scenes.py` and the others hold the scenes and measures of one kind of plugin.
A behaviour that a plugin does not claim is reported without judgement.
"""
