// One meaning of the colours of maps and traces: bright is good.

import { clamp, rgbs } from "./dom.js";
import { between } from "./drawing.js";

// Ratio of largest to smallest from which colours go by logarithms.
const WIDE = 20;
// Shares of the colours that are outside and inside of what is allowed.
const [OUTSIDE, INSIDE] = [[0, 0.25], [0.6, 1]];

/** A colour [red, green, blue] from dark, 0, to bright, 1. */
export const bright = (share) => between(stops ??= rgbs("sequential"), clamp(share, 0, 1));
let stops = null;

/** Whether a load moves the point further than is allowed, or without end. */
export const isOutside = (row, allowed) => Boolean(allowed) && (row.unstable || row.deflection?.[0] > allowed);

/**
 * How rows are coloured by what `plotted` reads: the worst and the best row, and the share of each; where a
 * displacement is allowed, all outside is darker than all inside. Null if no row has a value above zero.
 */
export function goodness({ one, worst: sign }, rows, allowed) {
  const value = (row) => { const x = row && one(row); return x > 0 && x < Infinity ? x : null; };
  const found = rows.filter((row) => value(row) !== null);
  if (!found.length) return null;
  const ends = [Math.min, Math.max].map((least) => found.reduce((a, b) => (least(value(a), value(b)) === value(a) ? a
    : b)));
  const [low, high] = ends.map(value);
  const [worst, best] = sign < 0 ? ends : ends.toReversed();
  const isLog = high > WIDE * low;
  const up = (x) => (high === low ? 0.5 : isLog ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low));
  const share = (row) => {
    const good = sign < 0 ? up(value(row)) : 1 - up(value(row));
    const [from, to] = !allowed ? [0, 1] : isOutside(row, allowed) ? OUTSIDE : INSIDE;
    return from + good * (to - from);
  };
  return { value, worst, best, low, high, isLog, share };
}
