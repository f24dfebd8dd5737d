"""Cable robots as the program CASPR keeps them."""
