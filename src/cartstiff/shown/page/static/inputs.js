// Fields of numbers, and sliders with a number.

import { clamp, el, short, toast } from "./dom.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";

export const DEGREES = 180 / Math.PI;

/**
 * Numbers in fields; calls back with all of them when one has changed. `blank` has a name and a value for those that
 * may be left empty.
 */
export function fields(names, onchange, blank = []) {
  const inputs = names.map(([name, unit, of]) => el("input",
    { type: "number", step: "any", "aria-label": `${of ? `${of} ` : ""}${name} ${unit}`, onchange: commit }));
  function commit() {
    const values = inputs.map((input, i) =>
      (blank[i] && input.value === "" && !input.validity.badInput ? blank[i].value : input.valueAsNumber));
    if (values.every((x) => x === null || Number.isFinite(x))) onchange(values);
  }
  inputs.forEach((input, i) => { if (blank[i]) input.placeholder = blank[i].called; });
  const node = el("div.fields", ...names.map(([name, unit], i) =>
    el("label", el("span", { title: unit }, name), inputs[i])));
  const set = (values) => inputs.forEach((input, i) => {
    if (document.activeElement !== input) input.value = (values[i] === blank[i]?.value ? null : values[i]) ?? "";
  });
  const disable = (off) => inputs.forEach((input) => { input.disabled = off; });
  return { node, set, disable };
}

/** A slider and a number of a length, or of an angle in degrees or radians; `limited`: its ends are limits. */
export function sliderRow(store, /** @type {any} */ { index, id = `slider-${index}`, name, label = name, lower, upper,
  unit,
  is_length: isLength, limited, digits = 4, value, move }) {
  const range = el("input", { type: "range", id, min: lower, max: upper, step: "any", "aria-label": name });
  const number = el("input", { type: "number", step: "any", "aria-label": `${name}, value`,
    id: id.replace("slider", "number") });
  const shownUnit = el("span.unit");
  const low = el("span.limit");
  const high = el("span.limit");
  const node = el("div.slider", el("label", { for: id, title: name }, label), number, shownUnit, low, range, high);
  const factor = () => (isLength || store.angle === "rad" ? 1 : DEGREES);

  range.addEventListener("input", () => {
    number.value = shown(range.valueAsNumber);
    move(range.valueAsNumber);
  });
  range.addEventListener("keydown", (event) => {
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };
    const step = steps[event.key];
    if (!step || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    const size = isLength ? (upper - lower) / 200 : Math.PI / 180;
    move(clamp(value() + step * size * (event.shiftKey ? 0.1 : 1), lower, upper));
  });
  let typing = false; // what is being typed is not overwritten
  number.addEventListener("input", () => { typing = true; });
  number.addEventListener("change", () => {
    typing = false;
    const typed = number.valueAsNumber / factor();
    if (!Number.isFinite(typed)) set(value());
    else {
      const inside = limited ? clamp(typed, lower, upper) : typed;
      if (inside !== typed) toast(`${name} is limited to ${low.textContent} … ${high.textContent}`);
      move(inside);
    }
  });

  function shown(x) {
    const decimals = factor() === 1 ? digits : 2;
    const text = (x * factor()).toFixed(decimals);
    return Number(text) === 0 ? (0).toFixed(decimals) : text;
  }

  function set(x) {
    if (range.valueAsNumber !== x) range.value = x;
    if (!typing) number.value = shown(x);
    node.classList.toggle("outside", Boolean(limited) && (x < lower - NEGLIGIBLE_DIFFERENCE || x > upper
      + NEGLIGIBLE_DIFFERENCE));
    range.setAttribute("aria-valuetext", `${shown(x)} ${shownUnit.textContent}`);
  }

  function relabel() {
    const degrees = factor() !== 1;
    shownUnit.textContent = degrees ? "°" : unit;
    low.textContent = short(lower * factor(), 3);
    high.textContent = short(upper * factor(), 3);
    const ends = limited ? "limits" : "range of the slider (no limits of its own)";
    range.title = `${name}: ${ends} ${low.textContent} … ${high.textContent} ${shownUnit.textContent}`;
  }

  return { node, index, set: () => set(value()), relabel };
}
