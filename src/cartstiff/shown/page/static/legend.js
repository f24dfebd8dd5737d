// What the picture's sizes mean: a bar of the machine's size, words, colours; and the picture as a
// file that carries all of it.

import { byId, el, engineering, inSize, short, typeset } from "./dom.js";
import { loadWords, wayOf } from "./loads.js";
import { doubts, legible, printed, provenance, saveDrawing, saveList, sheet, svg, timesOf } from "./plotfiles.js";

const MARKS = { translation: "●", rotation: "◆", force: "➞", moment: "↻", deflection: "⇢", tension: "│", nodal: "╱",
  held: "◇", note: "!" };
// Times its size that a picture can be saved with.
const SIZES = [1, 2, 3, 4];

/** A length of the picture. */
const inLength = (x, unit) => (unit === "m" && Math.abs(x) < 1 ? `${short(100 * x, 3)} cm` : `${short(x, 3)} ${unit}`);

/** What a radius means, by the example of the bar, in the unit that the page has for a size. */
function radius({ scale, unit, cut }, length, size) {
  if (scale.kind === "log") return `radius 0 at ${engineering(scale.zero_at, unit,
    3)}, and ${inLength(scale.length_per_decade, length.unit)} for each factor of 10 (rings)`;
  const isRoot = scale.kind === "root";
  const value = scale.value_per_length * length.bar ** (isRoot ? 2 : 1);
  return `${inLength(length.bar, length.unit)} = ${engineering(value, unit, 3, size)}`
    + (isRoot ? " (square-root scale)" : "")
    + (cut ? `; cut at ${inLength(scale.cut_at, length.unit)}: the axis marked (cut) is longer` : "");
}

/**
 * A picture's facts, as `cartstiff.scene.Scene.draw` returns them, with their words, the bar, and the scales of the
 * ellipsoids. Units are those of sizes of the shown quantity, where these are given.
 */
export function legendOf(facts, sizes = {}) {
  const { length, wrench, tension, nodal, held_forces: held } = facts;
  const ellipsoids = Object.entries(facts.ellipsoids).filter(([, own]) => own);
  const lines = [];
  const say = (mark, text, title = text) => lines.push({ mark, text, title });
  const missing = new Map(); // what is not drawn, by the reason
  const miss = (name, { reason }) => missing.set(reason, [...(missing.get(reason) ?? []), name]);
  for (const [freedom, own] of ellipsoids) {
    const called = `${facts.quantity} of ${freedom} (${freedom === "translation" ? "rotation"
      : "translation"} ${facts.others})`;
    const meant = own.shown && `${called}: ${radius(own, length, sizes[freedom])}`;
    if (own.shown) say(freedom, [meant, own.reason].filter(Boolean).join("; "));
    else miss(called, own);
  }
  for (const [kind, first] of [["force", 3], ["moment", 0]]) {
    if (!wrench?.[kind]) continue;
    const [unit, { zero_at: zero, length_per_decade: step }] = [wrench.units[kind], wrench.scale[kind]];
    const size = engineering(Math.hypot(...wrench.wrench.slice(Number(first), Number(first) + 3)), unit, 3);
    const longer = inLength(step, length.unit);
    say(kind, `${kind}: ${size} is ${inLength(wrench[kind],
      length.unit)} long; ten times the ${kind} is ${longer} longer`,
      `length = ${longer} log10(1 + ${kind} / ${engineering(zero, unit, 3)})`);
  }
  if (facts.rest) {
    say("deflection", facts.rest.mode === null
      ? `grey: without the load; the way between is drawn ${short(facts.rest.enlarged, 3)} times as far`
      : `grey: one end of the swing of mode ${facts.rest.mode}; its size is drawn, not computed`);
  }
  if (tension?.limits?.[1]) {
    const [low, high] = tension.limits.map((x) => short(x, 3));
    say("tension", tension.cables ? `lines: green up to ${high} ${tension.unit} of tension`
      : `legs: pink ${low} (compression) to green ${high} ${tension.unit} (tension)`);
  }
  if (facts.centres?.shown === false) miss("centres", facts.centres);
  if (held?.shown) say("held", `forces on M that the drives hold: ${inLength(length.bar, length.unit)} = `
    + engineering(held.per_length * length.bar, held.unit, 3),
  "Without a moment, beside the weight; the ball is the load");
  else if (held) miss("forces that the drives hold", held);
  if (nodal) say("nodal", `${nodal.name}, ${short(nodal.value, 3)} Hz${nodal.shown
    ? `, pitch ${engineering(nodal.pitch, length.unit, 3)}` : ` not drawn: ${nodal.reason}`}`);
  for (const [reason, names] of missing) say("note", `${names.join(", ")} not drawn: ${reason}`);
  for (const note of facts.notes) say("note", note);
  return {
    ...facts, lines, per_length: length.scene_units_per_unit, size: length.size,
    bar: { text: inLength(length.bar, length.unit), length: length.bar * length.scene_units_per_unit },
    measures: Object.fromEntries(ellipsoids.filter(([, { shown }]) => shown)
      .map(([freedom, { scale }]) => [freedom, scale])),
  };
}

/** The bar of a map's colours. */
function colourBar({ label, unit, count, lower, upper, log, kinds, better, stops = [] }) {
  const [factor, name] = inSize(upper ?? 0, unit ?? "");
  const words = [label, !kinds && name, log && !kinds && "logarithmic", better && "bright is good"].filter(Boolean);
  const head = el("span.small", words.join(", "));
  if (kinds) return [head,
    ...kinds.map((one) => el("div.small.kind", { title: `${one.count} of ${count} points: ${one.name}` },
    el("span.mark", { style: `color: ${one.colour}`, "aria-hidden": "true" }, "●"), ` ${one.name}`))];
  return [head, el("span.gradient", { style: `background: linear-gradient(to right, ${stops.join(", ")})` }),
    el("span.ends.small.num", ...[lower, upper].map((x) => el("span", short(x / factor))))];
}

/** A line without what a note says beside it. */
const unsaid = (text, notes) => notes.reduce((left, { message }) => left.replace(`: ${message}`, ""), text);

/** Whether the colours of legs are those of their shares. */
const isShared = ({ legs, moved }) => Boolean(legs && moved?.resisted && moved.shares);

export function legendBox(store) {
  const [box, bar] = [byId("legend"), byId("colour-bar")];
  const scale = el("i.scale");
  let length = 0; // of the bar, in units of the viewer
  let framed = false;
  store.pane.before.push(() => { scale.style.width = `${length * store.pane.dotsPerUnit}px`; });
  const bars = () => {
    const shown = [store.legend?.cloud, store.trace].filter(Boolean);
    bar.hidden = !shown.length;
    bar.replaceChildren(...shown.flatMap(colourBar));
  };
  store.on("trace", bars);
  store.on("hello", () => { framed = false; });
  store.on("numbers", () => {
    const { legend } = store;
    if (!legend) return;
    length = legend.bar.length;
    box.replaceChildren(el("div.num", { title: "As long as this at M; what is nearer looks larger" }, scale,
      ` ${legend.bar.text}`),
      ...legend.lines.filter(({ mark }) => mark !== "tension" || !isShared(store.numbers))
        .map(({ mark, text, title }) => el("div", { title, tabindex: title.startsWith(text) ? false : 0 },
          el("span", { class: `mark ${mark}`, "aria-hidden": "true" }, MARKS[mark] ?? "·"),
          ` ${typeset(unsaid(text, store.numbers.result.notes))}`)));
    bars();
    // An address may ask for another posture than the one that the first picture was framed for.
    if (framed) return;
    framed = true;
    if (String(store.state.q) !== String(store.hello.state.q)) store.ask({ do: "bounds" })
      .then(({ bounds }) => store.pane.frameAnew(bounds), () => {});
  });
}

/** A choice of sizes that saves the picture, with its legend, scale, name, load and version below. */
export const pictureFile = (store) => saveList("picture",
  [["", "PNG"], ...SIZES.map((times) => [`png${times}`, `PNG × ${times}`])],
  (kind) => saveDrawing(kind, store.hello.mechanism.name, picture(store, kind)),
  "The picture as a file, with its legend, scale, load and version", () => ({ hasOthers: othersOf(store).length > 0 }));

/** How far the load moves the point, in words with units. */
function answerIn(store) {
  const way = wayOf(store.numbers);
  const what = store.shown.point.some((x) => x) ? "the point" : "M";
  return way === null ? "" : ` under ${loadWords(store)}: ${what} moves ${engineering(way, store.unit("length"))}`;
}

/** Rows whose pictures are drawn beside this one. */
const othersOf = (store) => store.rows.filter(({ figure, store: own }) => figure && own?.legend);

/** The picture as a drawing of its own, and those beside it. */
function picture(store, kind) {
  const { state, legend, pane: { size: [first, height] } } = store;
  const others = kind.includes("alone") ? [] : othersOf(store);
  const width = others.reduce((sum, { pane }) => sum + pane.size[0], first);
  const [ink, letters] = [getComputedStyle(document.body).color, legible(kind, width)];
  const copy = svg("svg");
  let x = 0;
  for (const { pane, caption, store: own } of [{ pane: store.pane, caption: null, store }, ...others]) {
    const [wide, high] = pane.size;
    const href = pane.image(timesOf(kind, width), kind.includes("clear")).toDataURL("image/png");
    const { bar } = own.legend;
    const length = bar.length * pane.dotsPerUnit;
    const text = (at, y, words) => svg("text", { x: at, y, "font-size": 12 * letters, "font-family": "sans-serif",
      fill: ink }, words);
    copy.append(svg("image", { href, x, width: wide, height: high }),
      svg("path", { d: `M${x + 10},${height - 16}v6h${length}v-6`, fill: "none", stroke: ink, "stroke-width": 1.5 }),
      text(x + 14 + length, height - 8, bar.text),
      ...(caption ? [text(x + 10, height - 12 - 14 * letters, caption.firstChild.textContent)] : []));
    x += wide;
  }
  const words = [...byId("legend").querySelectorAll(".mark")]
    .map((mark) => ({ text: mark.parentElement.textContent, colour: getComputedStyle(mark).color }));
  const [title, ...lines] = provenance(store, state, `${store.hello.mechanism.name}: ellipsoids of ${state.quantity}`);
  const bars = [legend.cloud, store.trace].filter((one) => one?.lower !== undefined)
    .map(({ label, unit, lower, upper }) => `${label} [${unit}]: from ${short(lower)} to ${short(upper)}`);
  const paper = getComputedStyle(document.body).backgroundColor;
  // In print a caption: what moves how far, and what is assumed.
  const doubted = doubts(store, state).map((doubt) => doubt.words);
  const caption = [`${store.hello.mechanism.name}${answerIn(store)}`, ...others.map((row) =>
    row.caption.firstChild.textContent), ...doubted].join(". ");
  const said = kind.includes("bare") ? [] : printed(kind) ? [`${caption}.`] : [title, ...words, ...bars, ...lines];
  return sheet(copy, { width, height, ink, paper, kind }, said);
}
