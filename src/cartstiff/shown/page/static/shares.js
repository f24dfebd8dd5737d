// Which joint, link or leg contributes how much of the motion under the load: bars in the answer, and the same
// colours in the picture, on a band about each joint and on the legs. Pointing at one lights the other.

import { all, byId, clamp, el, rgbs, typeset } from "./dom.js";
import { between } from "./drawing.js";
import { align, both, worldOf } from "./shapes.js";

// A band about a joint: its radius and its thickness over the mechanism's size, without a share and with all of it.
const [RADIUS, THIN, THICK, LARGER] = [0.066, 0.006, 0.02, 1.25];
// Shares that are not named: rounded to 0 %.
const UNSAID = 0.005;
// What a flexible link is called, beside its name: its joints are called after it.
const LINK = " (link)";
// A band about a joint that slides is a sleeve: its radius and its length over those of a ring.
const SLEEVE = [0.32, 3];
const HEADS = { displacement: "Share of the displacement", energy: "Share of the energy" };

const tables = {}; // by name and theme
/** Red, green, blue of a share, or of a force over its limit, from -1 to 1. */
function colourOf(name, x) {
  const key = `${name} ${document.documentElement.dataset.theme}`;
  return between(tables[key] ??= rgbs(name), clamp(0.5 + 0.5 * x, 0, 1));
}

const shareColour = (share) => colourOf("shares", share);
const css = (colour) => `rgb(${colour.map(Math.round).join(", ")})`;
const percent = (share) => typeset(`${Math.round(100 * share) || 0} %`);

/** The part that a row is of: joints of the tree that it moves, those within a link, the number of a leg. */
function placesOf({ coordinates, joints, springs, platform }, name) {
  if (platform) return { joints: [], within: [], leg: springs.findIndex((one) => one.name === name) };
  const those = (is) => [...joints.keys()].filter((j) => is(coordinates[joints[j]]?.name ?? ""));
  const link = name.endsWith(LINK) && name.replace(LINK, ".");
  return { joints: those((one) => one === name), within: link ? those((one) => one.startsWith(link)) : [], leg: -1 };
}

/** Bars up to 100 %; returns their node. */
export function shareBars(store) {
  const head = el("div.shares-head.small.dim");
  const list = el("div.moved-bars", { role: "group", "aria-label": "Shares of the joints or legs" });
  const none = el("p.dim.small");

  /** A bar that lights its part, where it has one. */
  function bar(name, share, isPart) {
    const fill = el("i");
    fill.style.width = `${clamp(100 * Math.abs(share), 0, 100)}%`;
    if (isPart) fill.style.background = css(shareColour(share));
    const row = el("div.moved-bar", { tabindex: isPart ? 0 : false, "data-part": isPart ? name : false },
      el("span.moved-name", name),
      el("span", { class: `meter wide${share < 0 ? " against" : ""}` }, fill),
      el("span.num", percent(share)));
    const light = (name) => () => store.tell("part", name);
    if (isPart) for (const event of ["pointerenter", "focus"]) row.addEventListener(event, light(name));
    if (isPart) for (const event of ["pointerleave", "blur"]) row.addEventListener(event, light(null));
    return row;
  }

  store.on("numbers", () => {
    const { moved } = store.numbers;
    const found = moved?.resisted ? moved.shares : null;
    const parts = found?.parts.filter(({ share }) => Math.abs(share) >= UNSAID) ?? [];
    head.hidden = list.hidden = !found;
    none.textContent = moved?.resisted && !found ? reasonFor(moved) : "";
    none.hidden = !none.textContent;
    if (!found) return list.replaceChildren();
    const signed = parts.some(({ share }) => share < 0);
    const scale = el("span.gradient");
    const colours = (signed ? [-1, 0, 1] : [0, 1]).map((x) => css(shareColour(x)));
    scale.style.background = `linear-gradient(to right, ${colours})`;
    head.replaceChildren(el("span", HEADS[found.of]),
      el("span.num", signed ? "−100" : "0"), scale, el("span.num", "100 %"));
    const focused = all(".moved-bar:focus")[0]?.dataset.part;
    list.replaceChildren(...parts.map(({ name, share }) => bar(name, share, true)),
      ...(Math.abs(found.rest) >= UNSAID ? [bar("no joint or leg", found.rest, false)] : []));
    if (focused) all(".moved-bar").find(({ dataset }) => dataset.part === focused)?.focus();
  });
  store.on("part", (name) => {
    for (const row of list.children) row.classList.toggle("lit", name !== null && row.dataset.part === name);
  });
  return el("div", head, list, none);
}

/** Why there are no shares. */
function reasonFor({ displacement, rotation }) {
  if (displacement.some((x) => x)) return "No share is known: the springs store no energy";
  return rotation.some((x) => x) ? "The point does not move: nothing has a share of its way"
    : "The structure carries this load: no spring has a share";
}

/** The meshes below a place of a picture's mechanism. */
function meshesOf(pane, ...names) {
  const found = [];
  pane.part("mechanism", ...names)?.traverse((node) => {
    if (node.isMesh && !node.userData.isTwin) found.push(node);
  });
  return found;
}

const paintLeg = (pane, leg, colour) => meshesOf(pane, "legs", `line ${leg + 1}`, "rod")
  .forEach(({ material }) => material.color.set(css(colour)));

/** Legs in the colours of their forces, in a store's picture; slack ones come in theirs. */
export function legColours(store) {
  store.pane.before.push(() => {
    const { limits: [, most] = [0, 0], slack = [] } = store.legend?.tension ?? {};
    store.numbers?.legs?.forEach(({ tension }, i) => {
      if (!slack.includes(i + 1)) paintLeg(store.pane, i, colourOf("forces", most ? (tension ?? 0) / most : 0));
    });
  });
}

/** Bands about joints and colours of legs, in the picture. */
export function sharePicture(store) {
  legColours(store);
  const { THREE } = MeshCat;
  const { pane } = store;
  const world = worldOf(pane);
  const bands = new Map(); // by joint of the tree
  let lit = null;

  function made() {
    const band = new THREE.Group();
    band.add(...both(new THREE.TorusGeometry(1, 1, 12, 48), 0, 0.35, 5));
    world.add(band);
    return band;
  }

  /** A band about a joint's axis, as thick as its share is large. */
  function band(j, share, isLit) {
    const { size, per_length: per } = store.legend;
    const at = pane.part("mechanism", `joint ${j + 1}`);
    if (!at) return;
    if (!bands.has(j)) bands.set(j, made());
    const one = bands.get(j);
    one.visible = true;
    const { axes, joints, coordinates } = store.hello.mechanism;
    const isSlide = coordinates[joints[j]].is_length;
    align(one, at, [0, 0, 0], axes[j]);
    const thickness = (THIN + (THICK - THIN) * Math.min(1, Math.abs(share))) / RADIUS;
    const radius = RADIUS * size * per * (isLit ? LARGER : 1);
    for (const mesh of one.children) {
      if (mesh.userData.thickness !== thickness) {
        mesh.userData.thickness = thickness;
        mesh.geometry.dispose();
        mesh.geometry = new THREE.TorusGeometry(1, thickness, 12, 48).scale(1, 1, 2);
      }
      if (isSlide) mesh.scale.set(SLEEVE[0] * radius, SLEEVE[0] * radius, SLEEVE[1] * radius);
      else mesh.scale.setScalar(radius);
      mesh.material.color.set(css(shareColour(share)));
    }
  }

  const painted = []; // of flexible links, with the colours that they have otherwise
  function paintLink(within, colour) {
    for (const j of within) for (const { material } of meshesOf(pane, `joint ${j + 1}`)) {
      painted.push([material, material.color.clone()]);
      material.color.set(css(colour));
    }
  }

  pane.before.push(() => {
    for (const one of bands.values()) one.visible = false;
    for (const [material, colour] of painted.splice(0)) material.color.copy(colour);
    const { numbers, hello, shown } = store;
    if (!numbers || !hello || !shown.deflection && lit === null) return;
    const parts = numbers.moved?.resisted ? numbers.moved.shares?.parts ?? [] : [];
    for (const { name, share } of parts) {
      const { joints, within, leg } = placesOf(hello.mechanism, name);
      const isLit = lit === name;
      if (Math.abs(share) >= UNSAID || isLit) {
        for (const j of joints) band(j, share, isLit);
        paintLink(within, shareColour(isLit ? Math.sign(share) : share));
      }
      if (leg >= 0) paintLeg(pane, leg, shareColour(isLit ? Math.sign(share) : share));
    }
  });
  store.on("part", (name) => {
    lit = name;
    for (const row of document.querySelectorAll(".slider, .leg")) row.classList.remove("lit");
    if (name !== null) {
      const { mechanism } = store.hello;
      const index = mechanism.coordinates.findIndex((one) => one.name === name);
      byId(`slider-${index}`)?.closest(".slider").classList.add("lit");
    }
    pane.viewer.set_dirty();
  });
}
