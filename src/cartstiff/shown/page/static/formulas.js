// The recorded arithmetic of the library (`cartstiff.shown.page.browser_program`) at a posture: pose, Jacobian, load
// and stiffness. Where its verdict is not plain, or digits are lost, nothing is said.

import { adjoint, angles, back, changed, congruence, cross, dot, identity, inverse, largest, motion, moving, place,
  plus, product, rotation, scaled, scaledInverse, singular, sureOfInverse, symmetric, times,
  transposed } from "./algebra.js";
import { actsAt } from "./loads.js";
import { EPSILON, LOST_ERROR, NEGLIGIBLE_DIFFERENCE, RANK, REPORTED_ERROR } from "./numerics.js";

export const NOT_PLAIN = "this posture is too near to a singularity, or its load too near to what the springs hold, "
  + "for the formulas in this page: `cartstiff view` answers it";
export const NOT_CLOSED = "the loops do not close with the drives there, or only at a singularity";
// What forces inside a platform may lose near type 2, as a ratio of singular values.
const UNSURE = 10 * REPORTED_ERROR ** 0.5;

export class Formulas {
  constructor(data, programs) {
    this.data = data;
    this.programs = programs;
    this.out = {};
    for (const [name, places] of Object.entries(data.places)) {
      this.out[name] = new Float64Array(Math.max(...Object.values(places).map(([, end]) => end)));
    }
    this.n = data.are_lengths.length;
    this.freedoms = data.closing?.freedoms ?? this.n;
  }

  /** Run a program; its outputs by name: flat, or rows of a width. */
  run(name, inputs) {
    const out = this.out[name];
    this.programs[name]({ ...this.data.shared, ...inputs }, out);
    return (key, width) => {
      const at = this.data.places[name][key];
      const flat = at && Array.from(out.subarray(...at));
      return flat && width ? rows(flat, width) : flat;
    };
  }

  springs(state) {
    const { stiffness } = state;
    if (!stiffness) return {};
    const i = stiffness.findIndex((k, j) => (k === null || !(k > 0)) && k !== this.data.shared.stiffness[j]);
    if (i >= 0) throw new Error(`${this.data.names[i]} ${stiffness[i] === null ? "is rigid"
      : "has no spring"}: \`cartstiff view\` answers that`);
    return { stiffness };
  }

  /** Coordinates that close a chain, its drives where they are, as the library finds them. */
  closed(q) {
    const { closing } = this.data;
    if (!closing) return q;
    for (const name of closing.ways) {
      const found = this.programs[name](Array.from(q));
      if (found) return found;
    }
    throw new Error(NOT_CLOSED);
  }

  /** Pose and joints' frames alone, with the rates of the coordinates that move independently. */
  place(asked) {
    const q = this.closed(asked);
    const found = this.run("free", { q });
    const J = found("jacobian", this.n);
    const N = this.data.closing && found("motions", this.freedoms);
    return { q, pose: found("pose", 4), frames: frames(found("frames")), N, J: N ? product(J, N) : J,
      ...legsOf(found) };
  }

  /** Coordinates of a platform at a pose of M, on the turn of others. */
  coordinates(pose, q) {
    const P = product(pose, back(this.data.T_P_M));
    return [...place(P), ...angles(P)]
      .map((x, i) => (i < 3 ? x : x - 2 * Math.PI * Math.round((x - q[i]) / (2 * Math.PI))));
  }

  /** Coordinates after a step of those that move independently; of a platform after a twist. */
  along(m, step) {
    if (this.data.platform) return this.coordinates(product(m.pose, moving(step)), m.q);
    const all = m.N ? times(m.N, step) : step;
    return this.closed(m.q.map((x, j) => x + all[j]));
  }

  /** Places among the coordinates of those that move independently; none where no choice of them does. */
  get independent() {
    return this.data.closing?.independent ?? this.data.are_lengths.map((_, j) => j);
  }

  /** Everything that other answers are read from. */
  solve(state) {
    if (state.gravity || state.payload || state.command) {
      throw new Error("other weights and commands of the drives are answered by `cartstiff view`");
    }
    const { bending, virtual } = this.data;
    // Without a load links are straight.
    const asked = state.q.map((x, j) => (bending && !state.load && virtual.includes(j) ? 0 : Number(x)));
    let q = this.closed(asked);
    const most = (this.data.platform ? 2 : 4) * Math.PI;
    if (q.some((x, i) => !this.data.are_lengths[i] && Math.abs(x) > most)) throw new Error(NOT_PLAIN);
    // A next state begins with straight links: bent ones may not close at other positions of the drives.
    const straight = q;
    /** @type {any} */
    const inputs = { q, ...this.springs(state) };
    let name = "free";
    if (state.load) {
      if (this.data.no_load) throw new Error(`${this.data.no_load}: \`cartstiff view\` answers under a load`);
      name = "loaded";
      if (bending) q = this.bent(q, state, inputs);
      Object.assign(inputs, { q, wrench: this.given(q, state) });
    }
    const found = this.run(name, inputs);
    if (found("verdict")[0] !== 0) throw new Error(NOT_PLAIN);
    const { platform, are_lengths: areLengths, may_be_loaded: mayBeLoaded } = this.data;
    /** @type {any} */
    const m = {
      q, asked, straight, hessians: inputs.segment_hessians, pose: found("pose", 4), J: found("jacobian", this.n),
        W: found("wrench"), energy: found("energy")[0],
      frames: frames(found("frames")), ...legsOf(found), tensions: found("tensions"),
        torques: found("torques"), length: found("length")?.[0] ?? this.data.length,
      given: Boolean(state.load?.some((x) => x)), stiffness: inputs.stiffness ?? this.data.shared.stiffness,
      ...(state.load || mayBeLoaded ? { at: actsAt(state), kind: state.load_kind } : { at: [0, 0, 0], kind: "dead" }),
    };
    const K = found("stiffness_B", 6) ?? null;
    m.sizes = platform ? [1, 1, 1, m.length, m.length, m.length] : areLengths.map((is) => (is ? m.length : 1));
    m.columns = m.sizes;
    if (platform) m.H = K;
    else {
      m.jacobian = m.J;
      if (this.data.closing) this.onMotions(m, found("motions", this.freedoms));
      [m.H, m.L] = ["hessian", "lagrangian"].map((name) => found(name, this.freedoms));
    }
    const softness = (H, M) => (platform ? inverse(M, m.sizes) : this.softness(m, H));
    const C = softness(m.L, K);
    if (!C) throw new Error(NOT_PLAIN);
    m.K = { B: K, F: found("stiffness_F", 6) ?? null };
    m.C = { B: C, F: m.K.F && softness(m.H, m.K.F) };
    m.changes = this.changes(m);
    for (const [key, D] of Object.entries(m.changes)) {
      m.K[key] = K && plus(K, D);
      m.C[key] = largest(D) ? changed(C, D, m.length) : C;
    }
    if (!K) m.tangent = changed(C, symmetric(m.changes.load), m.length);
    for (const [key, M] of Object.entries(m.K)) if (M) this.refuseLost(M, m.C[key]);
    this.ratios(m);
    return m;
  }

  /** Jacobian and sizes of the motions that keep a chain closed, N; `orthonormal` are these in natural sizes. */
  onMotions(m, N) {
    const { distances } = this.data.closing;
    m.N = N;
    m.columns = distances.map((is) => (is ? m.length : 1));
    m.orthonormal = transposed(orthonormal(transposed(N.map((row, j) => row.map((x) => x / m.sizes[j])))));
    // What is rounding of a motion that the closures forbid is zero.
    const most = transposed(N).map((column) => Math.max(...column.map((x, j) => Math.abs(x) / m.sizes[j])));
    const sums = m.J.map((row) => row.reduce((sum, x, j) => sum + Math.abs(x) * m.sizes[j], 0));
    m.J = product(m.J, N)
      .map((row, i) => row.map((x, a) => (Math.abs(x) > this.n * EPSILON * sums[i] * most[a] ? x : 0)));
  }

  /** Singular values of the scaled Jacobians: of the motions of the body, and of what the drives hold. */
  ratios(m) {
    const { data } = this;
    m.singular = {};
    if (data.platform) m.singular["type-2"] = singular(m.lines.map((line) => line.map((x, i) => x * m.columns[i])));
    else {
      const J = scaled(m.jacobian, [0, 1, 2, 3, 4, 5].map((i) => (i < 3 ? 1 : 1 / m.length)), m.sizes);
      const motions = m.orthonormal ? product(J, m.orthonormal) : J;
      m.singular.serial = singular(motions[0].length < 6 ? motions : transposed(motions));
      if (this.least(m.singular.serial) <= NEGLIGIBLE_DIFFERENCE) throw new Error(NOT_PLAIN);
      if (this.freedoms < 6) { // a rotation, or translation, that nearly vanishes needs a note
        const [less, more] = [0, 3].map((i) => Math.hypot(...motions.slice(i, i + 3).flat())).sort((a, b) => a - b);
        if (less > RANK * more && less < LOST_ERROR * more) throw new Error(NOT_PLAIN);
      }
      if (m.orthonormal && data.actuated.length >= this.freedoms) {
        m.singular["type-2"] = singular(data.actuated.map((j) => m.orthonormal[j].map((x) => x * m.sizes[j])));
      }
    }
    const held = m.singular["type-2"];
    if (held && (m.W.some((x) => x) || m.orthonormal) && this.least(held) < UNSURE) throw new Error(NOT_PLAIN);
  }

  least({ values }) {
    return values.at(-1) / values[0];
  }

  /** The wrench of a state in the body's axes, at coordinates that are closed. */
  given(q, state) {
    const R = state.load_axes === "world" ? transposed(rotation(this.run("free", { q })("pose", 4))) : identity(3);
    const [moment, force] = [state.load.slice(0, 3), state.load.slice(3)].map((v) => times(R, v));
    const arm = cross(actsAt(state), force);
    return [...moment.map((x, i) => x + arm[i]), ...force];
  }

  /**
   * Coordinates at which links carry the load, as `cartstiff.recorded.closed_chains.settle`; derivatives of their
   * energy become inputs.
   */
  bent(start, state, inputs) {
    const { last, rounded, steps, terms } = this.data.bending;
    let [q, moved] = [start, Infinity];
    for (let k = 0; k < steps; k++) {
      const found = this.programs.terms(q);
      if (!found) throw new Error(NOT_PLAIN);
      terms.forEach((name, i) => { inputs[name] = found[i]; });
      if (moved <= last) return q;
      const next = this.run("settling", { ...inputs, q, wrench: this.given(q, state) });
      const [step, doubt] = next("moved");
      if (doubt !== 0 || !Number.isFinite(step)) break;
      [q, moved] = [next("settled"), step];
    }
    if (!(moved <= rounded)) throw new Error(NOT_PLAIN);
    return q;
  }

  /** J H^-1 J^T. */
  softness(m, H) {
    const found = scaledInverse(H);
    this.refuseLost(H, found);
    return congruence(transposed(m.J), found);
  }

  /** As `cartstiff.recorded.arithmetic.noteworthy`: what would be told of lost digits is not answered. */
  refuseLost(M, other) {
    if (!(other && sureOfInverse(other, M) < REPORTED_ERROR)) throw new Error(NOT_PLAIN);
  }

  /** K^A, K^K and the tangent under the load, each less K^B: see `cartstiff.core.stiffness.applied_load`. */
  changes({ W, kind, at }) {
    const under = (name, wrench) => rows(times(this.data.changes[name], wrench), 6);
    const [forth, reverse] = [1, -1].map((side) => adjoint(motion(identity(3), at.map((x) => side * x))));
    const own = Object.entries(this.data.own ?? {}).map(([name, map]) => [name, rows(times(map, W), 6)]);
    return { A: under("follower", W), K: under("conservative", W), ...Object.fromEntries(own),
      load: congruence(reverse, under(kind, times(transposed(forth), W))) };
  }
}

export const rows = (flat, width) => Array.from({ length: flat.length / width },
  (_, i) => flat.slice(i * width, (i + 1) * width));
const frames = (flat) => (flat ? rows(flat, 12).map((one) => [...rows(one, 4), [0, 0, 0, 1]]) : []);
/** Lengths of a platform's legs, and their lines along body twists, a row each. */
const legsOf = (found) => ({ lengths: found("leg_lengths"), lines: found("actuation", 6) });
/** Rows that span what some independent rows do, of length 1 and at right angles: each is taken off twice. */
function orthonormal(vectors) {
  const found = [];
  for (const v of vectors) {
    let rest = v;
    for (const other of [...found, ...found]) {
      const part = dot(other, rest);
      rest = rest.map((x, k) => x - part * other[k]);
    }
    const size = Math.sqrt(dot(rest, rest));
    found.push(rest.map((x) => x / size));
  }
  return found;
}
