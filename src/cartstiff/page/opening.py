"""Opening a page's address in the browser without showing the token to other users.

A command line can be read by every user of the machine, so the browser is given a file that only
this user can read; the file leads to the page.
"""

from __future__ import annotations

import atexit
import os
import tempfile
import webbrowser
from html import escape
from pathlib import Path


def open_page(url: str) -> None:
    """Have the user's browser open a page; nothing is said where there is none."""
    # A browser in a snap sees its user's files, but no hidden ones and not this /tmp.
    home = Path.home()
    folder = home if (home / "snap").is_dir() and os.access(home, os.W_OK) else None
    handle, name = tempfile.mkstemp(prefix="cartstiff-", suffix=".html", dir=folder)  # mode 0600
    path = Path(name)
    atexit.register(path.unlink, missing_ok=True)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(
            "<!doctype html><meta charset=utf-8><title>cartstiff</title>"
            f'<meta http-equiv="refresh" content="0;url={escape(url)}">'
            f'<a href="{escape(url)}">cartstiff</a>\n'
        )
    webbrowser.open(path.as_uri())
