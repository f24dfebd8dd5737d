"""Where a mechanism can be: assembly modes, and the workspace with what limits it."""
