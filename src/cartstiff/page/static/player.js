// Places of a series shown one after the other, as time goes.

import { clamp } from "./dom.js";

// A series is never shown sooner (s) than this, and a picture never jumps over more time than that.
const SOONEST = 0.5;
const LONGEST = 0.1;

/** `of` says how many places there are, where it stands, how long all take, whether it goes back at the ends; `go` goes to one. */
export function player(button, of) {
  let playing = null;

  function toggle() {
    if (playing !== null) return stop();
    if (!of.places()) return;
    button.textContent = "❚❚";
    button.setAttribute("aria-label", "Pause");
    let place = of.position() >= of.places() - 1 ? 0 : of.position();
    let direction = 1;
    let last = performance.now();
    const rate = (of.places() - 1) / Math.max(SOONEST, of.duration()); // places per second
    const step = (now) => {
      place += direction * rate * Math.min(LONGEST, (now - last) / 1000);
      last = now;
      const end = of.places() - 1;
      if (of.returns() && (place > end || place < 0)) direction = place > end ? -1 : 1;
      else if (place > end) {
        of.go(end);
        return stop();
      }
      if (Math.round(clamp(place, 0, end)) !== of.position()) of.go(place);
      playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  }

  function stop() {
    cancelAnimationFrame(playing);
    playing = null;
    button.textContent = "▶";
    button.setAttribute("aria-label", "Play");
  }

  return { toggle, stop, isPlaying: () => playing !== null };
}
