// While the tool is held: a pale ring about each joint, or around each leg, that is near an end of its
// range; an arc from one end to the other, and a ball where it stands.

import { hues } from "./dom.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { align, shape } from "./shapes.js";

// A coordinate is near its end within this share of its range, and an angle within this (rad).
const NEAR_END = 0.1;
const NEAR_ANGLE = Math.PI / 12;

/** Returns what shows the rings of a held tool: called with whether it is held, and with the names of what stops it. */
export function limitRings(store, world, size) {
  const { THREE } = MeshCat;
  let rings = new Map(); // by joint of the tree, or by leg

  const part = (...names) => store.pane.part("mechanism", ...names);

  function made(range) {
    const ring = new THREE.Group();
    for (const geometry of [new THREE.TorusGeometry(0.62, 0.028, 8, 64, Math.min(range, 2 * Math.PI)),
      new THREE.SphereGeometry(0.075, 14, 10).translate(0.62, 0, 0)]) ring.add(shape(geometry, hues("negative")[0],
      { through: true, order: 19 }));
    world.add(ring);
    return ring;
  }

  /** Where each limited coordinate stands: {key, x, lower, upper, angle, name, at, axis}. */
  function* limited() {
    const { mechanism } = store.hello;
    const { legs, result } = store.numbers;
    const seen = new Set();
    for (const [j, i] of mechanism.joints.entries()) {
      const { lower, upper, limited: has, is_length: isLength, name } = mechanism.coordinates[i];
      const at = has && !seen.has(i) && part(`joint ${j + 1}`);
      if (!at) continue;
      seen.add(i);
      yield { key: `joint ${j}`, x: result.q[i], lower, upper, angle: !isLength, name, at, axis: mechanism.axes[j],
        along: 0 };
    }
    for (const [i, { length, lower, upper }] of (legs ?? []).entries()) {
      const at = lower !== null && upper !== null && part("legs", `line ${i + 1}`, "rod");
      if (at) yield { key: `leg ${i}`, x: length, lower, upper, angle: false, name: `leg${i + 1}`, at, axis: [1, 0, 0],
        along: 0.5 };
    }
  }

  function place(held, stopped) {
    for (const ring of rings.values()) ring.visible = false;
    if (!held) return;
    for (const { key, x, lower, upper, angle, name, at, axis, along } of limited()) {
      const near = Math.min((upper - lower) * NEAR_END, angle ? NEAR_ANGLE : Infinity);
      const stops = stopped.includes(name) || Math.min(x - lower, upper - x) <= NEGLIGIBLE_DIFFERENCE;
      if (!stops && Math.min(x - lower, upper - x) > near) continue;
      if (!rings.has(key)) rings.set(key, made(angle ? upper - lower : 2 * Math.PI));
      const ring = rings.get(key);
      const [arc, ball] = ring.children;
      ring.visible = true;
      align(ring, at, [along, 0, 0], axis);
      // The joint's own frame turns with it: its lower end lies behind.
      arc.rotation.z = angle ? lower - x : 0;
      ball.visible = angle;
      for (const { material } of ring.children) material.opacity = stops ? 1 : 0.4;
      size(ring);
    }
  }

  store.on("hello", () => {
    for (const ring of rings.values()) world.remove(ring);
    rings = new Map();
  });
  return place;
}
