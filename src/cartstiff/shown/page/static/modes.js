// Modes in a table, and the response of the body over frequency.

import { LOST, byId, el, engineering, folded, hint, inSize, radio, short, toast } from "./dom.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { Plot } from "./plot.js";
import { mechanicsOf } from "./store.js";
import { MARGIN } from "./strip.js";

// What of a mode's energy is less is not named.
const SMALL = 0.1;

export function modesPanel(store) {
  const note = el("span.dim.small");
  const rows = el("div.modes", { role: "radiogroup", "aria-label": "Modes" });
  const words = hint();
  const response = responseStrip(store);
  const card = folded("modes", "Vibration", note, () => {
    const wanted = card.open ? (store.state.mode ?? 1) : null;
    if (store.state && store.state.mode !== wanted && (store.source.live || card.open)) choose(wanted);
    response(card.open);
  }, rows, words);

  const choose = (mode) => store.change({ mode });

  function update() {
    const { modes, result } = store.numbers;
    const { mode } = store.state;
    if (mode !== null && !card.open) card.open = true;
    if (mode === null && card.open && store.source.live) card.open = false;
    note.textContent = "";
    card.hidden = !store.source.live && (!modes || Boolean(modes.missing));
    if (!modes) return;
    if (modes.missing) {
      rows.replaceChildren();
      words.textContent = modes.missing;
      note.textContent = "none";
      return;
    }
    const first = modes.frequencies.find((f) => f !== null && f > 0);
    note.textContent = first ? `from ${short(first, 3)} Hz` : "";
    const focused = rows.contains(document.activeElement);
    rows.replaceChildren(...modes.frequencies.map((f, i) => row(modes, f, i, i + 1 === mode)));
    if (focused) rows.querySelector(":checked")?.focus();
    const load = result.load?.kind && result.wrench?.some((x) => x) ? `under its ${result.load.kind} load` : "unloaded";
    const notes = modes.notes.filter(({ code }) => ["unstable", "free-motion", "repeated-modes", "massless-struts",
      "implausible-mass"].includes(code));
    words.textContent = [
      `Small undamped motions, ${load}. A mode has no size of its own: that of its swing (v) is drawn, not computed.`,
      store.source.live ? "" : "An exported page holds the table; `cartstiff view` shows modes and draws the response.",
      ...notes.map(({ message }) => message),
    ].filter(Boolean).join(" ");
  }

  function row(modes, f, i, chosen) {
    const shares = modes.participation[i].map((x, k) => [x ?? 0, modes.names[k]]).sort((a, b) => b[0] - a[0]);
    const what = shares.filter(([x]) => x > SMALL).map(([x, name]) =>
      `${name.replace(/_joint$/, "")} ${Math.round(100 * x)} %`).join(", ");
    const hertz = f === null ? "unstable" : f === 0 ? "free" : `${short(f)} Hz`;
    const { direction, point, pitch } = modes.nodal_axes[i];
    const list = (v) => v.map((x) => short(Math.abs(x) < NEGLIGIBLE_DIFFERENCE ? 0 : x, 3)).join(", ");
    const axis = !direction ? "M rests" : !point ? `M moves along ${list(direction)}`
      : `M turns about ${list(direction)} through ${list(point)}, pitch ${short(pitch, 3)} ${store.unit("length")}`;
    const node = radio("mode", i + 1, [el("span.dim.num", String(i + 1)),
      el("span", { class: `num${f === null ? " bad" : ""}` }, hertz),
      el("span.small.what", what)], () => choose(i + 1), { class: "mode", title: axis });
    node.control.checked = chosen;
    return node;
  }

  store.on("hello", () => { card.open = store.state.mode !== null && store.state.mode !== undefined; });
  store.on("numbers", update);
}

/** The second strip: size of the receptance at the reference point. */
function responseStrip(store) {
  let ratio = 0.02;
  let answer = null;
  let key = null;
  const input = el("input", { type: "number", min: 0, max: 100, step: "any", value: 2,
    "aria-label": "Damping ratio in per cent",
    onchange: () => {
      const x = input.valueAsNumber / 100;
      if (!(x >= 0 && x <= 10)) return toast("damping must be between 0 and 1000 %");
      ratio = x;
      request();
    } });
  const label = el("span.num.small.grow.peak");
  const plot = new Plot(MARGIN, () => draw());
  const node = byId("response");
  node.append(el("div.row",
    el("span.dim", { title: "Motion of the reference point per force at it, along the body's axes" },
      "Over frequency"), label,
    el("label.row.small", el("span.dim", "damping"), input, el("span.dim", "%"))), plot.node);

  async function request() {
    if (node.hidden || !store.source.live || !store.numbers) return;
    const now = JSON.stringify([store.state.q, mechanicsOf(store.state), ratio, store.hello.mechanism.frame]);
    if (key === now) return;
    key = now;
    const found = await store.ask({ do: "response", ratio }).catch(({ message }) => ({ missing: message }));
    if (key !== now) return;
    if (found.missing === LOST) key = null; // the next numbers ask again
    else answer = found;
    draw();
  }

  function draw() {
    if (!answer || plot.width < 80 || plot.height < 30) return;
    if (answer.missing) return plot.say(answer.missing);
    const { frequencies: f, modes } = answer;
    const log = Math.log10;
    const [factor, unit] = inSize(Math.max(...Object.values(answer.curves).flat()), answer.unit);
    const curves = Object.entries(answer.curves).map(([name, sizes]) => [name, sizes.map((size) => size / factor)]);
    const values = curves.flatMap(([, sizes]) => sizes).filter((size) => size > 0);
    const high = log(Math.max(...values));
    const x = plot.across(log(f[0]), log(f.at(-1)));
    const y = plot.upwards(Math.max(log(Math.min(...values)), high - 5), high + 0.1);
    plot.node.replaceChildren();
    plot.grid(y, true, `${unit}, log: x solid, y dashed, z dotted`);
    plot.marks(modes.map((hertz) => [x.place(log(hertz)), engineering(hertz, "Hz", 3)])
      .filter(([at], i, all) => !i || at - all[i - 1][0] > 52));
    modes.forEach((hertz, i) => {
      const at = x.place(log(hertz));
      plot.add("line", { class: `grid own${i + 1 === store.state.mode ? " chosen" : ""}`, x1: at, x2: at, y1: y.end,
        y2: y.start });
    });
    let peak = ["", 0, 0];
    curves.forEach(([name, sizes], k) => {
      const points = sizes.map((size, i) => (size > 0 ? [x.place(log(f[i])), y.place(Math.max(y.low, log(size)))]
        : null));
      plot.path(points, { class: `curve response curve-${k}`, "data-axis": name });
      sizes.forEach((size, i) => { if (size > peak[1]) peak = [name, size, f[i]]; });
    });
    label.textContent = label.title = `largest ${short(peak[1], 3)} ${unit} along ${peak[0]} at ${short(peak[2],
      3)} Hz`;
    plot.node.setAttribute("aria-label", `Receptance over frequency, ${label.textContent}`);
  }

  store.on("hello", () => { key = null; });
  store.on("numbers", () => {
    request();
    draw();
  });
  return (isShown) => {
    node.hidden = !isShown || !store.source.live;
    document.body.classList.toggle("vibrating", !node.hidden);
    request();
  };
}
