// A plot: its drawing, axes with round values, what is seen of them.

import { clamp, short, typeset } from "./dom.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { WIDE_LETTER, svg, wrapped } from "./plotfiles.js";

// How many times nearer one step of the wheel goes.
export const CLOSER = 1.25;
// Height of a line of words instead of curves, in dots.
const LINE = 16;

/** Values from `low` to `high` along a drawing, between two dots. */
function axis(low, high, start, end) {
  const place = (x) => start + ((x - low) / (high - low || 1)) * (end - start);
  const value = (dot) => low + ((dot - start) / (end - start)) * (high - low);
  return { low, high, start, end, place, value };
}

/** What is seen of [first, last] so many times nearer, about a value that stays where it is. */
export function nearer(/** @type {number[]} */ [low, high], /** @type {number[]} */ [first, last], times, at, least) {
  const size = Math.min(last - first, Math.max(least, (high - low) / times));
  const start = clamp(at - ((at - low) * size) / (high - low), first, last - size);
  return [start, start + size];
}

/** Whether all of [first, last] is seen. */
export const isWhole = (/** @type {number[]} */ [low, high], /** @type {number[]} */ [first, last]) =>
  high - low >= (last - first) * (1 - NEGLIGIBLE_DIFFERENCE);

/** Round values between two ends, so many at most; of an angle in degrees parts of a turn. */
function ticks(first, last, most, isAngle = false) {
  const span = last - first;
  const power = 10 ** Math.floor(Math.log10(span / most));
  const steps = isAngle && span > 10 ? [1, 2, 5, 10, 15, 30, 45, 60, 90, 180] : [1, 2, 5, 10].map((x) => x * power);
  const step = steps.find((x) => span / x <= most) ?? steps.at(-1);
  const start = Math.ceil(first / step - NEGLIGIBLE_DIFFERENCE);
  return Array.from({ length: Math.max(0, Math.floor(last / step + NEGLIGIBLE_DIFFERENCE) - start + 1) },
    (_, k) => (start + k) * step);
}

/** Values at which a logarithmic axis has lines. */
function decades(bottom, top) {
  const [low, high] = [Math.log10(bottom), Math.log10(top)];
  const marks = high - low > 4 ? [1] : high - low > 1.2 ? [1, 3] : [1, 1.5, 2, 3, 5, 7];
  const step = high - low > 4 ? Math.ceil((high - low) / 5) : 1;
  return Array.from({ length: Math.floor(high) - Math.floor(low) + 1 }, (_, k) => Math.floor(low) + k)
    .filter((d) => d % step === 0).flatMap((d) => marks.map((m) => m * 10 ** d)).filter((x) => x >= bottom && x <= top);
}

export class Plot {
  /** `draw` is called when the size has changed: asking for it each time lays the page out. */
  constructor(margin, draw, { kind = "plot", label = "no curves yet" } = {}) {
    this.margin = margin;
    this.draw = draw;
    this.width = this.height = 0;
    this.node = svg("svg", { role: "img", class: kind, "aria-label": label });
    new ResizeObserver(() => {
      [this.width, this.height] = [this.node.clientWidth, this.node.clientHeight];
      draw();
    }).observe(this.node);
  }

  across(low, high) {
    return axis(low, high, this.margin.left, this.width - this.margin.right);
  }

  upwards(low, high) {
    return axis(low, high, this.height - this.margin.bottom, this.margin.top);
  }

  add(tag, attributes = {}, ...children) {
    const node = svg(tag, attributes, ...children);
    this.node.append(node);
    return node;
  }

  text(x, y, words, anchor = "start", kind = "") {
    return this.add("text", { x, y, "text-anchor": anchor, class: kind }, words);
  }

  /** Words instead of curves. */
  say(words) {
    this.node.replaceChildren();
    const lines = wrapped(typeset(words), Math.floor(this.width / WIDE_LETTER) - 2);
    lines.forEach((line, k) => this.text(this.width / 2, this.height / 2 + (k + (1 - lines.length) / 2) * LINE, line,
      "middle", "nothing"));
  }

  /** A path through points [x, y]; null interrupts it. */
  path(points, attributes) {
    const steps = points.map((point, i) => (point ? `${points[i - 1] ? "L" : "M"}${point.map((x) => x.toFixed(1))}`
      : ""));
    this.add("path", { d: steps.join(""), ...attributes });
  }

  /** An area of the drawing, from one value of an axis across to another. */
  band(x, width, attributes) {
    const { top, bottom } = this.margin;
    this.add("rect", { x, y: top, width, height: this.height - top - bottom, ...attributes });
  }

  /** What lies outside the axes is not seen of what has `clip-path: url(#id)`. */
  clip(id) {
    const { left, right, top, bottom } = this.margin;
    const [width, height] = [this.width - left - right, this.height - top - bottom];
    this.add("clipPath", { id }, svg("rect", { x: left, y: top, width, height }));
  }

  /** Lines and values up an axis, by decades or evenly; what the values are. */
  grid(y, isLog, words) {
    const { margin: { left, right, top }, width, height } = this;
    let lastY = Infinity;
    const [low, high] = isLog ? [10 ** y.low, 10 ** y.high] : [y.low, y.high];
    const round = isLog ? decades(low, high) : [];
    for (const value of round.length > 1 ? round : ticks(low, high, height / 28)) {
      const at = y.place(isLog ? Math.log10(value) : value);
      if (lastY - at < 13) continue;
      lastY = at;
      this.add("line", { class: "grid", x1: left, x2: width - right, y1: at, y2: at });
      this.text(left - 5, at + 3.5, short(value, 3), "end");
    }
    this.text(left, top - 8, words, "start", "unit");
  }

  /** Places along the axis across, each with its words. */
  marks(places) {
    const { margin: { bottom }, width, height } = this;
    for (const [x, words] of places) {
      this.add("line", { class: "grid", x1: x, x2: x, y1: height - bottom, y2: height - bottom + 4 });
      this.text(x, height - 4, words, x > width - 26 ? "end" : "middle");
    }
  }

  /** Round values along an axis across, `times` its own, in words. */
  rounds(x, times, isAngle, words) {
    const most = Math.max(2, (x.end - x.start) / 75);
    this.marks(ticks(x.low * times, x.high * times, most, isAngle)
      .map((value) => [x.place(value / times), words(value / times)]));
  }

  /** Where in the drawing a pointer is. */
  dots({ clientX, clientY }) {
    const { left, top } = this.node.getBoundingClientRect();
    return [clientX - left, clientY - top];
  }

  /** Flag a place, from above or from below; not beyond the axes. */
  flag(x, y, /** @type {number[]} */ [across, up], kind = "", isAbove = true) {
    if (across >= x.start && across <= x.end && up <= y.start && up >= y.end) this.add("path",
      { class: `flag ${kind}`, d: `M${across},${up}l-5,${isAbove ? "-9h10z" : "9h10z"}` });
  }

  /** Called with how many times nearer the wheel goes; answers whether there is something to see. */
  onwheel(zoom) {
    this.node.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && zoom(event.deltaY < 0 ? CLOSER : 1 / CLOSER, event)) event.preventDefault();
    }, { passive: false });
  }
}
