// Modes in a table, played in the picture, and the response of the body over frequency.

import { SUPERSEDED, byId, el, engineering, short } from "./dom.js";
import { grid, lettered, sized, through } from "./grid.js";
import { svg } from "./plotfiles.js";
import { CLOSE } from "./numerics.js";
import { MARGIN } from "./strip.js";

const SHARES = [[0.02, "2 %"], [0.05, "5 %"], [0.1, "10 %"], [0.2, "20 %"]];
// Seconds of one swing on the screen, whatever its frequency.
const PERIOD = 1.6;
// What of a mode's energy is less is not named.
const SMALL = 0.1;

export function modesPanel(store) {
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  let share = 0.05;
  let frames = null; // commands of each picture; the last brings the rest back
  let asked = 0;
  let key = null;
  let playing = null;
  let phase = 0.5; // 0 and 1 are the ends of the swing
  const shown = { picture: null, playing: false }; // for tests

  const note = el("span", { class: "dim small" });
  const rows = el("div", { class: "modes", role: "radiogroup", "aria-label": "Modes" });
  const words = el("p", { class: "dim small" });
  const size = el("select", { "aria-label": "Size of the swing", title: "How far what moves most goes, as a share of the mechanism's size",
    onchange: () => { share = Number(size.value); fetchSwing(); } },
  ...SHARES.map(([value, text]) => el("option", { value, selected: value === share }, text)));
  const play = el("button", { type: "button", class: "play", title: "Play or pause the mode (v)", "aria-label": "Play the mode", onclick: () => toggle() }, "▶");
  const slider = el("input", { type: "range", min: 0, max: 1, step: 1 / 16, value: 0.5, "aria-label": "Phase of the swing",
    oninput: () => { stop(); show(slider.valueAsNumber); } });
  const controls = el("div", { class: "row" }, play, slider, size);
  const card = el("details", { class: "card modes-card", ontoggle: () => {
    const wanted = card.open ? (store.state.mode ?? 1) : null;
    if (store.state && store.state.mode !== wanted && (store.source.live || card.open)) choose(wanted);
    response.hidden = !card.open;
  } }, el("summary", {}, el("h2", {}, "Vibration"), note), rows, controls, words);
  byId("right").append(card);

  const response = responseStrip(store);

  function choose(mode) {
    stop();
    rest();
    frames = null;
    key = null;
    store.change({ mode });
  }

  // -- the table ----------------------------------------------------------------------------

  function update() {
    const { modes, result } = store.numbers;
    const { mode } = store.state;
    if (mode !== null && !card.open) card.open = true;
    if (mode === null && card.open && store.source.live) card.open = false;
    note.textContent = "";
    card.hidden = !store.source.live && (!modes || Boolean(modes.missing));
    if (!modes) return;
    controls.hidden = Boolean(modes.missing) || !store.source.live;
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
    if (focused) rows.querySelector('[aria-checked="true"]')?.focus();
    const load = result.load?.kind && result.wrench?.some((x) => x) ? `under its ${result.load.kind} load` : "unloaded";
    const notes = modes.notes.filter(({ code }) => ["unstable", "free-motion", "repeated-modes", "massless-struts", "implausible-mass"].includes(code));
    words.textContent = [
      `Small undamped motions, ${load}. A mode has no size of its own: the swing is drawn, not computed.`,
      store.source.live ? "" : "An exported page holds the table; `cartstiff view` plays modes and draws the response.",
      ...notes.map(({ message }) => message),
    ].filter(Boolean).join(" ");
  }

  function row(modes, f, i, chosen) {
    const shares = modes.participation[i].map((x, k) => [x ?? 0, modes.names[k]]).sort((a, b) => b[0] - a[0]);
    const what = shares.filter(([x]) => x > SMALL).map(([x, name]) => `${name.replace(/_joint$/, "")} ${Math.round(100 * x)} %`).join(", ");
    const hertz = f === null ? "unstable" : f === 0 ? "free" : `${short(f)} Hz`;
    const { direction, point, pitch } = modes.nodal_axes[i];
    const list = (v) => v.map((x) => short(Math.abs(x) < CLOSE ? 0 : x, 3)).join(", ");
    const axis = !direction ? "M rests" : !point ? `M moves along ${list(direction)}`
      : `M turns about ${list(direction)} through ${list(point)}, pitch ${short(pitch, 3)} ${store.unit("length")}`;
    const node = el("button", { type: "button", role: "radio", class: "mode", "aria-checked": String(chosen),
      tabindex: chosen ? 0 : -1, title: axis, onclick: () => choose(i + 1),
      onkeydown: (event) => {
        const step = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[event.key];
        if (!step) return;
        event.preventDefault();
        const count = modes.frequencies.length;
        choose(((i + step + count) % count) + 1);
      } },
    el("span", { class: "dim num" }, String(i + 1)), el("span", { class: `num${f === null ? " bad" : ""}` }, hertz), el("span", { class: "small what" }, what));
    return node;
  }

  // -- the swing ----------------------------------------------------------------------------

  const wanted = () => {
    const { q, mode, load, load_axes: axes, load_kind: kind, load_at: at, stiffness, point } = store.state;
    return JSON.stringify([store.numbers?.result.q ?? q, mode, share, load, axes, kind, at, stiffness, point]);
  };

  async function fetchSwing() {
    const { mode } = store.state;
    if (mode === null || !store.source.live || store.numbers?.modes?.missing) return;
    const now = wanted();
    if (key === now && frames) return;
    const mine = ++asked;
    try {
      const answer = await store.ask({ do: "swing", share });
      if (mine !== asked) return;
      let start = 0;
      frames = answer.counts.map((count) => answer.packed.slice(start, start += count));
      key = now;
      const turn = short((answer.turn * 180) / Math.PI, 2);
      size.title = `drawn: M goes ${short(answer.displacement, 2)} ${store.unit("length")} and turns ${turn}° to either side`;
      if (!playing) show(phase);
      if (playing === true) run();
    } catch (error) {
      if (mine === asked && error.message !== SUPERSEDED) words.textContent = error.message;
    }
  }

  /** Show the picture at a phase between 0 and 1. */
  function show(at) {
    phase = at;
    if (document.activeElement !== slider) slider.value = at;
    if (!frames) return void fetchSwing();
    const index = Math.round(at * (frames.length - 2));
    if (shown.picture === index) return;
    shown.picture = index;
    store.pane.apply(frames[index], () => {});
  }

  /** The mechanism as it stands. */
  function rest() {
    phase = 0.5;
    slider.value = 0.5;
    if (frames && shown.picture !== null) store.pane.apply(frames.at(-1), () => {});
    shown.picture = null;
  }

  function toggle() {
    if (playing !== null) return stop();
    if (!card.open) {
      card.open = true;
      return;
    }
    if (still.matches) return show(phase === 1 ? 0 : 1); // one end, then the other: nothing runs
    playing = true;
    shown.playing = true;
    play.textContent = "❚❚";
    play.setAttribute("aria-label", "Pause the mode");
    if (frames && key === wanted()) run();
    else fetchSwing();
  }

  function run() {
    const begin = performance.now() - (Math.asin(2 * phase - 1) / (2 * Math.PI)) * 1000 * PERIOD;
    const step = (now) => {
      if (playing === null) return;
      show(0.5 + 0.5 * Math.sin((2 * Math.PI * (now - begin)) / (1000 * PERIOD)));
      playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  }

  function stop() {
    if (typeof playing === "number") cancelAnimationFrame(playing);
    playing = null;
    shown.playing = false;
    play.textContent = "▶";
    play.setAttribute("aria-label", "Play the mode");
  }

  store.beforePicture = () => {
    // A new picture says what has changed since the rest.
    if (frames && shown.picture !== null) store.pane.apply(frames.at(-1));
    shown.picture = null;
  };
  store.on("hello", () => {
    stop();
    frames = null;
    key = null;
    shown.picture = null;
    card.open = store.state.mode !== null && store.state.mode !== undefined;
  });
  store.on("numbers", () => {
    update();
    if (store.state.mode === null) return stop();
    if (playing !== null) {
      if (key !== wanted()) {
        if (typeof playing === "number") cancelAnimationFrame(playing);
        playing = true;
        frames = null;
        fetchSwing();
      }
    } else if (key !== null && key !== wanted()) {
      frames = null;
      key = null;
      phase = 0.5;
      slider.value = 0.5;
    }
  });
  store.swing = shown;
  return { toggle };
}

/** The second strip: size of the receptance at the reference point. */
function responseStrip(store) {
  let ratio = 0.02;
  let answer = null;
  let key = null;
  const input = el("input", { type: "number", min: 0, max: 100, step: "any", value: 2, "aria-label": "Damping ratio in per cent",
    onchange: () => {
      const x = input.valueAsNumber / 100;
      if (!(x >= 0 && x <= 10)) return;
      ratio = x;
      request();
    } });
  const label = el("span", { class: "num small grow peak" });
  const plot = svg("svg", { role: "img", class: "plot", "aria-label": "no curves yet" });
  const node = byId("response");
  node.append(el("div", { class: "row" }, el("span", { class: "dim", title: "Motion of the reference point per force at it, along the body's axes" }, "Over frequency"), label,
    el("label", { class: "row small" }, el("span", { class: "dim" }, "damping"), input, el("span", { class: "dim" }, "%"))), plot);
  const size = sized(plot, () => draw());

  async function request() {
    if (node.hidden || !store.source.live || !store.numbers) return;
    const { q, load, load_axes: axes, load_kind: kind, load_at: at, stiffness, point } = store.state;
    const now = JSON.stringify([q, load, axes, kind, at, stiffness, point, ratio, store.hello.mechanism.frame]);
    if (key === now) return;
    key = now;
    try {
      const found = await store.ask({ do: "response", ratio });
      if (key !== now) return;
      answer = found;
    } catch (error) {
      if (key !== now) return;
      answer = { missing: error.message };
    }
    draw();
  }

  function draw() {
    const { width, height } = size;
    if (!answer || width < 80 || height < 30) return;
    plot.replaceChildren();
    if (answer.missing) {
      plot.append(lettered(width / 2, height / 2, answer.missing, "middle", "nothing"));
      return;
    }
    const { frequencies: f, curves, modes, unit } = answer;
    const log = Math.log10;
    const values = Object.values(curves).flat().filter((x) => x > 0);
    const high = Math.max(...values);
    const [top, bottom] = [log(high) + 0.1, Math.max(log(Math.min(...values)), log(high) - 5)];
    const placeX = (x) => MARGIN.left + ((log(x) - log(f[0])) / (log(f.at(-1)) - log(f[0]))) * (width - MARGIN.left - MARGIN.right);
    const placeY = (x) => MARGIN.top + ((top - Math.max(bottom, log(x))) / (top - bottom)) * (height - MARGIN.top - MARGIN.bottom);
    const places = modes.map((x) => [placeX(x), engineering(x, "Hz", 3)]).filter(([x], i, all) => !i || x - all[i - 1][0] > 52);
    grid(plot, { width, height, margin: MARGIN }, { bottom: 10 ** bottom, top: 10 ** top, isLog: true }, placeY, places, `${unit}, log: x solid, y dashed, z dotted`);
    modes.forEach((x, i) => plot.append(svg("line", { class: `grid own${i + 1 === store.state.mode ? " chosen" : ""}`, x1: placeX(x), x2: placeX(x), y1: MARGIN.top, y2: height - MARGIN.bottom })));
    Object.entries(curves).forEach(([name, sizes], k) => {
      plot.append(svg("path", { d: through(sizes.map((x, i) => (x > 0 ? [placeX(f[i]), placeY(x)] : null))), class: `curve response curve-${k}`, "data-axis": name }));
    });
    let peak = ["", 0, 0];
    for (const [name, sizes] of Object.entries(curves)) sizes.forEach((x, i) => { if (x > peak[1]) peak = [name, x, f[i]]; });
    label.textContent = label.title = `largest ${short(peak[1], 3)} ${unit} along ${peak[0]} at ${short(peak[2], 3)} Hz`;
    plot.setAttribute("aria-label", `Receptance over frequency, ${label.textContent}`);
  }

  store.on("numbers", () => {
    request();
    draw();
  });
  return {
    get hidden() { return node.hidden; },
    set hidden(value) {
      node.hidden = value || !store.source.live;
      document.body.classList.toggle("vibrating", !node.hidden);
      if (!value) request();
    },
  };
}
