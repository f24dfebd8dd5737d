"""Commands that say where a mechanism can be."""
