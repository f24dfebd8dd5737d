// Small matrices as rows of numbers: products, inverses, eigenvalues, singular values, rigid motions.

import { EPSILON } from "./numerics.js";

export const transposed = (A) => A[0].map((_, j) => A.map((row) => row[j]));
export const times = (A, v) => A.map((row) => row.reduce((sum, x, k) => sum + x * v[k], 0));
export const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
/** @type {(a: number[], b: number[]) => number[]} */
export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
export const plus = (A, B) => A.map((row, i) => row.map((x, j) => x + B[i][j]));
export const identity = (n) => Array.from({ length: n },
  (_, i) => Array.from({ length: n }, (__, j) => Number(i === j)));
export const zeros = (n, m) => Array.from({ length: n }, () => new Array(m).fill(0));
/** @type {(v: number[]) => number[][]} */
export const skew = ([a, b, c]) => [[0, -c, b], [c, 0, -a], [-b, a, 0]];
export const symmetric = (A) => A.map((row, i) => row.map((x, j) => 0.5 * (x + A[j][i])));
export const block = (A, first) => [0, 1, 2].map((i) => A[first + i].slice(first, first + 3));
export const largest = (A) => Math.max(...A.flat().map(Math.abs));
export const squares = (A) => A.flat().reduce((sum, x) => sum + x * x, 0);

export function product(A, B) {
  return A.map((row) => {
    const found = new Array(B[0].length).fill(0);
    for (let k = 0; k < row.length; k++) for (let j = 0; j < found.length; j++) found[j] += row[k] * B[k][j];
    return found;
  });
}

/** A^T B A. */
export const congruence = (A, B) => product(transposed(A), product(B, A));

/** The matrix in four blocks of 3 x 3. */
export const blocks = (a, b, c, d) => [0, 1, 2].map((i) => [...a[i], ...b[i]])
  .concat([0, 1, 2].map((i) => [...c[i], ...d[i]]));

/** The matrix with its rows and columns multiplied. */
export const scaled = (A, rows, columns = rows) => A.map((row, i) => row.map((x, j) => x * rows[i] * columns[j]));
const inverted = (list) => list.map((x) => 1 / x);

/** Inverse by elimination with pivots, rows and columns measured in sizes; null where there is none. */
export function inverse(A, sizes = A.map(() => 1)) {
  const n = A.length;
  const work = scaled(A, sizes).map((row, i) => [...row, ...identity(n)[i]]);
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let i = k + 1; i < n; i++) if (Math.abs(work[i][k]) > Math.abs(work[pivot][k])) pivot = i;
    if (!(Math.abs(work[pivot][k]) > 0)) return null;
    [work[k], work[pivot]] = [work[pivot], work[k]];
    for (let i = k + 1; i < n; i++) {
      const factor = work[i][k] / work[k][k];
      if (factor) for (let j = k; j < 2 * n; j++) work[i][j] -= factor * work[k][j];
    }
  }
  for (let k = n - 1; k >= 0; k--) {
    for (let j = n; j < 2 * n; j++) {
      let sum = work[k][j];
      for (let i = k + 1; i < n; i++) sum -= work[k][i] * work[i][j];
      work[k][j] = sum / work[k][k];
    }
  }
  return scaled(work.map((row) => row.slice(n)), sizes);
}

const roots = (A) => A.map((row, i) => Math.sqrt(Math.abs(row[i])));

/** The same, measured by the roots of its diagonal. */
export const scaledInverse = (A) => inverse(A, inverted(roots(A)));

/**
 * To which share of its largest entry an inverse can be known: entries of the matrix, and elimination, each cost what
 * `cartstiff.core.numerics.invert` expects.
 */
export function sureOfInverse(C, K = scaledInverse(C)) {
  if (!K) return 1;
  const sizes = roots(K);
  return 2 * EPSILON * Math.sqrt(squares(scaled(K, inverted(sizes))) * squares(scaled(C, sizes)));
}

/** (C^-1 + D)^-1 from C, as the library finds it. */
export function changed(C, D, length) {
  const sizes = [1, 1, 1, length, length, length];
  const factor = plus(identity(6), scaled(product(D, C), sizes, inverted(sizes)));
  const back = inverse(factor);
  return back && product(C, scaled(back, inverted(sizes), sizes));
}

/** Cosine and sine of the turn that makes the off-diagonal entry d beside a and b vanish. */
function turnThat(a, b, d) {
  const theta = (b - a) / (2 * d);
  const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.hypot(theta, 1));
  const c = 1 / Math.hypot(t, 1);
  return [c, t * c];
}

/** Eigenvalues, smallest first, and eigenvectors as rows, of a symmetric matrix: Jacobi's rotations. */
export function eigen(M) {
  const n = M.length;
  const A = symmetric(M);
  const V = identity(n);
  for (let sweep = 0; sweep < 40; sweep++) {
    let rest = 0;
    for (let p = 0; p < n; p++) {
      for (let q = p + 1; q < n; q++) {
        if (Math.abs(A[p][q]) <= 0.1 * EPSILON * Math.sqrt(Math.abs(A[p][p] * A[q][q])) || A[p][q] === 0) continue;
        rest += 1;
        const [c, s] = turnThat(A[p][p], A[q][q], A[p][q]);
        for (let k = 0; k < n; k++) [A[k][p], A[k][q]] = [c * A[k][p] - s * A[k][q], s * A[k][p] + c * A[k][q]];
        for (let k = 0; k < n; k++) [A[p][k], A[q][k]] = [c * A[p][k] - s * A[q][k], s * A[p][k] + c * A[q][k]];
        for (let k = 0; k < n; k++) [V[p][k], V[q][k]] = [c * V[p][k] - s * V[q][k], s * V[p][k] + c * V[q][k]];
      }
    }
    if (!rest) break;
  }
  const order = A.map((_, i) => i).sort((i, j) => A[i][i] - A[j][j]);
  return { values: order.map((i) => A[i][i]), vectors: order.map((i) => V[i]) };
}

/** Singular values, largest first, and the right vectors as rows: rotations of pairs of columns. */
export function singular(M) {
  const columns = transposed(M).map((column) => column.slice());
  const n = columns.length;
  const V = identity(n);
  for (let sweep = 0; sweep < 60; sweep++) {
    let rest = 0;
    for (let p = 0; p < n; p++) {
      for (let q = p + 1; q < n; q++) {
        const [a, b, d] = [dot(columns[p], columns[p]), dot(columns[q], columns[q]), dot(columns[p], columns[q])];
        if (!(Math.abs(d) > 0.5 * EPSILON * Math.sqrt(a * b))) continue;
        rest += 1;
        const [c, s] = turnThat(a, b, d);
        for (const rows of [columns, V]) {
          const [x, y] = [rows[p], rows[q]];
          rows[p] = x.map((value, k) => c * value - s * y[k]);
          rows[q] = x.map((value, k) => s * value + c * y[k]);
        }
      }
    }
    if (!rest) break;
  }
  const found = columns.map((column, i) => ({ value: Math.hypot(...column), vector: V[i] }))
    .sort((a, b) => b.value - a.value);
  return { values: found.map(({ value }) => value), vectors: found.map(({ vector }) => vector) };
}

// -- rigid motions, as 4 x 4 --------------------------------------------------------------------

export const rotation = (T) => [0, 1, 2].map((i) => T[i].slice(0, 3));
export const place = (T) => [T[0][3], T[1][3], T[2][3]];
export const motion = (R, p) => [...R.map((row, i) => [...row, p[i]]), [0, 0, 0, 1]];
export const moved = (T, v) => [0, 1, 2].map((i) => T[i][0] * v[0] + T[i][1] * v[1] + T[i][2] * v[2] + T[i][3]);

export function back(T) {
  const R = transposed(rotation(T));
  return motion(R, times(R, place(T)).map((x) => -x));
}

export function adjoint(T) {
  const R = rotation(T);
  return blocks(R, zeros(3, 3), product(skew(place(T)), R), R);
}

/** The motion of a twist: its turn, and its shift as it is. */
export function moving(twist) {
  const angle = Math.hypot(...twist.slice(0, 3));
  const axis = twist.slice(0, 3).map((x) => (angle ? x / angle : 0));
  const [s, c] = [Math.sin(angle), 1 - Math.cos(angle)];
  const across = skew(axis);
  const R = identity(3).map((row, i) => row.map((x, k) => x + s * across[i][k] + c * (axis[i] * axis[k] - x)));
  return motion(R, twist.slice(3));
}

/** The motion of a twist along its screw. */
export function screwing(twist) {
  const T = moving(twist);
  const angle = Math.hypot(...twist.slice(0, 3));
  if (!angle) return T;
  const across = skew(twist.slice(0, 3).map((x) => x / angle));
  const v = twist.slice(3);
  const [once, twice] = [times(across, v), times(across, times(across, v))];
  const [c, s] = [(1 - Math.cos(angle)) / angle, 1 - Math.sin(angle) / angle];
  return motion(rotation(T), v.map((x, i) => x + c * once[i] + s * twice[i]));
}

/** Roll, pitch, yaw about the room's axes. */
export function angles(T) {
  const pitch = Math.atan2(-T[2][0], Math.hypot(T[0][0], T[1][0]));
  const yaw = Math.atan2(T[1][0], T[0][0]);
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  return [Math.atan2(s * T[0][2] - c * T[1][2], c * T[1][1] - s * T[0][1]), pitch, yaw];
}

/** A number as %g writes it. */
export function general(x, digits) {
  if (x === 0) return "0";
  const [mantissa, exponent] = x.toExponential(digits - 1).split("e");
  if (Number(exponent) < -4 || Number(exponent) >= digits) return `${Number(mantissa)}e${exponent[0]}${exponent.slice(1)
    .padStart(2, "0")}`;
  return String(Number(x.toPrecision(digits)));
}
