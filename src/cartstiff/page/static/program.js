// Answers without a server: the recorded arithmetic of the library (`cartstiff.page.browser_program`) gives
// pose, Jacobian, load and stiffness of a posture; what is read from them is read here. Where the
// verdict of the arithmetic is not plain, or digits are lost, nothing is said.

import { adjoint, angles, back, block, changed, congruence, cross, dot, eigen, general, identity, inverse,
  largest, motion, moving, place, plus, product, rotation, scaled, scaledInverse, singular, squares, sureOfInverse,
  symmetric, times, transposed } from "./algebra.js";
import { engineering } from "./dom.js";
import { ATTAINABLE_PRECISION, NEGLIGIBLE_DIFFERENCE, EPSILON, MAX_FUTILE_STEPS, LIMIT_SLACK, LOST_ERROR, NEAR_SINGULARITY, RANK, ROUNDOFF, SMALLEST_STEP, SYMMETRY, REPORTED_ERROR, ZERO_SHARE } from "./numerics.js";

export const NOT_PLAIN = "this posture is too near to a singularity, or its load too near to what the springs hold, for the formulas in this page: `cartstiff view` answers it";
export const NOT_CLOSED = "the loops do not close with the drives there, or only at a singularity";
// What forces inside a platform may lose near type 2, as a ratio of singular values.
const UNSURE = 10 * REPORTED_ERROR ** 0.5;

// Steps within which links come to rest under a load, and turns of their ends (rad) up to which no note asks for more segments.
const MOST_BENT = 40;
const BENT = 0.3;

export class Program {
  constructor(data, programs) {
    this.data = data;
    this.programs = programs;
    this.out = {};
    for (const [name, places] of Object.entries(data.places)) this.out[name] = new Float64Array(Math.max(...Object.values(places).map(([, end]) => end)));
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
    if (i >= 0) throw new Error(`${this.data.names[i]} ${stiffness[i] === null ? "is rigid" : "has no spring"}: \`cartstiff view\` answers that`);
    return { stiffness };
  }

  /** Coordinates that close a chain, its drives where they are. */
  closed(q) {
    const { closing } = this.data;
    if (!closing) return q;
    const found = this.led(q) ?? this.shut(q, closing.ways);
    if (!found) throw new Error(NOT_CLOSED);
    return found;
  }

  /** From the reference posture, where all coordinates but the drives are as there. */
  led(q) {
    const { ways, home, held, lengths, longest, most } = this.data.closing;
    if (!home?.every((x, j) => x === q[j] || held.includes(j))) return null;
    const way = held.map((j) => q[j] - home[j]);
    const steps = Math.ceil(Math.max(...way.map((x, i) => Math.abs(x) / lengths[i])) / longest);
    if (steps <= 1 || steps > most) return null;
    let found = home;
    for (let k = 1; k <= steps && found; k++) {
      const start = found.slice();
      held.forEach((j, i) => { start[j] = k === steps ? q[j] : home[j] + (way[i] * k) / steps; });
      found = this.shut(start, ways.slice(0, 1));
    }
    return found;
  }

  /** Steps towards closure, as `cartstiff.batch.closed_chains.close` takes them; null where they end in vain. */
  shut(start, ways) {
    const { longest, steps } = this.data.closing;
    for (const name of ways) {
      let [q, before, best, futile] = [start, Infinity, Infinity, 0];
      for (let k = 0; ; k++) {
        const found = this.run(name, { q });
        const [size, step, length, doubt] = found("left");
        const unit = Math.max(1, length);
        if (size <= ATTAINABLE_PRECISION * unit || (size <= ROUNDOFF * unit && (size > 0.1 * before || step <= SMALLEST_STEP))) return q;
        if (doubt !== 0 || !Number.isFinite(step) || k === steps) throw new Error(NOT_CLOSED);
        futile = size < 0.9 * best ? 0 : futile + 1;
        if (step <= SMALLEST_STEP || (futile >= MAX_FUTILE_STEPS && step < longest)) break;
        [before, best, q] = [size, Math.min(best, size), found("next")];
      }
    }
    return null;
  }

  /** Pose and joints' frames alone, with the rates of the coordinates that move independently. */
  place(asked) {
    const q = this.closed(asked);
    const found = this.run("free", { q });
    const J = found("jacobian", this.n);
    const N = this.data.closing && found("motions", this.freedoms);
    return { q, pose: found("pose", 4), frames: frames(found("frames")), N, J: N ? product(J, N) : J, ...legsOf(found) };
  }

  /** Coordinates of a platform at a pose of M, on the turn of others. */
  coordinates(pose, q) {
    const P = product(pose, back(this.data.T_P_M));
    return [...place(P), ...angles(P)].map((x, i) => (i < 3 ? x : x - 2 * Math.PI * Math.round((x - q[i]) / (2 * Math.PI))));
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
    if (state.gravity || state.payload || state.command) throw new Error("other weights and commands of the drives are answered by `cartstiff view`");
    const { bending, virtual } = this.data;
    // Without a load links are straight.
    const asked = state.q.map((x, j) => (bending && !state.load && virtual.includes(j) ? 0 : Number(x)));
    let q = this.closed(asked);
    if (q.some((x, i) => !this.data.are_lengths[i] && Math.abs(x) > (this.data.platform ? 2 : 4) * Math.PI)) throw new Error(NOT_PLAIN);
    // A next state begins with straight links: bent ones may not close at other positions of the drives.
    const straight = q;
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
    const m = {
      q, asked, straight, hessians: inputs.segment_hessians, pose: found("pose", 4), J: found("jacobian", this.n), W: found("wrench"), energy: found("energy")[0],
      frames: frames(found("frames")), ...legsOf(found), tensions: found("tensions"), length: found("length")?.[0] ?? this.data.length,
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
    m.J = product(m.J, N).map((row, i) => row.map((x, a) => (Math.abs(x) > this.n * EPSILON * sums[i] * most[a] ? x : 0)));
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
      if (m.orthonormal && data.actuated.length >= this.freedoms) m.singular["type-2"] = singular(data.actuated.map((j) => m.orthonormal[j].map((x) => x * m.sizes[j])));
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

  /** Coordinates at which links carry the load, as `cartstiff.batch.closed_chains.settle`; derivatives of their energy become inputs. */
  bent(start, state, inputs) {
    const { beams, last, rounded } = this.data.bending;
    let [q, moved] = [start, Infinity];
    for (let k = 0; k < MOST_BENT; k++) {
      Object.assign(inputs, this.segments(q, beams));
      if (moved <= last) return q;
      const found = this.run("settling", { ...inputs, q, wrench: this.given(q, state) });
      const [step, doubt] = found("moved");
      if (doubt !== 0 || !Number.isFinite(step)) break;
      [q, moved] = [found("settled"), step];
    }
    if (!(moved <= rounded)) throw new Error(NOT_PLAIN);
    return q;
  }

  /** Energy, gradients and Hessians (lower triangles) of the segments of beams. */
  segments(q, beams) {
    let energies = 0;
    const [gradients, hessians] = [[], []];
    for (const { program, segments } of beams) for (const indices of segments) {
      const x = indices.map((j) => q[j]);
      const found = this.run(program, { x });
      if (found("verdict")[0] !== 0 || largest([x.with(2, 0)]) > BENT) throw new Error(NOT_PLAIN);
      energies += found("energy")[0];
      gradients.push(...found("gradient"));
      const lower = found("hessian");
      for (let i = 0; i < 6; i++) for (let j = 0; j < 6; j++) hessians.push(lower[(Math.max(i, j) * (Math.max(i, j) + 1)) / 2 + Math.min(i, j)]);
    }
    return { energies: [energies], segment_gradients: gradients, segment_hessians: hessians };
  }

  /** J H^-1 J^T. */
  softness(m, H) {
    const found = scaledInverse(H);
    this.refuseLost(H, found);
    return congruence(transposed(m.J), found);
  }

  /** As `cartstiff.batch.arithmetic.noteworthy`: what would be told of lost digits is not answered. */
  refuseLost(M, other) {
    if (!(other && sureOfInverse(other, M) < REPORTED_ERROR)) throw new Error(NOT_PLAIN);
  }

  /** K^A, K^K and the tangent under the load, each less K^B: see `cartstiff.stiffness.applied_load`. */
  changes({ W, kind, at }) {
    const under = (name, wrench) => rows(times(this.data.changes[name], wrench), 6);
    const [forth, reverse] = [1, -1].map((side) => adjoint(motion(identity(3), at.map((x) => side * x))));
    return { A: under("follower", W), K: under("conservative", W),
      load: congruence(reverse, under(kind, times(transposed(forth), W))) };
  }

  // -- numbers --------------------------------------------------------------------------------

  /** As `cartstiff.page.shown.shown_numbers`. */
  numbers(state, m = this.solve(state)) {
    const T = state.axes === "body" && !state.point.some((x) => x) ? null
      : motion(state.axes === "body" ? identity(3) : transposed(rotation(m.pose)), state.point);
    const here = inFrame(m, T);
    const shown = here[state.quantity];
    const K = here.stiffness[state.connection] && symmetric(here.stiffness[state.connection]);
    const numbers = K && this.indices(K);
    const asymmetries = Object.fromEntries(Object.entries(shown).map(([name, M]) => [name, M && asymmetry(M)]));
    const notes = this.notes(m, state);
    const answer = {
      q: m.straight, result: this.part(m, state.quantity, notes), has_compliance: true, position: place(m.pose), frame: T,
      stiffness: null, compliance: null, wrench: here.wrench, principal: principalValues(here, state), indices: numbers,
      symmetric: { ...asymmetries, "+": asymmetries.A }, singularity: this.distance(m), legs: this.legs(m), moved: this.moved(m, state),
      modes: state.mode === null ? null : { missing: "Modes are computed by `cartstiff view`." },
      softest: softest(here),
      verdict: this.verdict(numbers?.definiteness, notes, state, m), doubts: this.doubts(notes, state),
    };
    if (T) answer[state.quantity] = Object.fromEntries(Object.entries(shown).filter(([name]) => name !== "+"));
    return answer;
  }

  matrices(table) {
    const { A, B, K, F } = table;
    return { A, B, K, F };
  }

  part(m, quantity, notes) {
    return { q: m.q, pose: m.pose, wrench: m.W, energy: m.energy, [quantity]: this.matrices(quantity === "stiffness" ? m.K : m.C),
      load: { kind: m.kind, at: m.at, meaning: this.data.words.kinds[m.kind], stiffness: m.K.load, compliance: m.C.load }, notes };
  }

  /** What `cartstiff analyse --json` prints. */
  result(state) {
    const m = this.solve(state);
    const found = { ...this.data.base, ...this.part(m, "stiffness", this.notes(m, state)), jacobian: m.jacobian ?? null, compliance: this.matrices(m.C) };
    delete found.stored_energy; // gravity's part is not told apart here
    if (found.legs) found.legs = this.drives(m, found.legs);
    return found;
  }

  /** Legs with their lengths, forces, and distances to the nearer limit. */
  drives(m, legs) {
    return legs.map((leg, i) => {
      const [position, force] = [m.lengths[i], m.tensions[i]];
      const margin = Math.min(position - (leg.lower ?? -Infinity), (leg.upper ?? Infinity) - position);
      return { ...leg, position, force, margin: Number.isFinite(margin) ? margin : null };
    });
  }

  indices(K) {
    const C = scaledInverse(K);
    const [move, turn] = [eigen(block(K, 3)).values, C ? eigen(block(C, 0)).values : [0]];
    // A positive definite K has determinants of these two blocks that differ by a length only.
    const isPositive = move[0] > 0 && turn[0] > 0;
    const [length, origin] = isPositive ? [[...move, ...turn].reduce((all, x) => all * x ** (-1 / 6), 1), "natural"] : [1, "unit"];
    const { values } = eigen(scaled(K, turnsBy(1 / length)));
    const condition = (list) => Math.max(...list.map(Math.abs)) / Math.min(...list.map(Math.abs));
    return {
      length, length_origin: origin, length_reason: this.data.words.lengths[origin], definiteness: definiteness(values), eigenvalues: values,
      condition_number: condition(values), translational_condition: condition(move),
      rotational_condition: condition(eigen(block(K, 0)).values),
    };
  }

  distance(m) {
    return Object.entries(m.singular).map(([kind, { values }]) => ({ kind, ratio: values.at(-1) / values[0], smallest: values.at(-1), largest: values[0], length: m.length }));
  }

  legs(m) {
    if (!this.data.platform) return null;
    return m.lengths.map((length, i) => {
      const [lower, upper] = this.data.leg_limits?.[i] ?? [null, null];
      return { length, tension: m.tensions[i], lower, upper };
    });
  }

  isLoaded(m) {
    if (m.given || !m.W.some((x) => x)) return m.given;
    const J = this.data.platform ? identity(6) : m.J;
    const torque = times(transposed(J), m.W).map((x, j) => Math.abs(x) * m.columns[j]);
    const stiffest = transposed(scaled(m.H, m.columns)).map((column) => largest([column]));
    const most = Math.max(...stiffest);
    return torque.some((x, j) => x > ROUNDOFF * (stiffest[j] || most));
  }

  /** The wrench with zeros for what is rounding of springs or of its other half. */
  shownWrench(m, W) {
    const stiffest = m.given ? 0 : largest(scaled(m.H, m.columns));
    const sizes = W.map((x, i) => Math.abs(x) * (i < 3 ? 1 : m.length));
    const noise = ROUNDOFF * Math.max(stiffest, ...sizes);
    return W.map((x, i) => (sizes[i] > noise ? x : 0));
  }

  moved(m, state) {
    if (!this.isLoaded(m)) return null;
    const units = turnsBy(m.length);
    const sized = (list) => list.map((x, i) => Math.abs(x) * units[i]);
    const whole = times(m.C.load, m.W);
    const shift = shiftAt(state.point, whole);
    // Where the structure carries the load all of it is rounding: beside the compliance, not beside itself.
    const most = largest(scaled(m.C.load, units)) * Math.max(...m.W.map((x, i) => Math.abs(x) / units[i]));
    const rounding = Math.max(ROUNDOFF * Math.max(...sized(whole), ...shift.map(Math.abs)), ZERO_SHARE * most);
    const displacement = shift.map((x) => (Math.abs(x) > rounding ? x : 0));
    const twist = whole.map((x, i) => (Math.abs(x) * units[i] > rounding ? x : 0));
    const energy = 0.5 * dot(m.W, twist);
    const { values } = eigen(m.C.load);
    const names = [...this.data.names, ...(this.data.bending?.beams ?? []).map(({ label }) => `${label} (link)`)];
    return {
      displacement, in_room: times(rotation(m.pose), displacement), rotation: twist.slice(0, 3), energy, acts_at: m.at,
      resisted: values[0] >= 0 || -values[0] <= ZERO_SHARE * Math.max(...values.map(Math.abs)),
      shares: this.shares(m, twist, displacement, energy, state.point).flatMap((share, i) => (m.stiffness[i] === 0 ? [] : [{ name: names[i], share }])), notes: [],
    };
  }

  /** How far the load moves the coordinates, or a platform's body. */
  way(m) {
    if (this.data.platform) return times(m.C.load, m.W);
    return times(scaledInverse(plus(m.L, congruence(m.J, m.changes.load))), times(transposed(m.J), m.W));
  }

  shares(m, twist, shift, energy, point) {
    if (this.data.platform) return m.lines.map((line, i) => (energy ? (0.5 * m.stiffness[i] * dot(line, twist) ** 2) / energy : null));
    const way = this.way(m);
    if (m.N) {
      const all = times(m.N, way);
      let from = 0;
      const links = (m.hessians ? this.data.bending.beams : []).map(({ segments }) => segments.reduce((sum, indices) => {
        const x = indices.map((j) => all[j]);
        return sum + 0.5 * dot(x, times(rows(m.hessians.slice(from, from += 36), 6), x));
      }, 0));
      return [...m.stiffness.map((k, j) => 0.5 * k * all[j] ** 2), ...links].map((x) => (energy ? x / energy : null));
    }
    const size = dot(shift, shift);
    return transposed(m.J).map((column, a) => (size ? (dot(shift, shiftAt(point, column)) * way[a]) / size : null));
  }

  notes(m, state) {
    const { data } = this;
    const notes = data.notes.flatMap((note) => (note.code === "stiffness-assumed" ? this.stillAssumed(note, state) : [note]));
    notes.push(...this.adjustedNotes(m));
    const { serial, "type-2": held } = m.singular;
    const size = { characteristic_length: m.length };
    if (this.freedoms < 6 && serial) {
      notes.push({ code: "fewer-than-six-freedoms", message: `the end-effector cannot move in ${6 - this.freedoms} of 6 directions here: the stiffness matrix does not exist, the compliance does; `
        + `the wrench along them is carried by the structure${m.given ? "" : " and is taken as zero in the scaled norm"}`, values: { rank: this.freedoms, singular_values: serial.values, ...size } });
    }
    if (serial && this.least(serial) < NEAR_SINGULARITY) {
      notes.push({ code: "near-serial-singularity", message: `the end-effector hardly moves in one direction: smallest over largest singular value ${general(this.least(serial), 2)}`,
        values: { singular_values: serial.values, ...size } });
    }
    if (held && this.least(held) < NEAR_SINGULARITY) {
      const { values, vectors } = held;
      const weak = values.filter((x) => x < NEAR_SINGULARITY * values[0]).length;
      const all = m.orthonormal ? product(vectors, transposed(m.orthonormal)) : vectors;
      notes.push({ code: "near-type-2-singularity", message: `the actuators hardly hold the mechanism in ${weak} direction(s): smallest over largest singular value ${general(this.least(held), 2)}`,
        values: { singular_values: values, ...size, directions: all.slice(-weak).map((v) => v.map((x, i) => x * m.sizes[i])) } });
    }
    notes.push(...this.beyond(m), ...this.stretched(m), ...(m.given ? data.loaded_rest_notes : data.rest_notes), ...this.indefinite(m), ...data.last_notes);
    return notes;
  }

  /** The note on a posture that springs and load do not keep, as `cartstiff.stiffness.posture_notes.indefinite`. */
  indefinite(m) {
    const [K, C] = [m.K.load, m.C.load];
    if ([K, C].some((M) => M && asymmetry(M))) return [];
    const spectra = [K && scaled(K, turnsBy(1 / m.length)), C && scaled(C, turnsBy(m.length))].filter(Boolean).map((M) => eigen(M).values);
    const below = (values) => values.filter((x) => x < -ZERO_SHARE * Math.max(...values.map(Math.abs))).length;
    const negative = Math.max(0, ...spectra.map(below));
    if (!negative) return [];
    const unit = K ? m.length ** 2 : 1 / m.length ** 2; // lengths, not angles, are of size one there
    return [{ code: "indefinite", message: `the stiffness is negative along ${negative} motion(s) of the body, under the load and the tensions here: the posture is not stable, `
      + "and without something else that holds it the mechanism moves away",
    values: { eigenvalues: spectra[0].map((x) => x * unit).sort((a, b) => a - b), characteristic_length: m.length } }];
  }

  /** The note on assumed stiffnesses without the springs that were replaced, as `cartstiff.notes.still_assumed`. */
  stillAssumed(note, { stiffness }) {
    const { names, shared, some_assumed: words } = this.data;
    const replaced = (name) => stiffness && stiffness[names.indexOf(name)] !== shared.stiffness[names.indexOf(name)];
    const joints = note.values.joints.filter((name) => !replaced(name));
    if (joints.length === note.values.joints.length) return [note];
    return joints.length ? [{ ...note, message: words.replace("{}", joints.join(", ")), values: { ...note.values, joints } }] : [];
  }

  /** Legs that the load stretches implausibly; where rest lengths were given and no load was, the stretch is meant. */
  stretched(m) {
    const { doubted, length_unit: unit } = this.data;
    if (!doubted || !(doubted.rest_is_open || m.given)) return [];
    const { lengths } = m;
    const stretch = m.tensions.map((tension, i) => tension / m.stiffness[i]);
    const long = doubted.legs.filter((i) => Math.abs(stretch[i]) > doubted.share * lengths[i]).sort((a, b) => Math.abs(stretch[b]) - Math.abs(stretch[a]));
    if (!long.length) return [];
    const size = (x, of) => engineering(Math.abs(x), of, 3);
    const words = long.slice(0, 3).map((i) => `${doubted.names[i]} changes its length of ${size(lengths[i], unit)} by ${size(stretch[i], unit)} `
      + `under ${size(m.tensions[i], doubted.force)}, at ${size(m.stiffness[i], doubted.spring)}`);
    return [{ code: "implausible-deflection", message: `${words.join("; ")}. Is the load meant, and the unit of the springs (1 N/um is 1e6 N/m)?`,
      values: { stretch: Object.fromEntries(long.map((i) => [doubted.names[i], stretch[i]])) } }];
  }

  /** Drives that the closures have moved, each [coordinate, from, to]: more of them than there are motions are not all free. */
  adjusted({ straight: q, asked }) {
    return this.data.actuated.filter((j) => Math.abs(q[j] - asked[j]) > NEGLIGIBLE_DIFFERENCE).map((j) => [j, asked[j], q[j]]);
  }

  adjustedNotes(m) {
    const moved = this.adjusted(m);
    if (!moved.length) return [];
    const { joints } = this.data.base.mechanism;
    const words = moved.map(([j, from, to]) => `${joints[j]} ${general(from, 6)} -> ${general(to, 6)} ${this.unit(j)}`);
    return [{ code: "actuators-adjusted", message: `the chain does not close with its joints as given, and they moved: ${words.join(", ")}`,
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
    const words = [];
    const values = {};
    let degrees = false;
    this.limited(m).forEach((x, i) => {
      const slack = LIMIT_SLACK * Math.max(1, Math.abs(x));
      const [low, high] = [lower[i] ?? -Infinity, upper[i] ?? Infinity];
      if (x >= low - slack && x <= high + slack) return;
      const unit = this.unit(columns[i]);
      const text = (y) => (Number.isFinite(y) ? general(y, 6) : y > 0 ? "inf" : "-inf");
      words.push(`${names[i]} is at ${text(x)} ${unit}, its limits are ${text(low)} and ${text(high)}`);
      degrees ||= unit === "rad" && Math.abs(x) > 2 * Math.PI;
      values[names[i]] = { value: x, lower: lower[i], upper: upper[i] };
    });
    return words.length ? [{ code: "beyond-limits", message: `beyond limits: ${words.join("; ")}${degrees ? ". Degrees? Angles are in radians" : ""}`, values }] : [];
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
    return { level, title, code: level === "good" ? null : code };
  }

  /** As `cartstiff.analysis.posture.is_tangent`. */
  isTangent(m, stiffness, connection) {
    if (connection === "load" || !this.isLoaded(m)) return true;
    const sizes = turnsBy(1 / m.length);
    const less = (M, N) => scaled(M.map((row, i) => row.map((x, j) => x - N[i][j])), sizes);
    return largest(less(stiffness.load, stiffness[connection])) <= SYMMETRY * largest(less(stiffness.load, stiffness.B));
  }

  /** Codes of the notes that cast doubt, as `cartstiff.answer.doubts.doubts_of`. */
  doubts(notes, { stiffness }) {
    const { names, shared, illustrative: { springs, always }, words: { weights } } = this.data;
    const replaced = (name) => stiffness && stiffness[names.indexOf(name)] !== shared.stiffness[names.indexOf(name)];
    const remains = always || !springs.every(replaced);
    const codes = [...notes.map(({ code }) => code), ...(remains ? ["springs-illustrative"] : [])];
    return codes.filter((code) => weights.includes(code)).toSorted((a, b) => weights.indexOf(a) - weights.indexOf(b));
  }
}

// -- helpers --------------------------------------------------------------------------------------

const rows = (flat, width) => Array.from({ length: flat.length / width }, (_, i) => flat.slice(i * width, (i + 1) * width));
const frames = (flat) => (flat ? rows(flat, 12).map((one) => [...rows(one, 4), [0, 0, 0, 1]]) : []);
/** What multiplies the parts of a twist, so that turns are lengths: rotations by a length. */
const turnsBy = (length) => [length, length, length, 1, 1, 1];
/** How far a twist moves a point. */
function shiftAt(point, twist) {
  const arm = cross(twist.slice(0, 3), point);
  return twist.slice(3).map((x, i) => x + arm[i]);
}

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

const upright = (v) => (v.reduce((most, x) => (Math.abs(x) > Math.abs(most) ? x : most), 0) < 0 ? v.map((x) => -x) : v);

/** The point in M at which the load acts. */
export const actsAt = (state) => state.load_at ?? (state.load ? state.point : [0, 0, 0]);

/** Matrices and wrench in a frame N of the body; `T` is null for M itself. */
export function inFrame(m, T) {
  let [stiffness, compliance, wrench, tangent] = [m.K, m.C, m.W, m.tangent];
  if (T) {
    const [forth, reverse] = [adjoint(T), transposed(adjoint(back(T)))];
    const each = (table, by) => Object.fromEntries(Object.entries(table).map(([name, M]) => [name, M && congruence(by, M)]));
    [stiffness, compliance, wrench] = [each(m.K, forth), each(m.C, reverse), times(transposed(forth), m.W)];
    tangent &&= congruence(reverse, tangent);
  }
  const both = (table) => ({ ...table, "+": table.A && transposed(table.A) });
  // Without a stiffness: the compliance with which other freedoms are held, that of a symmetric one.
  const held = { ...compliance, A: compliance.B, "+": compliance.B, load: tangent };
  return { stiffness: both(stiffness), compliance: both(compliance), held, wrench, pose: T ? product(m.pose, T) : m.pose };
}

/** Principal values of translation and of rotation with their axes, the other freedoms free or held; null without a matrix. */
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

/** As `cartstiff.page.shown.softest_in_room`. */
function softest({ compliance, stiffness, pose }) {
  const { values: all, vectors } = eigen(block(compliance.load, 3));
  const values = stiffness.load ? all : known(all);
  if (!(values[0] >= 0 && values[2] > 0)) return null;
  return { stiffness: 1 / values[2], direction: values[2] - values[1] > NEGLIGIBLE_DIFFERENCE * values[2] ? upright(times(rotation(pose), vectors[2])) : null };
}

/** Largest entry of M - M^T; 0 where each is round-off beside its block, as `cartstiff.analysis.asymmetry.is_roundoff`. */
function asymmetry(M) {
  const skew = M.map((row, i) => row.map((x, j) => x - M[j][i]));
  const [rr, rt, tt] = [[0, 0], [0, 3], [3, 3]].map(([i, j]) => squares(M.slice(i, i + 3).map((row) => row.slice(j, j + 3))) ** 0.5);
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
