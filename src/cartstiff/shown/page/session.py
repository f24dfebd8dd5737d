"""One tab: its messages become numbers and commands for its own picture.

A session has no socket. `answer` answers messages about one posture. `work` answers those
about many postures; it is a generator, which a server can interrupt between two postures.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from functools import lru_cache
from time import thread_time
from typing import Any

import numpy as np

from cartstiff.answer.commanded import analyse_commanded
from cartstiff.answer.data import Quantity
from cartstiff.answer.posture import answer_at
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_pose, named_values
from cartstiff.core.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    UnknownNameError,
)
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.units import LENGTHS
from cartstiff.recorded.gradients.spread import analyse_posture
from cartstiff.recorded.recorded_postures import RecordedPostures
from cartstiff.shown.page.following import Follower
from cartstiff.shown.page.messages import (
    Analysis,
    Answer,
    Better,
    Bounds,
    Draw,
    Frame,
    Message,
    Numbers,
    Response,
    Result,
    Said,
    Series,
    Sweep,
    ViewState,
    WhatIf,
    address_forms,
)
from cartstiff.shown.page.picture import PageScene
from cartstiff.shown.page.shown import (
    describe_mechanism,
    moved_part,
    own_matrices,
    response_curves,
    series_row,
    shown_numbers,
    slider_ranges,
    swept_range,
)
from cartstiff.shown.page.source import Source, changed
from cartstiff.shown.page.what_if import what_if
from cartstiff.shown.report.analysis import summary_text
from cartstiff.shown.report.sentences import (
    answer_sentences,
    settled_words,
    value_words,
    words_of,
)
from cartstiff.version import __version__

_Work = Generator[None, None, Answer]
# Why a row has no values if a drive has moved: by more than this, relative to 1 or its
# size.
_OPEN = "the loops do not close with the drives there"
_REACHED = numerics.NEGLIGIBLE_DIFFERENCE
# Places of a trajectory that are kept in view.
_MOST_SEEN = 200
#: The plotted numbers of a posture with its "q", or the "reason" why it is not reached.
Row = dict[str, Any]

#: Checking a point takes as long as some of the numbers.
_load_kind = lru_cache(maxsize=8)(LoadKind)

#: Makes the picture of a mechanism, without a posture yet.
PictureMaker = Callable[[ElasticMechanism], Any]


def refusal(error: CartstiffError, number: int, do: str | None = None) -> Answer:
    """The answer to a message that cannot be served."""
    code = error.code if isinstance(error, UndefinedError) else None
    return Answer({"id": number, "do": do, "error": str(error), "code": code})


class Session:
    """State of one tab.

    Parameters
    ----------
    source : Source
        The input of the page.
    picture : callable
        Makes a picture of a mechanism.
    facts : mapping, optional
        Further facts that a new page is sent.
    """

    def __init__(
        self,
        source: Source,
        picture: PictureMaker = PageScene,
        facts: dict[str, Any] | None = None,
    ) -> None:
        self.source, self._facts = source, facts or {}
        self.make_picture = picture
        self._start(source.elastic, source.q)

    def _start(self, elastic: ElasticMechanism, q: Array | None) -> None:
        self._elastic = elastic
        self._q = np.array(elastic.q if q is None else q, float)
        self._variant: tuple[Any, ElasticMechanism] = ((None, None, None), elastic)
        #: Its postures without commands, by programs once a page has them recorded.
        self.postures = RecordedPostures(elastic)
        self._follower = Follower(elastic)
        self._cloud_shown: tuple[str, tuple[float, str] | None] | None = None
        #: The posture of the picture.
        self.drawn: PostureStiffness | None = None
        self._colour_bar: dict[str, Any] | None = None
        self.picture = self.make_picture(elastic)
        if (way := self.source.trajectory) is not None:
            few = way.q[:: -(-len(way.q) // _MOST_SEEN)]
            at = [elastic.mechanism.at(q).pose[:3, 3] for q in few]
            self.picture.keep_in_view(np.array(at))

    @property
    def elastic(self) -> ElasticMechanism:
        """The mechanism, with the frame of interest that the tab has chosen."""
        return self._elastic

    @property
    def start(self) -> ViewState:
        """The first state: with the compliance if there is no stiffness."""
        source = self.source
        state = ViewState(
            q=self._q.tolist(),
            load=_six(source.load),
            load_kind=source.load_kind,
            load_at=source.load_at,
            # As the page's own buttons, unless a load was given along other axes.
            load_axes="world" if source.load is None else source.load_axes,
            command=source.command,
        )
        result = self.result(state)
        if result.reduction.stiffness is None and result.compliances["B"] is not None:
            quantity = "compliance"
        else:
            quantity = "stiffness"
        cloud = self.source.cloud
        return state.model_copy(
            update={
                "q": self.before_load(result, state).tolist(),
                "quantity": quantity,
                "quantity_of_map": None if cloud is None else next(iter(cloud.values)),
            }
        )

    # -- answers
    # ----------------------------------------------------------------------------

    def hello(
        self, number: int = 0, now: ViewState | None = None, *, with_numbers: bool = False
    ) -> Answer:
        """Everything a new page needs, and the whole picture as it is;
        `now` is shown at once.

        With the numbers of that picture a page that wants nothing else need not ask for
        them.
        """
        state = self.start
        data = {
            "id": number,
            "do": "hello",
            "version": __version__,
            "mechanism": describe_mechanism(self._elastic, self._q)
            | {"fingerprint": self.source.fingerprint},
            "own_connections": [
                {"name": own.name, "load": own.meaning} for own in self.source.connections
            ],
            "state": state.model_dump(),
            "now": None if now is None else now.model_dump(),
            **self._facts,
            "trajectory": _trajectory_in_short(self.source),
            "cloud": (cloud := _cloud_in_short(self.source)),
            "forms": forms_of(len(self._q), cloud),
        }
        result = self.result(state)
        legend = self._draw(result, state)
        data["bounds"] = self.picture.bounds(result)
        if with_numbers:
            numbers = self.numbers(result, state)
            data["first"] = {"numbers": numbers, "legend": legend, "followed": None}
        return Answer(data, self.picture.whole())

    def answer(self, message: Message) -> Answer:
        """Answer a question that takes one posture.

        Raises
        ------
        CartstiffError
            The reason in one line; the picture is then unchanged.
        """
        with np.errstate(all="ignore"):  # what is not finite is refused as a whole
            if isinstance(message, Draw):
                return self._drawn(message)
            if isinstance(message, Frame):
                return self._other_frame(message)
            if isinstance(message, Better):
                return Answer(
                    {"id": message.id, "do": "better", **self._better(message.state)}
                )
            if isinstance(message, WhatIf):
                kept = self._variant, self.postures
                answer = what_if(self.result, message.state, message.to)
                self._variant, self.postures = kept
                return Answer({"id": message.id, "do": "stiffer", **answer})
            result = self.result(message.state)
            facts: dict[str, Any]
            if isinstance(message, Numbers):
                facts = {"numbers": self.numbers(result, message.state)}
            elif isinstance(message, Result):
                facts = {"result": result.to_dict()}
            elif isinstance(message, Bounds):
                facts = {"bounds": self.picture.bounds(result)}
            elif isinstance(message, Response):
                facts = response_curves(result, message.state, message.ratio)
            elif isinstance(message, Analysis):
                facts = self.analysis(result, message.state)
            elif isinstance(message, Said):
                facts = said(result, message.state)
            else:
                raise InputError(
                    "this question takes many postures", expected="`work`", got=message.do
                )
        return Answer({"id": message.id, "do": message.do, **facts})

    def work(self, message: Sweep | Series) -> _Work:
        """Answer a question that takes many postures, yielding between them.

        The answer says how much processor time (s) that took: a page asks seldom for what
        is slow.
        """
        steps = (
            self._sweep(message) if isinstance(message, Sweep) else self._series(message)
        )
        spent = 0.0
        while True:
            begin = thread_time()
            try:
                next(steps)
            except StopIteration as done:
                seconds = spent + thread_time() - begin
                return Answer({**done.value.data, "seconds": seconds})
            spent += thread_time() - begin
            yield

    # -- postures
    # ---------------------------------------------------------------------------

    def result(self, state: ViewState) -> PostureStiffness:
        """The posture of a state, with its springs, its load and the commands
        of its drives.
        """
        commanded = state.command is not None and any(state.command)
        return self._analysed(*self._placed(state, is_left=not commanded), state)

    def _analysed(
        self, elastic: ElasticMechanism, q: Array, state: ViewState
    ) -> PostureStiffness:
        """The posture at coordinates of a mechanism with the springs of a state."""
        wrench: Array | None = None
        axes: Axes = "body"
        if state.load is not None:
            wrench, axes = np.array(state.load, float), state.load_axes
        # Its buttons stay as they are while there is no load.
        kind = DEAD_AT_ORIGIN
        if wrench is not None or elastic.may_be_loaded:
            kind = _load_kind(state.load_kind, state.acts_at)
        if state.command is None or not any(state.command):
            if self.postures.elastic is not elastic:
                self.postures = RecordedPostures(elastic)
            return self.postures.posture(q, wrench, kind, axes)
        load: dict[str, Any] = {}
        if wrench is not None:
            load = {"wrench": wrench, "load_axes": axes}
        if kind != DEAD_AT_ORIGIN:
            load |= {"load_kind": kind.kind, "load_at": kind.at}
        steps = named_values(
            state.command, elastic.spring_names, state.command, "command"
        )
        command = {
            n: x for n, x in zip(elastic.spring_names, steps.tolist(), strict=True) if x
        }
        return analyse_commanded(elastic, command, q, **load)

    def _placed(
        self, state: ViewState, is_left: bool = False
    ) -> tuple[ElasticMechanism, Array]:
        """The mechanism with the springs of a state, and its coordinates before
        any command.
        """
        elastic = self.changed(state)
        mechanism = elastic.mechanism
        q = mechanism.checked(self._q if state.q is None else np.array(state.q))
        moved = state.moved
        if moved is not None and moved >= len(q):
            raise InputError(
                "no such coordinate", where="moved", expected=f"below {len(q)}", got=moved
            )
        if mechanism.closures:
            hold = None if moved is None or mechanism.actuated is not None else [moved]
            if (
                hold is not None or not is_left
            ):  # else `analyse` closes it in the same way
                q = mechanism.closed(q, hold=hold).q
        return elastic, q

    def before_load(self, result: PostureStiffness, state: ViewState) -> Array:
        """Coordinates before drives are commanded to move and before a load bends links.

        A page sends them back with the next state, which must not begin with bent links:
        a closed chain whose links are bent may not close at other positions of its
        drives.
        """
        q = self._q if state.q is None else state.q
        is_bent = any(result.q[i] != q[i] for i in self._elastic.mechanism.virtual)
        return self._placed(state)[1] if state.command or is_bent else result.q

    def numbers(self, result: PostureStiffness, state: ViewState) -> dict[str, Any]:
        """Its numbers; "q" is where the sliders are, see `before_load`."""
        numbers = shown_numbers(result, state) | {
            "q": self.before_load(result, state).tolist()
        }
        if self.source.connections:
            numbers["own"] = own_matrices(result, state, self.source.connections)
        if state.gravity is not None or state.payload is not None:
            numbers["weighed"] = result.weighed.text
        return numbers

    def changed(self, state: ViewState) -> ElasticMechanism:
        """The mechanism with the springs, the payload and the gravity of a state."""
        key = state.stiffness, state.payload, state.gravity
        if self._variant[0] != key:
            self._variant = (key, changed(self._elastic, *key))
        return self._variant[1]

    def _draw(
        self,
        result: PostureStiffness,
        state: ViewState,
        numbers: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Move the picture to a posture whose `numbers` are known, if they are."""
        cloud, wanted = self.source.cloud, state.quantity_of_map
        if cloud is not None and wanted is not None:
            if wanted not in cloud.values:
                raise UnknownNameError("quantity", wanted, cloud.values)
            limit = self._limit_of(wanted, cloud.units[wanted], state.allowed)
            if (wanted, limit) != self._cloud_shown:
                self._colour_bar = self.picture.cloud(cloud, wanted, limit)
                self._cloud_shown = wanted, limit
        self.drawn = result
        moved = moved_part(result, state) if numbers is None else numbers["moved"]
        return self.with_colour_bar(self.picture.draw(result, state, moved))

    def _limit_of(
        self, quantity: str, unit: str, allowed: float | None
    ) -> tuple[float, str] | None:
        """The displacement that is allowed, in a map's unit and in words; None for a
        quantity that is none.
        """
        own = self._elastic.units.length
        if (
            allowed is None
            or not quantity.startswith("deflection")
            or unit not in LENGTHS
        ):
            return None
        words = value_words(Quantity(allowed, own), "3")
        return allowed * LENGTHS[own] / LENGTHS[unit], words

    def with_colour_bar(self, legend: dict[str, Any]) -> dict[str, Any]:
        """A picture's legend with that of the map, if there is one."""
        return (
            legend if self._colour_bar is None else {**legend, "cloud": self._colour_bar}
        )

    def _drawn(self, message: Draw) -> Answer:
        """Numbers and picture of the state, or of the posture that follows a
        hand from there.
        """
        state, followed, mechanism = message.state, None, self._elastic.mechanism
        start = self._q if state.q is None else state.q
        if message.lengths is not None:
            if not len(mechanism.points):
                raise InputError("is for platforms", where="lengths", expected="towards")
            start = mechanism.forward_kinematics(
                message.lengths, mechanism.checked(start)
            )
            state = state.model_copy(update={"q": start.tolist(), "moved": None})
        if message.towards is not None:
            pose = checked_pose(np.array(message.towards.pose), "pose", where="towards")
            now = self._follower.follow(
                mechanism.checked(start), pose, message.towards.turning
            )
            state = state.model_copy(update={"q": now.q.tolist(), "moved": None})
            followed = {
                "distance": now.distance,
                "angle": now.angle,
                "reached": now.reached,
                "stopped": list(now.stopped),
            }
        result = self.result(state)
        numbers = self.numbers(result, state)
        legend = self._draw(result, state, numbers)
        data = {"numbers": numbers, "followed": followed, "legend": legend}
        return Answer({"id": message.id, "do": "draw", **data}, self.picture.changes())

    # -- questions
    # --------------------------------------------------------------------------

    def _other_frame(self, message: Frame) -> Answer:
        before, first = self._elastic.mechanism, self.source.elastic
        if message.name == before.frame:
            return self.hello(message.id)
        # The first frame may have an offset of its own, that of the tool.
        is_first = message.name == first.mechanism.frame
        self._start(
            first if is_first else self._elastic.with_frame(message.name), self._q
        )
        # On one link they are at rest relative to each other, whatever the load bends.
        after = self._elastic.mechanism
        T = se3.inverse(after.at(self._q).pose) @ before.at(self._q).pose
        answer = self.hello(message.id, _seen_from(message.state, T))
        answer.data["kept"] = [_seen_from(one, T).model_dump() for one in message.kept]
        return answer

    def analysis(self, result: PostureStiffness, state: ViewState) -> dict[str, str]:
        """The answer and the analysis of the shown matrix at the reference point,
        as text.
        """
        at = se3.pose(np.eye(3), state.point)
        analysis = analyse_posture(result, connection=state.connection, at=at)
        text = summary_text(analysis, self._elastic.units)
        lines = said(result, state)["sentences"]
        title = f"Analysis of K^{state.connection}"
        return {"title": title, "text": "\n".join([*lines, "", text])}

    def _better(self, state: ViewState) -> dict[str, Any]:
        """Coordinates of a better posture, None where there is none,
        and what is said of it.
        """
        from cartstiff.wings.toolpaths.better import better_posture
        from cartstiff.wings.toolpaths.better_answer import better_statements

        if state.load is None:
            raise InputError("a better posture needs a load")
        elastic, q = self._placed(state)
        found = better_posture(
            elastic,
            q,
            wrench=state.load,
            load_kind=state.load_kind,
            load_at=state.acts_at,
            load_axes=state.load_axes,
            point=state.point,
        )
        words = words_of(better_statements(found, elastic))
        return {"q": None if found is None else found.q.tolist(), "words": words}

    def _sweep(self, message: Sweep) -> _Work:
        i, n = message.coordinate, len(self._q)
        if i >= n:
            raise InputError(
                "no such coordinate", where="sweep", expected=f"below {n}", got=i
            )
        base = self._placed(message.state)[1]
        ends = slider_ranges(self._elastic, self._q)[i]
        is_length = self._elastic.mechanism.coordinates[i].is_length
        values = np.linspace(*swept_range(*ends, is_length), message.steps)
        is_commanded = message.state.command is not None
        rows = [Row()] * message.steps
        # Outwards from the posture, each from its neighbour: a closed chain keeps its
        # branch.
        last = {-1: base, 1: base}
        for k in np.argsort(np.abs(values - base[i]), kind="stable"):
            side = 1 if values[k] >= base[i] else -1
            q = last[side].copy()
            q[i] = values[k]
            rows[k] = row = self._row(message.state, q, i)
            if "reason" not in row:
                # Commands of drives have moved the coordinates of a row on from where it
                # began.
                last[side] = q if is_commanded else np.array(row["q"])
            yield
        answer = {"coordinate": i, "at": values.tolist(), "rows": rows}
        return Answer({"id": message.id, "do": "sweep", **answer})

    def _series(self, message: Series) -> _Work:
        trajectory = self.source.trajectory
        if trajectory is None:
            raise InputError("this page was started without a trajectory")
        rows = []
        for q in trajectory.q:
            rows.append(self._row(message.state, q, None))
            yield
        return Answer(
            {
                "id": message.id,
                "do": "series",
                "at": trajectory.time.tolist(),
                "rows": rows,
            }
        )

    def _row(self, state: ViewState, q: Array, moved: int | None) -> Row:
        """One posture of a series, or the "reason" why there is none,
        with drives that moved.
        """
        at = state.model_copy(update={"q": q.tolist(), "moved": moved})
        try:
            with np.errstate(all="ignore"):
                elastic, reached = self._placed(at)
                if moved_on := self._moved_on(
                    reached, at
                ):  # most of a row's time is the load's
                    return {"reason": _OPEN, "moved": moved_on}
                row = series_row(self._analysed(elastic, reached, at), at)
                return row if at.command else row | {"q": reached.tolist()}
        except CartstiffError as error:
            return {"reason": str(error)}

    def _moved_on(
        self, reached: Array, state: ViewState
    ) -> list[tuple[int, float, float]]:
        """Drives that closures have moved, with their wanted and their
        reached coordinate.
        """
        wanted = state.q or ()
        return [
            (i, wanted[i], float(reached[i]))
            for i in self._elastic.commanded
            if abs(reached[i] - wanted[i]) > _REACHED * max(1.0, abs(wanted[i]))
        ]


def said(result: PostureStiffness, state: ViewState) -> dict[str, Any]:
    """The answer at the reference point, as the command has it, and its sentences.

    "settled" is that on the equilibrium, None where the first order says the same;
    "holds" how many times the load is held, and until what, None where that is not known
    of the point.
    """
    own = None if state.connection == "load" else state.connection
    allowed = None if any(state.point) else state.allowed  # which is of M's origin
    at = se3.pose(np.eye(3), state.point)
    found = answer_at(result, connection=own, at=at, allowed=allowed)
    held = [one for one in found.statements if one.code.startswith("capacity")]
    holds = None
    if held and (allowed is not None or state.allowed is None):
        factor, limit = (held[0].values[key] for key in ("factor", "limit"))
        holds = {"factor": factor, "until": words_of([limit])[0]}
    sentences = answer_sentences(found)
    return {
        "answer": found.to_dict(),
        "sentences": sentences,
        "settled": settled_words(found),
        "holds": holds,
    }


def _seen_from(state: ViewState, T: Array) -> ViewState:
    """The same with another frame N of the body, ``T_N_M``: numbers at N,
    the load where it was.
    """
    new: dict[str, Any] = {"point": (0.0, 0.0, 0.0)}
    if state.payload is not None:
        mass, *centre = state.payload
        new["payload"] = (mass, *se3.placed(T, centre).tolist())
    if state.load is not None:
        new["load_at"] = tuple(se3.placed(T, state.acts_at).tolist())
        if state.load_axes == "body":
            turned = [T[:3, :3] @ state.load[:3], T[:3, :3] @ state.load[3:]]
            new["load"] = _six(np.concatenate(turned))
    return state.model_copy(update=new)


def _six(values: Array | None) -> tuple[float, float, float, float, float, float] | None:
    if values is None:
        return None
    mx, my, mz, fx, fy, fz = (float(x) for x in values)
    return mx, my, mz, fx, fy, fz


def _trajectory_in_short(source: Source) -> dict[str, Any] | None:
    """What the page's player knows of the joint angles of a file."""
    trajectory = source.trajectory
    if trajectory is None:
        return None
    return {"time": trajectory.time.tolist(), "timed": trajectory.timed}


def forms_of(count: int, cloud: Mapping[str, Any] | None) -> dict[str, Any]:
    """How an address writes the fields of a state of so many coordinates."""
    maps = {"words": [one["name"] for one in cloud["quantities"]]} if cloud else {}
    return address_forms() | {
        "q": {"count": count, "optional": False},
        "quantity_of_map": maps | {"optional": True},
    }


def _cloud_in_short(source: Source) -> dict[str, Any] | None:
    """What the page's choices know of a cloud of points; the points come later."""
    cloud = source.cloud
    if cloud is None:
        return None
    return {
        "quantities": [{"name": n, "unit": cloud.units[n]} for n in cloud.values],
        "count": len(cloud.positions),
        "thinned": cloud.thinned,
        "has_postures": cloud.q is not None,
    }
