// Answers from recorded arithmetic in a page without a server: any posture, load, springs and point.

import { angles, back, inverse, moved, place, product, rotation, times, transposed } from "./algebra.js";
import { rowOf } from "./curves.js";
import { clamp } from "./dom.js";
import { Drawing } from "./drawing.js";
import { FileSource } from "./file.js";
import { Living, NOT_PLAIN } from "./living.js";
import { CLOSE, NEAR, ROUNDING } from "./numerics.js";

const STEPS = 121;
// Steps of the way to a pose, and halvings of a way that legs do not go to its end.
const MOST_STEPS = 30;
const HALVINGS = 14;
// Step of a difference, over the size of what changes.
const STEP = 2 ** -20;

export class LivingSource extends FileSource {
  constructor(data, commands, other) {
    super(data, commands, "A file that computes: postures, loads, springs and points are answered here, without a server, wherever the formulas hold.", other);
    this.moves = true;
    this.shows = ["translation", "rotation", "labels", "wrench"];
    this.theme = data.hello.state.theme;
    this.living = new Living(data.living, globalThis.cartstiffTapes);
    this.drawing = new Drawing(this.living, data.kit, data.scene);
  }

  reason({ message }) {
    return message === NOT_PLAIN ? `${NOT_PLAIN}; what is shown is the last posture that the page answers` : message;
  }

  numbersOf(state) {
    return this.living.numbers(state);
  }

  result(state) {
    return this.living.result(state);
  }

  bounds(state) {
    return this.drawing.bounds(this.living.place(state.q));
  }

  draw(id, asked, { towards, lengths }) {
    const followed = towards ? follow(this.living, asked.q, towards.pose) : null;
    const state = followed ? { ...asked, q: followed.q, moved: null } : lengths ? { ...asked, q: stretched(this.living, asked.q, lengths), moved: null } : asked;
    const m = this.living.solve(state);
    const numbers = this.living.numbers(state, m);
    const commands = this.themed(state.theme);
    const drawn = this.drawing.draw(m, state);
    return [{ id, do: "draw", numbers, followed, legend: { ...drawn.legend, cloud: this.data.cloud } }, [...commands, ...drawn.commands]];
  }

  row(q, state) {
    try {
      const m = this.living.solve({ ...state, q });
      return rowOf(this.living.numbers({ ...state, q, mode: null }, m), q);
    } catch ({ message }) {
      return { reason: message };
    }
  }

  sweep(coordinate, state) {
    const { lower, upper } = this.data.hello.mechanism.coordinates[coordinate];
    const at = Array.from({ length: STEPS }, (_, k) => lower + ((upper - lower) * k) / (STEPS - 1));
    return { coordinate, at, rows: at.map((x) => this.row(state.q.with(coordinate, x), state)) };
  }

  series(state) {
    return { at: this.data.hello.trajectory.time, rows: this.data.trajectory.map((q) => this.row(q, state)) };
  }
}

/** Rotation vector of a rotation. */
function turn(R) {
  const axis = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]].map((x) => x / 2);
  const sine = Math.hypot(...axis);
  const angle = Math.atan2(sine, (R[0][0] + R[1][1] + R[2][2] - 1) / 2);
  return axis.map((x) => (sine > CLOSE ? (x * angle) / sine : x));
}

/** What is left from a pose to another, along the axes of the first. */
function left(from, to) {
  const T = product(back(from), to);
  return [...turn(rotation(T)), ...place(T)];
}

/** The pose of a platform at which its legs have given lengths, next to q. */
export function stretched(living, q, lengths) {
  const { anchors, points } = living.data;
  const rest = (x) => {
    const { pose } = living.place(x);
    return points.map((point, i) => lengths[i] - Math.hypot(...moved(pose, point).map((c, k) => c - anchors[i][k])));
  };
  let found = q.slice();
  for (let k = 0; k < MOST_STEPS; k++) {
    const error = rest(found);
    if (Math.hypot(...error) <= ROUNDING * Math.hypot(...lengths)) return found;
    const columns = found.map((x, j) => {
      const h = STEP * (j < 3 ? living.data.reach : 1);
      const [back_, forth] = [-h, h].map((by) => rest(found.with(j, x + by)));
      return back_.map((y, i) => (y - forth[i]) / (2 * h));
    });
    const J = transposed(columns);
    const way = times(inverse(product(columns, J)) ?? [], times(columns, error));
    if (way.length < 6 || !way.every(Number.isFinite)) break;
    found = found.map((x, j) => x + way[j]);
  }
  throw new Error("no pose with these leg lengths found from here");
}

/** The posture that follows a hand to a pose, as near as limits let it; see `cartstiff.kinematics.following`. */
export function follow(living, q, wanted) {
  const { data } = living;
  const beyond = (x, pose, near) => living.limited(x, pose).flatMap((value, i) => (
    value < (data.limits.lower[i] ?? -Infinity) + near || value > (data.limits.upper[i] ?? Infinity) - near ? [data.limits.names[i]] : []));
  let found = q.slice();
  let stopped = [];
  if (data.platform) {
    const P = product(wanted, back(data.T_P_M));
    const end = [...place(P), ...angles(P)].map((x, i) => (i < 3 ? x : x - 2 * Math.PI * Math.round((x - q[i]) / (2 * Math.PI))));
    const on = (share) => q.map((x, i) => x + share * (end[i] - x));
    const stops = (share) => beyond(on(share), living.place(on(share)).pose, 0);
    let [low, high] = [0, 1];
    stopped = stops(0).length ? [] : stops(1); // who is beyond a limit may come back
    if (!stopped.length) low = 1;
    else for (let k = 0; k < HALVINGS; k++) {
      const middle = (low + high) / 2;
      const met = stops(middle);
      if (met.length) [high, stopped] = [middle, met];
      else low = middle;
    }
    found = on(low);
  } else {
    let here = living.place(found);
    let error = left(here.pose, wanted);
    const length = data.reach;
    const size = (e) => Math.hypot(...e.map((x, i) => (i < 3 ? x * length : x)));
    let damping = NEAR * NEAR;
    for (let k = 0; k < MOST_STEPS && size(error) > CLOSE * length; k++) {
      const free = data.are_lengths.map(() => true);
      let step;
      for (let again = 0; again < 2; again++) {
        const J = here.J.map((row, i) => row.map((x, j) => (free[j] ? x * (i < 3 ? length : 1) : 0)));
        const JJ = product(J, transposed(J)).map((row, i) => row.map((x, j) => x + (i === j ? damping * length * length : 0)));
        step = times(transposed(J), times(inverse(JJ) ?? [], error.map((x, i) => (i < 3 ? x * length : x))));
        // A joint that would leave its limit stays, and the others do what they can.
        data.limits.columns.forEach((j, i) => {
          const x = found[j] + step[j];
          if (x < (data.limits.lower[i] ?? -Infinity) || x > (data.limits.upper[i] ?? Infinity)) free[j] = false;
        });
      }
      const next = found.map((x, j) => x + step[j]);
      data.limits.columns.forEach((j, i) => { next[j] = clamp(next[j], data.limits.lower[i] ?? -Infinity, data.limits.upper[i] ?? Infinity); });
      const there = living.place(next);
      const rest = left(there.pose, wanted);
      if (size(rest) < size(error)) [found, here, error, damping] = [next, there, rest, Math.max(ROUNDING, damping / 10)];
      else if ((damping *= 10) > 10) break;
    }
    stopped = beyond(found, here.pose, NEAR * NEAR * NEAR);
  }
  const rest = left(living.place(found).pose, wanted);
  const [angle, distance] = [Math.hypot(...rest.slice(0, 3)), Math.hypot(...rest.slice(3))];
  const reached = Math.max(distance / data.reach, angle) <= NEAR ** 4;
  return { q: found, distance, angle, reached, stopped: reached ? [] : stopped };
}
