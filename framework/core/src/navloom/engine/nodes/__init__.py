"""The nodes of a robot, one file each: a node around each role, and the framework's own nodes.

Begin with `node_base.py`, what all nodes share: declared inputs and outputs as attributes, and one step.
`avoider_node.py` is a typical node around a plugin; `goal_node.py` and `gate_node.py` are the framework's own.
`node_plugin.py` is the base of whole nodes from other distributions.
"""
