"""Improved vector field histogram on sonars for navloom (Hoang et al. 2013)."""
