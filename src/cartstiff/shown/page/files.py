"""The files of the page: served one by one, or put together as one script."""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path

from cartstiff.core.errors import MissingDependencyError, printable
from cartstiff.shown.scene.theme import style_properties
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


def page_document(packed: bytes, title: str, more: str) -> str:
    """The page as one file: data that the script unpacks,
    and `more` script behind the viewer's.

    The policy of the file allows these scripts and no others.
    """
    script, viewer = minified(page_script()), f"{viewer_script().decode()}\n{more}"
    policy = (
        f"default-src 'none'; script-src {_hash(_LOADER)} {_hash(script)} "
        f"{_hash(viewer)}; "
        "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action "
        "'none'"
    )
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f'<meta name="generator" content="cartstiff {__version__}">\n'
        f"<style>\n{minified(page_style())}</style>"
    )
    parts = {"viewer": viewer.encode(), "data": packed, "script": script.encode()}
    data = "\n".join(
        f'<script type="text/plain" id="{name}">{_zipped(part)}</script>'
        for name, part in parts.items()
    )
    data += f'\n<script type="module">{_LOADER}</script>'
    before, rest = page_html().split("<!-- assets -->")
    _, after = rest.split("<!-- /assets -->")
    whole = before + head + after.replace("<!-- data -->", data)
    safe = printable(title).replace("&", "&amp;").replace("<", "&lt;")
    return whole.replace("<title>cartstiff</title>", f"<title>{safe}</title>", 1)


# The first script of a file: it unpacks the page's own.
_LOADER = """const text = document.getElementById("script").textContent;
const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
const own = document.createElement("script");
own.type = "module";
own.textContent = await new Response(stream).text();
document.head.append(own);"""
_COMMENT = re.compile(r"^\s*(?:/\*.*?\*/|//[^\n]*)\n", re.MULTILINE | re.DOTALL)
_INDENT = re.compile(r"^\s+", re.MULTILINE)


def minified(text: str) -> str:
    """A script or style sheet without comments on lines of their own, blank lines and
    indentation.
    """
    return _INDENT.sub("", _COMMENT.sub("", text))


def _hash(script: str) -> str:
    return (
        f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
    )


# The viewer, the largest part, is the same in every page: it stays beside the last data.
@lru_cache(maxsize=2)
def _zipped(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()
