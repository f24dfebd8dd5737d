// Directions in words, as `cartstiff.shown.report.sentences.direction_words` says them.

const [ALONG, ALMOST] = [1, 20]; // degrees
const degrees = (y, x) => (Math.atan2(y, x) * 180) / Math.PI;

/** A direction of the room: "almost vertical, 4 deg off z"; the sign of a line's means nothing. */
export function directionWords(direction, isLine = true, isUpright = true) {
  const size = Math.hypot(...direction);
  const [x, y, z] = direction.map((value) => value / size);
  const sign = (value) => (value < 0 && !isLine ? "-" : "");
  const off = degrees(Math.hypot(x, y), Math.abs(z));
  const way = z > 0 ? " upwards" : " downwards";
  const vertical = isUpright ? `vertical${isLine ? "" : way}` : `along ${sign(z)}z`;
  const horizontal = isUpright ? "horizontal" : "in the xy plane";
  if (off <= ALONG) return vertical;
  const axis = `${off.toFixed(0)} deg off ${sign(z)}z`;
  if (off <= ALMOST) return `almost ${vertical}, ${axis}`;
  const [[near, name], [far]] = Math.abs(x) >= Math.abs(y) ? [[x, "x"], [y]] : [[y, "y"], [x]];
  const beside = degrees(Math.abs(far), Math.abs(near));
  const called = `${sign(near)}${name}`;
  const across = beside <= ALONG ? `along ${called}` : `${beside.toFixed(0)} deg off ${called}`;
  if (off >= 90 - ALONG) return `${horizontal}, ${across}`;
  if (off >= 90 - ALMOST) return `almost ${horizontal}, ${(90 - off).toFixed(0)} deg off the xy plane, ${across}`;
  return `${axis} towards ${called}`;
}
