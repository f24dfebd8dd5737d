"""What files and models in hand mean: they become mechanisms."""
