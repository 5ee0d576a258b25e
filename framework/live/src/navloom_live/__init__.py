"""Live robots: transport, processes, supervision, and the tools that look at a robot and operate it."""
