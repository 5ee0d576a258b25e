"""Commands that print what is installed and what a config says."""
