"""Assembly modes, and the workspace with the limits of its boundary."""
