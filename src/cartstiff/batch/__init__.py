"""Many postures at once: stacks of matrices, maps, toolpaths."""
