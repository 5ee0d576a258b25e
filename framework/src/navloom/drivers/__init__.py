"""What drivers of real robots share: ports, a reader thread that reconnects, and clocks of devices. No robot in it."""
