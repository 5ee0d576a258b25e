"""Common parts of drivers for real robots, public: ports, a reader thread that reconnects, and device clocks.

Begin with `link.py`, `Link`: one thread reads the device, sends heartbeats and reconnects.
`ports.py` opens serial lines, UDP and TCP with time limits; `clocks.py` converts device time to this host's clock.
`examples/serial_base` shows a whole driver.
"""
