// A ball about the point whose colours are the stiffness along each direction: point at it, or turn the view with the
// keys, and read it.

import { dot, rotation, times } from "./algebra.js";
import { byId, checkbox, clamp, el, engineering, plainly, rgbs, tipIn } from "./dom.js";
import { between } from "./drawing.js";
import { shape } from "./shapes.js";
import { directionWords } from "./words.js";

// Radius over the mechanism's size.
const BALL = 0.13;

/** Stiffness along a direction of M, a unit vector: that against a force along it, see `principal`. */
export const alongDirection = ({ values, axes }, direction) =>
  1 / axes.reduce((sum, axis, k) => sum + dot(axis, direction) ** 2 / values[k], 0);

/** A box that shows the ball, and what reads it. */
export function stiffnessBall(store) {
  const { THREE } = MeshCat;
  const { pane } = store;
  const geometry = new THREE.SphereGeometry(1, 48, 32);
  const mesh = shape(geometry, null, { opacity: 0.92 });
  const words = el("div.ball-words.num", { role: "status", hidden: true });
  byId("stage").append(words);
  const tip = tipIn(byId("stage"), "overlay", [14, 16]);
  const box = checkbox("Coloured ball", () => {
    update();
    pane.viewer.set_dirty();
  }, { title: "The stiffness along every direction; point at it to read it" });
  let found = null; // values in the units of stiffness, and axes in M

  /** Principal stiffnesses, of a compliance their reciprocals, with their ends. */
  function stiffnesses() {
    const { values: found = [0], axes } = store.numbers?.principal?.translation ?? {};
    if (!(found[0] > 0)) return null;
    const values = store.shown.quantity === "stiffness" ? found : found.map((x) => 1 / x);
    return { values, axes, low: Math.min(...values), high: Math.max(...values) };
  }

  const text = (k) => engineering(k, `${store.unit("force")}/${store.unit("length")}`, 3, store.sizes.translation);

  function update() {
    found = box.control.checked ? stiffnesses() : null;
    mesh.visible = found !== null;
    words.hidden = found === null;
    if (!found) return;
    const [low, high] = [found.low, found.high].map(Math.log);
    const { position } = geometry.attributes;
    const table = rgbs("sequential");
    const colours = new Float32Array(3 * position.count);
    for (let i = 0; i < position.count; i++) {
      const k = alongDirection(found, [position.getX(i), position.getY(i), position.getZ(i)]);
      const share = high > low ? (Math.log(k) - low) / (high - low) : 0.5;
      between(table, clamp(share, 0, 1)).forEach((c, j) => { colours[3 * i + j] = c / 255; });
    }
    geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  }

  pane.before.push(() => {
    if (!found || !store.legend) return;
    const ball = pane.at("ball");
    if (mesh.parent !== ball) ball.add(mesh);
    const M = pane.at("M");
    mesh.position.set(...store.shown.point).applyMatrix4(M.matrix);
    mesh.quaternion.copy(M.quaternion);
    mesh.scale.setScalar(BALL * store.legend.size);
    const eye = new THREE.Vector3().setFromMatrixPosition(pane.viewer.camera.matrixWorld);
    mesh.updateWorldMatrix(true, false);
    const away = mesh.worldToLocal(eye).normalize().toArray();
    words.textContent = `towards you: ${text(alongDirection(found, away))} (dark ${text(found.low)}, bright `
      + `${text(found.high)})`;
  });
  pane.node.addEventListener("pointermove", (event) => {
    if (!found || event.buttons) return tip.say(null);
    const [hit] = pane.ray(event).intersectObject(mesh, false);
    if (!hit) return tip.say(null);
    const direction = mesh.worldToLocal(hit.point.clone()).normalize().toArray();
    tip.say(`${text(alongDirection(found, direction))}, ${roomWords(direction)}`, event);
  });
  pane.node.addEventListener("pointerleave", () => tip.say(null));
  const roomWords = (direction) => plainly(directionWords(times(rotation(store.numbers.result.pose), direction), true,
    store.hello.mechanism.upright));
  store.on("numbers", update);
  return box;
}
