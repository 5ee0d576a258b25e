"""The shortest possible path of a robot in a world, as the reference for episodes.

Begin with `shortest_path.py`, `optimal_length`: it turns the world into boxes and cylinders, occupied cells of a raster
too. `tangent_search.py` searches the tangents between their `circles.py`, which `visible_tangents.py` finds.
`buckets.py` tests whether the disc may move along a segment or an arc.
"""
