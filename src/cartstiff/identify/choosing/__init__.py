"""Which rows are chosen, and how good a choice can be."""
