"""What a mechanism file says in fewer words: parameters, and layouts in place of points."""
