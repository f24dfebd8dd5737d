"""Guided starts: three questions in a minute each, for who opens a page without a
mechanism.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from cartstiff.shown.page.source import Source

#: Of the axes of a load, those of the room, and those of the tool.
_ROOM, _TOOL = "world", "body"


@dataclass(frozen=True)
class Step:
    """One step of a guided start.

    Attributes
    ----------
    words : str
        What it says.
    state, plot : dict
        What it changes of the page's state and of its plot.
    reveal : str
        Selector of the part of the page that it is about.
    """

    words: str
    reveal: str
    state: dict[str, Any] = field(default_factory=dict)
    plot: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Guide:
    """A guided start at a bundled mechanism."""

    mechanism: str
    title: str
    words: str
    steps: tuple[Step, ...]


GUIDES = (
    Guide(
        "ur5",
        "An arm under a drilling load",
        """How far does a drill push the tool back, which joint gives most, and what
        helps?""",
        (
            Step(
                """A drill presses with 150 N against the tool. The number on the right
                says how far the tool moves, and which way; in grey is the arm
                without the load.""",
                ".moved-card",
                {"load": [0, 0, 0, 0, 0, -150], "load_axes": _TOOL},
            ),
            Step(
                """Each bar is a joint's share of that way. The joint with the longest
                bar has the thickest band in the picture. Point at a bar to light its
                joint.""",
                ".moved-bars",
            ),
            Step(
                """1.5 mm are allowed: is it good enough? The answer also says how large
                the load may be.""",
                ".enough-card",
                {"allowed": 1.5e-3},
            ),
            Step(
                """What if one joint were stiffer? The joint that gains most comes
                first; move a slider to try it.""",
                ".what-if-card",
            ),
            Step(
                """Better posture, on the right, finds a posture with the tip in the
                same place that moves less. It shows the posture and what gets worse;
                you take it or leave it.""",
                ".moved-card",
            ),
        ),
    ),
    Guide(
        "hexapod",
        "A hexapod under a cutting force",
        """How far does a cut push the platform, where is it worst, and which stiffness
        is meant?""",
        (
            Step(
                """A cut pushes the platform with 1500 N along x and 600 N down. The
                number on the right says how far it moves; the colours of the legs
                are their shares.""",
                ".moved-card",
                {"load": [0, 0, 0, 1500, 0, -600], "load_axes": _ROOM},
            ),
            Step(
                """Where is it worst? The map has the displacement over x and y of the
                platform: bright is good. Click on a place to go there.""",
                "#strip",
                {},
                {"of": "deflection", "along": "sweep:0", "and": "1"},
            ),
            Step(
                "2 mm are allowed: what is outside is dark now.",
                ".enough-card",
                {"allowed": 2e-3},
            ),
            Step(
                """Under a load there is more than one stiffness matrix. The table has
                them side by side, and says why they differ and which one to take.
                Make the load grow from zero by the slider.""",
                ".which-card",
            ),
            Step(
                """Drag the ball at the platform: everything follows. Keep a state to
                compare two places at one scale.""",
                ".compare-card",
            ),
        ),
    ),
    Guide(
        "cable-robot",
        "A cable robot",
        "How stiff is a body on eight cables, and what does it do where it works?",
        (
            Step(
                """A push along x and y, and down. The number on the right says how far
                it moves. The greener a cable, the more it contributes.""",
                ".moved-card",
                {"load": [0, 0, 0, 60, 30, -20], "load_axes": _ROOM},
            ),
            Step(
                """The curve has the displacement while the platform goes up. The worst
                height is flagged; click on its words to go there.""",
                "#strip",
                {},
                {"of": "deflection", "along": "sweep:2", "and": ""},
            ),
            Step(
                "What if one cable were stiffer? The cable that gains most comes first.",
                ".what-if-card",
            ),
            Step(
                "0.5 mm are allowed: is it good enough, and how large may the load be?",
                ".enough-card",
                {"allowed": 5e-4},
            ),
        ),
    ),
)


def guided_sources() -> list[Source]:
    """The mechanisms of the guided starts, in their order."""
    from cartstiff.files.loading import load

    return [Source(load(guide.mechanism)) for guide in GUIDES]


def guides_in_words() -> list[dict[str, Any]]:
    """What a page needs of them, each text in one line."""

    def plain(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        return {key: " ".join(x.split()) if key == "words" else x for key, x in pairs}

    return [asdict(guide, dict_factory=plain) for guide in GUIDES]
