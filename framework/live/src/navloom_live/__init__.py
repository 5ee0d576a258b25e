"""Live robots: the nodes of a config in processes on the wall clock, over Zenoh, on one host or several.

Begin with `drives/live_run.py`: what `navloom up` does. Layers, lowest first: `transport` carries bytes, `live` steps
nodes, `hosting` runs processes, `operating` is what tools do from outside. Nothing below reads anything above.
`timing.py` holds the watchdogs' times; a test asserts the inequalities between them.
"""
