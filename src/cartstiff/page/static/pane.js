// The picture: meshcat's viewer in a pane of ours.

/* global MeshCat */
import { byId } from "./dom.js";
import { arrange } from "./labels.js";
import { CLOSE } from "./numerics.js";

// Time (ms) without a picture after which the next is not left to wait for the screen's turn.
const REST = 250;
// Directions from the mechanism to the camera.
const DIRECTIONS = { iso: [1, -1.05, 0.75], front: [1, 0, 0.12], side: [0, -1, 0.12], top: [0, -1e-3, 1] };
// Distance of the camera over that at which the sphere around everything just fits.
const FILLED = 0.95;
// Boxes of words over the picture.
const OVER = ["cameras", "show", "legend", "colour-bar"];

export class Pane {
  constructor() {
    this.node = byId("pane");
    this.viewer = new MeshCat.Viewer(this.node);
    // The viewer takes the window's height for its own; the pane has another.
    const sized = this.viewer.set_3d_pane_size.bind(this.viewer);
    this.viewer.set_3d_pane_size = () => {
      const { clientWidth: width, clientHeight: height } = this.node;
      if (width > 0 && height > 0) sized(width, height);
      this.center();
    };
    window.onload = null;
    this.viewer.gui.domElement.style.display = "none";
    this.covered = 0;
    this.boxes = []; // what stands over the picture, as labels are kept
    this.framed = null; // the last view that was framed
    this.lit = null;
    this.every = false;
    this.holding = false; // whether a handle is being dragged
    new ResizeObserver(() => this.viewer.set_3d_pane_size()).observe(this.node);
    const over = new ResizeObserver(() => this.center());
    for (const id of OVER) over.observe(byId(id));
    this.viewer.set_3d_pane_size();
    this.after = [];
    const render = this.viewer.render.bind(this.viewer);
    this.rendered = 0;
    this.before = []; // called before each picture
    this.viewer.render = () => {
      for (const callback of this.before) callback();
      arrange(this.viewer.scene, this.viewer.camera, (freedom) => this.every || this.lit === freedom, this.boxes);
      render();
      this.rendered = performance.now();
      for (const callback of this.after.splice(0)) callback();
    };
  }

  /** Where a pointer is in the picture, from -1 to 1. */
  place(event) {
    const box = this.viewer.renderer.domElement.getBoundingClientRect();
    return [2 * (event.clientX - box.left) / box.width - 1, 1 - 2 * (event.clientY - box.top) / box.height];
  }

  /** Write all values of an ellipsoid ("translation", "rotation"), or of none. */
  light(freedom) {
    if (this.lit === freedom) return;
    this.lit = freedom;
    this.viewer.set_dirty();
  }

  /** Put the middle of the picture into the middle of what the legend leaves free. */
  center() {
    const { clientWidth: width, clientHeight: height } = this.node;
    // Never back: a legend that comes and goes does not shake the picture.
    this.covered = Math.max(this.covered, byId("legend").offsetHeight);
    this.viewer.camera.setViewOffset(width, height, 0, this.covered / 2, width, height);
    this.boxes = OVER.map((id) => box(byId(id), width, height));
    // A view that nobody has turned is framed anew for another shape of the pane.
    if (this.framed && String(this.view) === this.framed.view) {
      const first = this.first === this.framed.view;
      this.frame(this.framed.preset, this.framed.bounds);
      if (first) this.first = String(this.view);
    }
    this.viewer.set_dirty();
  }

  apply(commands, then) {
    for (const command of commands) {
      if (command instanceof Uint8Array) this.viewer.handle_command_bytearray(command);
      else if (command.type === "copy") this.copy(command);
      else this.viewer.handle_command(command.type === "label" ? label(command) : command);
    }
    if (then) {
      this.after.push(then);
      // After a rest at once; while pictures follow each other at the pace of the screen.
      if (performance.now() - this.rendered > REST) this.viewer.render();
      else this.viewer.set_dirty();
    }
  }

  /** Pale copies of what stands at some places below a path, at the same places below another. */
  copy({ from, to, parts, colour, opacity }) {
    const at = (path) => this.viewer.scene_tree.find(path.split("/").filter(Boolean)).object;
    const material = new MeshCat.THREE.MeshPhongMaterial({ color: colour, opacity, transparent: true, depthWrite: false, side: MeshCat.THREE.DoubleSide });
    for (const part of parts) {
      const target = at(`${to}/${part}`);
      for (const child of at(`${from}/${part}`).children) target.add(child.clone(true));
      target.traverse((node) => { if (node.isMesh) node.material = material; });
    }
  }

  /** A new picture; seen from where the last one was, or from the preset of a first one. */
  reset(commands, bounds) {
    const { camera, controls } = this.viewer;
    const [eye, target] = [camera.position.clone(), controls.target.clone()];
    this.viewer.handle_command({ type: "delete", path: "/meshcat" });
    this.apply(commands);
    if (this.seen) {
      camera.position.copy(eye);
      controls.target.copy(target);
    } else {
      this.look("iso", bounds);
      this.first = String(this.view);
    }
    this.seen = true;
  }

  /** Look from a preset, or with "fit" from the present side, so that all between two corners is seen. */
  look(preset, bounds) {
    this.frame(preset, bounds);
  }

  frame(preset, bounds) {
    const [low, high] = bounds;
    const { camera, controls } = this.viewer;
    const { clientWidth: width, clientHeight: height } = this.node;
    // The viewer's camera lives in a frame with y up.
    const up = ([x, y, z]) => [x, z, -y];
    const middle = up(low.map((x, i) => (x + high[i]) / 2));
    const direction = preset === "fit" ? camera.position.clone().sub(controls.target)
      : camera.position.clone().set(...up(DIRECTIONS[preset]));
    const free = Math.max(0.3, (height - this.covered) / Math.max(1, height));
    const half = Math.tan((camera.fov * Math.PI) / 360) * Math.min(free, width / Math.max(1, height));
    const radius = Math.max(CLOSE, Math.hypot(...low.map((x, i) => high[i] - x)) / 2);
    controls.target.set(...middle);
    camera.position.copy(controls.target).add(direction.normalize().multiplyScalar(FILLED * radius / Math.sin(Math.atan(half))));
    controls.update();
    this.framed = { preset, bounds, view: String(this.view) };
    this.viewer.set_dirty();
  }

  /** Where the camera is and what it looks at: six numbers. */
  get view() {
    const { camera, controls } = this.viewer;
    return [...camera.position.toArray(), ...controls.target.toArray()].map((x) => Number(x.toFixed(4)));
  }

  set view(numbers) {
    const { camera, controls } = this.viewer;
    camera.position.fromArray(numbers);
    controls.target.fromArray(numbers, 3);
    controls.update();
    this.viewer.set_dirty();
  }

  /** The picture as a PNG file. */
  image() {
    this.viewer.render();
    return new Promise((resolve) => this.viewer.renderer.domElement.toBlob(resolve, "image/png"));
  }
}

/** Middle and half sizes of a node over the pane, which reaches from -1 to 1. */
function box({ offsetLeft, offsetTop, offsetWidth, offsetHeight }, width, height) {
  return { x: (2 * offsetLeft + offsetWidth) / width - 1, y: 1 - (2 * offsetTop + offsetHeight) / height,
    width: offsetWidth / width, height: offsetHeight / height };
}

const LINEAR_FILTER = 1006;

/** The command that puts a line of text into the picture, facing the viewer. */
function label({ path, text, letters, paper, height }) {
  const canvas = document.createElement("canvas");
  const pen = canvas.getContext("2d");
  const font = "26px system-ui, sans-serif";
  const colour = (number, alpha) => `rgb(${number >> 16 & 255} ${number >> 8 & 255} ${number & 255} / ${alpha})`;
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(text).width) + 12;
  canvas.height = 38;
  pen.fillStyle = colour(paper, 0.72);
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.font = font;
  pen.fillStyle = colour(letters, 1);
  pen.fillText(text, 6, 28);
  return {
    type: "set_object", path, object: {
      images: [{ uuid: "i", url: canvas.toDataURL() }],
      textures: [{ uuid: "t", image: "i", minFilter: LINEAR_FILTER }],
      materials: [{ uuid: "m", type: "SpriteMaterial", map: "t", transparent: true, depthTest: false, sizeAttenuation: false }],
      object: { uuid: "o", type: "Sprite", material: "m", renderOrder: 10, scale: [height * canvas.width / canvas.height, height, 1] },
    },
  };
}
