// The grid of a plot: values by decades or evenly, round places along it.

import { short } from "./dom.js";
import { CLOSE } from "./numerics.js";
import { svg } from "./plotfiles.js";


export function lettered(x, y, text, anchor, kind = "") {
  return svg("text", { x, y, "text-anchor": anchor, class: kind }, text);
}

/** The size of a drawing, which is drawn anew when it changes: asking for it each time has the whole page laid out. */
export function sized(plot, draw) {
  const size = { width: 0, height: 0 };
  new ResizeObserver(() => {
    [size.width, size.height] = [plot.clientWidth, plot.clientHeight];
    draw();
  }).observe(plot);
  return size;
}

/** A path through points [x, y]; null interrupts it. */
export const through = (points) => points.map((point, i) => (point ? `${points[i - 1] ? "L" : "M"}${point[0].toFixed(1)},${point[1].toFixed(1)}` : "")).join("");

/** Round values between two ends, so many at most; of an angle in degrees parts of a turn. */
export function ticks(first, last, most, isAngle = false) {
  const span = last - first;
  const power = 10 ** Math.floor(Math.log10(span / most));
  const steps = isAngle && span > 10 ? [1, 2, 5, 10, 15, 30, 45, 60, 90, 180] : [1, 2, 5, 10].map((x) => x * power);
  const step = steps.find((x) => span / x <= most) ?? steps.at(-1);
  const start = Math.ceil(first / step - CLOSE);
  return Array.from({ length: Math.max(0, Math.floor(last / step + CLOSE) - start + 1) }, (_, k) => (start + k) * step);
}

/** Values at which a logarithmic axis has lines. */
function decades(bottom, top) {
  const [low, high] = [Math.log10(bottom), Math.log10(top)];
  const marks = high - low > 4 ? [1] : high - low > 1.2 ? [1, 3] : [1, 1.5, 2, 3, 5, 7];
  const step = high - low > 4 ? Math.ceil((high - low) / 5) : 1;
  return Array.from({ length: Math.floor(high) - Math.floor(low) + 1 }, (_, k) => Math.floor(low) + k)
    .filter((d) => d % step === 0).flatMap((d) => marks.map((m) => m * 10 ** d)).filter((x) => x >= bottom && x <= top);
}

/** Lines and values across from `bottom` to `top`; places along, each with its words; what the values are. */
export function grid(plot, { width, height, margin }, { bottom, top, isLog }, placeY, places, words) {
  let lastY = Infinity;
  for (const value of isLog ? decades(bottom, top) : ticks(bottom, top, height / 28)) {
    const y = placeY(value);
    if (lastY - y < 13) continue;
    lastY = y;
    plot.append(svg("line", { class: "grid", x1: margin.left, x2: width - margin.right, y1: y, y2: y }),
      lettered(margin.left - 5, y + 3.5, short(value, 3), "end"));
  }
  for (const [x, text] of places) {
    plot.append(svg("line", { class: "grid", x1: x, x2: x, y1: height - margin.bottom, y2: height - margin.bottom + 4 }),
      lettered(x, height - 4, text, x > width - 26 ? "end" : "middle"));
  }
  plot.append(lettered(margin.left, margin.top - 8, words, "start", "unit"));
}
