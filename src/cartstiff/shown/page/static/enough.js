// Is it good enough? A displacement that is allowed: whether the load stays within it, and how large it may be.

import { el, engineering, folded, inSize, plainly, short } from "./dom.js";
import { loadWords, wayOf } from "./loads.js";

// Unit in which a displacement is typed, where the file's is a metre.
const TYPED = "mm";

export function enoughCard(store) {
  const said = el("span.dim.small", { role: "status" });
  const input = el("input", { type: "number", min: 0, step: "any", id: "allowed", onchange: () => {
    const typed = input.valueAsNumber;
    store.change({ allowed: typed > 0 ? typed * factor() : null });
  } });
  const unit = el("span.dim");
  const result = el("output", { for: "allowed" });
  folded("enough", "Is it good enough?", said, () => {},
    el("label.line", el("span", "allowed displacement"), input, unit), result);

  const own = () => store.unit("length");
  const factor = () => (own() === "m" ? inSize(1e-3, own())[0] : 1);

  const size = (times) => loadWords(store, { digits: 3, times });

  function update() {
    const { state: { allowed }, numbers } = store;
    if (!numbers) return;
    unit.textContent = own() === "m" ? TYPED : own();
    if (document.activeElement !== input) input.value = allowed ? Number((allowed / factor()).toPrecision(12)) : "";
    const { moved } = numbers;
    const way = wayOf(numbers);
    const isInside = way !== null && way <= allowed;
    result.dataset.level = !allowed || !moved ? "none" : isInside ? "good" : "bad";
    said.textContent = !allowed ? "" : !moved ? "needs a load" : isInside ? "✓ inside" : "✕ outside";
    const most = engineering(allowed, own(), 3);
    if (!allowed) result.textContent = "";
    else if (!moved) result.textContent = "Without a load nothing moves";
    else if (way === null) result.textContent = "✕ The load is not held";
    else if (!way) result.textContent = "✓ Inside: the load does not move the point";
    else result.textContent = `${isInside ? "✓ Inside" : "✕ Outside"}: ${engineering(way, own(), 3)} of ${most}. The `
      + `largest load along this one is ${size(allowed / way)}, ${short(allowed / way, 3)} times it (to first order)`;
  }

  // At rest the equilibrium is known, and what else ends it: forces, travel, stability.
  store.on("said", ({ holds }) => {
    if (holds && store.state.allowed && store.numbers.moved?.resisted) result.append(
      `; ${size(holds.factor)} by the equilibrium, until ${plainly(holds.until)}`);
  });
  store.on("numbers", update);
  store.on("state", (patch) => { if ("allowed" in patch) update(); });
}
