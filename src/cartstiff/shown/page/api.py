"""A live page, or a notebook cell, from Python."""

from __future__ import annotations

import atexit
import os
import re
import tempfile
import webbrowser
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import checked_array, checked_input
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, MissingDependencyError
from cartstiff.core.geometry.connections import Connection
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.stiffness.compute import analyse
from cartstiff.shown.page.source import Playback, Source, cloud_of_workspace

if TYPE_CHECKING:
    from cartstiff.shown.page.additions import Slider
    from cartstiff.wings.reach.workspace import Workspace

_F = TypeVar("_F", bound=Callable[..., object])
_COLOUR = re.compile("#[0-9a-fA-F]{6}")


class Page:
    """A page that this process serves; a notebook displays it in a cell.

    Attributes
    ----------
    url : str
        Its address, which contains a secret: anyone who knows it can use the page.
    """

    def __init__(self, source: Source, port: int, height: int) -> None:
        try:
            from cartstiff.shown.page.server import Background
        except ImportError as error:
            if (error.name or "").startswith("cartstiff"):
                raise
            raise MissingDependencyError("tornado", "a page in the browser") from None
        self._source, self._height = source, height
        self._background = Background(source, port=port)
        self._additions = self._background.server.additions
        self.url = self._background.url

    def move(self, q: ArrayLike) -> None:
        """Take every tab to a posture, those that are opened later too.

        Raises
        ------
        InputError
            For a wrong count or numbers that are not finite.
        """
        values = self._source.elastic.mechanism.checked(q).tolist()
        server = self._background.server
        self._background.call(lambda: server.go_to(values))

    def slider(
        self, name: str, lower: float, upper: float, value: float | None = None
    ) -> Slider:
        """Add a slider to every tab, or replace that of the same name.

        Parameters
        ----------
        name : str
            What stands beside it.
        lower, upper : float
            Its ends.
        value : float, optional
            Where it is at first; default `lower`.

        Returns
        -------
        Slider
            Has a `value`; ``slider.on_change(f)`` has f called with it, in a thread of
            the page, whenever somebody moves it.

        Raises
        ------
        InputError
            For a name or ends that do not fit.
        """
        return self._additions.slider(name, lower, upper, value)

    def arrow(
        self, name: str, start: ArrayLike, vector: ArrayLike, *, colour: str = "#0072b2"
    ) -> None:
        """Draw an arrow in every tab, or move that of the same name.

        Parameters
        ----------
        name : str
            By which it is known again.
        start, vector : array_like (3,)
            Its beginning and the way to its head, along the axes of F in the mechanism's
            unit of length; a vector of zeros hides it.
        colour : str
            As ``"#rrggbb"``, at first.

        Raises
        ------
        InputError
            For what does not fit.
        """
        if not _COLOUR.fullmatch(colour):
            raise InputError(
                "not a colour", where="colour", expected="#rrggbb", got=colour
            )
        self._additions.arrow(name, start, vector, int(colour[1:], 16))

    def on_move(self, function: _F) -> _F:
        """Have a function called with each posture that a tab shows, or its load.

        It gets what `cartstiff.analyse` returns, in a thread of the page; of several
        postures that wait only the newest. Also a decorator.
        """
        return self._additions.on_move(function)

    def close(self) -> None:
        """End the page."""
        self._background.close()

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<page of {self._source.elastic.name} at {self.url}>"

    def _repr_html_(self) -> str:
        return _frame(f'src="{escape(self.url)}"', self._height)


class StaticPage:
    """An exported page: a notebook stores it, and displays it without a server.

    Attributes
    ----------
    html : str
        The whole page.
    """

    def __init__(self, html: str, height: int) -> None:
        self.html, self._height = html, height

    def __repr__(self) -> str:
        return f"<exported page, {len(self.html) / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        return _frame(f'srcdoc="{escape(self.html)}"', self._height)


def _frame(source: str, height: int) -> str:
    style = (
        f"width: 100%; height: {height}px; border: 1px solid #8888; border-radius: 6px"
    )
    return f'<iframe {source} style="{style}" allow="clipboard-write"></iframe>'


@checked
def show(
    elastic: ElasticMechanism,
    q: ArrayLike | dict[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    trajectory: ArrayLike | None = None,
    workspace: Workspace | None = None,
    connections: Sequence[Connection] = (),
    static: bool = False,
    port: int = 0,
    open_browser: bool | None = None,
    height: int = 720,
) -> Page | StaticPage:
    """Show a mechanism with its ellipsoids and matrices on a page.

    Parameters
    ----------
    elastic : ElasticMechanism
        From `cartstiff.load`, or your own.
    q : array_like (n,) or mapping, optional
        Posture shown at first; default the mechanism's.
    wrench : array_like (6,), optional
        Load (moment, force) shown at first, as in `cartstiff.analyse`.
    trajectory : array_like (N, n) or (N, joints), optional
        Coordinates, or joint positions, for the time slider.
    workspace : Workspace, optional
        From `cartstiff.workspace`; its boundary and the singular surface are drawn.
    connections : sequence of Connection
        Your own, which the page sets beside the named ones.
    static : bool
        An exported page instead of a live one: for notebooks that are kept, or whose
        server runs on another machine.
    port : int
        Port of a live page, on 127.0.0.1; 0 takes a free one.
    open_browser : bool, optional
        Open the page in a browser; default only outside notebooks.
    height : int
        Height of a notebook's cell, in dots.

    Returns
    -------
    Page or StaticPage
        As the last expression of a notebook's cell it is displayed there. A `Page` is
        served until `close`, or until Python ends.

    Raises
    ------
    InputError
        For a posture, wrench, trajectory or connection that does not fit; CartstiffError
        if there is no posture.
    MissingDependencyError
        Without tornado or meshcat.
    """
    checked_elastic(elastic)
    with np.errstate(all="ignore"):
        first = analyse(elastic, q, wrench=wrench)
    source = Source(
        elastic,
        first.q,
        None if wrench is None else checked_input(wrench, (6,), "wrench"),
        trajectory=None if trajectory is None else _trajectory(elastic, trajectory),
        cloud=None if workspace is None else cloud_of_workspace(workspace),
        connections=tuple(connections),
    )
    if static:
        from cartstiff.shown.page.export import export_page

        return StaticPage(export_page(source), height)
    page = Page(source, port, height)
    if open_browser is None:
        open_browser = not _in_notebook()
    if open_browser:
        open_page(page.url)
    return page


def _trajectory(elastic: ElasticMechanism, postures: ArrayLike) -> Playback:
    q = checked_array(postures, elastic.mechanism.shapes_of_rows, "trajectory")
    return Playback(elastic.mechanism.undeflected(q), np.arange(float(len(q))))


def _in_notebook() -> bool:
    try:
        from IPython import get_ipython
    except ImportError:
        return False
    shell = get_ipython()
    return shell is not None and hasattr(shell, "kernel")


def open_page(url: str) -> None:
    """Have the user's browser open a page; silent where there is none."""
    # A browser in a snap sees its user's files, but no hidden ones and not this /tmp.
    home = Path.home()
    folder = home if (home / "snap").is_dir() and os.access(home, os.W_OK) else None
    handle, name = tempfile.mkstemp(
        prefix="cartstiff-", suffix=".html", dir=folder
    )  # mode 0600
    path = Path(name)
    atexit.register(path.unlink, missing_ok=True)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(
            "<!doctype html><meta charset=utf-8><title>cartstiff</title>"
            f'<meta http-equiv="refresh" content="0;url={escape(url)}">'
            f'<a href="{escape(url)}">cartstiff</a>\n'
        )
    webbrowser.open(path.as_uri())
