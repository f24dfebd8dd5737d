"""MJCF files: compiled by MuJoCo, read as a model and the facts beside it."""
