"""The Lyapunov tracking law of Hoang et al. 2013 for navloom."""
