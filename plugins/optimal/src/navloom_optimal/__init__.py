"""The shortest possible path of a robot in a world, as the reference for episodes.

Begin with `shortest_path.py`, `optimal_length`: it chooses the method by the world's shapes.
Boxes and cylinders: tangent graphs (`tangents.py`, `lazy_tangents.py`). Rasters: `lazy_theta.py`, then pulled taut.
`free_space.py` is the interface of the space of a disc; `field_space.py` and `shape_space.py` implement it.
"""
