"""Parts of the pictures of maps."""
