"""Anchors, links and resources of built pages."""

from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """What a page offers and what it refers to."""

    def __init__(self, path):
        super().__init__()
        self.path = path
        self.text = path.read_text(encoding="utf-8")
        self.anchors = set()
        self.twice = set()
        self.links = []
        self.resources = []
        self.formulas = 0
        self.feed(self.text)

    def has(self, fragment):
        """Whether an anchor of that name exists."""
        return unquote(fragment) in self.anchors

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if name := values.get("id"):
            if name in self.anchors:
                self.twice.add(name)
            self.anchors.add(name)
        if name := values.get("name"):
            self.anchors.add(name)
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        if tag in ("script", "img", "iframe", "source") and values.get("src"):
            self.resources.append(values["src"])
        if tag == "link" and values.get("rel") in ("stylesheet", "icon", "preload", "preconnect"):
            self.resources.append(values["href"])
        self.formulas += tag == "math"

    def target(self, reference):
        """The local file that a link or resource names; None for another site's."""
        parts = urlsplit(reference)
        if parts.scheme or parts.netloc:
            return None
        if not parts.path:
            return self.path
        return (self.path.parent / unquote(parts.path)).resolve()


def broken(pages):
    """Links to files and anchors that do not exist, and resources that do not."""
    found = []
    for page in pages.values():
        for reference in [*page.links, *page.resources]:
            target = page.target(reference)
            if target is None:
                continue
            fragment = urlsplit(reference).fragment
            if not target.exists():
                found.append(f"{page.path.name}: {reference}")
            elif fragment and target in pages and not pages[target].has(fragment):
                found.append(f"{page.path.name}: {reference} (no such anchor)")
    return found
