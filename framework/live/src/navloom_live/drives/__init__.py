"""Whole drives of a live robot, from its config to the episode that is reported.

Begin with `live_run.py`: processes, goal, events and the end; `barrier_run.py` does the same in simulated time.
`live_observers.py` passes messages to observers without delaying the robot; `live_warnings.py` collects warnings.
"""
