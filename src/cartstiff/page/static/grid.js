// The grid of a plot: values by decades, places along it.

import { short } from "./dom.js";
import { svg } from "./plotfiles.js";

// A plot less wide than this (dots) has fewer words below.
const NARROW = 420;

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

/** From `bottom` to `top` in decades, and between two ends; `atText` says a place in words. */
export function grid(plot, { width, height, margin }, [bottom, top], placeY, [first, last], placeX, atText, unit) {
  const decades = top - bottom;
  const marks = decades > 4 ? [1] : decades > 1.2 ? [1, 3] : [1, 1.5, 2, 3, 5, 7];
  const step = Math.max(1, Math.ceil(decades / 5));
  let lastY = Infinity;
  for (let d = Math.floor(bottom); d <= top; d++) {
    for (const m of marks) {
      const value = m * 10 ** d;
      const at = Math.log10(value);
      if (at < bottom || at > top || (m === 1 && d % step !== 0 && decades > 4)) continue;
      const y = placeY(value);
      if (lastY - y < 13) continue;
      lastY = y;
      plot.append(svg("line", { class: "grid", x1: margin.left, x2: width - margin.right, y1: y, y2: y }),
        lettered(margin.left - 5, y + 3.5, short(value, 3), "end"));
    }
  }
  for (const share of width < NARROW ? [0, 0.5, 1] : [0, 0.25, 0.5, 0.75, 1]) {
    const x = first + share * (last - first);
    plot.append(lettered(placeX(x), height - 4, atText(x), share === 0 ? "start" : share === 1 ? "end" : "middle"));
  }
  plot.append(lettered(margin.left + 4, margin.top + 10, unit, "start", "unit"));
}
