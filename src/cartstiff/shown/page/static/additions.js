// Sliders that a user's code has added to the page; the arrows come with the picture.

import { card, el, heading } from "./dom.js";
import { sliderRow } from "./inputs.js";

export function additionsCard(store) {
  const list = el("div.sliders");
  const own = card("left", "div.card.additions-card", { hidden: true }, heading("From Python"), list);
  let rows = new Map();
  const values = {};
  const held = new Set(); // what somebody moves here is not set from elsewhere

  /** Tell where a slider is; while an answer is awaited only the newest place is kept. */
  async function tell(name) {
    if (held.has(name)) return;
    held.add(name);
    for (let said = null; said !== values[name];) {
      said = values[name];
      await store.ask({ do: "slide", name, value: said }).catch(({ message }) => store.tell("error", message));
    }
    held.delete(name);
  }

  store.on("additions", ({ sliders }) => {
    const key = JSON.stringify(sliders.map(({ value, ...rest }) => rest));
    for (const { name, value } of sliders) if (!held.has(name)) values[name] = value;
    if (own.dataset.key !== key) {
      own.dataset.key = key;
      rows = new Map(sliders.map(({ name, lower, upper }, k) => [name, sliderRow(store, { id: `slider-own-${k}`, name,
        lower, upper, unit: "", is_length: true, limited: true, value: () => values[name], move: (x) => {
          values[name] = x;
          rows.get(name).set();
          tell(name);
        } })]));
      list.replaceChildren(...[...rows.values()].map(({ node }) => node));
    }
    own.hidden = !sliders.length;
    for (const row of rows.values()) {
      row.relabel();
      row.set();
    }
  });
}
