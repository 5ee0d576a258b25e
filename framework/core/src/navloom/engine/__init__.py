"""The graph of nodes: ports, order, nodes and events. It has no thread, socket, file or clock of its own."""
