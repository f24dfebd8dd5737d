r"""Parameters of an elastic mechanism with their tolerances.

Parameters: the stiffness of every spring and line, a factor on that of every link that gives
(nominally 1), or, where springs were measured, their compliances with
the covariance of that measurement; the masses; for chains the placement of each joint on its
predecessor and of the body frame on the last joint (translations, and rotations about the
placement's own axes); for platforms the points of base and platform; what the mechanism's file
calls its parameters; and where a mechanism finds its rest by itself, rest lengths and angles.

A mechanism with other parameters is looked at in the same posture (that of its file, if it is at
this one) and under the same load: the rest positions follow, as in a robot whose controller holds
it there. Springs of platforms and closed chains keep their forces (which change as little as keeps
the load).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.uncertainty import Tolerance, Tolerances
from cartstiff.errors import UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import (
    Elements,
    stiffnesses_beside,
    with_stiffnesses_beside,
)
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.potentials.flexure_struts import FlexureStruts, ideal_joints_only
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import JointSprings
from cartstiff.stiffness.compute import PostureStiffness, analyse

__all__ = ["Parameters", "Tolerances"]

_XYZ = ("x", "y", "z")
_RXYZ = ("rx", "ry", "rz")
#: Begins the names of what the mechanism's file calls its parameters.
_FILE = "parameter."


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
    reread : callable, optional
        From values of the file's parameters, by name, to the mechanism; without it these are none.
    at_rest : bool
        Whether rest positions are parameters: of a mechanism that finds its rest by itself.
    """

    result: PostureStiffness
    tolerances: Tolerances
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None
    at_rest: bool = False

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Values of all parameters by name, whatever their tolerance.

        "stiffness.<spring>", "mass.<link>" (the link's centre and its moments of inertia about it
        stay; of legs all alike), the geometry's names of `named`, "rest.<spring>" and
        "parameter.<name>".
        """
        elastic = self.result.elastic
        given = {f"mass.{name}": m for name, m in self._masses.items()}
        if not isinstance(elastic.springs, FlexureStruts):
            springs = self._stiffnesses | stiffnesses_beside(elastic)
            given = {f"stiffness.{name}": k for name, k in springs.items()} | given
            given |= self._geometry | self._rests
        if self.reread is not None:
            given |= {f"{_FILE}{name}": float(x) for name, x in elastic.parameters.items()}
        return given

    def size(self, name: str) -> float:
        """Natural size of a parameter's changes, in its unit."""
        group = name.partition(".")[0]
        if group in ("stiffness", "mass"):
            return abs(self.nominal[name])
        if group == "parameter":
            return abs(self.nominal[name]) or 1.0
        return 1.0 if self.is_angle(name) else self.result.posture.length

    def is_angle(self, name: str) -> bool:
        """Whether a parameter of the geometry, or a rest position, is an angle."""
        group, _, rest = name.partition(".")
        if group == "rest":
            elastic = self.result.elastic
            if not isinstance(elastic.springs, JointSprings):
                return False
            return not elastic.mechanism.coordinates[elastic.names.index(rest)].is_length
        return group in ("placement", "frame") and name.rsplit(".", 1)[1] in _RXYZ

    @cached_property
    def _stiffnesses(self) -> dict[str, float]:
        """Of the linear springs that act."""
        elastic = self.result.elastic
        if elastic.springs is None:
            return {}
        laws = elastic.springs.laws if isinstance(elastic.springs, JointSprings) else {}
        each = zip(elastic.spring_names, elastic.springs.stiffness.tolist(), strict=True)
        return {
            name: k for i, (name, k) in enumerate(each) if 0.0 < k < np.inf and i not in laws
        }  # fmt: skip

    @cached_property
    def _rests(self) -> dict[str, float]:
        elastic = self.result.elastic
        if not self.at_rest or elastic.springs is None:
            return {}
        each = zip(elastic.spring_names, elastic.springs.rest.tolist(), strict=True)
        return {f"rest.{name}": x for name, x in each if name in self._stiffnesses and x == x}

    @cached_property
    def _masses(self) -> dict[str, float]:
        mechanism = self.result.elastic.mechanism
        if isinstance(mechanism, Chain):
            own, _ = mechanism.tree.masses()
            links = mechanism.tree.links().items()
            return {name: float(own[j - 1]) for j, name in sorted(links) if own[j - 1] > 0.0}
        masses = mechanism.masses() if isinstance(mechanism, Platform) else {}
        return {name: mass for name, mass in masses.items() if mass > 0.0}

    @cached_property
    def named(self) -> dict[str, Tolerance]:
        """Nominal value and deviation by name.

        "stiffness.<spring>", or "compliance.<spring>" where they were measured;
        "placement.<joint>.x" to ".rz" and "frame.x" to ".rz" for chains; "base.<leg>.x" and
        "platform.<leg>.x" to ".z" for platforms; "rest.<spring>". Rotations are nominally zero.
        """
        elastic, t = self.result.elastic, self.tolerances
        ideal_joints_only(elastic.springs, "tolerances")
        given: dict[str, Tolerance] = {}
        if t.stiffness > 0:
            for name, k in (self._stiffnesses | stiffnesses_beside(elastic)).items():
                given[f"stiffness.{name}"] = Tolerance(k, t.stiffness * k)
        if t.stiffness == 0 and (known := elastic.identified) is not None:
            spread = np.sqrt(known.covariance.diagonal())
            for pattern, c, s in zip(known.patterns, known.values, spread, strict=True):
                lower = 0.0 if pattern.is_diagonal else -np.inf
                given[f"compliance.{pattern.name}"] = Tolerance(float(c), float(s), lower=lower)
        for name, value in (self._geometry | self._rests).items():
            deviation = t.angle if self.is_angle(name) else t.length
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
        if isinstance(self.result.elastic.springs, FlexureStruts):
            return "of struts with flexures only masses and the file's parameters are varied"
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

    def mechanism(self, values: Mapping[str, float]) -> ElasticMechanism:
        """The mechanism with other parameters (those not named: nominal).

        Rest positions are those of the nominal one, unless named; open where the file was read
        with other parameters, and leaves them open.
        """
        elastic = self.result.elastic
        told = {n.removeprefix(_FILE): x for n, x in values.items() if n.startswith(_FILE)}
        if told and self.reread is not None:
            elastic = self.reread(told)
        if elastic.springs is not None:
            k, rest = np.array(elastic.springs.stiffness), np.array(elastic.springs.rest)
            for i, name in enumerate(elastic.spring_names):
                k[i] = values.get(f"stiffness.{name}", k[i])
                rest[i] = values.get(f"rest.{name}", rest[i])
            elastic = replace(elastic, springs=elastic.springs.replaced(k, rest))
        others = {
            n.removeprefix("stiffness."): x for n, x in values.items() if n.startswith("stiffness.")
        }
        elastic = with_stiffnesses_beside(elastic, others)
        elastic = self._placed_at(self._measured_springs(elastic, values), values)
        masses = {n: values[f"mass.{n}"] for n in self._masses if f"mass.{n}" in values}
        mechanism = elastic.mechanism
        return replace(elastic, mechanism=mechanism.with_masses(masses)) if masses else elastic

    def posture_of(self, elastic: ElasticMechanism, q: Array | None = None) -> Array:
        """Coordinates q, by default the nominal ones; where they are the file's: its own now."""
        q = self.result.q if q is None else q
        return elastic.q if np.array_equal(q, self.result.elastic.q) else q

    def _analysed(self, values: Mapping[str, float]) -> PostureStiffness:
        there, nominal = self.result.posture, self.result.elastic.springs
        elastic = self.mechanism(values)
        posture, springs = elastic.mechanism.closed(self.posture_of(elastic)), elastic.springs
        if isinstance(springs, FlexureStruts):
            W = self.result.wrench
            return analyse(elastic, posture.q, wrench=W if np.any(W) else None)
        if isinstance(springs, JointSprings) and isinstance(nominal, JointSprings):
            if posture.closure is None:
                return analyse(elastic, posture.q, wrench=self.result.wrench)
            active = (springs.stiffness > 0) & np.isfinite(springs.stiffness)
            active[list(springs.laws)] = False
            before, x, forces = there.q, posture.q, nominal.torque(there.q)
            rows = np.diag(posture.coordinate_lengths)
        elif (
            isinstance(springs, LineSprings) and isinstance(nominal, LineSprings)
            and isinstance(posture, PlatformPosture) and isinstance(there, PlatformPosture)
        ):  # fmt: skip
            before, x = there.lines.lengths, posture.lines.lengths
            active = springs.stiffness > 0
            if nominal.unilateral:
                active &= nominal.is_taut(before)
            forces, rows = (
                nominal.tensions(before),
                posture.lines.lines * posture.coordinate_lengths,
            )
        else:
            return analyse(elastic, posture.q)
        forces = forces + self._change(elastic, posture, rows, forces, active)
        rest = nominal.rest + x - before
        rest[active] = x[active] - forces[active] / springs.stiffness[active]
        return analyse(
            replace(elastic, springs=springs.replaced(springs.stiffness, rest)), posture.q
        )

    def _change(
        self, elastic: ElasticMechanism, posture: MechanismPosture, rows: Array, forces: Array,
        active: Array,
    ) -> Array:  # fmt: skip
        """Least change of the springs' forces (m,) by which they carry the nominal load.

        `rows` (m, n) is the way of each spring per natural coordinate.
        """
        columns, others = posture.coordinate_lengths, elastic._evaluate_others(posture)
        W = np.zeros(6) if self.result.wrench is None else self.result.wrench
        missing = posture.motion.jacobian.T @ W - (0.0 if others is None else others.gradient)
        missing = columns * missing - rows.T @ forces
        if posture.closure is not None:
            C = posture.closure.jacobian * columns
            N = np.linalg.svd(C)[2][np.linalg.matrix_rank(C, rtol=numerics.RANK) :]
            missing, rows = N @ missing, rows @ N.T
        change = np.zeros_like(forces)
        change[active] = np.linalg.lstsq(rows[active].T, missing, rcond=numerics.ROUNDING)[0]
        return change

    def _placed_at(
        self, elastic: ElasticMechanism, values: Mapping[str, float]
    ) -> ElasticMechanism:
        """The mechanism with other geometry; itself if none is named."""
        geometry = self._geometry
        if not any(name in geometry for name in values):
            return elastic
        mechanism = elastic.mechanism
        if isinstance(mechanism, Platform):
            moved = [values.get(name, x) for name, x in geometry.items()]
            platform = mechanism.with_points(*np.array(moved).reshape(2, -1, 3))
            elastic = replace(elastic, mechanism=platform)
            if isinstance(elastic.springs, LineSprings):
                springs = replace(elastic.springs, anchors=platform.anchors, points=platform.points)
                elastic = replace(elastic, springs=springs)
            return elastic
        if not isinstance(mechanism, Chain):
            return elastic
        poses = {}
        for name in dict.fromkeys(name.rpartition(".")[0] for name in values if name in geometry):
            T = self._placed[name]
            x = [values.get(key := f"{name}.{a}", geometry[key]) for a in (*_RXYZ, *_XYZ)]
            rotation = se3.exp(np.array([*x[:3], 0.0, 0.0, 0.0]))[:3, :3]
            poses[name] = se3.pose(T[:3, :3] @ rotation, np.array(x[3:]))
        frame = poses.pop("frame", mechanism.body.T_j_f)
        placements = {self._joints[name]: T for name, T in poses.items()}
        return replace(elastic, mechanism=mechanism.with_placements(placements, frame))
