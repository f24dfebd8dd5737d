// Meshes of a file, whose numbers are written as differences (`cartstiff.shown.page.filters`), as they were.

/** Put the numbers of commands back; each filter is [command, first byte, count, width, stride, grid]. */
export function restore(commands, filters) {
  for (const [command, at, count, width, stride, grid] of filters) {
    const bytes = commands[command];
    const planes = bytes.slice(at, at + count * width);
    const view = new DataView(bytes.buffer, bytes.byteOffset + at, count * width);
    const entries = count / stride;
    for (let column = 0; column < stride; column++) {
      let value = 0;
      for (let i = 0; i < entries; i++) {
        let signless = 0;
        for (let b = 0; b < width; b++) signless |= planes[b * count + column * entries + i] << (8 * b);
        value = (value + ((signless >>> 1) ^ -(signless & 1))) | 0;
        put(view, (i * stride + column) * width, value, width, grid);
      }
    }
  }
}

function put(view, at, value, width, grid) {
  if (grid) view.setFloat32(at, value * grid, true);
  else if (width === 1) view.setUint8(at, value & 255);
  else if (width === 2) view.setUint16(at, value & 65535, true);
  else view.setUint32(at, value >>> 0, true);
}
