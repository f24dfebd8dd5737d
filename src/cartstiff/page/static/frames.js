// Answers from the frames of an exported page: what a server would say, computed beforehand.

import { toast } from "./dom.js";
import { CLOSE, ROUNDING } from "./numerics.js";

const LINE = "Exported page: each slider runs through computed postures; the others then stand as in the file.";

export class FramesSource {
  constructor(data, commands) {
    this.data = data;
    this.commands = expand(data.commands, commands);
    this.live = false;
    this.moves = false;
    this.shows = Object.keys(data.parts);
    this.words = `${LINE} ${data.why ? `Why it does not compute: ${data.why}.` : ""}`;
    this.onstatus = () => {};
    this.shown = null;
  }

  start() {
    this.onanswer({ ...this.data.hello, id: 0, do: "hello" }, this.data.start.map((i) => this.commands[i]));
  }

  onlost() {}

  ask(message) {
    queueMicrotask(() => {
      try {
        this.onanswer(...this.answer(message));
      } catch (error) {
        this.onanswer({ id: message.id, do: message.do, error: error.message }, []);
      }
    });
  }

  answer(message) {
    const { id, state } = message;
    if (message.do === "draw") return this.draw(id, state);
    if (message.do === "numbers") return [{ id, do: "numbers", numbers: this.numbers(this.data.frames[this.nearest(state)], state) }, []];
    if (message.do === "result") return [{ id, do: "result", result: this.data.frames[this.nearest(state)].result }, []];
    if (message.do === "bounds") return [{ id, do: "bounds", bounds: this.data.frames[this.nearest(state)].bounds }, []];
    if (message.do === "sweep") return [{ id, do: "sweep", seconds: 0, ...this.sweep(message.coordinate, state) }, []];
    if (message.do === "series") return [{ id, do: "series", seconds: 0, ...this.series(state) }, []];
    if (message.do === "analysis") return [{ id, do: "analysis", ...this.data.analysis }, []];
    throw new Error("an exported page cannot do that; `cartstiff view` can");
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
    const { sliders } = this.data.hello.mechanism;
    if (!sliders.some((i) => i !== moved && Math.abs(wanted[i] - got[i]) > CLOSE)) return;
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
    const frame = this.data.frames[this.nearest(state)];
    const commands = frame.pictures[`${state.quantity}/${state.connection}`].map((i) => this.commands[i]);
    if (this.theme !== state.theme) {
      this.theme = state.theme;
      commands.push(...this.data.themes[state.theme].map((i) => this.commands[i]));
    }
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
      if (i === null) return null;
      const frame = this.data.frames[i];
      const { principal } = this.variant(frame, state).numbers;
      return { q: frame.result.q, position: frame.position, translation: principal?.translation.values ?? null,
        rotation: principal?.rotation.values ?? null,
        deflection: frame.moved?.resisted ? [Math.hypot(...frame.moved.displacement)] : null };
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

/** Commands from their compact form, see compact.py. */
export function expand({ paths, transforms, labels, meshes }, [planes, ...binary]) {
  const count = transforms.length;
  const bytes = new Uint8Array(48 * count);
  for (let k = 0; k < 48; k++) for (let i = 0; i < count; i++) bytes[48 * i + k] = planes[k * count + i];
  const numbers = new DataView(bytes.buffer);
  const commands = transforms.map((path, i) => {
    const matrix = [];
    for (let k = 0; k < 12; k++) {
      matrix.push(numbers.getFloat32(48 * i + 4 * k, true));
      if (k % 3 === 2) matrix.push(k === 11 ? 1 : 0);
    }
    return { type: "set_transform", path: paths[path], matrix };
  });
  return [...commands, ...labels.map((label) => ({ type: "label", ...label })),
    ...meshes.map((mesh, i) => built(mesh, binary[i])), ...binary.slice(meshes.length)];
}

/** Whole numbers from the byte planes of their differences, `width` to a row. */
function summed(bytes, at, count, width) {
  const found = new Int32Array(count * width);
  const plane = (k, i) => bytes[at + k * count + i];
  for (let i = 0; i < count; i++) {
    for (let c = 0; c < width; c++) {
      const k = 4 * c;
      const step = plane(k, i) | (plane(k + 1, i) << 8) | (plane(k + 2, i) << 16) | (plane(k + 3, i) << 24);
      found[i * width + c] = step + (i ? found[(i - 1) * width + c] : 0);
    }
  }
  return found;
}

/** The command that makes a mesh. */
function built({ path, object, counts: [points, corners], grid, coloured }, bytes) {
  const triples = (at, Kind) => {
    const found = new Kind(3 * points);
    for (let c = 0; c < 3; c++) for (let i = 0; i < points; i++) found[3 * i + c] = bytes[at + c * points + i];
    return { itemSize: 3, type: Kind.name, array: found, normalized: true };
  };
  const position = Float32Array.from(summed(bytes, 0, points, 3), (x) => x * grid);
  const index = Uint32Array.from(summed(bytes, 12 * points, corners, 1));
  const rest = 12 * points + 4 * corners;
  const attributes = { position: { itemSize: 3, type: "Float32Array", array: position, normalized: false }, normal: triples(rest, Int8Array) };
  if (coloured) attributes.color = triples(rest + 3 * points, Uint8Array);
  const [geometry] = object.geometries;
  geometry.data = { ...geometry.data, attributes, index: { itemSize: 1, type: "Uint32Array", array: index, normalized: false } };
  return { type: "set_object", path, object };
}

