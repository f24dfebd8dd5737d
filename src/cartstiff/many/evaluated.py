"""Energies that are no recorded arithmetic: over arrays where they can be, else one by one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.many.arithmetic import ENGINE, PLAIN, UNBALANCED
from cartstiff.many.beam_arithmetic import segments_of_many
from cartstiff.many.strut_arithmetic import struck
from cartstiff.mechanisms.contract import Mechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.flexure_struts import FlexureStruts, Struck
from cartstiff.potentials.springs import SpringLaw
from cartstiff.stiffness.applied_load import wrench_in_body

#: Postures whose struts are condensed at once, by a program and by stacks of matrices: what they
#: take fits into the caches.
_TOGETHER, _STACKED = 256, 64
#: Unsymmetric derivatives beyond this share of their largest entry are not those of an energy.
_UNSYMMETRIC = numerics.ROUNDING


class _Sums(NamedTuple):
    """What energies of (N,) postures add up to: (N, 1), (N, n), (N, n, n), and verdicts (N,)."""

    energies: Array
    gradients: Array
    hessians: Array
    verdicts: Array


@dataclass(frozen=True)
class Evaluated:
    """What is evaluated beside a program, which takes its derivatives as inputs.

    Attributes
    ----------
    mechanism : Mechanism
        Whose coordinates they are in.
    loose : tuple of Potential
        Potentials that are evaluated posture by posture.
    laws : dict of int to SpringLaw
        Nonlinear joint springs.
    rest : ndarray (n,), optional
        Their rest positions.
    beams : tuple of Beam
        Of which the program takes the derivatives of each segment.
    struts : FlexureStruts, optional
        A platform's, condensed in stacks.
    forces, points : tuple of ndarray (3,)
        Dead forces on the platform, and where they act in M, for open rest lengths to carry.
    is_loaded : bool
        Whether rest lengths of struts are chosen so that they carry a wrench.
    """

    mechanism: Mechanism
    loose: tuple[Potential, ...] = ()
    laws: Mapping[int, SpringLaw] = field(default_factory=dict)
    rest: Array | None = None
    beams: tuple[Beam, ...] = ()
    struts: FlexureStruts | None = None
    forces: tuple[Array, ...] = ()
    points: tuple[Array, ...] = ()
    is_loaded: bool = False

    @property
    def is_dense(self) -> bool:
        """Whether the program takes a whole gradient and Hessian."""
        return bool(self.loose or self.laws or self.struts)

    def __bool__(self) -> bool:
        return self.is_dense or bool(self.beams)

    @property
    def segments(self) -> tuple[tuple[int, ...], ...]:
        """Coordinates of each segment of the beams."""
        return tuple(tuple(map(int, own)) for beam in self.beams for own in beam.indices)

    def derivatives(
        self, q: Array, compiled: bool, wrench: Array | None = None
    ) -> tuple[dict[str, Array], Array]:
        """Inputs of a program at postures q (N, n), and verdicts on the postures (N,).

        Segments of beams, and struts, by machine code with `compiled`, else over arrays. The
        wrench (1 or N, 6) is for struts to carry.
        """
        count, n = q.shape
        sums = _Sums(
            np.zeros((count, 1)), np.zeros((0, n)), np.zeros((0, n, n)), np.full(count, PLAIN)
        )
        inputs = {"energies": sums.energies}
        if self.is_dense:
            sums = sums._replace(gradients=np.zeros((count, n)), hessians=np.zeros((count, n, n)))
            for j, law in self.laws.items():
                x = q[:, j] - (0.0 if self.rest is None else self.rest[j])
                energy, torque, stiffness = law.many(x)
                sums.energies[:, 0] += energy
                sums.gradients[:, j] += torque
                sums.hessians[:, j, j] += stiffness
            self._add_loose(q, sums)
            if self.struts is not None:
                self._add_struts(self.struts, q, wrench, compiled, sums)
            inputs |= {"gradients": sums.gradients, "hessians": sums.hessians.reshape(count, n * n)}
        if self.beams:
            energy, gradient, hessian = segments_of_many(self.beams, q, compiled)
            sums.energies[:, 0] += energy
            inputs["segment_gradients"] = np.ascontiguousarray(gradient.reshape(count, -1))
            inputs["segment_hessians"] = np.ascontiguousarray(hessian.reshape(count, -1))
        return inputs, sums.verdicts

    def _add_loose(self, q: Array, sums: _Sums) -> None:
        energies, gradients, hessians, verdicts = sums
        for i in range(len(q) if self.loose else 0):
            posture = self.mechanism.at(q[i])
            for potential in self.loose:
                try:
                    terms = potential.evaluate(posture)
                except (ArithmeticError, ValueError, RuntimeError):
                    verdicts[i] = ENGINE
                    break
                energies[i] += terms.energy
                gradients[i] += terms.gradient
                hessians[i] += terms.hessian
            H = hessians[i]
            if np.abs(H - H.T).max() > _UNSYMMETRIC * np.abs(H).max():
                verdicts[i] = ENGINE

    def _add_struts(
        self, struts: FlexureStruts, q: Array, wrench: Array | None, compiled: bool, sums: _Sums
    ) -> None:
        energies, gradients, hessians, verdicts = sums
        if not isinstance(self.mechanism, Platform):
            raise TypeError("struts are those of a platform")
        poses = se3.from_roll_pitch_yaw(q[:, :3], q[:, 3:]) @ self.mechanism.T_P_M
        borne = -gradients - self._of_forces(poses)
        if wrench is not None:
            borne += wrench
        # What their own rest lengths leave of it cannot be borne: these are then not found.
        left = UNBALANCED if self.is_loaded or not struts.is_complete else ENGINE

        def add(own: Array, at: Struck) -> None:
            energies[own, 0] += at.energy.sum(axis=1)
            gradients[own] += at.wrench.sum(axis=1)
            hessians[own] += at.stiffness.sum(axis=1)
            is_found, is_stable = (
                np.asarray(each).all(axis=1) for each in (at.is_found, at.is_stable)
            )
            found = np.where(is_stable, PLAIN, ENGINE)
            verdicts[own] = np.maximum(verdicts[own], np.where(is_found, found, left))

        others = np.arange(len(q))
        if compiled:
            doubtful = []
            for rows in np.split(others, range(_TOGETHER, len(q), _TOGETHER)):
                at, known = struck(struts, poses[rows], borne[rows], self.is_loaded)
                add(rows[known], at)
                doubtful.append(rows[~known])
            others = np.concatenate(doubtful)
        for start in range(0, len(others), _STACKED):
            own = others[start : start + _STACKED]
            add(own, struts.many(poses[own], borne[own], self.is_loaded))

    def _of_forces(self, poses: Array) -> Array:
        """Gradients (N, 6) of dead forces on the platform."""
        gradients = np.zeros((len(poses), 6))
        for force, point in zip(self.forces, self.points, strict=True):
            W = np.concatenate([np.zeros(3), force])
            gradients -= wrench_in_body(W, poses, point.tolist(), "world")
        return gradients
