// Point at a part of the picture: what it is and its number; click: its row is lit.

/* global MeshCat */
import { byId, el, sure, short } from "./dom.js";
import { pathOf } from "./labels.js";

// A press that moved less than this (dots) is a click.
const STILL = 4;
// How long (ms) a row stays lit.
const LIT = 2600;
// What is nearer to being meant where several parts lie behind each other.
const MEANT = { load: 0, moment: 0, screw: 1, axis: 1, ellipsoid: 2, deflection: 2, leg: 3, joint: 3 };

/** What a part of the picture is, by the names on its way; null for what says nothing. */
export function meaning(names, mechanism) {
  const [part, second, third] = names;
  if (part?.endsWith(" ellipsoid")) {
    const freedom = part.split(" ")[0];
    return third?.startsWith("axis") ? { kind: "axis", freedom, index: Number(third.slice(5)) - 1 } : { kind: "ellipsoid", freedom };
  }
  if (part === "wrench") return { kind: second === "moment" ? "moment" : "load" };
  if (part === "deflection") return { kind: "deflection" };
  if (part === "screws") return { kind: "screw", index: Number(second.slice(5)) - 1 };
  if (part !== "mechanism") return null;
  if (second === "legs") return { kind: "leg", index: Number(third.slice(5)) - 1 };
  if (!second?.startsWith("joint ")) return null;
  const index = mechanism.joints[Number(second.slice(6)) - 1];
  return index === undefined ? null : { kind: "joint", index };
}

/** Parts under a place of the screen, the one that is meant first; `what` as in `meaning`. */
export function under(pane, [x, y], mechanism) {
  const { viewer } = pane;
  const { Raycaster } = MeshCat.THREE;
  const ray = new Raycaster();
  ray.setFromCamera({ x, y }, viewer.camera);
  const root = viewer.scene_tree.find(["meshcat", "cartstiff"]).object;
  const meshes = [];
  root.traverseVisible((node) => {
    if (node.isMesh && !node.userData.isTwin && /^(mechanism|wrench|deflection|screws|.* ellipsoid)$/.test(pathOf(node)[0] ?? "")) meshes.push(node);
  });
  return ray.intersectObjects(meshes, false)
    .map(({ object, distance }) => ({ what: meaning(pathOf(object), mechanism), distance }))
    .filter(({ what }) => what)
    .sort((a, b) => MEANT[a.what.kind] - MEANT[b.what.kind] || a.distance - b.distance)[0]?.what ?? null;
}

export function picking(store) {
  const { pane } = store;
  const canvas = pane.node;
  const tip = el("div", { class: "tip overlay", role: "status", hidden: true });
  byId("stage").append(tip);
  let pressed = null;
  let waiting = null;

  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons || pane.holding) return hide();
    if (waiting === null) requestAnimationFrame(() => { show(waiting); waiting = null; });
    waiting = event;
  });
  canvas.addEventListener("pointerleave", () => { if (!pane.holding) hide(); });
  canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    const moved = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]);
    pressed = null;
    if (moved === null || moved > STILL || pane.holding || !store.numbers) return;
    const what = under(pane, pane.place(event), store.hello.mechanism);
    show(event);
    if (what) lightRow(store, what);
  });

  function hide() {
    tip.hidden = true;
    pane.light(null);
  }

  function show(event) {
    if (!event || !store.numbers || pane.holding) return;
    const what = under(pane, pane.place(event), store.hello.mechanism);
    pane.light(what?.freedom ?? null);
    tip.hidden = !what;
    if (!what) return;
    tip.textContent = words(store, what);
    const { left, top, width, height } = byId("stage").getBoundingClientRect();
    const [x, y] = [event.clientX - left, event.clientY - top];
    tip.style.left = `${Math.max(4, Math.min(x + 14, width - tip.offsetWidth - 6))}px`;
    tip.style.top = `${Math.max(4, Math.min(y + 16, height - tip.offsetHeight - 6))}px`;
  }

  // A row that is pointed at has its values written in the picture.
  for (const kind of ["translation", "rotation"]) {
    const row = document.querySelector(`[data-row-of="${kind}"]`);
    row.addEventListener("pointerenter", () => pane.light(kind));
    row.addEventListener("pointerleave", () => pane.light(null));
  }
}

/** What a part of the picture says, in a line. */
export function words(store, what) {
  const { numbers, hello: { mechanism } } = store;
  const share = (name) => {
    const found = numbers.moved?.shares.find((row) => row.name === name)?.share;
    return found == null ? "" : `, ${Math.round(100 * found) || 0} % of the motion under the load`;
  };
  if (what.kind === "ellipsoid" || what.kind === "axis") {
    const found = numbers.principal?.[what.freedom];
    if (!found) return what.freedom;
    const i = what.freedom === "translation" ? 1 : 0;
    const unit = store.blockUnits()[i][i];
    const values = what.kind === "axis" ? [found.values[what.index]] : found.values;
    const along = what.kind === "axis" ? ` along (${found.axes[what.index].map((c) => short(c, 3)).join(", ")})` : "";
    return `${what.freedom}, ${store.state.quantity}: ${values.map((x) => short(what.freedom === "translation" ? store.read(x) : x, 5)).join(", ")} ${unit}${along}`;
  }
  if (what.kind === "joint") {
    const { name, is_length: isLength, unit } = mechanism.coordinates[what.index];
    const x = numbers.result.q[what.index];
    const value = isLength || store.angle === "rad" ? `${short(x, 5)} ${unit}` : `${short((180 / Math.PI) * x, 5)}°`;
    return `${name} ${value}${share(name)}`;
  }
  if (what.kind === "leg") {
    const leg = numbers.legs?.[what.index];
    const name = mechanism.springs[what.index]?.name ?? `leg ${what.index + 1}`;
    return leg ? `${name}: ${short(leg.length, 5)} ${store.unit("length")}, tension ${short(leg.tension)} ${store.unit("force")}${share(name)}` : name;
  }
  if (what.kind === "screw") {
    const { name, value, unit, pitch } = store.legend.screws?.[what.index] ?? {};
    if (!name) return "eigenscrew";
    return `${name}: ${short(value, 5)} ${unit}, pitch ${short(pitch)} ${store.unit("length")}`;
  }
  if (what.kind === "deflection") return `moved by ${sure(Math.hypot(...(numbers.moved?.displacement ?? [0])))} ${store.unit("length")} under the load`;
  const part = what.kind === "moment" ? numbers.wrench?.slice(0, 3) : numbers.wrench?.slice(3);
  return part ? `load: ${short(Math.hypot(...part))} ${store.unit(what.kind === "moment" ? "moment" : "force")} (${part.map((x) => short(x, 3)).join(", ")})` : "load";
}

/** Show where a part's numbers stand. */
function lightRow(store, what) {
  const row = {
    ellipsoid: () => document.querySelector(`[data-row-of="${what.freedom}"]`),
    axis: () => document.querySelector(`[data-row-of="${what.freedom}"]`)?.querySelectorAll("td")[what.index],
    joint: () => byId(`slider-${what.index}`)?.closest(".slider"),
    leg: () => document.querySelectorAll(".leg")[what.index + 1],
    screw: () => document.querySelector(".matrix")?.closest(".card"), // it is read from the whole matrix
    load: () => document.querySelector(".moved-card"),
    moment: () => document.querySelector(".moved-card"),
    deflection: () => document.querySelector(".moved-card"),
  }[what.kind]();
  if (!row) return;
  row.scrollIntoView({ block: "nearest" });
  for (const other of document.querySelectorAll(".lit")) other.classList.remove("lit");
  row.classList.add("lit");
  setTimeout(() => row.classList.remove("lit"), LIT);
}
