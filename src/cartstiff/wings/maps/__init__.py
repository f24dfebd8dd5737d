"""Stiffness over many postures: where to look, computing, files, reading, pictures."""
