"""The whole picture of a mechanism at a posture, in a meshcat viewer.

Objects are sent once; a new posture moves and stretches them, some twenty-five short
commands. `Scene.draw` returns the legend: what every length, colour and factor in the
picture means.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.deflection import compliance_deflection
from cartstiff.answer.analysis.ellipsoids import Ellipsoid, Freedom, Quantity
from cartstiff.answer.analysis.matrices import symmetric_part
from cartstiff.answer.analysis.principal import block_ellipsoid
from cartstiff.core.arrays import Array, checked_vector
from cartstiff.core.errors import CartstiffError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.core.stiffness.posture import StiffnessInFrame
from cartstiff.shown.scene import theme
from cartstiff.shown.scene.appearance import (
    Appearance,
    reference,
    why_missing,
)
from cartstiff.shown.scene.arrows import (
    LONGEST_ARROW,
    SMALLEST_MOTION,
    DeflectionPicture,
    WrenchPicture,
)
from cartstiff.shown.scene.centres import CentresPicture, NodalAxis
from cartstiff.shown.scene.ellipsoids import (
    CUT,
    FLAT,
    FLAT_WORDS,
    MOST_RINGS,
    SHORTEST,
    THIN,
    EllipsoidPicture,
    Said,
)
from cartstiff.shown.scene.enlarged import MOST_SHOWN, MOST_TURN, SHOWN, TURN
from cartstiff.shown.scene.environment import Environment
from cartstiff.shown.scene.held_forces import HeldForcesPicture
from cartstiff.shown.scene.mechanism import MechanismPicture, extent
from cartstiff.shown.scene.points import add_points
from cartstiff.shown.scene.scales import SCALES, Growing
from cartstiff.shown.scene.viewer import ViewerNode

_QUANTITIES: tuple[Quantity, Quantity] = ("stiffness", "compliance")
_FREEDOMS: tuple[Freedom, Freedom] = ("translation", "rotation")
#: Largest semi-axis of an ellipsoid, over the size of the mechanism.
_RADIUS = 0.17


class Scene:
    """Draws a mechanism with its stiffness, load and deflection.

    Parameters
    ----------
    visualizer : meshcat.Visualizer
        Where; the picture is below ``visualizer["cartstiff"]``, and the viewer's own
        grid, axes, background and camera are set.
    elastic : ElasticMechanism
        The mechanism. Its springs may change later, its geometry may not.

    Attributes
    ----------
    notes : list of str
        Parts that cannot be shown (a missing mesh), and what is drawn instead.
    """

    def __init__(self, visualizer: Any, elastic: ElasticMechanism) -> None:
        self._elastic = elastic
        self._node = ViewerNode.of(visualizer)["cartstiff"]
        self._start = elastic.mechanism.closed(elastic.q)
        self._environment = Environment(
            self._node, extent(elastic, self._start), elastic.units.length
        )
        #: Place of the picture: what is added below is in F, in the mechanism's unit of
        #: length.
        self.node = self._node
        self._theme = ""
        self._ghost: MechanismPicture | None = None
        self._ghost_at: tuple[float, ...] | None = None
        self._usual: dict[tuple[str, str], Array] = {}
        self._around = dict[str, Array]()
        self.notes: list[str] = []

    # -- the picture
    # -------------------------------------------------------------------------

    def draw(
        self, result: PostureStiffness, look: Appearance | None = None
    ) -> dict[str, Any]:
        """Move everything to a posture and show the parts that an `Appearance` selects.

        Parameters
        ----------
        result : PostureStiffness
            From `cartstiff.analyse`, of the same mechanism.
        look : Appearance, optional
            Parts and scales; default the tangent stiffness under the load, and the load.

        Returns
        -------
        dict
            "length" (unit, grid, scene units), "connection", "quantity", "others",
            "ellipsoids" by freedom, "wrench", "deflection", "centres", "nodal",
            "held_forces", "tension", "notes". A part that is not shown has a "reason".

        Raises
        ------
        InputError
            For coordinates of a ghost or an added wrench that do not fit.
        """
        look = look or Appearance()
        if look.theme != self._theme:
            self._ghost_at = None  # will be drawn anew
        ghost = self._ghost_posture(look)
        here = reference(result, look)
        added = self._added(look, here)
        if look.theme != self._theme:
            self._build(look.theme)
        notes, reason = list(self.notes), why_missing(result, look)
        tension = self._mechanism.draw(result)
        self._move_ghost(ghost, look, notes)
        self._move_rest(look)
        self._frame.set_transform(result.pose)
        for name in ("F", "M"):
            self._node[name].show(look.frames)
            self._node[name]["name"].show(look.labels)
        self._node["ground"].show(look.grid)
        return {
            "length": self._environment.legend(),
            "connection": look.connection,
            "quantity": look.quantity,
            "others": look.others,
            "ellipsoids": {f: self._ellipsoid(f, look, here, reason) for f in _FREEDOMS},
            "wrench": (wrench := self._wrench(result, look, here)),
            "deflection": self._deflection(result, look, added, here, wrench),
            "centres": self._centres(look, here, reason),
            "nodal": self._nodal(result, look),
            "held_forces": self._held(result, look),
            "tension": tension,
            "notes": notes,
        }

    def points(
        self,
        positions: ArrayLike,
        values: ArrayLike,
        label: str = "",
        unit: str = "",
        *,
        size: float | None = None,
        carried: Mapping[str, Array] = MappingProxyType({}),
        better: str | None = None,
        allowed: tuple[float, str] | None = None,
    ) -> dict[str, Any]:
        """Show a map: points (N, 3) in F, in the mechanism's unit, coloured by values
        (N,).

        Arguments and returned facts of the colour bar as in `add_points`. No points
        remove the map.
        """
        self.keep_in_view("map", positions)
        return add_points(
            self._node["map"],
            positions,
            values,
            label=label,
            unit=unit,
            size=size,
            carried=carried,
            better=better,
            allowed=allowed,
        )

    def keep_in_view(self, what: str, positions: ArrayLike) -> None:
        """Have positions (N, 3) in F seen; others with the name `what` no longer have to
        be.
        """
        p = np.asarray(positions, float)
        self._around.pop(what, None)
        if p.size:
            self._around[what] = p[[*p.argmin(axis=0), *p.argmax(axis=0)]]

    def camera(self, preset: str = "iso") -> None:
        """View from a `preset`: "iso" (also "fit", "home"), "front", "side" or "top"."""
        self._environment.camera(preset)

    @property
    def size(self) -> float:
        """Size of the mechanism, a length."""
        return self._environment.size

    def bounds(self, result: PostureStiffness) -> Array:
        """Lowest and highest corner (2, 3), in the viewer's units, of what has to be seen
        with a `result`.
        """
        posture = result.posture
        around = _RADIUS * self._environment.size * np.array([[-1.0] * 3, [1.0] * 3])
        points = [
            extent(self._elastic, posture),
            result.pose[:3, 3] + around,
            *self._around.values(),
        ]
        if self._theme:
            points.append(self._mechanism.corners(posture))
        every = np.concatenate(points)
        return self._environment.seen(np.array([every.min(axis=0), every.max(axis=0)]))

    def assets(self, result: PostureStiffness, look: Appearance) -> dict[str, Any]:
        """Send every part that another posture, load or quantity than that of a `result`
        needs, with the parts of `look`, and what places them.

        A viewer that has this moves the picture itself. Lengths are in the mechanism's
        unit.

        Returns
        -------
        dict
            Sizes, units and usual values, colours of letters by theme, what moves with
            which joint.
        """
        self.draw(result, look)
        # Make all parts, also those that are not shown now.
        for freedom in _FREEDOMS:
            for quantity in _QUANTITIES:
                picture = self._ellipsoid_of(freedom, quantity)
                picture.make()
                picture.hide()
        self._wrenches.make()
        self.draw(result, look)
        size, kinds = (
            self._environment.size,
            [(q, f) for q in _QUANTITIES for f in _FREEDOMS],
        )
        return {
            **self._environment.facts(),
            "radius": _RADIUS * size,
            "around": [p for each in self._around.values() for p in each.tolist()],
            "arrows": self._wrenches.legend(),
            "size": size,
            "enlarged": [SHOWN, TURN, MOST_SHOWN, MOST_TURN],
            "thin": THIN * size,
            "flat": FLAT * size,
            "flat_words": FLAT_WORDS,
            "shortest": SHORTEST * size,
            "cut": CUT,
            "rings": MOST_RINGS,
            "usual": {f"{q}/{f}": self._usual_values(q, f).tolist() for q, f in kinds},
            "units": {f"{q}/{f}": self._unit(f, q) for q, f in kinds},
            "letters": {
                name: {
                    **{f: shades.tinted(theme.COLOURS[f]) for f in _FREEDOMS},
                    "load": shades.tinted(shades.load),
                    "paper": shades.paper,
                }
                for name, shades in theme.THEMES.items()
            },
            **self._mechanism.facts(),
        }

    # -- parts
    # -------------------------------------------------------------------------------

    def _build(self, name: str) -> None:
        """Send every object in the colours of a theme."""
        look = theme.THEMES[name]
        node, size = self._node, self._environment.size
        if self._theme:  # what has been drawn in another theme
            for part in (
                "mechanism",
                "ghost",
                "rest",
                "nodal",
                "centres",
                "held forces",
                "wrench",
                "deflection",
                *(f"{f} ellipsoid" for f in _FREEDOMS),
            ):
                node[part].delete()
        first = not self._theme
        self._theme = name
        self._mechanism = MechanismPicture(node["mechanism"], self._elastic, size, look)
        if first:
            self._environment.frame_also(self._mechanism.corners(self._start))
            self._environment.camera("iso")
        self._environment.dress(look)
        self._frame = self._environment.frames(look)
        self.notes = self._mechanism.notes
        self._ghost, self._ghost_at = None, None
        self._ellipsoids: dict[tuple[Freedom, Quantity], EllipsoidPicture] = {}
        self._wrenches = WrenchPicture(node["wrench"], look, self._arrow_scales())
        self._deflections = DeflectionPicture(node["deflection"], size, look)
        self._axis = NodalAxis(node["nodal"], size, look)
        self._balls = CentresPicture(node["centres"], size, look)
        self._forces = HeldForcesPicture(node["held forces"], size, look)

    def _ellipsoid(
        self,
        freedom: Freedom,
        look: Appearance,
        here: StiffnessInFrame,
        reason: str | None,
    ) -> dict[str, Any] | None:
        wanted = look.translation if freedom == "translation" else look.rotation
        key = (freedom, look.quantity)
        for other, picture in self._ellipsoids.items():
            if other[0] == freedom and (other != key or not wanted):
                picture.hide()
        if not wanted:
            return None
        # Its shape, or why it has none.
        shape: Ellipsoid | None = None
        try:
            shape = block_ellipsoid(
                here, look.connection, look.quantity, freedom, look.others
            )
        except UndefinedError as error:
            reason = str(error)
        if shape is None:
            if key in self._ellipsoids:
                self._ellipsoids[key].hide()
            return {"shown": False, "reason": reason or f"no {look.quantity} exists here"}
        picture = self._ellipsoid_of(freedom, look.quantity)
        # Its scale: the one that is kept, or one by the values.
        target, scale = _RADIUS * self._environment.size, SCALES[look.scale]
        kept = (look.measures or {}).get(freedom)
        if kept and kept["kind"] == look.scale:
            measure = scale.from_legend(kept)
        else:
            usual = self._usual_values(look.quantity, freedom)
            measure = scale.from_values(shape.eigenvalues, target, usual, cut=True)
        return picture.draw(
            shape,
            here.pose,
            measure,
            self._unit(freedom, look.quantity),
            look.axes,
            look.labels,
            self._said(freedom, look),
        )

    def _said(self, freedom: Freedom, look: Appearance) -> Said:
        """The words at the axes of an ellipsoid."""
        quantity = look.said or look.quantity
        ends = ("softest", "stiffest")[:: 1 if look.quantity == "stiffness" else -1]
        is_other = quantity != look.quantity
        return Said(self._unit(freedom, quantity), is_other, (ends[0], ends[1]))

    def _ellipsoid_of(self, freedom: Freedom, quantity: Quantity) -> EllipsoidPicture:
        if (freedom, quantity) not in self._ellipsoids:
            self._ellipsoids[freedom, quantity] = EllipsoidPicture(
                self._node[f"{freedom} ellipsoid"][quantity],
                theme.COLOURS[freedom],
                self._environment.size,
                theme.THEMES[self._theme],
                freedom,
            )
        return self._ellipsoids[freedom, quantity]

    def _arrow_scales(self) -> tuple[Growing, Growing]:
        """Scales of forces and moments, from loads on that move the mechanism
        very little.
        """
        scales = []
        for freedom, motion in zip(_FREEDOMS, (self._environment.size, 1.0), strict=True):
            stiffness = float(np.abs(self._usual_values("stiffness", freedom)).max())
            smallest = SMALLEST_MOTION * motion * stiffness
            scales.append(
                Growing(
                    LONGEST_ARROW * self._environment.size, smallest or SMALLEST_MOTION
                )
            )
        return scales[0], scales[1]

    def _usual_values(self, quantity: Quantity, freedom: Freedom) -> Array:
        """Principal values of K^B in the mechanism's own posture:
        sizes have no history.
        """
        if not self._usual:
            with np.errstate(all="ignore"):
                here = analyse(self._elastic).at(None)
                for q in _QUANTITIES:
                    for f in _FREEDOMS:
                        try:
                            shape = block_ellipsoid(here, "B", q, f, "block")
                        except UndefinedError:
                            shape = None
                        self._usual[q, f] = (
                            np.zeros(3) if shape is None else shape.eigenvalues
                        )
        return self._usual[quantity, freedom]

    def _unit(self, freedom: str, quantity: Quantity) -> str:
        units = self._elastic.units
        return (units.stiffness if quantity == "stiffness" else units.compliance)[freedom]

    def _wrench(
        self, result: PostureStiffness, look: Appearance, here: StiffnessInFrame
    ) -> dict[str, Any] | None:
        if not look.wrench or here.wrench is None:
            self._wrenches.hide()
            return None
        W, units = result.shown_wrench(here.wrench), self._elastic.units
        return self._wrenches.draw(W, here.pose, units.force, units.moment, look.labels)

    def _added(self, look: Appearance, here: StiffnessInFrame) -> Array | None:
        """The wrench whose deflection is drawn, about the reference point."""
        if not look.deflection:
            return None
        if look.added is None:
            return here.wrench
        added = checked_vector(look.added, 6, "added wrench")
        if look.added_at is None:
            return added
        away = np.subtract(look.added_at, look.point)
        return added + np.append(se3.cross(away, added[3:]), np.zeros(3))

    def _deflection(
        self,
        result: PostureStiffness,
        look: Appearance,
        added: Array | None,
        here: StiffnessInFrame,
        wrench: dict[str, Any] | None,
    ) -> dict[str, Any] | None:
        if not look.deflection:
            self._deflections.hide()
            return None
        C, T = here.compliances[look.connection], here.pose
        if C is None or added is None:
            self._deflections.hide()
            return {"shown": False, "reason": "no compliance or no load exists here"}
        twist = compliance_deflection(
            C, added
        ).twist  # of the frame at the reference point
        if not np.any(twist):
            self._deflections.hide()
            return {"shown": False, "reason": "no load: nothing moves"}
        unit = self._elastic.units.length
        if wrench is None:
            force = None
        else:
            force = (T[:3, :3] @ wrench["wrench"][3:], wrench["force"])
        answer = self._deflections.draw(
            twist, T, unit, look.exaggeration, look.labels, force
        )
        acts_at = result.load.at if look.added is None else look.added_at or look.point
        return {"shown": True, "reason": None, "acts_at": list(acts_at), **answer}

    def _nodal(self, result: PostureStiffness, look: Appearance) -> dict[str, Any] | None:
        if look.nodal is None:
            self._axis.hide()
            return None
        number, hertz, screw = look.nodal
        name, unit = f"nodal axis of mode {number}", self._elastic.units.length
        return self._axis.draw(name, hertz, screw, result.pose, unit, look.labels)

    def _centres(
        self, look: Appearance, here: StiffnessInFrame, reason: str | None
    ) -> dict[str, Any] | None:
        if not look.centres or (K := here.matrices[look.connection]) is None:
            self._balls.hide()
            return {"shown": False, "reason": reason} if look.centres else None
        C = here.inverse_of_symmetric_part(look.connection)
        return self._balls.draw(symmetric_part(K), C, here.pose, look.labels)

    def _held(self, result: PostureStiffness, look: Appearance) -> dict[str, Any] | None:
        if look.held_forces:
            return self._forces.draw(result, self._elastic.units.force)
        self._forces.hide()
        return None

    def _ghost_posture(self, look: Appearance) -> MechanismPosture | None:
        if look.ghost is None or look.ghost == self._ghost_at:
            return None
        q = self._elastic.mechanism.checked(look.ghost, "ghost")
        try:
            return self._elastic.mechanism.closed(q)
        except CartstiffError:
            return None

    def _move_ghost(
        self, posture: MechanismPosture | None, look: Appearance, notes: list[str]
    ) -> None:
        if look.ghost is None:
            self._node["ghost"].show(False)
            return
        place = self._node["ghost"]
        if posture is not None and self._copies:
            self._mechanism.move(posture, place)
            self._ghost_at = look.ghost
        elif posture is not None:
            if self._ghost is None:
                self._ghost = MechanismPicture(
                    place,
                    self._elastic,
                    self._environment.size,
                    theme.THEMES[look.theme],
                    ghost=True,
                )
            self._ghost.move(posture)
            self._ghost_at = look.ghost
        place.show(self._ghost_at == look.ghost)
        if self._ghost_at != look.ghost:
            notes.append("the reference posture cannot be assembled")

    @property
    def _copies(self) -> bool:
        """Whether the viewer copies the mechanism to places of a second one."""
        return bool(getattr(self._node.window, "writes", False))

    def _move_rest(self, look: Appearance) -> None:
        """Bring the mechanism, in grey, to where it would be without the load."""
        place = self._node["rest"]
        place.show(look.rest is not None)
        if look.rest is not None and self._copies:
            posture = self._elastic.mechanism.at(np.array(look.rest))
            self._mechanism.move(posture, place)
            place["M"].set_transform(posture.pose)
