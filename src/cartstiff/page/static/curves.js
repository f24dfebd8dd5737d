// What plots show: each from the numbers of one posture, with its words and its unit.

import { FINE } from "./deflection.js";

const THREE = ["least", "middle", "largest"];
const MILLI = 1000;

const size = (v) => Math.hypot(...v);
const principal = (kind) => ({ principal: found }) => found?.[kind].values ?? null;
const resisted = (of) => ({ moved }) => (moved?.resisted ? [of(moved)] : null);
const only = (...values) => (values.every((x) => x === null || x === undefined) ? null : values.map((x) => x ?? null));

/** `of` reads numbers, in the units of the mechanism; `scale` says what one of these is in `unit`. */
export const CURVES = [
  { key: "deflection", words: "deflection", title: () => "How far the load moves the point", nothing: "no load: nothing moves",
    of: resisted(({ displacement }) => size(displacement)), scale: (store) => fine(store)[0], unit: (store) => fine(store)[1] },
  { key: "turn", words: "turn under the load", title: () => "How far the load turns the body", nothing: "no load: nothing turns",
    of: resisted(({ rotation }) => size(rotation)), scale: () => MILLI, unit: () => "mrad" },
  { key: "translation", words: "translation", title: (store) => `Principal ${store.state.quantity} of translation`, lines: THREE,
    of: principal("translation"), scale: (store) => store.read(1), unit: (store) => store.blockUnits()[1][1] },
  { key: "rotation", words: "rotation", title: (store) => `Principal ${store.state.quantity} of rotation`, lines: THREE,
    of: principal("rotation"), scale: () => 1, unit: (store) => store.blockUnits()[0][0] },
  { key: "condition", words: "condition", title: () => "Condition number of the stiffness, of its translations, of its rotations",
    lines: ["whole", "translation", "rotation"], nothing: "the stiffness does not exist here", unit: () => "1", scale: () => 1,
    of: ({ indices }) => indices && only(indices.condition_number, indices.translational_condition, indices.rotational_condition) },
  { key: "singularity", words: "singular values", title: () => "Smallest over largest singular value: 0 at a singularity", unit: () => "1", scale: () => 1,
    of: ({ singularity }) => (singularity.length ? [Math.min(...singularity.map(({ ratio }) => ratio))] : null) },
  { key: "energy", words: "energy", title: () => "Energy that potentials store at the posture", nothing: "no energy is stored",
    of: ({ result }) => only(result.energy), scale: () => 1, unit: (store) => store.unit("moment") },
  { key: "leg_force", words: "leg force", title: () => "Largest force of a leg", nothing: "no legs, or none with a force",
    of: ({ legs }) => (legs?.some(({ tension }) => tension !== null) ? [Math.max(...legs.map(({ tension }) => Math.abs(tension ?? 0)))] : null),
    scale: () => 1, unit: (store) => store.unit("force") },
];

const fine = (store) => FINE[store.unit("length")] ?? [1, store.unit("length")];

/** One posture of a sweep or a trajectory, as the server answers it. */
export const rowOf = (numbers, q) => ({ q, position: numbers.position, margins: [],
  ...Object.fromEntries(CURVES.map(({ key, of }) => [key, of(numbers)])) });

/** What the plot shows: values of a row, in the unit that is shown; words. */
export function shown(store, key) {
  const curve = CURVES.find((each) => each.key === key);
  const lines = curve.lines ?? [curve.words];
  return {
    lines,
    unit: curve.unit(store),
    title: curve.title(store),
    values: (row) => row?.[key]?.map((x) => (x === null ? null : x * curve.scale(store))) ?? null,
    nothing: curve.nothing ?? (store.state.quantity === "stiffness" ? "the stiffness does not exist here; the compliance may" : "the compliance does not exist here"),
    legend: [`${lines.length > 1 ? `line: ${lines[0]}${lines === THREE ? " value" : ""}; dashes: ${lines[1]}; dots: ${lines[2]}; ` : ""}grey: nothing exists; hatched: a value is negative`],
  };
}
