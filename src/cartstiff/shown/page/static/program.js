// Answers without a server: formulas, the numbers that are read from them, and here notes, verdict and doubts.

import { eigen, general, identity, largest, motion, place, product, rotation, scaled, symmetric,
  transposed } from "./algebra.js";
import { engineering } from "./dom.js";
import { LIMIT_SLACK, NEAR_SINGULARITY, NEGLIGIBLE_DIFFERENCE, SYMMETRY, ZERO_SHARE } from "./numerics.js";
import { asymmetry, inFrame, principalValues, softest, turnsBy } from "./principal.js";
import { Readings } from "./readings.js";

export class Program extends Readings {
  /** As `cartstiff.shown.page.shown.shown_numbers`. */
  numbers(state, m = this.solve(state)) {
    const T = state.axes === "body" && !state.point.some((x) => x) ? null
      : motion(state.axes === "body" ? identity(3) : transposed(rotation(m.pose)), state.point);
    const here = inFrame(m, T);
    const shown = here[state.quantity];
    const K = here.stiffness[state.connection] && symmetric(here.stiffness[state.connection]);
    const indices = K && this.indices(K);
    const own = Object.keys(this.data.own ?? {});
    const asymmetries = Object.fromEntries(Object.entries(shown).map(([name, M]) => [name, M && asymmetry(M)]));
    const notes = this.notes(m, state);
    const found = softest(here);
    return {
      q: m.straight, result: this.part(m, state.quantity, notes), has_compliance: true, position: place(m.pose),
      frame: T, stiffness: null, compliance: null, wrench: here.wrench, principal: principalValues(here, state),
      indices, symmetric: { ...asymmetries, "+": asymmetries.A }, singularity: this.distance(m), legs: this.legs(m),
      moved: this.moved(m, state),
      modes: state.mode === null ? null : { missing: "Modes are computed by `cartstiff view`." },
      softest: found && { ...found, which: this.which(found.direction, true) },
      verdict: this.verdict(indices?.definiteness, notes, state, m), doubts: this.doubts(notes, state),
      ...(own.length ? { own: Object.fromEntries(own.map((name) => [name, shown[name]])) } : {}),
      ...(T ? { [state.quantity]: Object.fromEntries(Object.entries(shown).filter(([name]) => name !== "+")) } : {}),
    };
  }

  /** What `cartstiff analyse --json` prints. */
  result(state) {
    const m = this.solve(state);
    /** @type {any} */
    const found = { ...this.data.base, ...this.part(m, "stiffness", this.notes(m, state)), jacobian: m.jacobian ?? null,
      compliance: this.matrices(m.C) };
    delete found.stored_energy; // gravity's part is not told apart here
    if (found.legs) found.legs = this.drives(m, found.legs);
    if (found.forces) found.forces = this.forces(m);
    if (found.task_axes) found.task_axes = this.taskAxes(m, found.task_axes);
    return found;
  }

  notes(m, state) {
    const { data } = this;
    const notes = data.notes.flatMap((note) => (note.code === "stiffness-assumed" ? this.stillAssumed(note, state)
      : [note]));
    notes.push(...this.adjustedNotes(m));
    const { serial, "type-2": held } = m.singular;
    const size = { characteristic_length: m.length };
    if (this.freedoms < 6 && serial) {
      notes.push({ code: "fewer-than-six-freedoms",
        message: `the end-effector cannot move in ${6 - this.freedoms} of 6 directions here: the stiffness matrix `
          + "does not exist, the compliance does; the wrench along them is carried by the structure"
          + (m.given ? "" : " and is taken as zero in the scaled norm"),
        values: { rank: this.freedoms, singular_values: serial.values, ...size } });
    }
    if (serial && this.least(serial) < NEAR_SINGULARITY) {
      notes.push({ code: "near-serial-singularity",
        message: `the end-effector hardly moves in one direction: smallest over largest singular value `
          + `${general(this.least(serial), 2)}`,
        values: { singular_values: serial.values, ...size } });
    }
    if (held && this.least(held) < NEAR_SINGULARITY) {
      const { values, vectors } = held;
      const weak = values.filter((x) => x < NEAR_SINGULARITY * values[0]).length;
      const all = m.orthonormal ? product(vectors, transposed(m.orthonormal)) : vectors;
      notes.push({ code: "near-type-2-singularity",
        message: `the actuators hardly hold the mechanism in ${weak} direction(s): smallest over largest singular `
          + `value ${general(this.least(held), 2)}`,
        values: { singular_values: values, ...size, directions: all.slice(-weak)
          .map((v) => v.map((x, i) => x * m.sizes[i])) } });
    }
    notes.push(...this.beyond(m), ...this.overloaded(m), ...this.implausible(m),
      ...(m.given ? data.loaded_rest_notes : data.rest_notes), ...this.indefinite(m), ...data.last_notes);
    return notes;
  }

  /** The note on what springs and load do not keep, as `cartstiff.core.stiffness.posture_notes.indefinite`. */
  indefinite(m) {
    const [K, C] = [m.K.load, m.C.load];
    if ([K, C].some((M) => M && asymmetry(M))) return [];
    const spectra = [K && scaled(K, turnsBy(1 / m.length)), C && scaled(C, turnsBy(m.length))].filter(Boolean)
      .map((M) => eigen(M).values);
    const below = (values) => values.filter((x) => x < -ZERO_SHARE * Math.max(...values.map(Math.abs))).length;
    const negative = Math.max(0, ...spectra.map(below));
    if (!negative) return [];
    const unit = K ? m.length ** 2 : 1 / m.length ** 2; // lengths, not angles, are of size one there
    return [{ code: "indefinite",
      message: `the stiffness is negative along ${negative} motion(s) of the body, under the load and the tensions `
        + `here: the posture is not stable, `
      + "and without something else that holds it the mechanism moves away",
    values: { eigenvalues: spectra[0].map((x) => x * unit).sort((a, b) => a - b), characteristic_length: m.length } }];
  }

  /** The note on assumed stiffnesses without springs that were replaced, as `cartstiff.core.notes.still_assumed`. */
  stillAssumed(note, state) {
    const { some_assumed: words } = this.data;
    const joints = note.values.joints.filter((name) => !this.isReplaced(name, state));
    if (joints.length === note.values.joints.length) return [note];
    return joints.length ? [{ ...note, message: words.replace("{}", joints.join(", ")),
      values: { ...note.values, joints } }] : [];
  }

  /** The note on what a load deflects implausibly, as `cartstiff.core.mechanisms.limits.deflection_notes`. */
  implausible(m) {
    const [words, values, unit] = this.data.platform ? this.stretched(m) : this.woundUp(m);
    return words.length ? [{ code: "implausible-deflection", values,
      message: `${words.join("; ")}. Is the load meant, and the unit of the springs (${unit})?` }] : [];
  }

  /** Legs that a load stretches; where rest lengths were given and no load was, the stretch is meant. */
  stretched(m) {
    const { doubted: { rest_is_open: isOpen, legs, share, names, force, springs }, length_unit: unit } = this.data;
    const { lengths, tensions } = m;
    const stretch = tensions.map((tension, i) => tension / m.stiffness[i]);
    const isLong = (i) => (isOpen || m.given) && Math.abs(stretch[i]) > share * lengths[i];
    const long = bySize(stretch, legs.filter(isLong));
    const words = long.slice(0, 3).map((i) => `${names[i]} changes its length of ${sized(lengths[i], unit)} by `
      + `${sized(stretch[i], unit)} under ${sized(tensions[i], force)}, at ${sized(m.stiffness[i], springs[1])}`);
    return [words, { stretch: Object.fromEntries(long.map((i) => [names[i], stretch[i]])) }, "1 N/um is 1e6 N/m"];
  }

  /** Joints that a load winds up, and how far it moves the tip of an arm. */
  woundUp(m) {
    const { doubted: { turn, undriven, share, reach, names, moment, springs }, are_lengths: slides } = this.data;
    const wound = m.torques.map((x, j) => (x === 0 || undriven.includes(j) ? 0 : -x / m.stiffness[j]));
    const angles = wound.map((x, j) => (slides[j] ? 0 : Math.abs(x)));
    const most = bySize(angles, [...angles.keys()].filter((j) => angles[j] > turn));
    const turned = angles.map((x) => general((x * 180) / Math.PI, 3));
    const words = most.slice(0, 3).map((j) => `joint '${names[j]}' winds up by ${turned[j]} deg under `
      + `${sized(m.torques[j], moment)}, at ${sized(m.stiffness[j], springs[0])}`);
    if (most.length > 3) words.push(`${most.slice(3).map((j) => names[j]).join(", ")}: more than 5 deg`);
    const values = { wind_up: Object.fromEntries(most.map((j) => [names[j], wound[j]])) };
    const isSmall = !slides.some(Boolean) && angles.reduce((sum, x) => sum + x, 0) <= turn;
    if (reach && !isSmall) {
      const there = this.run("free", { q: m.q.map((x, j) => x - wound[j]) })("pose", 4);
      const moved = Math.hypot(...place(m.pose).map((x, i) => x - there[i][3]));
      if (moved > share * reach) {
        const [way, whole] = [moved, reach].map((x) => sized(x, this.data.length_unit));
        words.push(`the tip moves by ${way}, its reach is ${whole}`);
        Object.assign(values, { moved, reach });
      }
    }
    return [words, values, "1 N m/arcmin is 3438 N m/rad"];
  }

  /**
   * Drives that the closures have moved, each [coordinate, from, to]: more of them than there are motions are not all
   * free.
   */
  adjusted({ straight: q, asked }) {
    return this.data.actuated.filter((j) => Math.abs(q[j] - asked[j]) > NEGLIGIBLE_DIFFERENCE)
      .map((j) => [j, asked[j], q[j]]);
  }

  adjustedNotes(m) {
    const moved = this.adjusted(m);
    if (!moved.length) return [];
    const { joints } = this.data.base.mechanism;
    const words = moved.map(([j, from, to]) => `${joints[j]} ${general(from, 6)} -> ${general(to, 6)} ${this.unit(j)}`);
    return [{ code: "actuators-adjusted",
      message: `the chain does not close with its joints as given, and they moved: ${words.join(", ")}`,
      values: Object.fromEntries(moved.map(([j, from, to]) => [joints[j], to - from])) }];
  }

  unit(j) {
    return this.data.platform || this.data.are_lengths[j] ? this.data.length_unit : "rad";
  }

  /** Values of what is limited: joints, or lengths of legs. */
  limited({ q, lengths = q }) {
    return this.data.limits.columns.map((j) => lengths[j]);
  }

  beyond(m) {
    const { names, columns, lower, upper } = this.data.limits;
    const found = this.limited(m).map((value, i) =>
      ({ name: names[i], value, unit: this.unit(columns[i]), lower: lower[i], upper: upper[i] }))
      .filter((one) => isBeyond(one, LIMIT_SLACK * Math.max(1, Math.abs(one.value))));
    const degrees = found.some(({ value, unit }) => unit === "rad" && Math.abs(value) > 2 * Math.PI);
    return noteBeyond("beyond-limits", found, degrees ? ". Degrees? Angles are in radians" : "");
  }

  /** The note on forces of drives beyond their limits, as `cartstiff.core.stiffness.forces.force_notes`. */
  overloaded(m) {
    const words = new Map(this.data.drives.map((one) => [one.name, one]));
    const found = this.forces(m).map(({ name, force, least, most }) =>
      ({ name: words.get(name).called, value: force, unit: words.get(name).unit, lower: least, upper: most }));
    const slack = LIMIT_SLACK * largest([found.map(({ value }) => value)]);
    return noteBeyond("force-limits", found.filter((one) => isBeyond(one, slack)));
  }

  /** The first rule of `cartstiff.answer.verdict` whose facts hold. */
  verdict(kind, notes, state, m) {
    const { connection } = state;
    const { stiffness } = inFrame(m, null);
    const facts = new Set([...notes.map(({ code }) => code), kind ? `K ${kind}` : "no matrix"]);
    if (connection === "F") facts.add("F");
    if (kind && asymmetry(stiffness[connection])) facts.add("asymmetric");
    if (kind && !this.isTangent(m, stiffness, connection)) facts.add("not tangent");
    const { level, title, code } = this.data.words.rules.find(({ needs }) => needs.every((fact) => facts.has(fact)));
    if (level === "good") return { level, title, code: null, advice: null };
    const { advice } = this.data.words;
    const own = this.isLoaded(m) && !m.given ? advice[`preload ${code}`] : null;
    return { level, title, code, advice: own ?? advice[code] ?? null };
  }

  /** As `cartstiff.answer.analysis.posture.is_tangent`. */
  isTangent(m, stiffness, connection) {
    if (connection === "load" || !this.isLoaded(m)) return true;
    const sizes = turnsBy(1 / m.length);
    const less = (M, N) => scaled(M.map((row, i) => row.map((x, j) => x - N[i][j])), sizes);
    return largest(less(stiffness.load, stiffness[connection])) <= SYMMETRY * largest(less(stiffness.load,
      stiffness.B));
  }

  /** Codes of the notes that cast doubt, as `cartstiff.answer.doubts.doubts_of`. */
  doubts(notes, state) {
    const { illustrative: { springs, always }, words: { weights } } = this.data;
    const remains = always || !springs.every((name) => this.isReplaced(name, state));
    const codes = [...notes.map(({ code }) => code), ...(remains ? ["springs-illustrative"] : [])];
    return codes.filter((code) => weights.includes(code)).toSorted((a, b) => weights.indexOf(a) - weights.indexOf(b));
  }

  /** Whether a state has another spring than the file. */
  isReplaced(name, { stiffness }) {
    const i = this.data.names.indexOf(name);
    return stiffness && stiffness[i] !== this.data.shared.stiffness[i];
  }
}

const sized = (x, unit) => engineering(Math.abs(x), unit, 3);
const bySize = (values, which) => which.toSorted((a, b) => Math.abs(values[b]) - Math.abs(values[a]));

const isBeyond = ({ value, lower, upper }, slack) => value < (lower ?? -Infinity) - slack
  || value > (upper ?? Infinity) + slack;

/** As `cartstiff.core.mechanisms.limits.note_beyond`. */
function noteBeyond(code, found, more = "") {
  if (!found.length) return [];
  const words = found.map(({ name, value, unit, lower, upper }) => `${name} is at ${general(value, 6)} ${unit}, its `
    + `limits are ${lower === null ? "-inf" : general(lower, 6)} and ${upper === null ? "inf" : general(upper, 6)}`);
  return [{ code, message: `beyond limits: ${words.join("; ")}${more}`,
    values: Object.fromEntries(found.map(({ name, value, lower, upper }) => [name, { value, lower, upper }])) }];
}
