// What is read from matrices: principal values, softest directions, signs, asymmetry; and matrices in other frames.

import { adjoint, back, block, congruence, cross, eigen, identity, largest, product, rotation, scaled, squares, times,
  transposed } from "./algebra.js";
import { NEGLIGIBLE_DIFFERENCE, SYMMETRY, UNCOUPLED, ZERO_SHARE } from "./numerics.js";

/** What multiplies the parts of a twist, so that turns are lengths: rotations by a length. */
export const turnsBy = (length) => [length, length, length, 1, 1, 1];

const upright = (v) => (v.reduce((most, x) => (Math.abs(x) > Math.abs(most) ? x : most), 0) < 0 ? v.map((x) => -x) : v);

/** Matrices and wrench in a frame N of the body; `T` is null for M itself. */
export function inFrame(m, T) {
  let [stiffness, compliance, wrench, tangent] = [m.K, m.C, m.W, m.tangent];
  if (T) {
    const [forth, reverse] = [adjoint(T), transposed(adjoint(back(T)))];
    const each = (table, by) => Object.fromEntries(Object.entries(table)
      .map(([name, M]) => [name, M && congruence(by, M)]));
    [stiffness, compliance, wrench] = [each(m.K, forth), each(m.C, reverse), times(transposed(forth), m.W)];
    tangent &&= congruence(reverse, tangent);
  }
  const both = (table) => ({ ...table, "+": table.A && transposed(table.A) });
  // Without a stiffness: the compliance with which other freedoms are held, that of a symmetric one.
  const held = { ...compliance, A: compliance.B, "+": compliance.B, load: tangent };
  return { stiffness: both(stiffness), compliance: both(compliance), held, wrench,
    pose: T ? product(m.pose, T) : m.pose };
}

/**
 * Principal values of translation and of rotation with their axes, the other freedoms free or held; null without a
 * matrix.
 */
export function principalValues(here, { quantity, connection, others }) {
  const M = here[quantity][connection];
  if (!M) return null;
  // With the others free they are those of a block of the compliance, else of one of the stiffness.
  const free = others === "free";
  const isKnown = here.stiffness[connection] !== null;
  const inverted = isKnown && free === (quantity === "stiffness");
  const of = inverted ? here[free ? "compliance" : "stiffness"][connection] : M;
  const found = {};
  for (const [name, first] of [["translation", 3], ["rotation", 0]]) {
    const part = block(of, first);
    let { values, vectors } = eigen(isKnown || free ? part : heldBlock(here.held[connection], first));
    if (!isKnown) values = known(values, largest(part));
    if (inverted) {
      const order = values.map((x, i) => [1 / x, vectors[i]]).sort(([x], [y]) => x - y);
      [values, vectors] = [order.map(([x]) => x), order.map(([, v]) => v)];
    }
    const [x, y] = vectors.slice(0, 2).map(upright);
    found[name] = { values, axes: [x, y, cross(x, y)], definiteness: definiteness(values) };
  }
  return found;
}

/** A block of a compliance without an inverse, the other freedoms held: C_kk - C_ko C_oo^+ C_ok. */
function heldBlock(C, first) {
  const others = 3 - first;
  const { values, vectors } = eigen(block(C, others));
  const edge = product(vectors, [0, 1, 2].map((i) => C[others + i].slice(first, first + 3)));
  const gains = known(values).map((x) => (x ? 1 / x : 0));
  const taken = congruence(edge, scaled(identity(3), gains, [1, 1, 1]));
  return block(C, first).map((row, i) => row.map((x, j) => x - taken[i][j]));
}

/** Eigenvalues of a matrix without an inverse, zero where they are rounding beside a size. */
const known = (values, size = largest([values])) => values.map((x) => (Math.abs(x) > ZERO_SHARE * size ? x : 0));

/** As `cartstiff.shown.page.shown.softest_in_room`. */
export function softest({ compliance, stiffness, pose }) {
  const { values: all, vectors } = eigen(block(compliance.load, 3));
  const values = stiffness.load ? all : known(all);
  if (!(values[0] >= 0 && values[2] > 0)) return null;
  return { stiffness: 1 / values[2], direction: values[2] - values[1] > NEGLIGIBLE_DIFFERENCE * values[2]
    ? upright(times(rotation(pose), vectors[2])) : null };
}

/**
 * Largest entry of M - M^T; 0 where each is round-off beside its block, as
 * `cartstiff.answer.analysis.asymmetry.is_roundoff`.
 */
export function asymmetry(M) {
  const skew = M.map((row, i) => row.map((x, j) => x - M[j][i]));
  const [rr, rt, tt] = [[0, 0], [0, 3], [3, 3]].map(([i, j]) =>
    squares(M.slice(i, i + 3).map((row) => row.slice(j, j + 3))) ** 0.5);
  const size = (i, j) => (i !== j ? Math.sqrt(rr * tt) || rt : i ? tt : rr) || 1;
  const counts = skew.some((row, i) => row.some((x, j) => Math.abs(x) > SYMMETRY * size(+(i > 2), +(j > 2))));
  return counts ? largest(skew) : 0;
}

export function definiteness(values) {
  const [below, above, none] = [values.some((x) => x < 0), values.some((x) => x > 0), values.some((x) => x === 0)];
  if (below && above) return "indefinite";
  if (above) return none ? "positive semidefinite" : "positive";
  return below ? (none ? "negative semidefinite" : "negative") : "zero";
}

/**
 * Cells in which matrices by name differ, the largest difference first: their values by name, the names of the largest
 * and the smallest, and the difference as a share of the geometric mean of two diagonal entries of the first matrix.
 */
export function differences(matrices) {
  const known = Object.entries(matrices).filter(([, M]) => M);
  if (known.length < 2) return [];
  const [[, first]] = known;
  const found = [];
  first.forEach((row, i) => row.forEach((_, j) => {
    const values = known.map(([name, M]) => [name, M[i][j]]);
    const [least, most] = [Math.min, Math.max].map((end) => end(...values.map(([, x]) => x)));
    const share = (most - least) / Math.sqrt(Math.abs(first[i][i] * first[j][j]));
    if (!(share > UNCOUPLED)) return;
    // Of several that are alike but for rounding, the one that comes first.
    const [low, high] = [least, most].map((end) =>
      values.find(([, x]) => Math.abs(x - end) <= NEGLIGIBLE_DIFFERENCE * Math.abs(most - least))[0]);
    found.push({ i, j, values: Object.fromEntries(values), low, high, share });
  }));
  return found.sort((a, b) => b.share - a.share);
}
