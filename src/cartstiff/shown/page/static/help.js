// Light and dark, keyboard shortcuts, and their list.

import { all, button, byId, el, hint, openDialog } from "./dom.js";
import { showReport } from "./numbers.js";
import { toHome, toRandom, toZero } from "./pose.js";

/** `acts` of other parts are those that they have when a key is pressed. */
export function shortcuts(store, acts) {
  const steps = [["↶", "Undo (u)", () => store.undo(), () => store.past],
    ["↷", "Redo (U)", () => store.redo(), () => store.future]]
    .map(([sign, words, act, list]) => [button(sign, act, { title: words, "aria-label": words, disabled: true }),
      list]);
  const able = () => { for (const [node, list] of steps) node.disabled = !list().length; };
  for (const event of ["numbers", "kept", "plot", "angles"]) store.on(event, able);
  byId("actions").prepend(...steps.map(([node]) => node));
  byId("actions").append(button("◐", () => flip(), { title: "Light or dark (t)", "aria-label": "Light or dark" }),
    button("?", () => showHelp(), { title: "Keyboard shortcuts (?)", "aria-label": "Keyboard shortcuts" }));

  function flip() {
    const theme = store.state.theme === "dark" ? "light" : "dark";
    document.documentElement.dataset.theme = theme;
    store.change({ theme });
  }

  /** @type {[string, string, (key?: string) => any][]} */
  const keys = [
    ["?", "this list; Esc closes what is open", () => showHelp()],
    ["h", "home posture", () => toHome(store)],
    ["r", "random posture", () => store.source.moves && toRandom(store)],
    ["0", "all coordinates zero", () => store.source.moves && !store.hello.mechanism.platform && toZero(store)],
    ["a", "keep this state", () => store.keep()],
    ["b", "back to state 1", () => store.goToKept()],
    ["123456", "connection A, B, K, F, +, under the load",
      (key) => store.change({ connection: ["A", "B", "K", "F", "+", "load"][Number(key) - 1] })],
    ["g", "handles at the tool stay", () => acts.pinHandles()],
    ["u", "undo", () => store.undo()],
    ["U", "redo", () => store.redo()],
    ["s", "stiffness or compliance",
      () => store.change({ quantity: store.state.quantity === "stiffness" ? "compliance" : "stiffness" })],
    ["l", "radii: √, linear, log", () => store.source.moves
      && store.change({ scale: { root: "linear", linear: "log", log: "root" }[store.state.scale] })],
    ["c", "copy as NumPy array", () => acts.copyNumpy()],
    ["i", "full analysis", () => showReport(store)],
    ["p", "play or pause", () => acts.play()],
    ["v", "show it move: under the load, or in a mode", () => acts.showMove()],
    ["d", "degrees or radians", () => acts.flipAngle()],
    ["t", "light or dark", () => flip()],
  ];

  function showHelp() {
    if (byId("help").open) return byId("help").close();
    openDialog("help", "Keyboard shortcuts",
      el("dl.keys", ...[...keys, ["← →", "on a slider: 1° or 0.5 %; Shift a tenth, PageUp ten"],
        ["Tab", "next control; arrows within a group"]]
        .map(([key, words]) => el("div", el("dt",
          el("kbd", /^\d{2}/.test(key) ? `${key[0]} … ${key.at(-1)}` : key)), el("dd", words)))),
      hint("Mouse in the picture: left turns, right moves, wheel zooms; the ball at M and its arms move the tool, its "
        + "rings turn it (Shift: in steps of 5°), the balls at the load's arrows pull them, the ring about the "
          + "moment's line makes it larger or smaller (Alt: without snapping); a point of a map that is clicked "
            + "becomes the posture. Arrow keys turn the view, with Shift they move it, + and − zoom. The wheel zooms "
              + "curves, as + and − do on their slider. In a map of colours arrow keys read cells, Enter goes there."),
      hint(`cartstiff ${store.hello.version}`));
  }

  document.addEventListener("keydown", (/** @type {any} */ event) => {
    if (event.altKey || !store.numbers) return;
    const typing = event.target.closest("input:not([type=range], [type=checkbox], [type=radio]), select, textarea");
    if ((event.ctrlKey || event.metaKey) && !typing && /^[zy]$/i.test(event.key)) {
      event.preventDefault();
      if (event.shiftKey || /y/i.test(event.key)) store.redo();
      else store.undo();
    }
    if (event.key === "Escape") {
      for (const open of all("#show[open], .parts-fold[open]")) open.open = false;
      for (const tip of all(".tip")) tip.hidden = true;
      if (typing) event.target.blur();
    }
    if (event.ctrlKey || event.metaKey || typing) return;
    const found = keys.find(([key]) => key.includes(event.key));
    if (!found || (document.querySelector("dialog[open]") && found[0] !== "?")) return;
    event.preventDefault();
    found[2](event.key);
  });

  const wished = new URLSearchParams(location.search).get("theme");
  const dark = wished ? wished === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  store.on("hello", () => {
    const name = document.documentElement.dataset.theme;
    if (store.state.theme !== name) store.state.theme = name;
  });
}
