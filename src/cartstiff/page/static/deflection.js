// The first question: how far does the load move the point, and what gives way.

import { byId, chop, el, short } from "./dom.js";
import { CLOSE, ROUNDING } from "./numerics.js";
import { sway } from "./sway.js";

// Where lengths are metres, people say millimetres.
export const FINE = { m: [1000, "mm"], mm: [1, "mm"], cm: [10, "mm"] };

// A load to begin with, in the unit of force.
const EXAMPLE = 100;

/** Load, weight and what is taken for granted, in a line. */
function assumptions(store, moved) {
  const { result } = store.numbers;
  const [m, f] = [0, 3].map((i) => Math.hypot(...(store.shown.load ?? result.wrench).slice(i, i + 3)));
  const load = [[f, "force"], [m, "moment"]].filter(([x]) => x > 0).map(([x, kind]) => `${short(x, 3)} ${store.unit(kind)}`).join(", ");
  const at = moved.acts_at.some((x) => x) ? `(${moved.acts_at.map((x) => short(x, 3)).join(", ")}) ${store.unit("length")} in M` : "M";
  return `${load} at ${at}: ${result.load.meaning}. ${store.numbers.weighed ?? store.hello.mechanism.weighed}. To first order.`;
}

export function deflectionPanel(store) {
  const head = el("div", { class: "moved-head" });
  const detail = el("div", { class: "moved-detail" });
  const line = el("p", { class: "moved-line dim small" });
  const bars = el("div", { class: "moved-bars", tabindex: 0, role: "group", "aria-label": "Shares of the joints or legs" });
  const example = el("button", { type: "button", title: "A force of 100 downwards in the room; then drag the arrow, or type numbers on the left",
    onclick: () => store.change({ load: [0, 0, 0, 0, 0, -EXAMPLE], load_axes: "inertial" }) });
  store.on("hello", () => { example.textContent = `Add ${EXAMPLE} ${store.unit("force")} downwards`; });
  byId("right").append(el("div", { class: "card moved-card" }, el("div", { class: "row" }, el("h2", {}, "Under this load"), el("span", { class: "grow" }), sway(store)), head, detail, line, bars));

  const length = (x) => {
    const [factor, unit] = FINE[store.unit("length")] ?? [1, store.unit("length")];
    return `${short(x * factor, 3)} ${unit}`;
  };
  const vector = (v) => {
    const [factor, unit] = FINE[store.unit("length")] ?? [1, store.unit("length")];
    const size = Math.hypot(...v);
    return `${v.map((x) => short(Math.abs(x) < CLOSE * size ? 0 : x * factor, 3)).join(", ")} ${unit}`;
  };

  const wrenchText = (wrench) => [wrench.slice(0, 3), wrench.slice(3)].map((part, i) =>
    `${chop(part).map((x) => short(x, 3)).join(", ")} ${store.unit(i ? "force" : "moment")}`).join(";  ");

  store.on("numbers", () => {
    const { moved, result } = store.numbers;
    const { wrench } = result;
    bars.replaceChildren();
    detail.replaceChildren();
    line.replaceChildren();
    if (!moved) {
      head.className = "moved-head dim";
      if (!wrench) head.textContent = "no load can be held here";
      else if (store.shown.load?.some((x) => x)) head.textContent = "no compliance exists here: how far the load moves it is not said";
      else head.replaceChildren("no load", ...(store.source.moves && store.hello.mechanism.takes_load ? [" ", example] : []));
      return;
    }
    head.className = "moved-head";
    if (!moved.resisted) {
      head.textContent = "Unstable: the load pushes it away";
      head.className = "moved-head bad";
      return;
    }
    // A turn that is rounding beside the way is none.
    const [way, turn] = [moved.displacement, moved.rotation].map((v) => Math.hypot(...v));
    const turned = turn * store.hello.mechanism.size > CLOSE * way ? turn : 0;
    const what = store.shown.point.some((x) => x) ? "the point" : "M";
    head.replaceChildren(`${what} moves `, el("b", {}, length(way)),
      ` and turns `, el("b", {}, `${short(1000 * turned, 3)} mrad`));
    head.title = "To first order, from where the springs rest without this load";
    const row = (name, value, title) => el("div", { title }, el("span", { class: "dim" }, name), el("span", { class: "num" }, value));
    detail.append(
      row("tool axes", vector(moved.displacement), "along the axes of M"),
      row("room axes", vector(moved.in_room), "along the axes of F"),
      ...(moved.acts_at.some((x) => x) ? [row("wrench at M", wrenchText(wrench), "moment and force about the origin of M, along its axes")] : []),
      row("energy", `${short(moved.energy, 3)} ${store.unit("moment")}`, "that the load puts into the springs"));
    const says = assumptions(store, moved);
    line.textContent = says;
    line.title = says;
    const size = ({ share }) => Math.abs(share ?? 0);
    const ordered = moved.shares.toSorted((a, b) => size(b) - size(a));
    for (const entry of ordered) {
      const { name, share } = entry;
      const bar = el("i");
      bar.style.width = `${(100 * size(entry)) / Math.max(size(ordered[0]), ROUNDING)}%`;
      bars.append(el("div", { class: "moved-bar", title: `${name}: part of the point's way` },
        el("span", { class: "moved-name" }, name), el("span", { class: `meter wide${share < 0 ? " against" : ""}` }, bar),
        el("span", { class: "num" }, share === null ? "–" : `${Math.round(100 * share) || 0} %`)));
    }
    for (const note of moved.notes) bars.append(el("div", { class: "dim small" }, note));
  });
}
