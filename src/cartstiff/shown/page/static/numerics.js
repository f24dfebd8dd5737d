/* Thresholds of the numeric policy: names and values are those of cartstiff.core.numerics (a test compares). */

export const EPSILON = 2.220446049250313e-16;
export const LIMIT_SLACK = 1e-13;
export const LOST_ERROR = 1e-4;
export const NEAR_SINGULARITY = 0.05;
export const NEGLIGIBLE_DIFFERENCE = 1e-9;
export const PRINTED_AS_ZERO = 1e-12;
export const RANK = 1e-10;
export const REPORTED_ERROR = 1e-9;
export const ROUNDOFF = 1e-12;
export const STALLED_RESIDUAL = 1e-11;
export const SYMMETRY = 1e-9;
export const UNCOUPLED = 1e-10;
export const ZERO_SHARE = 1e-13;
