"""The processes of one host: started, watched, restarted and ended.

Begin with `supervisor.py`; `node_process.py` is one process with its nodes, `fork_server.py` forks it ready to run.
`live_robot.py` brings a robot up; `node_services.py` answers requests; `runtime_folders.py` finds what runs here.
A process that dies is restarted by `Supervisor._reap`; the gate, `live/live_gate.py`, stops the robot meanwhile.
A process that hangs ends itself by a timer; the supervisor's heartbeat is the second line.
"""
