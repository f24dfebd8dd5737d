"""The page in the browser: its server, its sessions, and the page as one file."""
