r"""Parameters of an elastic mechanism with their tolerances.

Parameters: the stiffness of every spring, or, where springs were measured, their compliances with
the covariance of that measurement; for chains the placement of each joint on its
predecessor and of the body frame on the last joint (translations, and rotations about the
placement's own axes); for platforms the points of base and platform.

A mechanism with other parameters is looked at in the same posture and under the same load: the
rest positions follow, as in a robot whose controller holds it there. Springs of platforms and
closed chains keep their forces (those of a platform change as little as keeps the load).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.uncertainty import Tolerance
from cartstiff.arrays import checked_number
from cartstiff.errors import InputError, UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.potentials.flexure_struts import ideal_joints_only
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import JointSprings
from cartstiff.stiffness.compute import PostureStiffness, analyse

__all__ = ["Parameters", "Tolerances"]

_XYZ = ("x", "y", "z")
_RXYZ = ("rx", "ry", "rz")


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations for whole groups of parameters.

    Attributes
    ----------
    stiffness : float
        Standard deviation of every spring stiffness, relative to it (0.05: five per cent).
    length : float
        Standard deviation of every coordinate of a joint placement or an attachment point, in
        units of length.
    angle : float
        Standard deviation of every small rotation of a joint placement, in radians; chains only.
    """

    stiffness: float = 0.0
    length: float = 0.0
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("stiffness", "length", "angle"):
            value = checked_number(getattr(self, name), f"tolerance of the {name}")
            if value < 0:
                raise InputError(
                    f"tolerance of the {name} cannot be used", expected="zero or more", got=value
                )


@dataclass(frozen=True, eq=False)
class Parameters:
    """The parameters of a mechanism at a posture.

    Attributes
    ----------
    result : PostureStiffness
        The nominal mechanism, posture and load; never modified.
    tolerances : Tolerances
        Only parameters with a deviation above zero are listed. Without one of the stiffness, the
        compliances of measured springs are.
    """

    result: PostureStiffness
    tolerances: Tolerances

    @cached_property
    def named(self) -> dict[str, Tolerance]:
        """Nominal value and deviation by name.

        "stiffness.<spring>", or "compliance.<spring>" where they were measured;
        "placement.<joint>.x" to ".rz" and "frame.x" to ".rz" for chains; "base.<leg>.x" and
        "platform.<leg>.x" to ".z" for platforms. Rotations are nominally zero.
        """
        elastic, t = self.result.elastic, self.tolerances
        ideal_joints_only(elastic.springs, "tolerances")
        given: dict[str, Tolerance] = {}
        if t.stiffness > 0 and elastic.springs is not None:
            laws = elastic.springs.laws if isinstance(elastic.springs, JointSprings) else {}
            for i, name in enumerate(elastic.spring_names):
                k = float(elastic.springs.stiffness[i])
                if k > 0 and i not in laws:
                    given[f"stiffness.{name}"] = Tolerance(k, t.stiffness * k)
        if t.stiffness == 0 and (known := elastic.identified) is not None:
            spread = np.sqrt(known.covariance.diagonal())
            for pattern, c, s in zip(known.patterns, known.values, spread, strict=True):
                lower = 0.0 if pattern.is_diagonal else -np.inf
                given[f"compliance.{pattern.name}"] = Tolerance(float(c), float(s), lower=lower)
        for name, value in self._geometry.items():
            deviation = t.angle if name.rsplit(".", 1)[1] in _RXYZ else t.length
            if deviation > 0:
                given[name] = Tolerance(value, deviation)
        if not given:
            raise UndefinedError(
                "no parameter of this mechanism has a tolerance", code="no-parameters"
            )
        return given

    @cached_property
    def correlation(self) -> Array | None:
        """Of the named parameters; None where all are independent."""
        known, names = self.result.elastic.identified, list(self.named)
        measured = [i for i, name in enumerate(names) if name.startswith("compliance.")]
        if known is None or not measured:
            return None
        R = np.eye(len(names))
        spread = np.sqrt(known.covariance.diagonal())
        spread[spread == 0.0] = 1.0
        own = known.covariance / np.multiply.outer(spread, spread)
        np.fill_diagonal(own, 1.0)
        R[np.ix_(measured, measured)] = own
        return R

    @property
    def degrees(self) -> float:
        """Degrees of freedom of measured springs; infinite for tolerances that are given."""
        known = self.result.elastic.identified
        if known is None or known.degrees is None or self.correlation is None:
            return float(np.inf)
        return known.degrees

    @cached_property
    def _elements(self) -> Elements:
        return Elements(self.result.elastic)

    def _measured_springs(
        self, elastic: ElasticMechanism, values: Mapping[str, float]
    ) -> ElasticMechanism:
        """The mechanism with other compliances of measured springs; itself if none is named."""
        known = self.result.elastic.identified
        if known is None or not any(name.startswith("compliance.") for name in values):
            return elastic
        at = [values.get(f"compliance.{n}", c) for n, c in zip(
            known.names, known.values, strict=True)]  # fmt: skip
        change = np.array(at, float) - known.values
        patterns = self._elements.patterns(known.patterns)
        compliance = self._elements.compliance + np.tensordot(change, patterns, axes=1)
        return self._elements.with_compliance(compliance)

    @cached_property
    def _geometry(self) -> dict[str, float]:
        mechanism = self.result.elastic.mechanism
        if isinstance(mechanism, Platform):
            return {
                f"{body}.leg{i + 1}.{axis}": float(x)
                for body, points in (("base", mechanism.anchors), ("platform", mechanism.points_P))
                for i, point in enumerate(points)
                for axis, x in zip(_XYZ, point, strict=True)
            }
        if not isinstance(mechanism, Chain) or self._is_overconstrained:
            return {}
        return {
            f"{name}.{axis}": float(x)
            for name, T in self._placed.items()
            for axis, x in zip((*_XYZ, *_RXYZ), (*T[:3, 3], 0.0, 0.0, 0.0), strict=True)
        }

    @cached_property
    def left_out(self) -> str | None:
        """Why no geometry is varied, where it was asked for."""
        asked = self.tolerances.length > 0 or self.tolerances.angle > 0
        if asked and self._is_overconstrained:
            return (
                "geometry is not varied: the closures hold more than they need, and links of "
                "other lengths would not fit without clearance"
            )
        return None

    @cached_property
    def _is_overconstrained(self) -> bool:
        closure = self.result.posture.closure
        if closure is None:
            return False
        C = closure.jacobian * self.result.posture.coordinate_lengths
        values = np.linalg.svd(C, compute_uv=False)
        return len(values) < len(C) or not values[-1] > numerics.RANK * values[0]

    @cached_property
    def _joints(self) -> dict[str, int]:
        """Names of the joints whose placement matters, with their indices."""
        elastic = self.result.elastic
        chain = elastic.mechanism
        if not isinstance(chain, Chain):
            return {}
        tree = chain.tree
        joints = range(1, tree.model.njoints)
        if not chain.closures:
            joints = tree.support(chain.body.joint)  # type: ignore[assignment]
            if elastic.gravity is None and not elastic.potentials:
                joints = joints[1:]  # the mechanism does not feel where its base stands
        return {f"placement.{tree.model.names[j]}": j for j in joints}

    @cached_property
    def _placed(self) -> dict[str, Array]:
        chain = self.result.elastic.mechanism
        if not isinstance(chain, Chain):
            return {}
        placements = chain.tree.placements()
        places = {name: placements[j - 1] for name, j in self._joints.items()}
        return {**places, "frame": np.asarray(chain.body.T_j_f)}

    def at(self, values: Mapping[str, float]) -> PostureStiffness:
        """Stiffness of the mechanism with other parameters (those not named: nominal).

        Raises
        ------
        CartstiffError
            Where those parameters make no mechanism, or the chain cannot be closed.
        """
        return replace(self._analysed(values), load=self.result.load)

    def _analysed(self, values: Mapping[str, float]) -> PostureStiffness:
        elastic, q = self.result.elastic, self.result.q
        if elastic.springs is not None:
            k = np.array(elastic.springs.stiffness)
            for i, name in enumerate(elastic.spring_names):
                k[i] = values.get(f"stiffness.{name}", k[i])
            elastic = replace(elastic, springs=elastic.springs.replaced(k, elastic.springs.rest))
        elastic = self._measured_springs(elastic, values)
        elastic = self._placed_at(elastic, values)
        posture = elastic.mechanism.closed(q)
        springs, old = elastic.springs, self.result.elastic.springs
        if isinstance(springs, LineSprings) and isinstance(old, LineSprings):
            if isinstance(posture, PlatformPosture):
                elastic = replace(elastic, springs=self._tensioned(springs, old, posture))
        elif isinstance(springs, JointSprings) and isinstance(old, JointSprings):
            if posture.closure is None:
                return analyse(elastic, q, wrench=self.result.wrench)
            linear = springs.stiffness > 0
            linear[list(springs.laws)] = False
            rest = posture.q - (self.result.q - old.rest)
            torque = old.torque(self.result.q)
            rest[linear] = posture.q[linear] - torque[linear] / springs.stiffness[linear]
            elastic = replace(elastic, springs=springs.replaced(springs.stiffness, rest))
        return analyse(elastic, posture.q)

    def _placed_at(
        self, elastic: ElasticMechanism, values: Mapping[str, float]
    ) -> ElasticMechanism:
        """The mechanism with other geometry; itself if none is named."""
        geometry = self._geometry
        if not any(name in geometry for name in values):
            return elastic
        moved = {name: values.get(name, x) for name, x in geometry.items()}
        mechanism = elastic.mechanism
        if isinstance(mechanism, Platform):
            points = np.array(list(moved.values())).reshape(2, -1, 3)
            platform = mechanism.with_points(*points)
            elastic = replace(elastic, mechanism=platform)
            if isinstance(elastic.springs, LineSprings):
                springs = replace(elastic.springs, anchors=platform.anchors, points=platform.points)
                elastic = replace(elastic, springs=springs)
            return elastic
        if not isinstance(mechanism, Chain):
            return elastic
        poses = {}
        for name, T in self._placed.items():
            shift = np.array([moved[f"{name}.{axis}"] for axis in _XYZ])
            turn = np.array([moved[f"{name}.{axis}"] for axis in _RXYZ])
            rotation = se3.exp(np.concatenate([turn, np.zeros(3)]))[:3, :3]
            poses[name] = se3.pose(T[:3, :3] @ rotation, shift)
        placements = {j: poses[name] for name, j in self._joints.items()}
        return replace(elastic, mechanism=mechanism.with_placements(placements, poses["frame"]))

    def _tensioned(
        self, springs: LineSprings, old: LineSprings, posture: PlatformPosture
    ) -> LineSprings:
        """Rest lengths at which the legs exert the nominal wrench with the least change."""
        platform = self.result.elastic.mechanism.at(self.result.q)
        if not isinstance(platform, PlatformPosture):
            raise TypeError("legs of a body that is not a platform")
        before, now = platform.lines, posture.lines
        tension = old.tensions(before.lengths)
        active = springs.stiffness > 0
        if springs.unilateral:
            active &= old.is_taut(before.lengths)
        lengths = np.repeat([1.0, posture.length], 3)[:, None]
        missing = lengths[:, 0] * (before.lines.T @ tension - now.lines.T @ tension)
        tension = tension.copy()
        tension[active] += np.linalg.lstsq(
            lengths * now.lines[active].T, missing, rcond=numerics.ROUNDING
        )[0]
        rest = old.rest_length + now.lengths - before.lengths
        rest[active] = now.lengths[active] - tension[active] / springs.stiffness[active]
        return springs.replaced(springs.stiffness, rest)
