"""What tools do to a live robot from outside: goals, stops, status, diagnosis, metrics.

Begin with `navigator.py`, the Python interface, or `client.py`, the requests below it.
`introspection.py` reads nodes, streams and status; `diagnosis.py` finds what is wrong and says what to do.
`stop_command.py` sends `navloom stop` before anything else is loaded.
"""
