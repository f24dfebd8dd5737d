// The mechanism sways between its rest without the load and the posture under it, enlarged by a stated factor.

import { button, short, toast } from "./dom.js";
import { Drawing, growing } from "./drawing.js";
import { ticking } from "./player.js";

// How far the point goes, about, over the mechanism's size, and the time (s) of one way there and back.
const WIDEST = 0.06;
const SWAY_TIME = 2.6;

/** A button that plays it, and words that say how much is enlarged. */
export function sway(store) {
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const node = button("", () => {
    if (playing) stop();
    else if (store.local && !store.state.deflection) start();
    else store.change({ deflection: !store.state.deflection });
  }, { class: "quiet", hidden: true, "aria-pressed": "false" });
  let playing = null;

  function start() {
    const { local: { program, data }, state } = store;
    let m;
    try {
      m = program.solve(state);
    } catch ({ message }) {
      return toast(message);
    }
    const size = Math.hypot(...store.numbers.moved.displacement);
    const angle = Math.hypot(...store.numbers.moved.rotation);
    // A larger motion is drawn larger.
    const share = Math.max(size / data.program.reach, angle / 4);
    const enlarged = growing(share, WIDEST / 4, data.assets.smallest_motion) / share;
    const drawing = new Drawing(program, data.assets, data.scene);
    const put = (share) =>
      store.pane.move(drawing.places(program.place(program.along(m,
        program.way(m).map((x) => -share * enlarged * x)))));
    node.textContent = `◼ enlarged ${short(enlarged, 3)} times`;
    node.title = "From where it rests without the load to where it is under it, and back";
    node.setAttribute("aria-pressed", "true");
    playing = { put };
    if (still.matches) return put(1); // no motion: where it would be without the load
    playing.halt = ticking((now) => put(0.5 + 0.5 * Math.cos((2 * Math.PI * now) / SWAY_TIME)));
  }

  function stop() {
    if (!playing) return;
    playing.halt?.();
    playing.put(0);
    playing = null;
    offer();
  }

  function offer() {
    const { moved } = store.numbers ?? {};
    node.hidden = (!store.local && !store.source.live) || !moved?.resisted || !moved.displacement.some((x) => x);
    if (playing) return;
    // What the page cannot move it draws.
    node.textContent = store.shown?.deflection ? "◼ deflection drawn" : "▶ Show it move";
    node.setAttribute("aria-pressed", String(Boolean(store.shown?.deflection)));
  }
  store.on("state", stop);
  store.on("numbers", () => {
    stop();
    offer();
  });
  store.on("local", offer);
  return node;
}
