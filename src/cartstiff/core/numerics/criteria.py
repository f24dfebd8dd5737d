"""Thresholds for one kind of decision each, with their reasons.

Those for rank, definiteness and balance are in `cartstiff.core.numerics.policy`.
"""

from __future__ import annotations

from typing import Final

# -- equality
# -----------------------------------------------------------------------------------

#: Relative difference within which given numbers, or results of two methods, are equal:
#: nine digits are more than people write, and fewer than a few operations preserve.
NEGLIGIBLE_DIFFERENCE: Final = 1e-9
#: Positions and postures that differ by less than this (shares of a size, rad) are equal,
#: and directions shorter than this do not exist: files have six digits.
NEGLIGIBLE_DISTANCE: Final = 1e-6
#: Largest unexplained share of an asymmetry by a law, or of a matrix by a fit.
UNEXPLAINED_SHARE: Final = 1e-8
#: Round-off of sums and products of some dozens of numbers, as a share of their terms.
ROUNDOFF_OF_SUMS: Final = 1e-14
#: Two units in the last place.
TWO_UNITS_IN_LAST_PLACE: Final = 4e-16
#: Tolerance of limits, as a share of the quantity, or of its natural size.
LIMIT_SLACK: Final = 1e-13
#: The pitch of a screw is infinite where its direction is shorter than this, beside its
#: moment.
INFINITE_PITCH: Final = 1e-11
#: Coupling of rotation and translation vanishes below this share of the geometric mean of
#: both blocks.
UNCOUPLED: Final = 1e-10
#: Least length of a line, as a share of a platform's size: its direction then has six
#: digits.
SHORTEST_LINE: Final = 1e-10
#: Imaginary part of omega^2 over its size above which a pair is complex. Where two
#: frequencies meet, their difference is proportional to the root of the change of the
#: load: round-off is 1e-8 there, and this share corresponds to a change by 1e-12.
COMPLEX_SHARE: Final = 1e-6
#: Below this ratio of omega^2 the small ones are taken from the compliance as well.
SMALL_FREQUENCY_RATIO: Final = 1e-5
#: Forms on the motions of closures below this share of the largest vanish: they are
#: products of motions with an error of the root of `ROUNDOFF_OF_SUMS`.
VANISHING_FORM: Final = 1e-7
#: The rank that most postures have counts values above this share of the largest: some of
#: the postures are nearly singular.
USUAL_RANK_RATIO: Final = 1e-8

# -- significance
# -------------------------------------------------------------------------------

#: A force, or its uncertainty, below this share of the others is negligible.
NEGLIGIBLE_FORCE: Final = 1e-6
#: Tension that every cable keeps if that is possible, as a share of the mean given
#: tension.
TAUT_SHARE: Final = 0.1
#: Numbers below this share of the largest one are printed as 0.
PRINTED_AS_ZERO: Final = 1e-12
#: Largest condition numbers of a Jacobian and of an equilibrated stiffness for recorded
#: arithmetic; beyond them `cartstiff.analyse` reports the loss of digits.
LARGEST_JACOBIAN_CONDITION: Final = 1e8
LARGEST_STIFFNESS_CONDITION: Final = 1e6
#: The same of ``1 + D C`` for the inverse of a compliance C under a change D: two digits
#: less than where a motion may cost no energy (`FREE_MOTION_STIFFNESS`).
LARGEST_CHANGE_CONDITION: Final = 1e9
#: Largest condition number of a stiffness, or of a block of one, that alone determines
#: all its eigenvalues.
LARGEST_BLOCK_CONDITION: Final = 1e4

#: Largest coordinate of a point fixed to a body, in the mechanism's unit of length:
#: farther away, the robot's own numbers have fewer than seven digits beside it.
FARTHEST_POINT: Final = 1e9

# -- searches
# -----------------------------------------------------------------------------------

#: Residual of an equilibrium that ends the search, and
EQUILIBRIUM_TOLERANCE: Final = 1e-13
#: the largest accepted one when it stops decreasing.
ACCEPTED_RESIDUAL: Final = 1e-9
#: Least decrease by a step, as a share of that predicted by the slope [NocedalWright]_.
SUFFICIENT_DECREASE: Final = 1e-4
#: Least significant decrease of an energy, as a share of the terms in its sum.
LEAST_ENERGY_DECREASE: Final = 1e-11
#: Shares of a motion's stiffness scale: the least stiffness of a step, and
LEAST_STEP_STIFFNESS: Final = 1e-10
#: the least negative stiffness of a saddle.
SADDLE_STIFFNESS: Final = 1e-8
#: Largest ratio of the springs' stiffnesses in one equilibrium, in natural units: the
#: softest one then has seven digits beside the stiffest.
LARGEST_STIFFNESS_RATIO: Final = 1e9
#: Largest ratio of inertias of the motions of one mechanism, in natural units.
LARGEST_INERTIA_RATIO: Final = 1e6
#: Ratio of stiffnesses from which on stiff springs slow the search down, and a body on
#: legs is moved in the coordinates of their lengths.
SLOWING_STIFFNESS_RATIO: Final = 1e5
#: Stiffness of a free motion, as a share of the stiffest one.
FREE_STIFFNESS_SHARE: Final = 1e-30
#: Least step of a search whose result is refined or checked later.
NEGLIGIBLE_STEP: Final = 1e-6
#: Largest residual of an iteration that has stopped decreasing.
STALLED_RESIDUAL: Final = 1e-11
#: Tolerance of poses in inverse kinematics, and of constraints.
CONSTRAINT_TOLERANCE: Final = 1e-10
#: A few units in the last place: the attainable precision of an iteration.
ATTAINABLE_PRECISION: Final = 1e-15
#: Least step that changes a number of size 1.
SMALLEST_STEP: Final = 1e-16
#: Largest number of consecutive whole steps without progress.
MAX_FUTILE_STEPS: Final = 8
#: Least rate of closures along a direction of motion that is used, as a share of the
#: largest.
LEAST_CLOSURE_RATE: Final = 1e-9
#: Steps of central differences in rad and characteristic lengths: the error is
#: proportional to the square, round-off to the inverse;
DIFFERENCE_STEP: Final = 1e-5
#: of one-sided ones, and of those of first derivatives with ten digits.
WIDE_DIFFERENCE_STEP: Final = 1e-4
#: Steps of eighth-order differences in natural sizes, tried until two orders agree.
EIGHTH_ORDER_STEPS: Final = (5e-3, 5e-4, 5e-5)
#: and the widest one, if a natural size causes relative changes below `NEGLIGIBLE_CHANGE`
#: only.
WIDEST_EIGHTH_ORDER_STEP: Final = 3e-2
NEGLIGIBLE_CHANGE: Final = 1e-4
#: Largest difference of derivatives with the full and with half the step.
DERIVATIVE_DISAGREEMENT: Final = 1e-6
#: Relative decrease below which a sum of squares has reached its minimum.
LEAST_DECREASE_OF_SQUARES: Final = 1e-7
#: Largest error of a predictor along a path of solutions (of unit vectors): Newton's
#: method then returns to the same path in two steps.
PREDICTOR_TOLERANCE: Final = 1e-5
#: Parameter of a path, from 1 to 0, below which it has ended at a singular solution: a
#: triple one then has an error of the root of `NEGLIGIBLE_DISTANCE`.
PATH_END: Final = 1e-11
#: Least share of the rotation in the coordinates of a pose; ends of paths to infinity
#: have 1e-6 and less.
LEAST_ROTATION_SHARE: Final = 1e-4
#: Largest residual of a solution near a multiple one.
MULTIPLE_SOLUTION_RESIDUAL: Final = 1e-8
#: Slope that vanishes, as a share of the cost.
NEGLIGIBLE_SLOPE: Final = 1e-7
#: Least damping after a successful step, as a share of the matrix.
LEAST_DAMPING: Final = 1e-4
#: Prior information while too few rows are chosen, as a share of that of one row.
PRIOR_INFORMATION_SHARE: Final = 1e-5

#: Share of its natural size below which a compliance under load is extrapolated by its
#: derivative: the error is far below that of measurements, and stiffer springs slow a
#: search down.
LEAST_COMPLIANCE_SHARE: Final = 1e-4
