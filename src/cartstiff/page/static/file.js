// Answers without a server, from what an exported page holds.

/** What the sources in a file share: commands by number, one answer to each question. */
export class FileSource {
  /** From what a file holds, or the same beside another source. */
  constructor(data, commands, words, other = null) {
    this.data = data;
    this.commands = other ? other.commands : expand(data.commands, commands);
    this.live = false;
    this.words = words;
    this.cannot = "an exported page cannot do that; `cartstiff view` can";
    this.onstatus = () => {};
  }

  start() {
    this.onanswer({ ...this.data.hello, id: 0, do: "hello" }, this.listed(this.data.start));
  }

  onlost() {}

  beside() {
    return new this.constructor(this.data, null, this);
  }

  close() {}

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
        this.onanswer({ id: message.id, do: message.do, error: this.reason(error) }, []);
      }
    });
  }

  reason(error) {
    return error.message;
  }

  answer(message) {
    const { id, state, do: what } = message;
    if (what === "draw") return this.draw(id, state, message);
    const found = {
      numbers: () => ({ numbers: this.numbersOf(state) }),
      result: () => ({ result: this.result(state) }),
      bounds: () => ({ bounds: this.bounds(state) }),
      sweep: () => ({ seconds: 0, ...this.sweep(message.coordinate, state) }),
      series: () => ({ seconds: 0, ...this.series(state) }),
      analysis: () => this.data.analysis,
    }[what]?.();
    if (!found) throw new Error(this.cannot);
    return [{ id, do: what, ...found }, []];
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
