// Small helpers: elements, numbers as text, downloads.

import { PRINTED_AS_ZERO, ROUNDOFF } from "./numerics.js";

/** What the server says where it answers a later question of the same kind instead. */
export const SUPERSEDED = "a newer question took the place of this one";
export const LOST = "the connection was lost";

/**
 * An element, "tag.class.class", with attributes and listeners (on...) where they are given first, and children.
 *
 * @param {string} name
 * @param {...any} rest
 * @returns {any}
 */
export function el(name, ...rest) {
  const dot = name.indexOf(".");
  const node = document.createElement(dot < 0 ? name : name.slice(0, dot));
  if (dot > 0) node.className = name.slice(dot + 1).replaceAll(".", " ");
  const attributes = rest[0]?.constructor === Object ? rest.shift() : {};
  for (const key in attributes) {
    const value = attributes[key];
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value != null) node.setAttribute(key, value);
  }
  node.append(...rest.filter((child) => child != null));
  return node;
}

/** @type {(id: string) => any} */
export const byId = (id) => document.getElementById(id);

/** Every node that a selector finds. */
export const all = (selector) => /** @type {any[]} */ ([...document.querySelectorAll(selector)]);

/** Colours of the table that pictures share, as #rrggbb. */
export const hues = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim()
  .split(",");

/** The same as [red, green, blue]. */
export const rgbs = (name) => hues(name).map((text) => [1, 3, 5].map((i) => Number(`0x${text.slice(i, i + 2)}`)));

/** How much of the page has come, from 0 to 1; then the bar goes. */
export function loaded(share) {
  const bar = byId("loading");
  if (share < 1 && bar) bar.value = Math.max(bar.value, share);
  else bar?.remove();
}

const MINUS = "\u2212";

/** Words with numbers as people write them: a negative one has a minus, not a hyphen. */
export const typeset = (text) => text.replaceAll(/(?<![\w)])-(?=[\d.])/g, MINUS);

/** Words of the library in the signs of the page: degrees, minus, one motion or two motions. */
export const plainly = (words) => typeset(words.replaceAll("`", "").replaceAll(/ deg\b/g, "°")
  .replaceAll(/-(?=[xyz]\b)/g, "−")
  .replaceAll(/\b(\d+) (\S+)\(s\)/g, (_, count, what) => `${count} ${what}${count === "1" ? "" : "s"}`));

// As in `cartstiff.core.mechanisms.contract`, which a test compares.
/** @type {[number, string][]} */
const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"]];
/** @type {[number, string][]} */
const STIFF = [[1e9, "MN/mm"], [1e6, "kN/mm"], [1e3, "N/mm"], [1, "N/m"]];
const MILLIMETRES = /\bmm\b/g;
const UP = 1 + ROUNDOFF;

/**
 * The unit in which people read a size, and its value in the given one: [1000, "N/mm"].
 *
 * @returns {[number, string]}
 */
export function inSize(size, unit) {
  const [above, below = 0] = unit.split("/").map((part) => (part.match(MILLIMETRES) ?? []).length);
  const metres = unit === "cm" ? 1e-2 : 1e-3 ** (above - below);
  const name = unit === "cm" ? "m" : unit.replaceAll(MILLIMETRES, "m");
  const head = name.split("/")[0];
  const small = head === "m" || head === "rad";
  const steps = name === "N/m" ? STIFF
    : /^(N|J|Hz|m|rad)\b/.test(name) ? PREFIXES.filter(([factor]) => factor <= 1 || !small)
      .map(([factor, prefix]) => [factor, prefix + name]) : [[1, name]];
  const [factor, shown] = steps.find((step) => Math.abs(size) * metres * UP >= step[0])
    ?? (size ? steps.at(-1) : [1, name]);
  return [factor / metres, shown];
}

/** A value for people: "75.7 N/mm", "7.54 kN m/rad", "3.9 mm"; in the unit of another size, if given. */
export function engineering(value, unit = "", digits = 4, size = value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const [factor, name] = Number.isFinite(size) ? inSize(size, unit) : [1, unit];
  const x = Math.abs(value / factor) * UP;
  const [mantissa, power] = x.toExponential(digits - 1).split("e");
  const text = x === Infinity ? "∞" : x === 0 || (x >= 1e-3 && x < 1e5) ? String(Number(`${mantissa}e${power}`))
    : `${Number(mantissa)}e${Number(power)}`;
  return `${value < 0 ? MINUS : ""}${text} ${name.replace(/^1/, "")}`.trimEnd();
}

/** A number for reading, in few characters. */
export const short = (x, digits = 4) => engineering(x, "", digits);

/** Components for reading: "(1, 0, 0)". */
export const tuple = (list, digits = 3) => `(${list.map((x) => short(x, digits)).join(", ")})`;

/** Components in one unit (of a size) and to one decimal, four digits of the largest: "(0, −0.011, −110.5) µm". */
export function together(values, unit, size = Math.max(...values.map(Math.abs))) {
  const most = Math.max(...values.map(Math.abs));
  const [factor, name] = most ? inSize(size, unit) : [1, unit];
  const decimals = most ? clamp(3 - Math.floor(Math.log10(most / factor)), 0, 20) : 0;
  return `${tuple(values.map((x) => Number((x / factor).toFixed(decimals))), 8)} ${name}`;
}

/** A number with every digit that it has. */
const full = (x) => (x === null || x === undefined ? "–" : String(x).replace("-", MINUS));

// Digits of the largest of several numbers in which each way of computing them agrees.
const SURE = 9;

/** A number to the digits that page, file and command share, beside the largest of its fellows. */
export function sure(x, most = Math.abs(x)) {
  if (!x || !Number.isFinite(x)) return full(x);
  const digits = SURE + Math.floor(Math.log10(Math.abs(x))) - Math.floor(Math.log10(most));
  return full(digits < 1 ? 0 : Number(x.toPrecision(digits)));
}

/** Numbers with those that are only rounding, beside the largest or a size, set to 0. */
export const chop = (list, size = 0) => {
  const noise = PRINTED_AS_ZERO * Math.max(size, ...list.map(Math.abs));
  return list.map((x) => (Math.abs(x) < noise ? 0 : x));
};

export const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

/** So many numbers from one to another, at equal distances. */
export const evenly = (low, high, count) => Array.from({ length: count },
  (_, k) => low + ((high - low) * k) / (count - 1));

/** Give the user a file, in whose name signs of other kinds are one. */
export function download(name, content, type = "text/plain") {
  const blob = content instanceof Blob ? content : new Blob([content], { type });
  const link = el("a", { download: name.replaceAll(/[^\w.-]+/g, "_"), href: URL.createObjectURL(blob) });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 2000);
}

/** What does an act after a time (ms) without another one. */
export function resting() {
  let timer = null;
  return (act, ms) => {
    clearTimeout(timer);
    timer = setTimeout(act, ms);
  };
}

/** A list of options [value, words] of which one is chosen; `offer` gives it others. */
export function dropdown(label, options, onchoose, more = {}) {
  const node = el("select", { "aria-label": label, onchange: () => onchoose(node.value), ...more });
  node.offer = (list) => node.replaceChildren(...list.map(([value, words]) => el("option", { value }, words)));
  node.offer(options);
  return node;
}

/** The head of a card: its title, and what is at its end. */
export const heading = (title, ...end) => el("div.row.head", el("h2", title), el("span.grow"), ...end);

export const hint = (...words) => el("p.dim.small", ...words);

export const button = (words, onclick, more = {}) => el("button", { type: "button", onclick, ...more }, words);

/** A box to check, with its words. */
export const checkbox = (words, onchange, more = {}) =>
  el("label.check", more, el("input", { type: "checkbox", onchange: ({ target }) => onchange(target.checked) }), words);

/** A card of the page, on the left or on the right; it may fold under a title, and words beside it. */
export function card(side, tag, ...content) {
  const node = el(tag, ...content);
  byId(side).append(node);
  return node;
}
export const folded = (name, title, said, ontoggle, ...content) =>
  card("right", `details.card.${name}-card`, { ontoggle }, el("summary", el("h2", title), said), ...content);

/** Open one of the page's two dialogs. */
export function openDialog(id, title, ...content) {
  const dialog = byId(id);
  dialog.setAttribute("aria-label", title);
  dialog.replaceChildren(heading(title, button("Close", () => dialog.close())), ...content);
  dialog.showModal();
  return dialog;
}

/** A radio button with its words: [text or node], more attributes of the label. */
export function radio(name, value, words, onchange, more = {}) {
  return el("label", { "data-value": value, ...more }, el("input", { type: "radio", name, value, onchange }), ...words);
}

/** A group of radio buttons; returns [element, choose]. */
export function choice(label, options, onchoose) {
  const name = `choice ${++choices}`;
  const labels = options.map(([value, text, title]) => radio(name, value, [text], () => onchoose(value), { title }));
  const choose = (value) => { for (const { control } of labels) control.checked = control.value === value; };
  return [el("div.choice", { role: "radiogroup", "aria-label": label }, ...labels), choose];
}
let choices = 0;

/** The same for a value of the state. */
export function stateChoice(store, key, label, options) {
  const [group, choose] = choice(label, options, (value) => store.change({ [key]: value }));
  store.on("state", () => choose(store.state[key]));
  return group;
}

/** Panels [name, words, node] of which one is seen, by tabs; returns [element, offer]. */
export function tabs(label, panels) {
  const [group, choose] = choice(label, panels.map(([name, words]) => [name, words]), show);
  function show(wanted) {
    choose(wanted);
    for (const [name, , node] of panels) node.hidden = name !== wanted;
  }
  const offer = (name, is) => {
    const tab = group.querySelector(`[data-value="${name}"]`);
    tab.hidden = !is;
    if (!is && tab.control.checked) show(panels[0][0]);
    group.hidden = [...group.children].filter((one) => !one.hidden).length < 2;
  };
  for (const [name, , node] of panels) node.reveal = () => show(name);
  show(panels[0][0]);
  return [group, offer];
}

/** See a node, in whatever tab or fold it is. */
export function reveal(node) {
  for (let up = node; up; up = up.parentElement) {
    up.reveal?.();
    if (up.localName === "details") up.open = true;
  }
  node.scrollIntoView({ block: "nearest" });
}

/** Steps [across, up] of the arrow keys. */
export const ARROWS = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** Words within a box, so many dots beside a pointer; `say` shows them, or none. */
export function tipIn(box, kind, [right, down]) {
  const node = el("div", { class: `tip ${kind}`, role: "status", hidden: true });
  box.append(node);
  const say = (words, event) => {
    node.hidden = !words;
    if (!words) return;
    node.textContent = words;
    const { left, top, width, height } = box.getBoundingClientRect();
    node.style.left = `${clamp(event.clientX - left + right, 4, width - node.offsetWidth - 6)}px`;
    node.style.top = `${clamp(event.clientY - top + down, 4, height - node.offsetHeight - 6)}px`;
  };
  return { node, say };
}

/** A short message that goes away. */
export function toast(text) {
  document.querySelector(".toast")?.remove();
  const node = el("div.toast", { role: "status" }, text);
  document.body.append(node);
  setTimeout(() => node.remove(), 2500);
}

/** Text to the clipboard. */
export function copy(text, what) {
  navigator.clipboard.writeText(text).then(() => toast(`${what} copied`), () => toast(`${what} could not be copied`));
}
