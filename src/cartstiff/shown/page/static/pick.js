// Point at a part of the picture: what it is and its number; click: its row is lit.

import { all, byId, engineering, reveal, short, tipIn, toast, tuple } from "./dom.js";
import { pathOf } from "./labels.js";
import { inWords } from "./store.js";

// A press that moved less than this (dots) is a click.
const STILL = 4;
// How near (dots) to the middle of a map's point is on it, however small it is.
const NEAR_POINT = 4;
// How long (ms) a row stays lit.
const LIT = 2600;
// What is nearer to being meant where several parts lie behind each other.
const MEANT = { load: 0, moment: 0, axis: 1, ellipsoid: 2, leg: 3, joint: 3 };
const POINT_MEANT = 1.5; // unless something stands before it

/** What a part of the picture is, by the names on its way; null for what says nothing. */
export function meaning(names, mechanism) {
  const [part, second, third] = names;
  if (part?.endsWith(" ellipsoid")) {
    const freedom = part.split(" ")[0];
    return third?.startsWith("axis") ? { kind: "axis", freedom, index: Number(third.slice(5)) - 1 }
      : { kind: "ellipsoid", freedom };
  }
  if (part === "wrench") return { kind: second === "moment" ? "moment" : "load" };
  if (part !== "mechanism") return null;
  if (second === "legs") return { kind: "leg", index: Number(third.slice(5)) - 1 };
  if (!second?.startsWith("joint ")) return null;
  const index = mechanism.joints[Number(second.slice(6)) - 1];
  return index === undefined ? null : { kind: "joint", index };
}

/** Parts under a pointer, the one that is meant first; `what` as in `meaning`. */
export function under(pane, event, mechanism) {
  const [x, y] = pane.place(event);
  const meshes = [];
  /** @type {any} */
  let point = null;
  pane.at().traverseVisible((node) => {
    if (node.isPoints && pathOf(node)[0] === "map") point = pointAt(node, pane, x, y);
    else if (node.isMesh && !node.userData.isTwin && meaning(pathOf(node), mechanism)) meshes.push(node);
  });
  const found = pane.ray(event).intersectObjects(meshes, false)
    .map(({ object, distance }) => ({ what: meaning(pathOf(object), mechanism), distance }))
    .sort((a, b) => MEANT[a.what.kind] - MEANT[b.what.kind] || a.distance - b.distance);
  if (point && !found.some(({ what, distance }) => MEANT[what.kind] < POINT_MEANT
    || distance < point.distance)) return point.what;
  return found[0]?.what ?? null;
}

/** The point of a map under a place of the screen, nearest to the eye; null for none. */
function pointAt(node, { viewer: { camera }, size: [width, height] }, x, y) {
  const { array } = node.geometry.attributes.position;
  const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).multiply(node.matrixWorld).elements;
  let [index, depth] = [-1, Infinity];
  for (let i = 0; 3 * i < array.length; i++) {
    const [a, b, c] = [array[3 * i], array[3 * i + 1], array[3 * i + 2]];
    const w = m[3] * a + m[7] * b + m[11] * c + m[15];
    if (!(w > camera.near && w < depth)) continue;
    const reach = Math.max(NEAR_POINT, node.material.size * height / 4 / w); // half its square, as three.js draws it
    if (Math.abs((m[0] * a + m[4] * b + m[8] * c + m[12]) / w - x) * width / 2 <= reach
      && Math.abs((m[1] * a + m[5] * b + m[9] * c + m[13]) / w - y) * height / 2 <= reach) [index, depth] = [i, w];
  }
  if (index < 0) return null;
  const place = camera.position.clone().fromArray(array, 3 * index).applyMatrix4(node.matrixWorld);
  const eye = place.clone().setFromMatrixPosition(camera.matrixWorld);
  return { what: { kind: "point", index, node }, distance: place.distanceTo(eye) };
}

/** Numbers that travel with a point of a map; null where the map carries none of that name. */
function carried({ node, index }, name) {
  const { [name]: nearest, [`${name} rest`]: rest } = node.geometry.attributes;
  if (!nearest) return null;
  const from = index * nearest.itemSize;
  return Array.from({ length: nearest.itemSize }, (_, k) => nearest.array[from + k] + rest.array[from + k]);
}

/** A point of the map becomes the posture. */
export function standAt(store, what) {
  const q = carried(what, "q");
  if (!q?.every(Number.isFinite)) toast("The map holds no postures of this mechanism here");
  else if (!store.source.moves) toast("This file shows one posture: `cartstiff view` goes to where a point of the map "
    + "is");
  else store.goTo(q);
}

/** Stand where the map's quantity is largest (1) or smallest (-1). */
export function standAtExtreme(store, sign) {
  const object = store.pane.at("map", "<object>");
  const { value } = object.geometry.attributes;
  let index = -1;
  value.array.forEach((x, i) => { if (Number.isFinite(x) && !(sign * x <= sign * value.array[index])) index = i; });
  if (index < 0) toast("No point of the map has a value");
  else standAt(store, { node: object, index });
}

/** A point of the map by its number, from 0; null where there is none. */
export function pointOfMap(store, index) {
  const node = store.pane.at("map", "<object>");
  return index >= 0 && index < (node?.geometry?.attributes.position.count ?? 0) ? { kind: "point", index, node } : null;
}

export function picking(store) {
  const { pane } = store;
  const canvas = pane.node;
  const tip = tipIn(byId("stage"), "overlay", [14, 16]);
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
    const what = under(pane, event, store.hello.mechanism);
    show(event);
    if (what?.kind === "point") standAt(store, what);
    else if (what) lightRow(store, what);
  });

  let pointed = null; // the part whose bar is lit
  function point(name) {
    if (pointed !== name) store.tell("part", name);
    pointed = name;
  }

  function hide() {
    point(null);
    tip.say(null);
    pane.light(null);
  }

  function show(event) {
    if (!event || !store.numbers || pane.holding) return;
    const what = under(pane, event, store.hello.mechanism);
    pane.light(what?.freedom ?? null);
    point(nameOfPart(store, what));
    tip.say(what && words(store, what), event);
  }

  // A row that is pointed at has its values written in the picture.
  const table = document.querySelector(".principal");
  for (const event of ["pointerover", "focusin"]) table.addEventListener(event, (/** @type {any} */ { target }) =>
    pane.light(target.closest("[data-row-of]")?.dataset.rowOf ?? null));
  for (const event of ["pointerleave", "focusout"]) table.addEventListener(event, () => pane.light(null));
}

/** The name that a joint or a leg has among the shares; null for anything else. */
function nameOfPart({ hello: { mechanism: { coordinates, springs } }, numbers }, what) {
  if (what?.kind === "leg") return springs[what.index]?.name ?? null;
  if (what?.kind !== "joint") return null;
  const { name } = coordinates[what.index];
  const link = name.replace(/\.[^.]*$/, " (link)"); // of a flexible link, whose joints are called after it
  return numbers.moved?.shares?.parts.some((one) => one.name === link) ? link : name;
}

/** What a part of the picture says, in a line. */
export function words(store, what) {
  const { numbers, hello: { mechanism } } = store;
  const share = (name) => {
    const { parts = [], of } = numbers.moved?.shares ?? {};
    const found = parts.find((row) => row.name === name)?.share;
    return found == null ? "" : `, ${Math.round(100 * found) || 0} % of the ${of} under the load`;
  };
  if (what.kind === "ellipsoid" || what.kind === "axis") {
    const found = numbers.principal?.[what.freedom];
    if (!found) return what.freedom;
    const i = what.freedom === "translation" ? 3 : 0;
    const unit = store.unitOf(i, i);
    const values = what.kind === "axis" ? [found.values[what.index]] : found.values;
    const along = what.kind === "axis" ? ` along ${tuple(found.axes[what.index])}` : "";
    return `${what.freedom}, ${store.shown.quantity}: ${values.map((x) => short(x, 5)).join(", ")} ${unit}${along}`;
  }
  if (what.kind === "joint") {
    const { name } = mechanism.coordinates[what.index];
    return `${name} ${inWords(store, what.index, numbers.result.q[what.index], 5)}${share(nameOfPart(store, what))}`;
  }
  if (what.kind === "point") {
    const { label, unit, words: kinds } = store.legend.cloud;
    const [value] = carried(what, "value");
    const goes = store.source.moves && carried(what, "q") ? "; click: this posture" : "";
    return `${label}: ${kinds ? kinds[value] : Number.isFinite(value) ? engineering(value, unit) : "no value"}${goes}`;
  }
  if (what.kind === "leg") {
    const leg = numbers.legs?.[what.index];
    const name = mechanism.springs[what.index]?.name ?? `leg ${what.index + 1}`;
    return leg ? `${name}: ${engineering(leg.length, store.unit("length"))}, tension ${engineering(leg.tension,
      store.unit("force"))}${share(name)}` : name;
  }
  const [kind, first] = what.kind === "moment" ? ["moment", 0] : ["force", 3];
  const part = numbers.wrench?.slice(first, first + 3);
  return part ? `load: ${engineering(Math.hypot(...part), store.unit(kind))} ${tuple(part)}` : "load";
}

/** Show where a part's numbers stand. */
function lightRow(store, what) {
  const { kind, index, freedom } = what;
  const rows = {
    ellipsoid: () => all(`[data-row-of="${freedom}"]`)[0],
    axis: () => all(`[data-row-of="${freedom}"] td`)[index],
    joint: () => byId(`slider-${index}`)?.closest(".slider"),
    leg: () => all(".leg")[index + 1],
  };
  const row = kind in rows ? rows[kind]() : all(".moved-card")[0];
  if (!row) return;
  reveal(row);
  for (const other of all(".lit")) other.classList.remove("lit");
  row.classList.add("lit");
  setTimeout(() => row.classList.remove("lit"), LIT);
}
