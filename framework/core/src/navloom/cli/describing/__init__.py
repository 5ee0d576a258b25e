"""Commands that print what is installed and what a config says: `plugins`, `messages`, `graph`, `config`, `worlds`.

Begin with `plugins.py`. A list imports no plugin; only a plugin's own page does.
"""
