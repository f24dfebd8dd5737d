// Answers from the frames of an exported page: what a server would say, computed beforehand.

import { rowOf } from "./curves.js";
import { toast } from "./dom.js";
import { FileSource } from "./file.js";
import { CLOSE, ROUNDING } from "./numerics.js";

const LINE = "Exported page: each slider runs through computed postures; the others then stand as in the file.";

export class FramesSource extends FileSource {
  constructor(data, commands, other) {
    super(data, commands, `${LINE} ${data.why ? `Why it does not compute: ${data.why}.` : ""}`, other);
    this.moves = false;
    this.shows = Object.keys(data.parts);
  }

  frame(state) {
    return this.data.frames[this.nearest(state)];
  }

  numbersOf(state) {
    return this.numbers(this.frame(state), state);
  }

  result(state) {
    return this.frame(state).result;
  }

  bounds(state) {
    return this.frame(state).bounds;
  }

  /** The frame nearest to a state: along the sweep of the coordinate just moved, or of all. */
  nearest(state) {
    const { frames, sweeps } = this.data;
    const among = state.moved !== null && sweeps[state.moved] ? sweeps[state.moved] : frames.keys();
    let best = 0;
    let distance = Infinity;
    for (const i of among) {
      const q = frames[i].result.q;
      const d = state.moved !== null && sweeps[state.moved] ? Math.abs(q[state.moved] - state.q[state.moved])
        : Math.max(...q.map((x, k) => Math.abs(x - state.q[k])));
      if (d < distance) [best, distance] = [i, d];
    }
    return best;
  }

  /** Say once that other coordinates have gone back: the file holds one sweep of each. */
  saySnapped(wanted, got, moved) {
    if (this.said || moved === null) return;
    const { mechanism: { sliders }, state: { q } } = this.data.hello;
    const went = (i) => i !== moved && Math.abs(wanted[i] - q[i]) > CLOSE && Math.abs(wanted[i] - got[i]) > CLOSE;
    if (!sliders.some(went)) return;
    this.said = true;
    toast("This file holds a sweep of each slider alone: the others have gone back");
  }

  /** The value of a coordinate at the next frame in a direction. */
  neighbour(coordinate, value, step) {
    const values = (this.data.sweeps[coordinate] ?? []).map((i) => this.data.frames[i].result.q[coordinate]);
    const further = values.filter((x) => (x - value) * step > ROUNDING);
    return further.length ? (step > 0 ? Math.min(...further) : Math.max(...further)) : value;
  }

  variant(frame, state) {
    return this.data.variants[frame.variants[`${state.quantity}/${state.connection}`]];
  }

  draw(id, state) {
    const frame = this.frame(state);
    const commands = [...this.listed(frame.pictures[`${state.quantity}/${state.connection}`]), ...this.themed(state.theme)];
    const { legend } = this.variant(frame, state);
    return [{ id, do: "draw", numbers: this.numbers(frame, state), legend }, [...commands, ...this.visible(state)]];
  }

  numbers(frame, state) {
    const { variants, pictures, ...common } = frame;
    return { ...common, ...this.variant(frame, state).numbers };
  }

  /** What the boxes under "Show" hide and show. */
  visible(state) {
    const commands = [];
    for (const [key, paths] of Object.entries(this.data.parts)) {
      if (!state[key]) for (const path of paths) commands.push({ type: "set_property", path, property: "visible", value: false });
    }
    // The file holds the picture of one posture A only.
    const { ghost } = this.data.hello.state;
    if (ghost) commands.push({ type: "set_property", path: "/meshcat/cartstiff/ghost", property: "visible",
      value: JSON.stringify(ghost) === JSON.stringify(state.ghost) });
    return commands;
  }

  rows(indices, state) {
    return indices.map((i) => {
      if (i === null) return { reason: "this posture is not reached" };
      const frame = this.data.frames[i];
      return rowOf(this.numbers(frame, state), frame.result.q);
    });
  }

  sweep(coordinate, state) {
    const { frames, sweeps } = this.data;
    const indices = sweeps[coordinate];
    if (!indices) throw new Error("this page holds no sweep of that coordinate");
    return { coordinate, at: indices.map((i) => frames[i].result.q[coordinate]), rows: this.rows(indices, state) };
  }

  series(state) {
    const { hello, path } = this.data;
    return { at: hello.trajectory.time, rows: this.rows(path, state) };
  }
}
