"""Common parts of drivers for real robots: ports, a reader thread that reconnects, and device clocks."""
