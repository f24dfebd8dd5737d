// The picture without a server: what `cartstiff.scene` would send for a posture, from its `assets`.

import { motion, moved, place, product, rotation, screwing, times } from "./algebra.js";
import { engineering } from "./dom.js";
import { NEGLIGIBLE_DIFFERENCE, ROUNDOFF, ZERO_SHARE } from "./numerics.js";
import { inFrame, principalValues } from "./principal.js";

const ROOT = "/meshcat/cartstiff";

/** The largest of 1, 2, 5 times a power of ten that does not exceed x > 0. */
function round(x) {
  const power = Math.floor(Math.log10(x));
  const lead = x / 10 ** power;
  return Number(`${[5, 2].find((step) => lead >= step * (1 - ROUNDOFF)) ?? 1}e${power}`);
}

// Of scales that go with a power of the length: see `cartstiff.shown.scene.scales`.
const POWERS = { linear: { power: 1, least: 0.05 }, root: { power: 2, least: 0.02 } };
const APART = 30;
// Notes that say why a stiffness does not exist.
const MISSING = ["fewer-than-six-freedoms", "kf-undefined"];

/** A scale from what a legend says of it: a function from a value to a length. */
function scaleOf(facts) {
  if (facts.kind === "log") {
    const { zero_at: zero, length_per_decade: step } = facts;
    return { facts, step, most: Infinity, length: (x) => Math.log10(Math.max(Math.abs(x), zero) / zero) * step };
  }
  const { power } = POWERS[facts.kind];
  const most = facts.cut_at ?? Infinity;
  return { facts, most, length: (x) => Math.min(most, (Math.abs(x) / facts.value_per_length) ** (1 / power)) };
}

/** The largest of some sizes, if it does not lie apart. */
function telling(list) {
  const [next, last] = list.map(Math.abs).sort((a, b) => a - b).slice(-2);
  return next ? Math.min(last, APART * next) : last;
}

/** The scale of a kind for values that are drawn together. */
function fitting(kind, values, usual, target) {
  if (kind === "log") return logarithmic(values, usual, target);
  const { power, least } = POWERS[kind];
  const area = target ** power;
  let per = round((1.6 * telling(largestOf(usual) ? usual : values)) / area);
  const size = telling(values) / per / area;
  if (!(size > least && size <= 2.5)) per *= 10 ** Math.ceil(Math.log10(size / 2.5));
  return scaleOf({ kind, value_per_length: per, cut_at: target * 2.5 ** (1 / power) });
}

function logarithmic(values, usual, target) {
  const least = (list) => Math.min(...list.map(Math.abs).filter((x) => x > ZERO_SHARE * largestOf(list)));
  const of = (list) => {
    const zero = Math.floor(Math.log10(least(list)) - 0.7);
    return [zero, target / Math.ceil(Math.log10(largestOf(list)) - zero)];
  };
  let [zero, step] = of(values);
  if (largestOf(usual)) {
    const [first, per] = of(usual);
    const reach = ((Math.log10(largestOf(values)) - first) * per) / target;
    const low = Math.log10(least(values)) - first;
    if (low >= 0.3 && low <= 3.5 && reach >= 0.6 && reach <= 1.3) [zero, step] = [first, per];
  }
  return scaleOf({ kind: "log", zero_at: Number(`1e${zero}`), length_per_decade: step });
}

/** A length for each factor of ten above `zero`: see `cartstiff.shown.scene.scales.Growing`. */
export const growing = (value, perDecade, zero) => perDecade * Math.log1p(Math.abs(value) / zero) / Math.LN10;

const largestOf = (list) => Math.max(0, ...list.map(Math.abs));

/** Three digits and a unit, as `cartstiff.shown.scene.labels.number`. */
const number = (value, unit, size) => engineering(value, unit, 3, size).replace("\u2212", "-");

/** The words at the axes of an ellipsoid, as `cartstiff.shown.scene.ellipsoids.Said`. */
function saidOf(values, unit, isInverse, ends) {
  const numbers = isInverse ? values.map((x) => (x ? 1 / x : Infinity)) : values;
  const sizes = numbers.filter((x) => x && Math.abs(x) < Infinity).map(Math.abs);
  const words = values[0] > 0 ? [ends[0], "", ends[1]] : ["", "", ""];
  return numbers.map((x, i) => `${words[i]} ${number(x, unit, sizes.length ? Math.min(...sizes) : 0)}`.trimStart());
}

export class Drawing {
  constructor(program, assets, scene) {
    this.program = program;
    this.assets = assets;
    this.scene = scene; // {units, notes}
    this.seen = new Map(); // what was sent of each path, so that only changes are
    this.texts = new Map();
  }

  // -- commands ---------------------------------------------------------------------------------

  /** A place and its motion, as columns. */
  put(path, columns) {
    const matrix = columns.flatMap((column, i) => [...column, i === 3 ? 1 : 0]);
    this.commands.push({ type: "set_transform", path: `${ROOT}/${path}`, matrix });
  }

  pose(path, T) {
    this.put(path, [0, 1, 2, 3].map((j) => [T[0][j], T[1][j], T[2][j]]));
  }

  show(path, visible) {
    if (this.seen.get(path) === visible) return;
    this.seen.set(path, visible);
    this.commands.push({ type: "set_property", path: `${ROOT}/${path}`, property: "visible", value: visible });
  }

  write(path, text, point, kind) {
    const { letters: { light, dark } } = this.assets;
    if (this.texts.get(path) !== text) {
      this.texts.set(path, text);
      const [letters, paper] = [kind, "paper"].map((name) => [light[name], dark[name]]);
      this.commands.push({ type: "label", path: `${ROOT}/${path}`, text, letters, paper, height: this.assets.label });
    }
    this.put(path, [[1, 0, 0], [0, 1, 0], [0, 0, 1], point]);
    this.show(path, true);
  }

  // -- parts ------------------------------------------------------------------------------------

  /** Everything at a solved posture; {commands, legend}, the legend as `cartstiff.scene.Scene.draw` returns it. */
  draw(m, state, { moved }) {
    this.commands = [];
    const { assets, scene: { units, notes } } = this;
    this.mechanism("mechanism", m);
    const tension = m.tensions ? this.tensions(m) : null; // whose colours come with the page, see `legColours`
    this.pose("M", m.pose);
    this.ghost(state);
    const here = inFrame(m, state.point.some((x) => x) ? motion([[1, 0, 0], [0, 1, 0], [0, 0, 1]], state.point) : null);
    const resisted = moved?.resisted;
    const drawn = { ...state, quantity: state.drawn ?? (resisted ? "compliance" : state.quantity) };
    here.principal = principalValues(here, drawn);
    const missing = this.program.notes(m, state).findLast(({ code }) => MISSING.includes(code))?.message
      ?? `K^${state.connection} does not exist here`;
    const [translation, rotation] = ["translation", "rotation"]
      .map((freedom) => this.ellipsoid(freedom, here, drawn, missing, state.quantity));
    const legend = { length: { unit: units.length, bar: assets.bar, size: assets.size,
      scene_units_per_unit: assets.scale },
      others: state.others, quantity: drawn.quantity, rest: this.rest(m, state, moved),
      ellipsoids: { translation, rotation }, wrench: this.arrows(m, here, state), tension, notes };
    return { commands: this.commands, legend };
  }

  mechanism(root, { pose, frames }) {
    const { assets, program } = this;
    if (program.data.platform) {
      this.pose(`${root}/body`, pose);
      program.data.points.forEach((point, i) => {
        const [start, end] = [program.data.anchors[i], moved(pose, point)];
        this.segment(`${root}/legs/line ${i + 1}/rod`, start, end);
        if (assets.telescope) this.segment(`${root}/legs/line ${i + 1}/tube`, start, end, assets.telescope);
      });
      return;
    }
    for (const joint of assets.joints) this.pose(`${root}/joint ${joint}`, frames[joint - 1]);
    for (const [name, parent, start, joint] of assets.sliders) {
      this.segment(`${root}/${name}`, parent ? moved(frames[parent - 1], start) : start, place(frames[joint - 1]));
    }
  }

  segment(path, start, end, most = Infinity) {
    const along = end.map((x, i) => x - start[i]);
    const length = Math.hypot(...along);
    const [x, y, z] = length ? across(along) : [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const shown = Math.min(Math.max(length, NEGLIGIBLE_DIFFERENCE), most);
    this.put(path, [x.map((c) => c * shown), y, z, start]);
  }

  tensions(m) {
    const most = largestOf(m.tensions);
    const near = most && 2 * round(most);
    const limit = near < most ? 5 * round(most) : near;
    return { limits: [-limit, limit], unit: this.scene.units.force };
  }

  ghost(state) {
    this.show("ghost", state.ghost !== null);
    if (!state.ghost) return;
    this.mechanism("ghost", this.program.place(state.ghost));
  }

  /** The mechanism without the load, enlarged, see `cartstiff.shown.scene.enlarged`; how much. */
  rest(m, state, moved) {
    const factor = state.deflection && moved?.resisted ? this.factor(m, state, moved) : null;
    this.show("rest", factor !== null);
    if (factor === null) return null;
    const { program } = this;
    const step = program.way(m).map((x) => -factor * x);
    const q = program.data.platform ? program.coordinates(product(m.pose, screwing(step)), m.q)
      : program.along(m, step);
    const there = program.place(q);
    this.mechanism("rest", there);
    this.pose("rest/M", there.pose);
    return { enlarged: factor, mode: null };
  }

  factor(m, { enlarged }, { displacement, of_frame: shift, motion }) {
    const { platform, are_lengths: areLengths } = this.program.data;
    const [far, round_, mostFar, mostRound] = this.assets.enlarged;
    const way = Math.max(Math.hypot(...displacement), Math.hypot(...shift));
    const turned = platform ? Math.hypot(...motion.slice(0, 3))
      : Math.max(...motion.map((x, i) => Math.abs(x) / (areLengths[i] ? m.length : 1)));
    const { size } = this.assets;
    if (!(way > ROUNDOFF * size || turned > ROUNDOFF)) return null;
    const upTo = (most, turn) => Math.min(way ? (most * size) / way : Infinity, turned ? turn / turned : Infinity);
    return enlarged === null ? round(upTo(far, round_)) : Math.min(enlarged, upTo(mostFar, mostRound));
  }

  ellipsoid(freedom, here, state, missing, said) {
    const { assets } = this;
    const [quantity, root] = [state.quantity, `${freedom} ellipsoid`];
    const other = quantity === "stiffness" ? "compliance" : "stiffness";
    this.show(`${root}/${other}`, false);
    const at = `${root}/${quantity}`;
    const found = here.principal?.[freedom];
    this.show(at, state[freedom] && found !== undefined);
    if (!state[freedom]) return null;
    if (!found) return { shown: false, reason: missing };
    const { values, definiteness: kind } = found;
    const R = rotation(here.pose);
    const axes = found.axes.map((v) => times(R, v));
    const isFlat = kind === "positive semidefinite";
    const solid = isFlat || kind === "positive";
    const unit = assets.units[`${quantity}/${freedom}`];
    const kept = state.measures?.[freedom];
    const scale = kept?.kind === state.scale ? scaleOf(kept)
      : fitting(state.scale, values, assets.usual[`${quantity}/${freedom}`], assets.radius);
    const [lengths, centre] = [values.map(scale.length), place(here.pose)];
    const ends = quantity === "stiffness" ? ["softest", "stiffest"] : ["stiffest", "softest"];
    const words = saidOf(values, assets.units[`${said}/${freedom}`], said !== quantity, ends);
    const along = (v, x, from = [0, 0, 0]) => v.map((c, i) => from[i] + x * c);
    this.show(`${at}/body`, solid);
    if (solid) this.put(`${at}/body`,
      [...axes.map((v, i) => along(v, Math.max(lengths[i], isFlat ? assets.flat : assets.thin))), centre]);
    axes.forEach((v, i) => {
      const path = `${at}/axis ${i + 1}`;
      const shown = state.labels && lengths[i] > 0;
      this.show(path, shown);
      if (shown) {
        this.show(`${path}/plus`, values[i] >= 0);
        this.show(`${path}/minus`, values[i] < 0);
        const half = Math.max(lengths[i], assets.shortest);
        const isCut = lengths[i] >= scale.most;
        this.show(`${path}/cut`, isCut);
        this.put(path, [along(v, 2 * half), axes[(i + 1) % 3], axes[(i + 2) % 3], along(v, -half, centre)]);
        this.write(`${at}/value ${i + 1}`, words[i] + (isCut ? assets.cut : ""),
          along(v, (freedom === "translation" ? 1.08 : -1.08) * half, centre), freedom);
      } else this.show(`${at}/value ${i + 1}`, false);
    });
    for (let k = 1; k <= assets.rings; k++) {
      const radius = solid ? k * (scale.step ?? 0) : 0;
      const shown = radius > 0 && radius < Math.max(...lengths);
      this.show(`${at}/ring ${k}`, shown);
      if (shown) this.put(`${at}/ring ${k}`, [...[1, 2, 0].map((i) => along(axes[i], radius)), centre]);
    }
    const reason = isFlat ? assets.flat_words[values.filter((x) => x === 0).length]
      : kind === "zero" ? "it is zero" : `${kind}, softest ${number(values[0], unit,
        Math.min(...values.filter(Boolean).map(Math.abs)))}`;
    return { shown: solid, reason: kind === "positive" ? null : reason, unit, scale: scale.facts,
      cut: Math.max(...lengths) >= scale.most };
  }

  arrows(m, here, state) {
    const { units } = this.scene;
    const wrench = this.program.shownWrench(m, here.wrench);
    const facts = { wrench, units, scale: this.assets.arrows };
    for (const [kind, vector] of [["force", wrench.slice(3)], ["moment", wrench.slice(0, 3)]]) {
      const size = Math.hypot(...vector);
      const path = `wrench/${kind}`;
      const shown = state.wrench && size > 0;
      this.show(path, shown);
      if (!shown) continue;
      const { length_per_decade: per, zero_at: zero } = this.assets.arrows[kind];
      const length = facts[kind] = growing(size, per, zero);
      const [along, centre] = [times(rotation(here.pose), vector), place(here.pose)];
      this.put(`${path}/arrow`, [...across(along).map((v) => v.map((c) => c * length)), centre]);
      if (state.labels) this.write(`${path}/label`, number(size, units[kind]),
        centre.map((x, i) => x + (1.1 * length * along[i]) / size), "load");
      else this.show(`${path}/label`, false);
    }
    return facts;
  }

  // -- how much room ------------------------------------------------------------------------------

  /** Two corners of what has to be seen, in the viewer's units. */
  bounds({ pose, frames }) {
    const { assets, program } = this;
    const tool = place(pose);
    const points = [...assets.around, ...[-1, 1].map((side) => tool.map((x) => x + side * assets.radius))];
    if (program.data.platform) points.push(...program.data.anchors,
      ...program.data.points.map((point) => moved(pose, point)));
    else {
      points.push([0, 0, 0], ...frames.map(place));
      for (const [joint, box] of assets.boxes) points.push(...box.map((corner) =>
        (joint ? moved(frames[joint - 1], corner) : corner)));
    }
    return [Math.min, Math.max].map((least) => [0, 1, 2]
      .map((i) => assets.scale * (least(...points.map((p) => p[i])) - assets.middle[i])));
  }
}

/** Columns of a rotation whose x axis is a direction. */
function across(direction) {
  const size = Math.hypot(...direction);
  const [a, b, c] = direction.map((x) => x / size);
  if (Math.abs(a) < 0.6) {
    const n = Math.hypot(b, c);
    return [[a, b, c], [0, c / n, -b / n], [-n, (a * b) / n, (a * c) / n]];
  }
  const n = Math.hypot(a, b);
  return [[a, b, c], [-b / n, a / n, 0], [(-a * c) / n, (-b * c) / n, n]];
}

/** A colour of a table with equal steps, at a share from 0 to 1. */
export function between(table, share) {
  const at = share * (table.length - 1);
  const low = Math.min(Math.floor(at), table.length - 2);
  return table[low].map((x, i) => x + (at - low) * (table[low + 1][i] - x));
}
