// Hands in the picture: handles at the tool and at the load's arrows.

import { motion, moving, place, product, rotation, times, transposed } from "./algebra.js";
import { byId, chop, engineering, hues, short, tipIn, tuple } from "./dom.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { limitRings } from "./rings.js";
import { shape, worldOf } from "./shapes.js";

// Length of the handles' arms on the screen (dots), and how near (dots) a pointer brings them out.
const ARM = 84;
const NEAR_HAND = 120;
// Sine of the angle between a ring's plane and the line of sight below which it is turned as seen.
const EDGE_ON = 0.2;
// An arrow's head that is pulled within this distance (dots) of a line stays on it.
const SNAP = 12;
const AXIS_NAMES = ["x", "y", "z"];
// Colours of a handle: free, and held back by a limit.
const [FREE, STOPPED] = [0x0b5cad, 0xb3261e];
// Without a moment, half a turn of its ring gives the force (or this one) at this share of the size.
const FIRST_FORCE = 100;
const LEVER = 0.1;
// What is held of the tool, and of the load.
const TOOL = ["ball", "arm", "ring"];
const LOAD = ["force", "moment", "twirl"];

export function hands(store) {
  const { pane } = store;
  const { viewer } = pane;
  const { THREE } = MeshCat;
  const vector = (...xyz) => new THREE.Vector3(...xyz);
  const node = (...names) => pane.at(...names);
  const world = worldOf(pane);
  const [tool, arms] = [new THREE.Group(), new THREE.Group()];
  tool.add(arms);
  world.add(tool);
  const tip = tipIn(byId("stage"), "overlay", [18, 18]);
  let near = false;
  let pinned = false;
  let hold = null;

  // -- what can be taken hold of

  const grips = [];

  /** What is seen. */
  function add(parent, geometry, colour = /** @type {any} */ (FREE)) {
    const mesh = shape(geometry, colour, { opacity: 0.9, through: true, order: 20 });
    parent.add(mesh);
    return mesh;
  }

  /** What is taken hold of: larger, and not seen. */
  function grip(parent, geometry, kind, axis) {
    const mesh = add(parent, geometry);
    mesh.material.visible = false;
    grips.push({ mesh, kind, axis });
  }

  const { SphereGeometry: Sphere, CylinderGeometry: Cylinder, TorusGeometry: Torus } = THREE;
  const ball = add(tool, new Sphere(0.085, 20, 14));
  grip(tool, new Sphere(0.15, 12, 8), "ball");
  hues("axes").forEach((colour, i) => {
    const arm = new THREE.Group(); // along its own y
    arm.quaternion.setFromUnitVectors(vector(0, 1, 0), vector(i === 0, i === 1, i === 2));
    arms.add(arm);
    add(arm, new Cylinder(0.016, 0.016, 0.5, 10).translate(0, 0.5, 0), colour);
    add(arm, new THREE.ConeGeometry(0.06, 0.18, 16).translate(0, 0.84, 0), colour);
    add(arm, new Torus(0.66, 0.013, 8, 60).rotateX(Math.PI / 2), colour);
    grip(arm, new Cylinder(0.07, 0.07, 0.75, 8).translate(0, 0.58, 0), "arm", i);
    grip(arm, new Torus(0.66, 0.06, 6, 40).rotateX(Math.PI / 2), "ring", i);
  });
  const pulls = ["force", "moment"].map((kind) => {
    const pull = new THREE.Group();
    world.add(pull);
    add(pull, new Sphere(0.07, 16, 12));
    grip(pull, new Sphere(0.14, 10, 8), kind);
    return pull;
  });
  // The moment's ring: turned about its own line, the moment grows or shrinks.
  const twirl = new THREE.Group();
  world.add(twirl);
  add(twirl, new Torus(0.46, 0.02, 8, 60));
  add(twirl, new Sphere(0.07, 16, 12).translate(0.46, 0, 0));
  grip(twirl, new Torus(0.46, 0.07, 6, 40), "twirl");
  const rings = limitRings(store, world, size);

  // -- where the handles are

  const arrow = (kind) => node("wrench", kind, "arrow");
  const shown = (object) => {
    for (let at = object; at; at = at.parent) if (!at.visible) return false;
    return true;
  };

  function size(group) {
    const { camera } = viewer;
    const away = group.position.distanceTo(vector().setFromMatrixPosition(camera.matrixWorld));
    group.scale.setScalar(Math.max(NEGLIGIBLE_DIFFERENCE,
      (ARM * 2 * away * Math.tan((camera.fov * Math.PI) / 360)) / Math.max(1, pane.size[1])));
  }

  function update() {
    const live = store.source.moves && store.numbers !== null && !store.isPlaying;
    tool.visible = live;
    if (live) {
      const M = node("M");
      M.updateWorldMatrix(true, false);
      M.matrixWorld.decompose(tool.position, tool.quaternion, vector());
      if (store.state.axes === "world") node().getWorldQuaternion(tool.quaternion);
      size(tool);
      arms.visible = near || pinned || TOOL.includes(hold?.kind);
    }
    rings(live && TOOL.includes(hold?.kind), hold?.names ?? []);
    twirl.visible = live && store.state.load !== null && store.state.wrench && Boolean(store.numbers.wrench)
      && (near || pinned || hold?.kind === "twirl");
    if (twirl.visible) {
      twirl.position.setFromMatrixPosition(reference());
      twirl.quaternion.setFromUnitVectors(vector(0, 0, 1), hold?.kind === "twirl" ? hold.along : line());
      if (hold?.kind === "twirl") twirl.rotateZ(hold.angle - hold.from);
      size(twirl);
    }
    ["force", "moment"].forEach((kind, i) => {
      const vectorOf = arrow(kind);
      const given = live && store.state.load !== null && store.state.wrench && vectorOf.children.length > 0
        && shown(vectorOf);
      pulls[i].visible = Boolean(given) && (near || pinned || hold?.kind === kind);
      if (!given) return;
      if (hold?.kind === kind) pulls[i].position.copy(hold.at);
      else {
        vectorOf.updateWorldMatrix(true, false);
        pulls[i].position.copy(vector(1, 0, 0).applyMatrix4(vectorOf.matrixWorld));
      }
      size(pulls[i]);
    });
  }
  pane.before.push(update);

  /** The frame of the shown wrench, in the world. */
  function reference() {
    const M = node("M").matrixWorld.clone();
    const { frame } = store.numbers;
    return frame ? M.multiply(new THREE.Matrix4().set(...frame.flat())) : M;
  }

  /** The line of the moment; of the force where there is no moment, and upwards where there is neither. */
  function line() {
    const { wrench } = store.numbers;
    const found = [wrench.slice(0, 3), wrench.slice(3)].find((v) =>
      Math.hypot(...v) > NEGLIGIBLE_DIFFERENCE * Math.hypot(...wrench));
    const axes = found ? reference() : node().matrixWorld;
    return vector(...(found ?? [0, 0, 1])).transformDirection(axes);
  }

  // -- taking hold

  function gripAt(event) {
    const ray = pane.ray(event);
    const found = grips.filter(({ mesh }) => shown(mesh)).flatMap((grip) =>
      ray.intersectObject(grip.mesh, false).map(({ distance }) => ({ ...grip, distance })));
    // A ball in the middle is meant before a ring behind which it lies.
    const order = { force: 0, moment: 0, ball: 1, arm: 2, twirl: 3, ring: 4 };
    return found.sort((a, b) => order[a.kind] - order[b.kind] || a.distance - b.distance)[0] ?? null;
  }

  /** How far (dots) a pointer is from a point, on the screen. */
  function distance(event, point = tool.position) {
    const p = point.clone().project(viewer.camera);
    const [x, y] = pane.place(event);
    return Math.hypot((p.x - x) * pane.size[0], (p.y - y) * pane.size[1]) / 2;
  }

  const sight = () => vector().setFromMatrixColumn(viewer.camera.matrixWorld, 2);
  const onPlane = ({ ray }, point, normal) =>
    ray.intersectPlane(new THREE.Plane().setFromNormalAndCoplanarPoint(normal, point), vector());

  /** Along a line through `o` with direction `a`, where a ray passes it. */
  function onLine({ ray }, o, a) {
    const w = ray.origin.clone().sub(o);
    const b = a.dot(ray.direction);
    return Math.abs(1 - b * b) < NEGLIGIBLE_DIFFERENCE ? 0 : (a.dot(w) - b * ray.direction.dot(w)) / (1 - b * b);
  }

  function angleIn(point, origin, axis) {
    const u = vector(1, 0, 0);
    if (Math.abs(axis.x) > 0.8) u.set(0, 1, 0);
    u.cross(axis).normalize();
    const d = point.clone().sub(origin);
    return Math.atan2(d.dot(axis.clone().cross(u)), d.dot(u));
  }

  function begin(event, grip) {
    const { kind, axis } = grip;
    const origin = ({ force: pulls[0], moment: pulls[1], twirl }[kind] ?? tool).position.clone();
    const wrench = store.numbers.wrench ?? [];
    const vectorOf = kind === "force" ? wrench.slice(3) : wrench.slice(0, 3);
    hold = { ...grip, pointer: event.pointerId, origin, at: origin.clone(), toF: node().matrixWorld.clone().invert(),
      normal: sight(), moved: false, pose: store.numbers.result.pose.map((row) => row.slice()),
      state: structuredClone(store.state), base: vector().setFromMatrixPosition(reference()), vector: vectorOf,
      size: Math.hypot(...vectorOf) };
    hold.per = hold.size / toRoom(origin.clone().sub(hold.base)).length();
    if (axis !== undefined) hold.along = vector(axis === 0, axis === 1, axis === 2).applyQuaternion(tool.quaternion);
    if (kind === "twirl") {
      const first = (Math.hypot(...wrench.slice(3)) || FIRST_FORCE) * store.hello.mechanism.size * LEVER;
      hold.along = line();
      hold.direction = toRoom(line()).normalize();
      hold.half = hold.size > NEGLIGIBLE_DIFFERENCE * first ? hold.size : first;
    }
    const edge = kind === "arm" ? 1 : hold.along?.dot(hold.normal);
    if (Math.abs(edge) < EDGE_ON) hold.along = hold.normal.clone().multiplyScalar(Math.sign(edge) || 1);
    hold.angle = hold.from = meet(event);
    pane.holding = true;
    viewer.controls.enabled = false;
    pane.node.setPointerCapture(event.pointerId);
    store.remember(`hand ${Date.now()}`);
  }

  const toRoom = (way) => way.applyMatrix3(new THREE.Matrix3().setFromMatrix4(hold.toF));

  /** Where a pointer meets what is held: how far along an arm, at what angle of a ring, a ball at which point. */
  function meet(event) {
    const { kind, origin, along, normal } = hold;
    const ray = pane.ray(event);
    if (kind === "arm") return onLine(ray, origin, along);
    if (!along) return onPlane(ray, origin, normal);
    const point = onPlane(ray, origin, along);
    return point && angleIn(point, origin, along);
  }

  function drag(event) {
    hold.moved = true;
    const met = meet(event);
    if (met === null || hold.from === null) return;
    DRAGGED[hold.kind](met, event);
    say(event);
  }

  const DRAGGED = {
    ball: (point) => shift(point.sub(hold.from)),
    arm: (x) => shift(hold.along.clone().multiplyScalar(x - hold.from)),
    ring: (angle, event) => turn(angle - hold.from, event),
    twirl: (angle, event) => {
      // Further round than half a turn goes on.
      const step = angle - hold.angle;
      hold.angle += step - 2 * Math.PI * Math.round(step / (2 * Math.PI));
      const size = hold.size + (hold.half * (hold.angle - hold.from)) / Math.PI;
      load(hold.direction.clone().multiplyScalar(size).toArray(), event);
    },
    force: pull,
    moment: pull,
  };

  function shift(way) {
    const d = toRoom(way).toArray();
    store.reach({ towards: { pose: motion(rotation(hold.pose), place(hold.pose).map((x, i) => x + d[i])),
      turning: false } });
  }

  function turn(angle, event) {
    const steps = event.shiftKey ? Math.PI / 36 : 0; // five degrees
    const by = steps ? Math.round(angle / steps) * steps : angle;
    const axis = toRoom(hold.along.clone()).normalize();
    const R = rotation(moving([...axis.multiplyScalar(by).toArray(), 0, 0, 0]));
    store.reach({ towards: { pose: motion(product(R, rotation(hold.pose)), place(hold.pose)), turning: true } });
  }

  /** Force or moment by its arrow's head: direction and size, along its line or an axis where the hand passes one. */
  function pull(point, event) {
    const head = (event.altKey ? null : onGuide(event)) ?? hold.origin.clone().add(point.sub(hold.from));
    hold.at.copy(head);
    load(toRoom(head.sub(hold.base)).multiplyScalar(hold.per).toArray(), event);
  }

  /** The load with another force or moment, given along the room's axes. */
  function load(room, event) {
    const { state } = hold;
    const R = rotation(hold.pose);
    const toBody = (v) => times(transposed(R), v);
    const toF = (v) => times(R, v);
    const own = state.load_axes === "body";
    let found = own ? toBody(room) : room;
    if (!event.altKey) found = rounded(found);
    // The arrows are along the axes of the numbers; a change is the same along any axes.
    const before = state.axes === "body" ? (own ? hold.vector : toF(hold.vector)) : own ? toBody(hold.vector)
      : hold.vector;
    const wanted = state.load.slice();
    const kind = hold.kind === "force" ? "force" : "moment";
    const first = hold.kind === "force" ? 3 : 0;
    const part = kind === "force" ? found : chop(found.map((x, i) => wanted[i] + x - before[i]),
      Math.max(...before.map(Math.abs)));
    wanted.splice(first, 3, ...part.map((x) => Number(x.toPrecision(12))));
    hold.words = `${engineering(Math.hypot(...found), store.unit(kind))} ${tuple(found)} ${own ? "tool" : "room"} axes`;
    store.change({ load: wanted });
  }

  /** The point under a pointer on the arrow's own line or on an axis, if it passes one. */
  function onGuide(event) {
    const ray = pane.ray(event);
    const turned = hold.state.load_axes === "body" ? new THREE.Quaternion()
      .setFromRotationMatrix(new THREE.Matrix4().extractRotation(node("M").matrixWorld))
      : node().getWorldQuaternion(new THREE.Quaternion());
    const axes = [0, 1, 2].flatMap((i) => [1, -1].map((side) => vector(...[0, 1, 2].map((k) => (k === i ? side : 0)))
        .applyQuaternion(turned)));
    for (const direction of [hold.origin.clone().sub(hold.base).normalize(), ...axes]) {
      const along = onLine(ray, hold.base, direction);
      const point = hold.base.clone().addScaledVector(direction, along);
      if (along > 0 && distance(event, point) < SNAP) return point;
    }
    return null;
  }

  /** Two digits of the size; what is rounding beside it is zero. */
  function rounded(v) {
    const length = Math.hypot(...v);
    if (!length) return v;
    const digit = 10 ** (Math.floor(Math.log10(length)) - 1);
    return chop(v.map((x) => (x * Math.round(length / digit) * digit) / length)).map((x) => Number(x.toPrecision(12)));
  }

  function end() {
    pane.holding = false;
    viewer.controls.enabled = true;
    tip.say(null);
    if (hold.kind === "ball" && !hold.moved) pin(!pinned);
    hold = null;
    feel(null);
    pane.center();
  }

  pane.node.addEventListener("pointerdown", (event) => {
    if (!store.source.moves || !store.numbers || hold || event.button !== 0) return;
    const grip = gripAt(event);
    if (!grip) return;
    begin(event, grip);
    say(event);
  }, true);
  pane.node.addEventListener("pointermove", (event) => {
    if (hold) {
      if (event.pointerId === hold.pointer) drag(event);
      return;
    }
    if (event.buttons || !tool.visible) return;
    const close = distance(event) < NEAR_HAND;
    pane.node.style.cursor = close && gripAt(event) ? "grab" : "";
    bringOut(close);
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
    pane.node.addEventListener(name, (event) => hold && event.pointerId === hold.pointer && end());
  }
  pane.node.addEventListener("pointerleave", () => { if (!hold) bringOut(false); });

  /** Show the handles' arms, or no longer. */
  function bringOut(is) {
    if (near !== is) viewer.set_dirty();
    near = is;
  }

  // -- what the hand feels

  function say(event) {
    if (event) hold.last = event;
    const length = store.unit("length");
    const p = store.numbers.position.map((x) => short(x, 4)).join(", ");
    const said = { ball: p, arm: `${AXIS_NAMES[hold.axis]}: ${p}`, ring: `about ${AXIS_NAMES[hold.axis]}` }[hold.kind];
    const words = hold.kind === "ring" ? said : hold.words
      ?? (LOAD.includes(hold.kind) ? (hold.kind === "twirl" ? "turn: moment" : `pull: ${hold.kind}`)
        : `${said} ${length}`);
    tip.node.classList.toggle("stopped", Boolean(hold.stopped));
    tip.say(hold.stopped ? `${words} · ${hold.stopped}` : words, hold.last);
  }

  /** Limits that stop the hand: named beside it, their rows coloured, the ball red. */
  function feel(followed) {
    const stopped = followed && !followed.reached ? followed.stopped : [];
    const { coordinates } = store.hello.mechanism;
    coordinates.forEach(({ name }, i) => byId(`slider-${i}`)?.closest(".slider").classList.toggle("stopped",
      stopped.includes(name)));
    [...document.querySelectorAll(".leg:not(.leg-head)")].forEach((row, i) =>
      row.classList.toggle("stopped", stopped.includes(`leg${i + 1}`)));
    if (hold) hold.names = stopped;
    const away = followed && !followed.reached;
    ball.material.color.set(away ? STOPPED : FREE);
    if (!hold) return;
    hold.stopped = !away ? "" : stopped.length ? `${stopped.join(", ")} at ${stopped.length > 1 ? "their limits"
      : "its limit"}`
      : "out of reach";
    if (hold.last) say();
  }
  store.on("numbers", ({ followed }) => feel(followed ?? null));

  function pin(on) {
    pinned = on;
    viewer.set_dirty();
  }

  return { pinHandles: () => pin(!pinned) };
}
