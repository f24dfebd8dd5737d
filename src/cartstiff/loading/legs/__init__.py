"""Legs of parallel machines by name, such as UPS or RUS: from a few numbers to their joints."""
