"""Optimal 8-connected grid planning for navloom: A* without corner cutting."""
