/* Of the numeric policy (names and values of cartstiff.numerics, which a test compares): what is rounding. */

export const ATTAINABLE_PRECISION = 1e-15;
export const BLANK = 1e-12;
export const CLOSE = 1e-9;
export const EPSILON = 2.220446049250313e-16;
export const FUTILE = 8;
export const LIMIT_SLACK = 1e-13;
export const NEAR = 0.05;
export const RANK = 1e-10;
export const ROUNDING = 1e-12;
export const SMALLEST_STEP = 1e-16;
export const SYMMETRY = 1e-9;
export const REPORTED_ERROR = 1e-9;
export const UNCOUPLED = 1e-10;
export const ZERO = 1e-13;
