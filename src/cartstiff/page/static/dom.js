// Small helpers: elements, numbers as text, downloads.

import { BLANK } from "./numerics.js";

/** What the server says where it answers a later question of the same kind instead. */
export const SUPERSEDED = "a newer question took the place of this one";
export const LOST = "the connection was lost";

/** An element with attributes, listeners (on...) and children. */
export function el(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "class") node.className = value;
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value != null) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child != null));
  return node;
}

export const byId = (id) => document.getElementById(id);

/** Colours of the table that pictures share, as #rrggbb. */
export const hues = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim().split(",");

/** How much of the page has come, from 0 to 1; then the bar goes. */
export function loaded(share) {
  const bar = byId("loading");
  if (share < 1 && bar) bar.value = Math.max(bar.value, share);
  else bar?.remove();
}

const MINUS = "\u2212";

/** A number for reading, in few characters: 4 digits, powers of ten where it is large or small. */
export function short(x, digits = 4, large = 1e6) {
  if (x === null || x === undefined || Number.isNaN(x)) return "–";
  if (x === 0) return "0";
  if (!Number.isFinite(x)) return x > 0 ? "∞" : MINUS + "∞";
  const size = Math.abs(x);
  let text;
  if (size >= large || size < 1e-3) {
    const [mantissa, exponent] = size.toExponential(Math.max(0, digits - 2)).split("e");
    text = `${Number(mantissa)}e${Number(exponent)}`;
  } else if (size >= 10 ** (digits - 1)) text = size.toFixed(0);
  else text = String(Number(size.toPrecision(digits)));
  return (x < 0 ? MINUS : "") + text;
}

/** A number with every digit that it has. */
export const full = (x) => (x === null || x === undefined ? "–" : String(x).replace("-", MINUS));

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
  const noise = BLANK * Math.max(size, ...list.map(Math.abs));
  return list.map((x) => (Math.abs(x) < noise ? 0 : x));
};

export const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

/** Give the user a file. */
export function download(name, content, type = "text/plain") {
  const blob = content instanceof Blob ? content : new Blob([content], { type });
  const link = el("a", { download: name, href: URL.createObjectURL(blob) });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 2000);
}

/** A group of buttons of which one is chosen; returns [element, choose]. */
export function choice(label, options, onchoose) {
  const buttons = new Map();
  const group = el("div", { class: "choice", role: "radiogroup", "aria-label": label });
  const choose = (value) => {
    for (const [key, button] of buttons) {
      const chosen = key === value;
      button.setAttribute("aria-checked", String(chosen));
      button.tabIndex = chosen ? 0 : -1;
    }
  };
  const keys = options.map(([value]) => value);
  for (const [value, text, title] of options) {
    const button = el("button", {
      type: "button", role: "radio", title, "data-value": value, "aria-checked": "false",
      onclick: () => onchoose(value),
    }, text);
    button.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const next = keys[(keys.indexOf(value) + step + keys.length) % keys.length];
      buttons.get(next).focus();
      onchoose(next);
    });
    buttons.set(value, button);
    group.append(button);
  }
  return [group, choose];
}

/** A short message that goes away. */
export function toast(text) {
  document.querySelector(".toast")?.remove();
  const node = el("div", { class: "toast", role: "status" }, text);
  document.body.append(node);
  setTimeout(() => node.remove(), 2500);
}

/** Text to the clipboard; where that is not allowed, selected in a dialog to be copied by hand. */
export async function copy(text, what) {
  try {
    await navigator.clipboard.writeText(text);
    toast(`${what} copied`);
  } catch {
    const area = el("textarea", { class: "copy-area", readonly: true, "aria-label": what });
    area.value = text;
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    toast(done ? `${what} copied` : `${what} could not be copied`);
  }
}
