"""The files of the page: served one by one, or put together as one script."""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path

from cartstiff.errors import MissingDependencyError, printable
from cartstiff.scene.theme import style_properties
from cartstiff.version import __version__

_PAGE = Path(__file__).parent / "static"
_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
#: First script of the page; the others are reached from it.
_MAIN = "main.js"
_IMPORT = re.compile(r'^import (?:\{[^}]*\} from )?"\./([a-z_]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|const|class|let))", re.MULTILINE)


def viewer_script() -> bytes:
    """The viewer of meshcat, as its package holds it.

    Raises
    ------
    MissingDependencyError
        Without meshcat.
    """
    # Found, not imported: the package brings ZeroMQ along, which a page does not need.
    package = find_spec("meshcat")
    if package is None or not package.submodule_search_locations:
        raise MissingDependencyError("meshcat", "a picture in a page")
    folder = Path(package.submodule_search_locations[0])
    return (folder / "viewer" / "dist" / "main.min.js").read_bytes()


def page_html() -> str:
    """The page's markup."""
    return (_PAGE / "index.html").read_text(encoding="utf-8")


def page_style() -> str:
    """The page's style sheet, with the colours that pictures have."""
    return style_properties() + (_PAGE / "style.css").read_text(encoding="utf-8")


def page_files() -> dict[str, tuple[str, bytes]]:
    """Everything that is served: address to (content type, content)."""
    files = {
        f"/page/{path.name}": (_KINDS[path.suffix], path.read_bytes())
        for path in sorted(_PAGE.iterdir())
        if path.suffix in _KINDS and path.suffix != ".js"
    }
    files["/page/style.css"] = (_KINDS[".css"], page_style().encode())
    files["/"] = files.pop("/page/index.html")
    # One script instead of one for each module, which a browser would ask for one after
    # another.
    files["/page/main.js"] = (_KINDS[".js"], page_script().encode())
    files["/viewer.js"] = (_KINDS[".js"], viewer_script())
    return files


@cache
def page_script(main: str = _MAIN) -> str:
    """All modules that one of the page's needs as one, each after those that it imports.

    Modules import by name from "./x.js" and export declarations only, so that taking both
    words away and putting the files in order is all there is to do.
    """
    done: dict[str, str] = {}

    def add(name: str) -> None:
        if name in done:
            return
        done[name] = ""
        text = (_PAGE / name).read_text(encoding="utf-8")
        for needed in _IMPORT.findall(text):
            add(needed)
        del done[name]
        done[name] = _EXPORT.sub("", _IMPORT.sub("", text))

    add(main)
    return "\n".join(done.values())


def page_document(packed: bytes, title: str, more: str = "") -> str:
    """The page as one file: data that the script unpacks,
    and `more` script behind the viewer's.

    The policy of the file allows these scripts and no others.
    """
    script, viewer = page_script(), f"{viewer_script().decode()}\n{more}"
    if "</script" in script:
        raise ValueError("the page's script must not hold its own end")
    policy = (
        f"default-src 'none'; script-src {_hash(script)} {_hash(viewer)}; "
        "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action "
        "'none'"
    )
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f'<meta name="generator" content="cartstiff {__version__}">\n'
        f"<style>\n{page_style()}</style>"
    )
    data = (
        f'<script type="text/plain" id="viewer">{_zipped(viewer.encode())}</script>\n'
        f'<script type="text/plain" id="data">{_zipped(packed)}</script>\n'
        f'<script type="module">{script}</script>'
    )
    before, rest = page_html().split("<!-- assets -->")
    _, after = rest.split("<!-- /assets -->")
    whole = before + head + after.replace("<!-- data -->", data)
    safe = printable(title).replace("&", "&amp;").replace("<", "&lt;")
    return whole.replace("<title>cartstiff</title>", f"<title>{safe}</title>", 1)


def _hash(script: str) -> str:
    return (
        f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
    )


# The viewer, the largest part, is the same in every page: it stays beside the last data.
@lru_cache(maxsize=2)
def _zipped(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()
