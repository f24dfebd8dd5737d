// How the mechanism gives under its load: an arrow from where it would rest to where it is, with the true way
// written at it, a slider for how much it is enlarged, and everything moving between the two.

import { button, el, hues, short, typeset } from "./dom.js";
import { pairsOf } from "./ghosts.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { ticking } from "./player.js";
import { both } from "./shapes.js";

// Time (s) of one way there and back.
const SWAY_TIME = 2.6;
// What hangs on the body, besides its frame M.
const HANGING = ["translation ellipsoid", "rotation ellipsoid", "wrench", "nodal", "centres", "held forces", "ball"];
// Height of the callout's letters where the picture is one unit away.
const LETTERS = 0.032;
// Ends of the slider: the true size, and so many times what is drawn by default.
const MOST = 10;
// Thickness of the arrow, and length of its head, over the mechanism's size.
const [SHAFT, HEAD] = [0.006, 0.045];

/** Places of M without the load and under it; null where nothing is drawn of it. */
function ends({ pane, legend }) {
  const found = [["rest", "M"], ["M"]].map((names) => pane.part(...names));
  return legend?.rest && found.every(Boolean) && pane.part("rest").visible ? found : null;
}

const matrix = (object) => new MeshCat.THREE.Matrix4().compose(object.position, object.quaternion, object.scale);

/** The same of the point, where a load moves it. */
function points(store) {
  if (!store.numbers?.moved || store.legend.rest?.mode !== null) return null;
  const found = ends(store)?.map((object) =>
    new MeshCat.THREE.Vector3(...store.shown.point).applyMatrix4(matrix(object)));
  return found && found[0].distanceTo(found[1]) >= NEGLIGIBLE_DIFFERENCE ? found : null;
}

/** In a store's picture an arrow along the way on which the load moves the point, with the answer at it. */
export function callOut(store, answer) {
  const [{ THREE }, { pane }] = [MeshCat, store];
  const arrow = new THREE.Group();
  const shaft = new THREE.CylinderGeometry(1, 1, 1, 14).translate(0, 0.5, 0);
  const head = new THREE.ConeGeometry(2.6, 1, 18).translate(0, 0.5, 0);
  const parts = [shaft, head].map((geometry) => {
    const part = new THREE.Group();
    part.add(...both(geometry, hues("deflection")[0], 0.85, 18));
    arrow.add(part);
    return part;
  });
  pane.before.push(() => {
    const found = points(store);
    const place = pane.at();
    if (arrow.parent !== place) place.add(arrow);
    arrow.visible = found !== null;
    if (!found) return pane.caption(["callout"], null);
    const [from, to] = found;
    const { size, per_length: per } = store.legend;
    pane.caption(["callout"], { text: answer(), at: from.clone().lerp(to, 0.5), height: LETTERS / per,
      hue: "deflection-letters" });
    const way = to.clone().sub(from);
    const length = way.length();
    const heads = Math.min(HEAD * size, 0.5 * length);
    parts[0].scale.set(SHAFT * size, Math.max(length - heads, NEGLIGIBLE_DIFFERENCE * size), SHAFT * size);
    parts[1].scale.set(SHAFT * size, heads, SHAFT * size);
    parts[1].position.set(0, length - heads, 0);
    arrow.position.copy(from);
    arrow.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
  });
}

/** A button that plays it, and the line with the factor. */
export function give(store, answer) {
  callOut(store, answer);
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const node = button("▶ Show it move", () => toggle(), { class: "quiet", hidden: true, "aria-pressed": "false",
    title: "From where it rests without the load to where it is under it, and back; or the swing of a mode (v)" });
  const slider = el("input", { type: "range", min: 0, max: 1, step: 0.01,
    "aria-label": "How much the motion is enlarged",
    oninput: () => store.change({ enlarged: Number((most() ** slider.valueAsNumber).toPrecision(2)) }) });
  const auto = button("auto", () => store.change({ enlarged: null }), { class: "quiet",
    title: "Drawn as about a tenth of the mechanism's size" });
  const words = el("span.num");
  const line = el("div.row.enlarged", { hidden: true }, words, slider, auto);
  /** @type {any} */
  let playing = null;
  let usual = 1; // the factor that is taken by default

  const most = () => Math.max(MOST * usual, MOST);

  function start() {
    const found = ends(store);
    if (!found) return;
    const [from, to] = found;
    const parts = [...pairsOf(store.pane, "rest"), [from, to]].map(([rest, object]) => ({ rest, object,
      position: object.position.clone(), quaternion: object.quaternion.clone(), scale: object.scale.clone() }));
    const back = matrix(to).invert();
    playing = {};
    store.isPlaying = true;
    node.textContent = "◼ Stop";
    node.setAttribute("aria-pressed", "true");
    /** All between the rest (1) and where it is (0). */
    playing.put = (share) => {
      for (const { rest, object, position, quaternion, scale } of parts) {
        object.position.lerpVectors(position, rest.position, share);
        object.quaternion.slerpQuaternions(quaternion, rest.quaternion, share);
        object.scale.lerpVectors(scale, rest.scale, share);
      }
      const carried = matrix(to).multiply(back);
      for (const name of HANGING) {
        const object = store.pane.part(name);
        if (object) carried.decompose(object.position, object.quaternion, object.scale);
      }
      store.pane.viewer.set_dirty();
    };
    // A load's way goes one way and back; a mode swings to either side.
    const { mode } = store.legend.rest;
    const share = (turn) => (mode === null ? 0.5 + 0.5 * Math.cos(turn) : Math.sin(turn));
    playing.halt = ticking((now) => playing?.put(share((2 * Math.PI * now) / SWAY_TIME)));
  }

  function stop() {
    if (!playing) return;
    playing.halt();
    playing.put(0);
    playing = null;
    store.isPlaying = false;
    node.textContent = "▶ Show it move";
    node.setAttribute("aria-pressed", "false");
  }

  const toggle = () => {
    if (playing) stop();
    else if (!still.matches) start();
  };

  store.on("state", stop);
  store.on("numbers", () => {
    stop();
    const enlarged = store.legend?.rest?.enlarged ?? null;
    line.hidden = enlarged === null || store.legend.rest.mode !== null;
    node.hidden = enlarged === null || still.matches;
    if (line.hidden) return;
    const { enlarged: wanted } = store.shown;
    if (wanted === null) usual = enlarged;
    words.textContent = typeset(`drawn ${short(enlarged, 3)} times as far`);
    slider.value = Math.log(enlarged) / Math.log(most());
    slider.setAttribute("aria-valuetext", `${short(enlarged, 3)} times`);
    auto.disabled = wanted === null;
  });
  return { node, line, toggle };
}
