// Loads and what they do: where they act, what springs exert, in words.

import { cross, rotation, times } from "./algebra.js";
import { chop, engineering } from "./dom.js";

export const NO_LOAD = [0, 0, 0, 0, 0, 0];

/** The point in M at which the load acts. */
export const actsAt = (state) => state.load_at ?? (state.load ? state.point : [0, 0, 0]);

/** Another posture moves the drives and leaves the load: the patch of a state that says so.
 *
 * Where the file says how springs rest, they exert a load of their own: it is given from then on,
 * along the room's axes unless it turns with the tool.
 */
export function givenLoad(state, numbers, { may_be_loaded: mayBe }) {
  const W = numbers?.result.wrench;
  if (!mayBe || state.load !== null || !W) return {};
  const at = state.load_at ?? [0, 0, 0];
  const force = W.slice(3);
  const moment = W.slice(0, 3).map((x, i) => x - cross(at, force)[i]);
  const turns = state.load_kind === "follower";
  const along = (v) => chop(turns ? v : times(rotation(numbers.result.pose), v), Math.hypot(...v));
  const load = numbers.moved ? [...along(moment), ...along(force)] : NO_LOAD;
  return { load, load_at: at, load_axes: turns ? "body" : "world" };
}

/** The load that acts, as a state that gives one has it: what springs exert, if none was given. */
export function shownLoad({ state, numbers, hello: { mechanism } }) {
  const { load, load_axes: axes, load_at: at } = state;
  return { load: load ?? NO_LOAD, load_axes: axes, load_at: at, ...givenLoad(state, numbers, mechanism) };
}

/** How far a load that is resisted moves the point; null without one. */
export const wayOf = ({ moved }) => (moved?.resisted ? Math.hypot(...moved.displacement) : null);

/** Force and moment of a load, that which is shown or another, so many times, in words: "100 N, 5 N m". */
export function loadWords(store, { load = null, digits = 4, times = 1 } = {}) {
  const acts = load ?? store.shown.load ?? store.numbers.result.wrench;
  return [["force", acts.slice(3)], ["moment", acts.slice(0, 3)]].map(([kind, v]) => [Math.hypot(...v), kind])
    .filter(([x]) => x).map(([x, kind]) => engineering(times * Number(x), store.unit(kind), digits)).join(", ");
}
