"""Criteria of single questions: each a number with its reason, for one kind of decision.

What is asked of ranks, definiteness and balance stands in `cartstiff.numerics.policy`.
"""

from __future__ import annotations

from typing import Final

# -- what is the same ---------------------------------------------------------------------------

#: Numbers that are given, or found along two ways, are the same within this share: nine digits are
#: more than people write, and fewer than a few operations lose.
CLOSE: Final = 1e-9
#: Places and postures nearer than this (shares of a size, rad) are one, and directions of this
#: length none: files have six digits.
NEARBY: Final = 1e-6
#: A law explains a measured asymmetry, or a fit a matrix, if no more than this share is left.
EXPLAINED: Final = 1e-8
#: Numbers of two processors agree to this.
PORTABLE: Final = 1e-8
#: Sums and products of some dozens of numbers are known to this share of their terms.
LAST_DIGITS: Final = 1e-14
#: Two units in the last place: nothing computed is better.
TWO_UNITS: Final = 4e-16
#: A limit is kept to within this share of the quantity, or of its natural size.
LIMIT_SLACK: Final = 1e-13
#: The pitch of a screw is infinite where its direction is shorter than this, beside its moment.
INFINITE_PITCH: Final = 1e-11
#: What couples turning and moving is none below this share of the geometric mean of both blocks.
UNCOUPLED: Final = 1e-10
#: Lines shorter than this share of a platform's size are not trusted: their directions have six
#: digits.
SHORTEST: Final = 1e-10
#: Imaginary part of omega^2 over its size above which a pair is complex: where two meet their
#: difference goes with the root of the load, so that the rounding there is 1e-8, and this share is
#: met at 1e-12 of the load.
COMPLEX: Final = 1e-6
#: Below this ratio of omega^2 the small ones are taken from the compliance as well.
FAR_APART: Final = 1e-5
#: Share of the largest eigenvalue above which a stiffness alone has digits enough.
PLAIN: Final = 1e-8
#: Forms on the motions of closures below this share of the largest vanish: they are products of
#: motions that are known to the root of `LAST_DIGITS`.
VANISHING: Final = 1e-7
#: The rank that most postures have counts values above this share of the largest: some of the
#: postures are nearly singular.
USUAL_RANK: Final = 1e-8

# -- what counts --------------------------------------------------------------------------------

#: A force, or what is unsure of one, below this share of those beside it is not felt.
NEGLIGIBLE_FORCE: Final = 1e-6
#: Shares of the mean tension that every cable keeps, if it can: the first that is possible.
TAUT_SHARES: Final = (0.1, 0.01, 1e-3, 1e-5, 0.0)
#: A printed number below this share of the largest beside it is printed as 0.
BLANK: Final = 1e-12
#: Condition numbers of a Jacobian and of an equilibrated stiffness up to which fast arithmetic
#: answers; beyond them the engine does, which names what is lost.
PLAIN_JACOBIAN: Final = 1e8
PLAIN_STIFFNESS: Final = 1e6
#: That of ``1 + D C`` up to which the inverse of a compliance C under a change D is taken for known
#: by it: two digits short of where a motion may cost nothing (`IDLE`).
PLAIN_CHANGE: Final = 1e9
#: Condition number of a stiffness, or of a block of one, up to which it alone has digits enough for
#: all its eigenvalues.
PLAIN_BLOCK: Final = 1e4

#: Coordinates of a point fixed to a body up to which it is used: farther away, in the mechanism's
#: unit of length, it leaves the robot fewer than seven digits.
FARTHEST_POINT: Final = 1e9

# -- searches -----------------------------------------------------------------------------------

#: Residual of an equilibrium that ends the search at once, and
EQUILIBRIUM_TOLERANCE: Final = 1e-13
#: the one that is accepted once it falls no more.
ACCEPTED_RESIDUAL: Final = 1e-9
#: Share of the fall that a slope promises which a step must bring [NocedalWright]_.
SUFFICIENT: Final = 1e-4
#: The fall of an energy is trusted down to this share of the energies added up.
TRUSTED: Final = 1e-11
#: Shares of a motion's hardness: the least stiffness of a step, and
SOFTEST: Final = 1e-10
#: the least negative stiffness of a saddle.
SADDLE: Final = 1e-8
#: Stiffnesses of the springs of one equilibrium, in natural units, differ by no more than this
#: factor: the softest is then known to seven digits beside the stiffest.
LARGEST_STIFFNESS_RATIO: Final = 1e9
#: Inertias of the motions of one mechanism, in natural units, differ by no more than this factor.
LARGEST_INERTIA_RATIO: Final = 1e6
#: Ratio of stiffnesses from which on stiff springs hold back soft ones, and a body on legs moves by
#: their lengths.
STIFF: Final = 1e5
#: That from which on a stiff spring drowns soft ones: half of the digits.
FAR: Final = 1e8
#: Below this share of the stiffest a motion is as good as free.
AS_GOOD_AS_FREE: Final = 1e-30
#: A step, of searches whose result is looked at or refined, below this share is none.
NEGLIGIBLE_STEP: Final = 1e-6
#: An iteration that comes no nearer has converged within this share.
CONVERGED: Final = 1e-11
#: Inverse kinematics and constraints: a pose is reached, a closure met, within this share.
REACHED: Final = 1e-10
#: A few units in the last place: no iteration, bisection or fit can do better.
ATTAINABLE_PRECISION: Final = 1e-15
#: A step, or a coordinate, below this does not change numbers of size 1.
SMALLEST_STEP: Final = 1e-16
#: Whole steps in a row that bring a search no nearer to zero.
FUTILE: Final = 8
#: Directions in which closures move by less than this share are left where they are.
LEAST_EFFORT: Final = 1e-9
#: Steps of central differences in rad and characteristic lengths: the error goes with the square,
#: rounding with the inverse;
DIFFERENCE: Final = 1e-5
#: of one-sided ones, and of those of first derivatives that are known to ten digits.
WIDE_DIFFERENCE: Final = 1e-4
#: Steps of those of eighth order in natural sizes, tried until two orders agree.
EIGHTH_ORDER: Final = (5e-3, 5e-4, 5e-5)
#: and the widest one, where a natural size changes nothing by more than a slight share.
WIDEST: Final = 3e-2
SLIGHT: Final = 1e-4
#: Two differentiations, with the full and with half the step, agree to this share.
AGREEING: Final = 1e-6
#: A sum of squares that falls by less than this share has reached its minimum.
FLAT: Final = 1e-7
#: A predictor along a path of solutions may miss it by this (of unit vectors): Newton's method then
#: comes back to the same path in two steps.
FOLLOWED: Final = 1e-5
#: Where the parameter of a path that began at 1 is below this, it has ended at a singular solution:
#: those of which three meet are then known to the root of `NEARBY`.
PATH_END: Final = 1e-11
#: Points whose rotation has a smaller share than this are no pose; the ends of paths to infinity
#: have 1e-6 and less.
NO_ROTATION: Final = 1e-4
#: A point beside a multiple solution is one itself if it misses the equations by less than this.
BESIDE: Final = 1e-8
#: A slope so small beside the cost is none.
NO_SLOPE: Final = 1e-7
#: Least damping of a step that went well, as a share of what it is added to.
LEAST_DAMPING: Final = 1e-4
#: Information that stands for "nothing is known" while too few rows are chosen: a thousandth of a
#: percent of what one row tells.
FAINT: Final = 1e-5

#: Share of its natural size below which a compliance under load is followed along its derivative:
#: its square is far below what is measured, and stiffer springs hold a search back.
STIFFEST: Final = 1e-4
