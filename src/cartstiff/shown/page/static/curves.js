// What plots show: each from the numbers of one posture, with its words and its unit. Words and
// units are of the state that the numbers are of.

import { inSize } from "./dom.js";
import { freeness } from "./numbers.js";
import { inWords } from "./store.js";

/** The words of three principal values, smallest first. */
const extremes = ({ quantity }) => (quantity === "stiffness" ? ["softest", "middle", "stiffest"]
  : ["stiffest", "middle", "softest"]);

const size = (v) => Math.hypot(...v);
const principal = (kind) => ({ principal: found }) => found?.[kind].values ?? null;
const resisted = (of) => ({ moved }) => (moved?.resisted ? [of(moved)] : null);
const UNSTABLE = "unstable: the load pushes it away";
const only = (...values) => (values.every((x) => x === null || x === undefined) ? null : values.map((x) => x ?? null));

/**
 * `of` reads numbers, in the units of the mechanism; `nothing` says why a row has no value. The `worst` posture is that
 * of the largest value (1) or of the smallest (-1); of a stiffness of the smallest, of a compliance of the largest.
 */
export const CURVES = [
  { key: "deflection", worst: 1, words: "deflection", title: () => "How far the load moves the point",
    nothing: ({ unstable }) => (unstable ? UNSTABLE : "no load: nothing moves"),
    of: resisted(({ displacement }) => size(displacement)), unit: (store) => store.unit("length") },
  { key: "turn", worst: 1, words: "turn under the load", title: () => "How far the load turns the body",
    nothing: ({ unstable }) => (unstable ? UNSTABLE : "no load: nothing turns"),
    of: resisted(({ rotation }) => size(rotation)), unit: () => "rad" },
  { key: "translation", words: "translation", title: (_, state) =>
    `Principal ${state.quantity} of translation, ${freeness(state)[0]}`, lines: extremes,
    of: principal("translation"), unit: (store, { quantity }) => store.blockUnits(quantity)[1][1] },
  { key: "rotation", words: "rotation", title: (_, state) =>
    `Principal ${state.quantity} of rotation, ${freeness(state)[1]}`, lines: extremes,
    of: principal("rotation"), unit: (store, { quantity }) => store.blockUnits(quantity)[0][0] },
  { key: "condition", worst: 1, words: "condition",
    title: () => "Condition number of the stiffness, of its translations (rotation held), of its rotations "
      + "(translation held)",
    lines: ["whole", "translation", "rotation"], nothing: () => "the stiffness does not exist here", unit: () => "1",
    of: ({ indices }) => indices && only(indices.condition_number, indices.translational_condition,
      indices.rotational_condition) },
  { key: "singularity", worst: -1, words: "singular values", title: () =>
    "Smallest over largest singular value: 0 at a singularity", unit: () => "1",
    of: ({ singularity }) => (singularity.length ? [Math.min(...singularity.map(({ ratio }) => ratio))] : null) },
  { key: "energy", worst: 1, words: "energy", title: () => "Energy that potentials store at the posture",
    nothing: () => "no energy is stored",
    of: ({ result }) => only(result.energy), unit: (store) => store.unit("moment") },
  { key: "leg_force", worst: 1, words: "leg force", title: () => "Largest force of a leg",
    nothing: () => "no legs, or none with a force",
    of: ({ legs }) => (legs?.some(({ tension }) => tension !== null)
      ? [Math.max(...legs.map(({ tension }) => Math.abs(tension ?? 0)))] : null),
    unit: (store) => store.unit("force") },
];

/** One posture of a sweep or a trajectory, as the server answers it. */
export const rowOf = (numbers, q) => ({ q, position: numbers.position, unstable: numbers.moved?.resisted === false,
  ...Object.fromEntries(CURVES.map(({ key, of }) => [key, of(numbers)])) });

/** Why a posture is not reached; of the drives that would have to move to close the loops, the two that move most. */
function reasonOf(store, { reason, moved }) {
  if (!moved?.length) return reason;
  const most = moved.toSorted(([, a, b], [, c, d]) => Math.abs(d - c) - Math.abs(b - a)).slice(0, 2);
  const words = most.map(([i, ...ends]) =>
    `${store.hello.mechanism.coordinates[i].name} moves from ${ends.map((x) => inWords(store, i, x)).join(" to ")}`);
  const more = moved.length > 2 ? `; and ${moved.length - 2} more` : "";
  return `the loops do not close with the drives there: ${words.join("; ")}${more}`;
}

/** What the plot of a state shows: values of a row, in a unit of the rows' size; words. */
export function plotted(store, key, state, rows) {
  const curve = CURVES.find((each) => each.key === key);
  const sizes = rows.flatMap((row) => row?.[key] ?? []).map(Math.abs).filter((x) => x > 0 && x < Infinity)
    .sort((a, b) => a - b);
  // In the page's unit of the quantity, if it has one.
  const [factor, unit] = inSize(store.sizes[key] ?? sizes[sizes.length >> 1] ?? 0, curve.unit(store, state));
  const worst = curve.worst ?? (state.quantity === "stiffness" ? -1 : 1);
  const counted = worst < 0 || key === "condition" ? 0 : -1; // of several lines
  const lines = typeof curve.lines === "function" ? curve.lines(state) : curve.lines ?? [curve.words];
  const values = (row) => row?.[key]?.map((x) => (x === null ? null : x / factor)) ?? null;
  return {
    lines,
    worst,
    read: (x) => x / factor,
    unit,
    title: curve.title(store, state),
    values,
    one: (row) => values(row)?.at(counted) ?? null,
    called: lines.length > 1 ? `${curve.words}, ${lines.at(counted)}` : curve.words,
    why: (row) => reasonOf(store, row) ?? curve.nothing?.(row)
      ?? (state.quantity === "stiffness" ? "the stiffness does not exist here; the compliance may"
        : "the compliance does not exist here"),
    legend: ["grey: no value; hatched: a value is negative"],
  };
}
