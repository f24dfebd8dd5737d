// Places of a series shown one after the other, as time goes.

import { clamp } from "./dom.js";

// A series is never shown sooner (s) than this, and a picture never jumps over more time than that.
const SOONEST = 0.5;
const LONGEST = 0.1;

/** Call before each picture with the time (s) since now, until what is returned is called. */
export function ticking(step) {
  const start = performance.now();
  let frame = requestAnimationFrame(function next(now) {
    frame = requestAnimationFrame(next);
    step((now - start) / 1000);
  });
  return () => cancelAnimationFrame(frame);
}

/** Say on a button what it does. */
export function showPlaying(button, is, what = "") {
  button.textContent = is ? "❚❚" : "▶";
  button.setAttribute("aria-label", `${is ? "Pause" : "Play"}${what}`);
}

/**
 * `of` says how many places there are, where it stands, how long all take, whether it goes back at the ends; `go` goes
 * to one.
 */
export function player(button, of) {
  let halt = null;

  function toggle() {
    if (halt) return stop();
    if (!of.places()) return;
    showPlaying(button, true);
    let place = of.position() >= of.places() - 1 ? 0 : of.position();
    let direction = 1;
    let last = 0;
    const rate = (of.places() - 1) / Math.max(SOONEST, of.duration()); // places per second
    halt = ticking((now) => {
      place += direction * rate * Math.min(LONGEST, now - last);
      last = now;
      const end = of.places() - 1;
      if (of.returns() && (place > end || place < 0)) direction = place > end ? -1 : 1;
      else if (place > end) stop();
      place = clamp(place, 0, end);
      if (Math.round(place) !== of.position()) of.go(place);
    });
  }

  function stop() {
    halt?.();
    halt = null;
    showPlaying(button, false);
  }

  return { toggle, stop, isPlaying: () => halt !== null };
}
