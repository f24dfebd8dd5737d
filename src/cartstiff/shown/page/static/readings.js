// The numbers of a posture that the page shows, as `cartstiff.shown.page.shown` has them, from its formulas.

import { adjoint, block, congruence, cross, dot, eigen, identity, inverse, largest, motion, plus, product, rotation,
  scaled, scaledInverse, times, transposed } from "./algebra.js";
import { Formulas, rows } from "./formulas.js";
import { wayOf } from "./loads.js";
import { PRINTED_AS_ZERO, ROUNDOFF, STALLED_RESIDUAL, ZERO_SHARE } from "./numerics.js";
import { definiteness, turnsBy } from "./principal.js";
import { directionWords } from "./words.js";

// Decimal places up to which shares are compared.
const SAME_SHARE = 9;

// Components of a twist, and the turn of a machine that moves in a plane.
const TWIST = ["rx", "ry", "rz", "x", "y", "z"];
const turnOf = (names) => `r${["x", "y", "z"].find((axis) => !names.includes(axis))}`;

export class Readings extends Formulas {
  matrices(table) {
    const { A, B, K, F } = table;
    return { A, B, K, F };
  }

  part(m, quantity, notes) {
    return { q: m.q, pose: m.pose, wrench: m.W, energy: m.energy,
      [quantity]: this.matrices(quantity === "stiffness" ? m.K : m.C),
      load: { kind: m.kind, at: m.at, meaning: this.data.words.kinds[m.kind], stiffness: m.K.load,
        compliance: m.C.load }, notes };
  }

  /** What drives carry, with their limits, the most loaded first, as `cartstiff.core.stiffness.forces.forces_of`. */
  forces(m) {
    const { drives, closing, platform } = this.data;
    const carried = m.tensions ?? m.torques;
    const most = Math.max(...drives.map(({ coordinate: j }) => Math.abs(carried[j])));
    // Without a load, springs have what rounding leaves of their own sizes.
    const rounding = drives.map(({ coordinate: j }) => m.stiffness[j] * (platform ? m.length : m.sizes[j]));
    const isNoise = most <= (closing ? STALLED_RESIDUAL : PRINTED_AS_ZERO) * Math.max(...rounding);
    const found = drives.map(({ name, is_length: isLength, coordinate, least: low, most: high }) => {
      const own = carried[coordinate];
      const force = isNoise || Math.abs(own) <= PRINTED_AS_ZERO * most ? 0 : own;
      const margin = Math.min(force - (low ?? -Infinity), (high ?? Infinity) - force);
      const middle = (low > 0 && high !== null) || (high < 0 && low !== null) ? (low + high) / 2 : 0;
      const limit = force < middle ? low : high;
      const share = limit === null || force === middle ? 0 : (force - middle) / (limit - middle);
      const used = low === null && high === null ? null : share;
      return { name, is_length: isLength, force, least: low, most: high,
        margin: Number.isFinite(margin) ? margin : null, used };
    });
    return found.sort((a, b) => (b.used ?? -1) - (a.used ?? -1));
  }

  /**
   * The stiffness in the axes of `cartstiff.core.stiffness.task_axes` that the first posture has: the inverse of the
   * compliance of these components.
   */
  taskAxes(m, { names, axes, alone }) {
    const turn = motion(axes === "F" ? transposed(rotation(m.pose)) : identity(3), [0, 0, 0]);
    const [C, loaded] = [m.C.B, m.C.load].map((M) => congruence(transposed(adjoint(turn)), M));
    const rows = names.map((name) => TWIST.indexOf(name === "phi" ? turnOf(names) : name));
    const [stiffness, tangent] = [C, loaded].map((M) => inverse(rows.map((i) => rows.map((j) => M[i][j]))));
    const motions = product(C.map((row) => rows.map((j) => row[j])), stiffness);
    return { names, axes, alone, motions, stiffness, tangent };
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
    const [length, origin] = isPositive ? [[...move, ...turn].reduce((all, x) => all * x ** (-1 / 6), 1), "natural"]
      : [1, "unit"];
    const { values } = eigen(scaled(K, turnsBy(1 / length)));
    const condition = (list) => Math.max(...list.map(Math.abs)) / Math.min(...list.map(Math.abs));
    return {
      length, length_origin: origin, length_reason: this.data.words.lengths[origin], definiteness: definiteness(values),
        eigenvalues: values,
      condition_number: condition(values), translational_condition: condition(move),
      rotational_condition: condition(eigen(block(K, 0)).values),
    };
  }

  distance(m) {
    return Object.entries(m.singular).map(([kind, { values }]) =>
      ({ kind, ratio: values.at(-1) / values[0], smallest: values.at(-1), largest: values[0], length: m.length }));
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
    const inRoom = times(rotation(m.pose), displacement);
    return {
      displacement, in_room: inRoom, of_frame: twist.slice(3), rotation: twist.slice(0, 3),
      which: this.which(inRoom, false), energy, acts_at: m.at,
      resisted: values[0] >= 0 || -values[0] <= ZERO_SHARE * Math.max(...values.map(Math.abs)),
      shares: this.contributions(m, this.shares(m, twist, displacement, energy, state.point)),
      motion: this.motion(m, twist), notes: [],
    };
  }

  /** As `cartstiff.shown.page.what_if.what_if`. */
  whatIf(state, to) {
    const size = (one) => {
      return wayOf({ moved: this.moved(this.solve(one), one) });
    };
    const now = Array.from(state.stiffness ?? this.data.shared.stiffness);
    const sizes = to.map((k, i) => {
      if (k === null) return null;
      try {
        return size({ ...state, stiffness: now.with(i, k) });
      } catch {
        return null; // the formulas do not hold there
      }
    });
    const order = [...sizes.keys()].filter((i) => sizes[i] !== null).sort((i, j) => sizes[i] - sizes[j]);
    return { here: size(state), sizes, order };
  }

  /** A direction of the room in words; null for none. */
  which(direction, isLine) {
    return direction?.some((x) => x) ? directionWords(direction, isLine, this.data.upright) : null;
  }

  /** Shares with their names, the largest first, and the rest; null where one does not exist. */
  contributions(m, shares) {
    const names = [...this.data.names, ...(this.data.bending?.beams ?? []).map(({ label }) => `${label} (link)`)];
    const parts = shares.flatMap((share, i) => (m.stiffness[i] === 0 ? [] : [{ name: names[i], share }]));
    if (!parts.length || parts.some(({ share }) => share === null)) return null;
    const size = ({ share }) => Number(Math.abs(share).toFixed(SAME_SHARE));
    const isOfJoints = !this.data.platform && !m.N;
    return { of: isOfJoints ? "displacement" : "energy", parts: parts.toSorted((x, y) => size(y) - size(x)),
      rest: isOfJoints ? 0 : parts.reduce((sum, { share }) => sum - share, 1) };
  }

  /** How far the load moves all coordinates, or a platform's body, as `cartstiff.answer.analysis.posture.motion_of`. */
  motion(m, twist) {
    if (this.data.platform) return twist;
    return m.N ? times(m.N, this.way(m)) : this.way(m);
  }

  /** How far the load moves the coordinates, or a platform's body. */
  way(m) {
    if (this.data.platform) return times(m.C.load, m.W);
    return times(scaledInverse(plus(m.L, congruence(m.J, m.changes.load))), times(transposed(m.J), m.W));
  }

  shares(m, twist, shift, energy, point) {
    if (this.data.platform) return m.lines.map((line, i) =>
      (energy ? (0.5 * m.stiffness[i] * dot(line, twist) ** 2) / energy : null));
    const way = this.way(m);
    if (m.N) {
      const all = times(m.N, way);
      let from = 0;
      const links = (m.hessians ? this.data.bending.beams : [])
        .map(({ segments }) => segments.reduce((sum, indices) => {
        const x = indices.map((j) => all[j]);
        return sum + 0.5 * dot(x, times(rows(m.hessians.slice(from, from += 36), 6), x));
      }, 0));
      return [...m.stiffness.map((k, j) => 0.5 * k * all[j] ** 2), ...links].map((x) => (energy ? x / energy : null));
    }
    const size = dot(shift, shift);
    return transposed(m.J).map((column, a) => (size ? (dot(shift, shiftAt(point, column)) * way[a]) / size : null));
  }
}

/** How far a twist moves a point. */
export function shiftAt(point, twist) {
  const arm = cross(twist.slice(0, 3), point);
  return twist.slice(3).map((x, i) => x + arm[i]);
}
