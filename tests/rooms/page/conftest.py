"""The servers and tabs of tests/view."""

from tests.view.conftest import no_picture, page, platform, tab

__all__ = ["no_picture", "page", "platform", "tab"]
