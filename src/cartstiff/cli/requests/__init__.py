"""What the options of one command ask for, put together from several of them or from a file."""
