"""What uses all of it: maps, workspaces, paths, identification. None uses another."""
