"""The graph of nodes: ports, order, nodes and events. No thread, no socket, no file, no clock of its own."""
