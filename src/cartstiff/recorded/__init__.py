"""Many postures at once: formulas recorded once, run as machine code or over arrays."""
