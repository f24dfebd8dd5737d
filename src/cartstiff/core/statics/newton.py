r"""Newton's method for equilibria: globalised, on the motions that the constraints leave.

With an energy: step -|H_N|^-1 g_N (eigenvalues by their absolute value, so that every
step goes down), a cap on its size in natural units, pulled back onto the constraints,
accepted when the energy falls enough [NocedalWright]_; where rounding hides the energy's
fall, when the residual falls. Without an energy: step -H_N^-1 g_N on the unsymmetric
tangent, accepted when the residual falls. After a full step that is refused, a few more
are tried before it is shortened: a watchdog, as stiff springs otherwise stop soft motions
([NocedalWright]_, section 15.6). Limits touched on the way become constraints; limits
that pull are released. Every loop is bounded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import ConvergenceError, UndefinedError
from cartstiff.core.statics.held import COMPONENTS
from cartstiff.core.statics.problem import (
    Balance,
    Contact,
    ExhaustedError,
    Point,
    System,
    bound,
    bounded,
    sizes,
)
from cartstiff.core.stiffness.posture_notes import near_type_2

_ITERATIONS = 200
_HALVINGS = 30
# Steps without a halved residual after which a search without an energy ends.
_MAX_STALLED_STEPS = 40
# Steps of the watchdog, and the ratio of stiffnesses from which on it is used: elsewhere
# such steps may lead to another equilibrium.
_WATCHDOG_STEPS, _WATCHDOG_RATIO = 3, numerics.SLOWING_STIFFNESS_RATIO
# Cap of the first step and of any, and the largest turn of one step [rad].
_FIRST_CAP, _LARGEST_CAP, _LARGEST_TURN = 0.3, 1e18, 1.0
_SUFFICIENT, _ROUNDING = numerics.SUFFICIENT_DECREASE, numerics.LEAST_ENERGY_DECREASE
# Shares of a motion's stiffness scale: the least stiffness of a step, and a saddle's
# least slope.
_SOFTEST, _SADDLE = numerics.LEAST_STEP_STIFFNESS, numerics.SADDLE_STIFFNESS


@dataclass(slots=True, eq=False)
class Solution:
    """The end of the iteration.

    `is_far` says whether a state on the way was a saddle, or the first step predicted
    less than half of the way: gradually growing loads may then lead elsewhere.
    """

    point: Point
    balance: Balance
    contacts: tuple[Contact, ...]
    iterations: int
    history: list[float]
    is_far: bool = False

    @property
    def is_saddle(self) -> bool:
        """Whether a motion has a negative stiffness, by the symmetric part of
        the tangent.
        """
        return bool((self.balance.modes[0] < -_SADDLE).any())


def solve(
    system: System,
    q: Array,
    *,
    contacts: tuple[Contact, ...] = (),
    iterations: int = _ITERATIONS,
    settle: bool = True,
) -> Solution:
    """Equilibrium near q.

    Parameters
    ----------
    system : System
        Forces and constraints.
    q : ndarray
        Start; it need not satisfy the constraints.
    contacts : tuple of Contact
        Limits touched at the start.
    iterations : int
        Bound on the number of steps.
    settle : bool
        Go on from a saddle or maximum of the energy to a minimum.

    Raises
    ------
    ConvergenceError
        If the constraints cannot be met, or no equilibrium is reached.
    """
    with (
        np.errstate(over="ignore", invalid="ignore", divide="ignore"),
        bounded(system.elastic),
    ):
        return _Iteration(system, q, contacts, settle).run(iterations)


class _Iteration:
    def __init__(
        self, system: System, q: Array, contacts: tuple[Contact, ...], settle: bool
    ) -> None:
        self.system, self.settle = system, settle
        self.contacts = contacts
        self.cap = _FIRST_CAP
        self.history: list[float] = []
        q = system.retracted(q, contacts)
        point = system.at(q)
        for _ in range(len(system.limits)):
            new = self._violated(point)
            if not new:
                break
            self.contacts = (*self.contacts, *new)
            point = system.at(system.retracted(point.q, self.contacts))
        self.point = self.start = point
        self.balance = self._balanced(point)
        self.met_saddle = False
        self.predicted: Array | None = None

    def run(self, iterations: int) -> Solution:
        try:
            return self._run(iterations)
        except ExhaustedError as error:
            raise ConvergenceError(
                f"no equilibrium found, {error}: {self._suspicion()}",
                iterations=len(self.history),
                residual=min(self.history, default=np.inf),
            ) from None

    def _run(self, iterations: int) -> Solution:
        best, best_at = np.inf, 0
        kept: tuple[Point, Balance] | None = None
        face = self.contacts
        for iteration in range(iterations):
            residual = self.balance.residual
            self.history.append(residual)
            if self.contacts != face:  # residuals on another face do not compare
                best, kept, face = np.inf, None, self.contacts
            if residual < 0.5 * best:
                best_at = iteration
            if residual < best:
                best, kept = residual, (self.point, self.balance)
            stalled = iteration - best_at >= 2
            if best <= numerics.EQUILIBRIUM_TOLERANCE or (
                stalled and self._is_enough(best, kept)
            ):
                if kept is not None:
                    self.point, self.balance = kept
                best, kept = np.inf, None
                if self._release_contact() or (self.settle and self._settle()):
                    best_at = iteration
                    continue
                return Solution(
                    self.point,
                    self.balance,
                    self.contacts,
                    iteration,
                    self.history,
                    self._is_far(),
                )
            lost = (
                np.isnan(self.point.evaluation.energy)
                and iteration - best_at > _MAX_STALLED_STEPS
            )
            if lost or not self._step():
                if self._is_enough(best, kept):
                    best_at = iteration - 2
                    continue
                break
        raise ConvergenceError(
            "no equilibrium found: " + self._suspicion(),
            iterations=len(self.history),
            residual=best if np.isfinite(best) else self.balance.residual,
        )

    @staticmethod
    def _is_enough(best: float, kept: tuple[Point, Balance] | None) -> bool:
        return best <= numerics.ACCEPTED_RESIDUAL or (
            kept is not None and kept[1].is_rounding
        )

    def _is_far(self) -> bool:
        if self.met_saddle or self.predicted is None:
            return self.met_saddle
        way = self.system.displacement(self.start, self.point)
        sizes = [numerics.norm(each) for each in (way, self.predicted)]
        return numerics.norm(way - self.predicted) > max(
            0.5 * max(sizes), numerics.NEGLIGIBLE_DISTANCE
        )

    def _suspicion(self) -> str:
        """A likely reason why no equilibrium was found."""
        posture = self.point.posture
        own, ratio = self.system.own_stiffness(self.start.posture)
        free = None if posture.closure is None else self.balance.free
        for note in near_type_2(posture, free):
            return f"{note.message}; a load moves it far, or nothing holds it"
        if self.system.loads and posture.closure is None and not own.all():
            names = (
                COMPONENTS if posture.coordinates_are_pose else self.system.elastic.names
            )
            loose = names[int(own.argmin())]
            return f"nothing holds {loose!r} against the load"
        if self.system.loads and ratio > numerics.SLOWING_STIFFNESS_RATIO:
            return (
                f"stiffnesses differ by a factor {ratio:.0e}, which holds the search back"
            )
        if self.system.loads:
            return "the load may be beyond what the mechanism carries"
        return "the forces do not balance near this posture"

    # -- steps
    # ------------------------------------------------------------------------------

    def _balanced(self, point: Point) -> Balance:
        e = point.evaluation
        if not (np.isfinite(e.gradient).all() and np.isfinite(e.hessian).all()):
            raise ConvergenceError(
                "the forces overflow", iterations=len(self.history), residual=np.inf
            )
        try:
            return self.system.balance(point, self.contacts)
        except np.linalg.LinAlgError:
            raise ConvergenceError(
                "the constraint forces overflow",
                iterations=len(self.history),
                residual=np.inf,
            ) from None

    def _direction(self) -> tuple[Array, float]:
        """Step (n,) in natural units, and the energy's slope along it
        (NaN without energy).
        """
        b = self.balance
        if np.isnan(self.point.evaluation.energy):
            return b.motion(-b.solved(b.force, _SOFTEST)), np.nan
        values, modes = b.modes
        self.met_saddle |= bool((values < -_SADDLE).any())
        stiff = np.maximum(np.abs(values), _SOFTEST)
        y = -modes @ ((modes.T @ b.force) / stiff)
        step = b.motion(y)
        self.predicted = step if self.predicted is None else self.predicted
        return step, float(b.force @ y)

    def _step(self) -> bool:
        """Take one step; False if none helps.

        Without `settle` the nearest equilibrium is wanted, of whatever kind: saddles come
        first.
        """
        try:
            return (
                (not self.settle and self._to_saddle(0.5))
                or self._downwards()
                or self._to_saddle(1.0 - _SUFFICIENT)
            )
        except np.linalg.LinAlgError:
            return False

    def _to_saddle(self, share: float) -> bool:
        """Take Newton's own step at negative stiffness; False unless it leaves this
        share of merit.

        Beside stiff springs a few steps: the next one takes back what the first stretches
        them.
        """
        before = self.balance.merit
        if np.isnan(self.point.evaluation.energy) or self.balance.stiffness.size == 0:
            return False
        if self.balance.modes[0][0] >= -_SADDLE:
            return False

        def whole_step() -> Array | None:
            step = self.balance.motion(-self.balance.solved(self.balance.force, _SOFTEST))
            return step if self._share(step)[0] >= 1.0 else None

        steps = _WATCHDOG_STEPS if self._is_stiff() else 1
        return self._followed(
            steps, whole_step, lambda: self.balance.merit <= share * before
        )

    def _downwards(self) -> bool:
        """Take one step by which energy or residual falls; False if there is none."""
        step, slope = self._direction()
        if not np.isfinite(step).all():
            return False
        t, largest = self._share(step)
        capped = t < 1.0
        b, energy = self.balance, self.point.evaluation.energy
        energy_rounding = _ROUNDING * self.point.energies
        before = b.merit
        # At rounding level shorter steps do not help.
        for halving in range(_HALVINGS if b.residual > numerics.ACCEPTED_RESIDUAL else 2):
            trial = self._trial(t * step)
            if trial is None:
                t *= 0.5
                continue
            point, contacts, share = trial
            fall = -_SUFFICIENT * t * share * slope
            by_energy = (
                energy - point.evaluation.energy >= fall
                and fall / _SUFFICIENT > energy_rounding
            )
            if by_energy or np.isnan(slope) or fall / _SUFFICIENT <= energy_rounding:
                old = self.contacts
                self.contacts = contacts
                balance = self._balanced(point)
                falls = balance.merit <= (1.0 - _SUFFICIENT * t * share) * before
                if by_energy or falls or contacts != old:
                    if halving == 0 and capped:
                        self.cap = min(2.0 * self.cap, _LARGEST_CAP)
                    elif halving > 0:
                        self.cap = max(2.0 * t * largest, numerics.NEGLIGIBLE_STEP)
                    self.point, self.balance = point, balance
                    return True
                self.contacts = old
            whole = halving == 0 and share == 1.0 and contacts == self.contacts
            if whole and self._is_stiff() and self._watched(point, fall, energy_rounding):
                return True
            t *= 0.5
        return False

    def _share(self, step: Array) -> tuple[float, float]:
        """Share of a step that may be taken, and its largest part."""
        largest = max(numerics.largest(step), numerics.TINY)
        turning = max(self.system.turning(self.point.posture, step), numerics.TINY)
        return min(1.0, self.cap / largest, _LARGEST_TURN / turning), largest

    def _is_stiff(self) -> bool:
        stiffness_scale = self.balance.stiffness_scale
        return float(stiffness_scale.max(initial=0.0)) > _WATCHDOG_RATIO * float(
            stiffness_scale.min(initial=np.inf)
        )

    def _watched(self, trial: Point, fall: float, energy_rounding: float) -> bool:
        """Take a refused step and a few more; False, and nothing done,
        if these lead up as well.

        To second order a soft motion may stretch a stiff spring by more energy than it
        releases, which would stop every step but the shortest; the next step takes it
        back.
        """
        energy, merit = self.point.evaluation.energy, self.balance.merit

        def capped_step() -> Array | None:
            step, _ = self._direction()
            t, largest = self._share(step)
            return t * step if np.isfinite(t * largest) else None

        def is_lower() -> bool:
            gained = energy - self.point.evaluation.energy
            is_gain = gained >= fall and gained > energy_rounding
            return is_gain or self.balance.merit <= (1.0 - _SUFFICIENT) * merit

        return self._followed(_WATCHDOG_STEPS, capped_step, is_lower, trial)

    def _followed(
        self,
        steps: int,
        next_step: Callable[[], Array | None],
        is_better: Callable[[], bool],
        first: Point | None = None,
    ) -> bool:
        """Take steps until one is better than the start; False, and back at the start,
        if none is.

        Steps that touch a limit, or do not exist, end the attempt. `first` is a point to
        begin at.
        """
        start = self.point, self.balance
        try:
            if first is not None:
                self.point, self.balance = first, self._balanced(first)
            for _ in range(steps):
                step = next_step()
                trial = None if step is None else self._trial(step)
                if trial is None or trial[1] != self.contacts:
                    break
                self.point, self.balance = trial[0], self._balanced(trial[0])
                if is_better():
                    return True
        except (ConvergenceError, np.linalg.LinAlgError):
            pass
        self.point, self.balance = start
        return False

    def _trial(self, step: Array) -> tuple[Point, tuple[Contact, ...], float] | None:
        """Point after a step that ends at the first limit, its contacts,
        and the share taken.
        """
        system, contacts, share = self.system, self.contacts, 1.0
        try:
            for _ in range(len(system.limits) + 1):
                q = system.displaced(self.point, share * step)
                if not (np.abs(q) <= LARGEST_INPUT).all():  # also where it is no number
                    return None
                point = system.at(system.retracted(q, contacts))
                if not np.isfinite(point.evaluation.gradient).all():
                    return None
                new = self._violated(point, contacts)
                if not new:
                    return point, contacts, share
                fractions = [self._fraction(point, c) for c in new]
                first = int(np.argmin(fractions))
                share *= fractions[first]
                contacts = (*contacts, new[first])
        except (ConvergenceError, UndefinedError, np.linalg.LinAlgError):
            pass
        return None

    # -- limits
    # -----------------------------------------------------------------------------

    def _violated(
        self, point: Point, contacts: tuple[Contact, ...] | None = None
    ) -> list[Contact]:
        limits = self.system.limits
        posture = point.posture
        if not len(limits) or limits.holds(posture.q, posture.pose):
            return []
        taken = {c.quantity for c in (self.contacts if contacts is None else contacts)}
        sides = limits.side(point.limited, sizes(limits, point.posture))
        beyond = [Contact(int(i), int(sides[i])) for i in np.flatnonzero(sides)]
        return [c for c in beyond if c.quantity not in taken]

    def _fraction(self, point: Point, contact: Contact) -> float:
        """Share of the way from the present point at which a limit is met."""
        start = float(self.point.limited[contact.quantity])
        end = float(point.limited[contact.quantity])
        share = (bound(self.system.limits, contact) - start) / (end - start)
        return float(min(max(share, 0.0), 1.0))

    def reactions(self) -> Array:
        """Forces of the stops, positive towards larger values of the quantity."""
        count = len(self.contacts)
        return -self.balance.multipliers[len(self.balance.multipliers) - count :]

    def _release_contact(self) -> bool:
        """Release the stop with the largest pull; False if none pulls."""
        if not self.contacts:
            return False
        posture = self.point.posture
        units = sizes(self.system.limits, posture)
        scale = max(float(self.point.forces.max(initial=0.0)), numerics.TINY)
        pulls = [
            float(r * c.side * units[c.quantity]) / scale
            for r, c in zip(self.reactions(), self.contacts, strict=True)
        ]
        worst = int(np.argmax(pulls))
        if pulls[worst] <= numerics.ACCEPTED_RESIDUAL:
            return False
        self.contacts = tuple(c for i, c in enumerate(self.contacts) if i != worst)
        self.balance = self._balanced(self.point)
        return True

    def _settle(self) -> bool:
        """Step down from a saddle along its most negative eigenvalue;
        False at a minimum.
        """
        b = self.balance
        energy = self.point.evaluation.energy
        if np.isnan(energy) or b.stiffness.size == 0:
            return False
        values, modes = b.modes
        if values[0] >= -_SADDLE:
            return False
        self.met_saddle = True
        down = b.motion(modes[:, 0])
        down /= np.abs(down).max()
        for size in (0.1, 0.03, 0.01, 0.001):
            for sign in (1.0, -1.0):
                trial = self._trial(sign * size * down)
                if trial is None or not trial[2] > 0.0:
                    continue
                if trial[0].evaluation.energy < energy - _ROUNDING * self.point.energies:
                    self.point, self.contacts, _ = trial
                    self.balance = self._balanced(self.point)
                    self.cap = _FIRST_CAP
                    return True
        return False
