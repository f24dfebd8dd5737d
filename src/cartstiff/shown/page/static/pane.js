// The picture: meshcat's viewer in a pane of ours.

import { byId, clamp, hues, typeset } from "./dom.js";
import { haunt, sharpen } from "./ghosts.js";
import { arrange } from "./labels.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";

// Time (ms) without a picture after which the next is not left to wait for the screen's turn.
const REST = 250;
// How long (ms) a picture is kept back for one that is wanted more.
const PATIENCE = 500;
// Directions from the mechanism to the camera.
const DIRECTIONS = { iso: [1, -1.05, 0.75], front: [1, 0, 0.12], side: [0, -1, 0.12], top: [0, -1e-3, 1] };
// Turn of the camera (rad) and share of its distance for a key, and of what is left beside its poles.
const TURN = Math.PI / 36;
const ZOOM = 1.1;
const POLE = 0.02;
// How far an arrow key with Shift moves the eye, over its distance.
const ASIDE = 0.04;
const WAYS = { ArrowLeft: [TURN, 0], ArrowRight: [-TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN], "+": ZOOM,
  "=": ZOOM, "-": 1 / ZOOM };
// Change of the distance, and of the place looked at over it, up to which a view stays.
const STAYS = 0.2;
// Distance of frames below which they have one label, over the mechanism's size.
const COINCIDE = 0.02;
// First byte of a command in JSON.
const BRACE = 0x7b;
// Distance of the camera over that at which the sphere around everything just fits.
const FILLED = 0.95;
// Share of the free picture within which all corners of what is framed lie.
const ROOM = 0.94;
// Height (dots) of a picture in which labels are as large as the scene says.
const USUAL_HEIGHT = 720;
// Share of their height there that labels keep in the lowest pictures.
const LEGIBLE = 0.6;
// Boxes of words over the picture.
const OVER = ["cameras", "show", "legend", "colour-bar"];

export class Pane {
  /** A picture in a node; the ids are those of boxes over it, a legend among them. */
  constructor(node = byId("pane"), over = OVER) {
    this.node = node;
    this.over = over;
    this.viewer = new MeshCat.Viewer(this.node);
    this.node.addEventListener("keydown", (event) => this.turn(event));
    // The viewer takes the window's height for its own; the pane has another.
    const sized = this.viewer.set_3d_pane_size.bind(this.viewer);
    this.viewer.set_3d_pane_size = () => {
      const { clientWidth: width, clientHeight: height } = this.node;
      if (width > 0 && height > 0) sized(width, height);
      this.center();
    };
    window.onload = null;
    this.viewer.gui.domElement.style.display = "none";
    this.covered = this.above = 0; // by the legend, and by buttons
    this.extent = 1; // size of the mechanism
    this.boxes = []; // what stands over the picture, as labels are kept
    this.framed = null; // the last view that was framed
    this.lit = null;
    this.every = false;
    this.holding = false; // whether a handle is being dragged
    // Asking for a size after a change has the whole page laid out, each picture: it is kept instead.
    this.size = [this.node.clientWidth, this.node.clientHeight];
    new ResizeObserver(() => {
      this.size = [this.node.clientWidth, this.node.clientHeight];
      this.viewer.set_3d_pane_size();
      this.rewrite();
    }).observe(this.node);
    new MutationObserver(() => this.rewrite()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
    const covering = new ResizeObserver(() => this.center());
    for (const id of over) covering.observe(byId(id));
    this.viewer.set_3d_pane_size();
    this.after = [];
    const render = this.viewer.render.bind(this.viewer);
    this.rendered = 0;
    this.waiting = 0; // until when no picture is drawn
    this.before = []; // called before each picture
    this.viewer.render = () => {
      if (performance.now() < this.waiting) return; // the viewer asks again
      haunt(this);
      sharpen(this);
      this.frames();
      for (const callback of this.before) callback();
      arrange(this.viewer.scene, this.viewer.camera, (freedom) => this.every || this.lit === freedom, this.boxes);
      render();
      this.rendered = performance.now();
      for (const callback of this.after.splice(0)) callback();
    };
  }

  /** The view by keyboard. */
  turn(event) {
    const wish = WAYS[event.key];
    if (!wish || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    const { THREE } = MeshCat;
    const { camera, controls } = this.viewer;
    const way = new THREE.Spherical().setFromVector3(camera.position.clone().sub(controls.target));
    if (Array.isArray(wish) && event.shiftKey) { // across the line of sight
      controls.target.add(new THREE.Vector3(-wish[0], wish[1], 0).multiplyScalar(way.radius * ASIDE / TURN)
        .applyQuaternion(camera.quaternion));
    } else if (Array.isArray(wish)) {
      way.theta += wish[0];
      way.phi = clamp(way.phi + wish[1], POLE, Math.PI - POLE);
    } else way.radius /= wish;
    this.stand(new THREE.Vector3().setFromSpherical(way).add(controls.target));
  }

  /** Stand at a place, and look at another. */
  stand(eye, aim = this.viewer.controls.target) {
    const { camera, controls } = this.viewer;
    camera.position.copy(eye);
    controls.target.copy(aim);
    controls.update();
    this.viewer.set_dirty();
  }

  /** Where a pointer is in the picture, from -1 to 1. */
  place(event) {
    const box = this.viewer.renderer.domElement.getBoundingClientRect();
    return [2 * (event.clientX - box.left) / box.width - 1, 1 - 2 * (event.clientY - box.top) / box.height];
  }

  /** From the eye through a pointer. */
  ray(event) {
    const [x, y] = this.place(event);
    const ray = new MeshCat.THREE.Raycaster();
    ray.setFromCamera({ x, y }, this.viewer.camera);
    return ray;
  }

  /** Write all values of an ellipsoid ("translation", "rotation"), or of none. */
  light(freedom) {
    if (this.lit === freedom) return;
    this.lit = freedom;
    this.viewer.set_dirty();
  }

  /** Put the middle of the picture into the middle of what legend and buttons leave free. */
  center() {
    const { clientWidth: width, clientHeight: height } = this.node;
    // Never back, and not under a hand: a legend that comes and goes does not shake the picture.
    if (this.over.includes("legend") && !this.holding) this.covered = Math.max(this.covered,
      byId("legend").offsetHeight);
    if (this.over.includes("cameras")) this.above = byId("cameras").offsetTop + byId("cameras").offsetHeight;
    this.viewer.camera.setViewOffset(width, height, 0, (this.covered - this.above) / 2, width, height);
    this.boxes = this.over.map((id) => box(byId(id), width, height));
    // A view that nobody has turned is framed anew for another shape of the pane.
    this.frameAnew(this.framed?.bounds);
    this.viewer.set_dirty();
  }

  apply(commands, then) {
    for (const command of commands) {
      if (command instanceof Uint8Array && command[0] !== BRACE) this.viewer.handle_command_bytearray(command);
      else {
        const plain = command instanceof Uint8Array ? JSON.parse(new TextDecoder().decode(command)) : command;
        if (plain.type === "label") this.write(plain);
        else this.viewer.handle_command(plain);
      }
    }
    if (then) {
      this.waiting = 0;
      this.after.push(then);
      // After a rest at once; while pictures follow each other at the pace of the screen.
      if (performance.now() - this.rendered > REST) this.viewer.render();
      else this.viewer.set_dirty();
    }
  }

  /** Draw nothing until the next answer, for a while: a first picture takes long, and so would two. */
  wait() {
    this.waiting = performance.now() + PATIENCE;
  }

  /** A node of the tree below the mechanism's place, if there is one. */
  branch(...names) {
    return ["meshcat", "cartstiff", ...names].reduce((node, name) => node?.children[name], this.viewer.scene_tree);
  }

  /** What is drawn there. */
  part(...names) {
    return this.branch(...names)?.object;
  }

  /** The same, where it may still be empty. */
  at(...names) {
    return this.viewer.scene_tree.find(["meshcat", "cartstiff", ...names]).object;
  }

  /** Put a line of text into the picture, facing the viewer. */
  write(label) {
    const { Sprite, SpriteMaterial, CanvasTexture, LinearFilter } = MeshCat.THREE;
    const path = namesOf(label.path);
    let sprite = this.viewer.scene_tree.find([...path, "<object>"]).object;
    if (sprite.userData.canvas) {
      penned(sprite.userData.canvas, label);
      sprite.material.map.dispose(); // of another size
    } else {
      const canvas = penned(document.createElement("canvas"), label);
      const map = new CanvasTexture(canvas);
      map.minFilter = LinearFilter;
      sprite = new Sprite(new SpriteMaterial({ map, transparent: true, depthTest: false, sizeAttenuation: false }));
      sprite.renderOrder = 30; // over the handles
      sprite.userData.canvas = canvas;
      this.viewer.set_object(path, sprite);
    }
    sprite.userData.label = label;
    const { width, height } = sprite.userData.canvas;
    const tall = label.height * this.lettering;
    sprite.scale.set((tall * width) / height, tall, 1);
    sprite.material.map.needsUpdate = true;
    this.viewer.set_dirty();
  }

  /** Words at a place, {text, at, height} with the table of their colours for light and dark; null for none. */
  caption(names, words) {
    const found = this.part(...names);
    if (found) found.visible = words !== null;
    if (!words) return;
    const { text, at, height, hue } = words;
    const numbers = (name) => [0, -1].map((k) => Number(`0x${hues(name).at(k).slice(1)}`));
    if (text !== found?.children[0]?.userData.label?.text) this.write({ path: `/meshcat/cartstiff/${names.join("/")}`,
      text, letters: numbers(hue), paper: numbers("label-paper"), height });
    this.part(...names).position.copy(at);
  }

  /** Label frames that coincide once. */
  frames() {
    const [F, M] = ["F", "M"].map((name) => this.part(name));
    const [one, other] = ["F", "M"].map((name) => this.part(name, "name"));
    const label = one?.children[0]?.userData.label;
    if (!label || !other) return;
    const isOne = F.position.distanceTo(M.position) < this.extent * COINCIDE;
    const text = isOne ? "F, M" : "F";
    if (label.text !== text) this.write({ ...label, text });
    if (isOne) other.visible = false;
    else if (one.visible) other.visible = true;
  }

  /** How much larger labels are than in a picture of the usual height: in a low one they stay legible. */
  get lettering() {
    const times = USUAL_HEIGHT / Math.max(1, this.size[1]);
    return Math.max(Math.sqrt(times), LEGIBLE * times);
  }

  /** Write every label in the colours of the theme. */
  rewrite() {
    this.viewer.scene.traverse((node) => { if (node.userData.label) this.write(node.userData.label); });
  }

  /** A new picture; seen from where the last one was, or from the preset of a first one. */
  reset(commands, bounds) {
    const { camera, controls } = this.viewer;
    const before = [camera.position.clone(), controls.target.clone()];
    this.viewer.handle_command({ type: "delete", path: "/meshcat" });
    this.apply(commands);
    if (this.framed) return this.stand(...before);
    this.look("iso", bounds);
    this.first = String(this.view);
  }

  /** Look from a preset, or with "fit" from the present side, so that all between two corners is seen. */
  look(preset, bounds) {
    const [low, high] = bounds;
    const { camera, controls } = this.viewer;
    const { clientWidth: width, clientHeight: height } = this.node;
    // The viewer's camera lives in a frame with y up.
    const up = ([x, y, z]) => [x, z, -y];
    const middle = controls.target.clone().set(...up(low.map((x, i) => (x + high[i]) / 2)));
    const direction = preset === "fit" ? camera.position.clone().sub(controls.target)
      : camera.position.clone().set(...up(DIRECTIONS[preset]));
    const free = Math.max(0.3, (height - this.covered - this.above) / Math.max(1, height));
    const half = Math.tan((camera.fov * Math.PI) / 360) * Math.min(free, width / Math.max(1, height));
    const radius = Math.max(NEGLIGIBLE_DIFFERENCE, Math.hypot(...low.map((x, i) => high[i] - x)) / 2);
    const tangent = Math.tan((camera.fov * Math.PI) / 360);
    const sizes = [(tangent * width) / Math.max(1, height), tangent * free];
    const far = Math.max((FILLED * radius) / Math.sin(Math.atan(half)),
      farEnough(direction.normalize(), bounds, sizes.map((size) => ROOM * size), up));
    this.stand(direction.multiplyScalar(far).add(middle), middle);
    this.framed = { preset, bounds, view: String(this.view) };
  }

  /** Look at other bounds from the present side where some of them would not be seen, or where they look small. */
  keepInView(bounds) {
    const { camera, controls } = this.viewer;
    const [eye, aim, framed] = [camera.position.clone(), controls.target.clone(), this.framed];
    this.look("fit", bounds);
    const there = camera.position.distanceTo(controls.target);
    const isFar = Math.abs(Math.log(there / eye.distanceTo(aim))) > STAYS;
    if (isFar || controls.target.distanceTo(aim) > STAYS * there) return;
    this.stand(eye, aim);
    this.framed = framed;
  }

  /** Where the camera is and what it looks at: six numbers. */
  get view() {
    const { camera, controls } = this.viewer;
    return [...camera.position.toArray(), ...controls.target.toArray()].map((x) => Number(x.toFixed(4)));
  }

  set view(numbers) {
    this.stand(...[0, 3].map((k) => new MeshCat.THREE.Vector3().fromArray(numbers, k)));
  }

  /** Look as another picture does, in units that are so many times its own. */
  seeAs({ viewer: { camera: eye, controls: aim } }, times) {
    const { camera, controls } = this.viewer;
    const wished = [eye.position, aim.target].map((one) => one.clone().multiplyScalar(times));
    if (!camera.position.equals(wished[0]) || !controls.target.equals(wished[1])) this.stand(...wished);
  }

  /** The picture on a canvas, so many times as fine; without a ground on request. */
  image(times = 1, isClear = false) {
    const { renderer, scene } = this.viewer;
    const { background } = scene;
    if (isClear) scene.background = null;
    const before = renderer.getPixelRatio();
    const canvas = document.createElement("canvas");
    this.waiting = 0;
    renderer.setPixelRatio(times);
    this.viewer.render();
    [canvas.width, canvas.height] = [renderer.domElement.width, renderer.domElement.height];
    canvas.getContext("2d").drawImage(renderer.domElement, 0, 0);
    renderer.setPixelRatio(before);
    scene.background = background;
    this.viewer.set_dirty();
    return canvas;
  }

  /** Dots on the screen that a unit of the viewer takes where M is. */
  get dotsPerUnit() {
    const { camera } = this.viewer;
    const object = this.at("M");
    object.updateWorldMatrix(true, false);
    camera.updateMatrixWorld();
    const depth = -camera.position.clone()
      .setFromMatrixPosition(object.matrixWorld).applyMatrix4(camera.matrixWorldInverse).z;
    return depth > 0 ? this.size[1] / (2 * Math.tan((camera.fov * Math.PI) / 360) * depth) : 0;
  }

  /** Frame other bounds from the present preset, unless somebody has turned the view. */
  frameAnew(bounds) {
    if (!this.framed || String(this.view) !== this.framed.view) return;
    const first = this.first === this.framed.view;
    this.look(this.framed.preset, bounds);
    if (first) this.first = String(this.view);
  }
}

/**
 * From how far, in a direction, every corner of a box is seen within tangents of the picture's half width and height.
 */
function farEnough(direction, [low, high], /** @type {number[]} */ [across, upright], up) {
  const right = direction.clone().cross({ x: 0, y: -1, z: 0 }).normalize();
  const over = direction.clone().cross(right);
  const half = low.map((x, i) => (high[i] - x) / 2);
  let far = 0;
  for (let k = 0; k < 8; k++) {
    const corner = direction.clone().set(...up(half.map((x, i) => (k >> i & 1 ? x : -x))));
    far = Math.max(far, corner.dot(direction) + Math.max(Math.abs(corner.dot(right)) / across,
      Math.abs(corner.dot(over)) / upright));
  }
  return far;
}

const namesOf = (path) => path.split("/").filter(Boolean);

/** Middle and half sizes of a node over the pane, which reaches from -1 to 1. */
function box({ offsetLeft, offsetTop, offsetWidth, offsetHeight }, width, height) {
  return { x: (2 * offsetLeft + offsetWidth) / width - 1, y: 1 - (2 * offsetTop + offsetHeight) / height,
    width: offsetWidth / width, height: offsetHeight / height };
}

/** A line of text on a canvas; colours are numbers, for light and dark. */
function penned(canvas, { text: said, letters, paper }) {
  const text = typeset(said);
  const theme = Number(document.documentElement.dataset.theme === "dark");
  const pen = canvas.getContext("2d");
  const font = "26px system-ui, sans-serif";
  const colour = (number, alpha) => `rgb(${number >> 16 & 255} ${number >> 8 & 255} ${number & 255} / ${alpha})`;
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(text).width) + 12;
  canvas.height = 38;
  pen.fillStyle = colour(paper[theme], 0.72);
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.font = font;
  pen.fillStyle = colour(letters[theme], 1);
  pen.fillText(text, 6, 28);
  return canvas;
}
