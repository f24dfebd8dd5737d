// Answers without a server: from the recorded arithmetic any posture, load, springs and point, or one posture as it was
// exported.

import { back, inverse, place, product, rotation, times, transposed } from "./algebra.js";
import { rowOf } from "./curves.js";
import { clamp, evenly } from "./dom.js";
import { Drawing } from "./drawing.js";
import { NOT_CLOSED } from "./formulas.js";
import { NEAR_SINGULARITY, NEGLIGIBLE_DIFFERENCE, ROUNDOFF } from "./numerics.js";
import { Program } from "./program.js";

// Postures of a sweep: an even number, so that none is in the middle of the range, where many a singularity lies.
const STEPS = 120;
// Shares of the way from a posture to the file's at which one is tried that the formulas cover.
const ON_THE_WAY = [0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1];
// Steps of the way to a pose, and halvings of a way that legs do not go to its end.
const MOST_STEPS = 30;
const HALVINGS = 14;
// Keys of a state on which an answer depends.
const ASKED = ["q", "connection", "point", "stiffness", "load", "load_axes", "load_kind", "load_at", "gravity",
  "payload", "command", "allowed"];

/** What the sources in a file share: commands by number, one answer to each question. */
class FileSource {
  /** From what a file holds, or the same beside another source. */
  constructor(data, commands, words, other = null) {
    this.data = data;
    this.commands = other ? other.commands : commands;
    this.live = false;
    this.words = words;
    this.cannot = "an exported page cannot do that; `cartstiff view` can";
    this.onstatus = (_status) => {};
    this.onanswer = (_data, _commands) => {};
  }

  start() {
    this.onanswer({ ...this.data.hello, id: 0, do: "hello" }, this.listed(this.data.start));
  }

  onlost() {}

  beside() {
    const Own = /** @type {any} */ (this.constructor);
    return new Own(this.data, null, this);
  }

  close() {}

  /** @returns {any[]} */
  draw(_id, _state, _message) { return []; }

  /** @returns {Record<string, () => any>} */
  answers(_message) { return {}; }

  listed(numbers) {
    return numbers.map((i) => this.commands[i]);
  }

  /** Commands that show a theme, if it is not the one shown. */
  themed(theme) {
    if (this.theme === theme) return [];
    this.theme = theme;
    return this.listed(this.data.themes[theme]);
  }

  ask(message) {
    queueMicrotask(() => {
      try {
        this.onanswer(...this.answer(message));
      } catch (error) {
        this.onanswer({ id: message.id, do: message.do, error: error.message }, []);
      }
    });
  }

  /** Whether a state differs from that of the file in one of some keys. */
  differs(state, keys) {
    const { state: own } = this.data.hello;
    return keys.some((key) => JSON.stringify(state[key]) !== JSON.stringify(own[key]));
  }

  /** The sentences that were exported: those of other states are the library's. */
  said(state) {
    if (this.differs(state, ASKED)) throw new Error(this.cannot);
    return this.data.said;
  }

  answer(message) {
    const { id, state, do: what } = message;
    if (what === "draw") return this.draw(id, state, message);
    const found = this.answers(message)[what]?.();
    if (!found) throw new Error(this.cannot);
    return [{ id, do: what, ...found }, []];
  }
}

/** A file of a mechanism that the browser computes, and what answers while a server is busy or gone. */
export class ComputingSource extends FileSource {
  constructor(data, commands, other) {
    super(data, commands,
      "A file that computes: postures, loads, springs and points are answered here, without a server, wherever the "
        + "formulas hold.", other);
    this.moves = true;
    this.shows = ["translation", "rotation", "labels", "wrench", "deflection"];
    this.theme = data.hello.state.theme;
    this.program = new Program(data.program, globalThis.cartstiffProgram);
    this.drawing = new Drawing(this.program, data.assets, data.scene);
  }

  /** Answers to all questions but "draw", by their names. */
  answers({ state, coordinate, to }) {
    const { program, drawing, data } = this;
    return {
      numbers: () => ({ numbers: program.numbers(state) }),
      result: () => ({ result: program.result(state) }),
      bounds: () => ({ bounds: drawing.bounds(program.place(state.q)) }),
      sweep: () => this.sweep(coordinate, state),
      stiffer: () => program.whatIf(state, to),
      series: () => ({ seconds: 0, at: data.hello.trajectory.time,
        rows: data.trajectory.map((q) => this.row(q, state)) }),
      analysis: () => data.analysis,
      answer: () => this.said(state),
    };
  }

  draw(id, asked, { towards, lengths }) {
    const followed = towards ? follow(this.program, asked.q, towards.pose) : null;
    const state = followed ? { ...asked, q: followed.q, moved: null } : lengths
      ? { ...asked, q: stretched(this.program, asked.q, lengths), moved: null } : asked;
    const m = this.program.solve(state);
    const numbers = this.program.numbers(state, m);
    const commands = this.themed(state.theme);
    const drawn = this.drawing.draw(m, state, numbers);
    return [{ id, do: "draw", numbers, followed, legend: { ...drawn.legend, cloud: this.data.legend.cloud } },
      [...commands, ...drawn.commands]];
  }

  /** The posture that the formulas cover nearest to q on the way to another; q itself if none does. */
  covered(q, home, state) {
    for (const share of ON_THE_WAY) {
      const near = share ? q.map((x, i) => x + share * (home[i] - x)) : q;
      try {
        this.program.solve({ ...state, q: near });
        return near;
      } catch {
        // further on
      }
    }
    return q;
  }

  row(q, state) {
    try {
      const m = this.program.solve({ ...state, q });
      const moved = this.program.adjusted(m);
      return moved.length ? { reason: NOT_CLOSED, moved }
        : rowOf(this.program.numbers({ ...state, q, mode: null }, m), m.straight);
    } catch ({ message }) {
      return { reason: message, ...(message === NOT_CLOSED ? { moved: [] } : {}) };
    }
  }

  /** Rows at all values of a coordinate, outwards from where it is: a closed chain goes on from the neighbour. */
  rows(coordinate, values, state) {
    const from = state.q[coordinate];
    /** @type {any[]} */
    const found = [];
    const last = { true: state.q, false: state.q };
    for (const k of [...values.keys()].sort((a, b) => Math.abs(values[a] - from) - Math.abs(values[b] - from))) {
      const side = String(values[k] >= from);
      found[k] = this.row(last[side].with(coordinate, values[k]), state);
      last[side] = found[k].q ?? last[side];
    }
    return found;
  }

  sweep(coordinate, state) {
    const { swept: [lower, upper] } = this.data.hello.mechanism.coordinates[coordinate];
    const at = evenly(lower, upper, STEPS);
    return { seconds: 0, coordinate, at, rows: this.rows(coordinate, at, state) };
  }
}

/** A file of a mechanism that the browser cannot compute: one posture, as it was exported. */
export class PostureSource extends FileSource {
  constructor(data, commands, other) {
    super(data, commands,
      `This file shows one posture: ${data.posture.why}, which the browser does not compute. You can turn the picture, `
      + "read and copy every number, see the parts of the matrix, the modes and the full analysis, and save JSON and "
        + "PNG. `cartstiff view` moves it.", other);
    this.moves = false;
    this.shows = [];
    this.theme = data.hello.state.theme;
    this.cannot = "this file shows one posture as it was exported; `cartstiff view` shows others";
  }

  draw(id, state) {
    if (this.differs(state, Object.keys(this.data.hello.state)
      .filter((key) => !["theme", "mode", "moved", "allowed"].includes(key)))) throw new Error(this.cannot);
    return [{ id, do: "draw", numbers: this.data.posture.numbers, legend: this.data.legend, followed: null },
      this.themed(state.theme)];
  }

  answers({ state }) {
    const { posture: { numbers, result }, hello: { bounds }, analysis } = this.data;
    return { numbers: () => ({ numbers }), result: () => ({ result }), bounds: () => ({ bounds }),
      analysis: () => analysis, answer: () => this.said(state) };
  }
}

/** Rotation vector of a rotation. */
function turn(R) {
  const axis = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]].map((x) => x / 2);
  const sine = Math.hypot(...axis);
  const angle = Math.atan2(sine, (R[0][0] + R[1][1] + R[2][2] - 1) / 2);
  return axis.map((x) => (sine > NEGLIGIBLE_DIFFERENCE ? (x * angle) / sine : x));
}

/** What is left from a pose to another, along the axes of the first. */
function left(from, to) {
  const T = product(back(from), to);
  return [...turn(rotation(T)), ...place(T)];
}

/** The pose of a platform at which its legs have given lengths, next to q. */
export function stretched(program, q, lengths) {
  let here = program.place(q);
  for (let k = 0; k < MOST_STEPS; k++) {
    const error = lengths.map((length, i) => length - here.lengths[i]);
    if (Math.hypot(...error) <= ROUNDOFF * Math.hypot(...lengths)) return here.q;
    const J = here.lines;
    const way = times(inverse(product(transposed(J), J)) ?? [], times(transposed(J), error));
    if (way.length < 6 || !way.every(Number.isFinite)) break;
    here = program.place(program.along(here, way));
  }
  throw new Error("no pose with these leg lengths found from here");
}

/** The posture that follows a hand to a pose, as near as limits let it; see `cartstiff.shown.page.following`. */
export function follow(program, q, wanted) {
  const { data } = program;
  const beyond = (place, near) => program.limited(place).flatMap((value, i) => (
    value < (data.limits.lower[i] ?? -Infinity) + near || value > (data.limits.upper[i] ?? Infinity) - near
      ? [data.limits.names[i]] : []));
  let found = q.slice();
  let stopped = [];
  if (data.platform) {
    const end = program.coordinates(wanted, q);
    const on = (share) => q.map((x, i) => x + share * (end[i] - x));
    const stops = (share) => beyond(program.place(on(share)), 0);
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
    let here = program.place(found);
    let error = left(here.pose, wanted);
    const length = data.reach;
    const size = (e) => Math.hypot(...e.map((x, i) => (i < 3 ? x * length : x)));
    let damping = NEAR_SINGULARITY * NEAR_SINGULARITY;
    const { independent } = program;
    const ends = independent.map((j) => {
      const i = data.limits.columns.indexOf(j);
      return [data.limits.lower[i] ?? -Infinity, data.limits.upper[i] ?? Infinity];
    });
    for (let k = 0; k < MOST_STEPS && size(error) > NEGLIGIBLE_DIFFERENCE * length; k++) {
      const free = here.J[0].map((_, a) => !data.virtual.includes(independent[a]));
      let step;
      for (let again = 0; again < 2; again++) {
        const J = here.J.map((row, i) => row.map((x, j) => (free[j] ? x * (i < 3 ? length : 1) : 0)));
        const JJ = product(J, transposed(J)).map((row, i) =>
          row.map((x, j) => x + (i === j ? damping * length * length : 0)));
        step = times(transposed(J), times(inverse(JJ) ?? [], error.map((x, i) => (i < 3 ? x * length : x))));
        // A joint that would leave its limit stays, and the others do what they can.
        ends.forEach(([low, high], a) => {
          const x = found[independent[a]] + step[a];
          if (x < low || x > high) free[a] = false;
        });
      }
      ends.forEach(([low, high], a) => { step[a] = clamp(found[independent[a]] + step[a], low,
        high) - found[independent[a]]; });
      const there = program.place(program.along(here, step));
      const rest = left(there.pose, wanted);
      if (size(rest) < size(error)) [found, here, error, damping] = [there.q, there, rest,
        Math.max(ROUNDOFF, damping / 10)];
      else if ((damping *= 10) > 10) break;
    }
    stopped = beyond({ q: found }, NEAR_SINGULARITY * NEAR_SINGULARITY * NEAR_SINGULARITY);
  }
  const rest = left(program.place(found).pose, wanted);
  const [angle, distance] = [Math.hypot(...rest.slice(0, 3)), Math.hypot(...rest.slice(3))];
  const reached = Math.max(distance / data.reach, angle) <= NEAR_SINGULARITY ** 4;
  return { q: found, distance, angle, reached, stopped: reached ? [] : stopped };
}
