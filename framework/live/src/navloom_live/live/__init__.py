"""When a node steps on the wall clock or under the barrier, and what it knows of other processes.

Begin with `live_node.py`, a node with its mailbox and streams, then `live_runner.py`, which steps it.
`live_gate.py`, `live_goal.py` and `live_platform.py` also step without new inputs: they act on silence.
`process_streams.py` connects a process, `node_output.py` sends and `mailbox.py` receives.
`presence.py` tells who is alive; `barrier.py` keeps processes in step; `replicated_state.py` holds what must survive
the death of any process.
"""
