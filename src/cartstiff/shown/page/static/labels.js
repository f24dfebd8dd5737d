// What is seen of labels and of what is hidden: each label as near to its point as it can be without
// covering another; of an ellipsoid's values the softest, until it is pointed at; ellipsoids shine through the links.

// Parts that are seen through others, by the share of their opacity.
const SHINING = /^(translation|rotation) ellipsoid$/;
const SHINE = 0.45;
const OVER_ALL = 15; // but labels and handles

// How many times as wide as high labels are, about.
const ASPECT = 6;
// Places around the point, in sizes of the label: those whose edge is nearest first, of these whose middle is.
const PLACES = [0, 1, 2, 3, 4, 5]
  .flatMap((ring) => [-6, -5, -4, -3, -2, 0, 2, 3, 4, 5, 6].flatMap((x) => [-ring, ring].map((y) => [x / 4, y])))
  .map((at) => ({ at, away: Math.hypot(ASPECT * Math.max(0, Math.abs(at[0]) - 0.5), Math.max(0, Math.abs(at[1]) - 0.5))
    + 0.1 * Math.hypot(ASPECT * at[0], at[1]) })).sort((a, b) => a.away - b.away).map(({ at }) => at);
// Space between labels, as a share of their size.
const GAP = 1.06;

/** Middle and half sizes of a label on the screen, which reaches from -1 to 1; null if unseen. */
function onScreen(sprite, camera) {
  const world = sprite.matrixWorld.elements;
  const middle = sprite.position.clone().setFromMatrixPosition(sprite.matrixWorld).project(camera);
  if (!(Math.abs(middle.z) <= 1)) return null;
  // As three.js does: a size that does not shrink with the distance.
  const [x, , , , , y] = camera.projectionMatrix.elements;
  const width = Math.hypot(world[0], world[1], world[2]) * x / 2;
  const height = Math.hypot(world[4], world[5], world[6]) * y / 2;
  // A label of what is seen is not cut off at the edge.
  const inside = (at, half) => (Math.abs(at) < 1 ? Math.max(half - 1, Math.min(1 - half, at)) : at);
  const [x0, y0] = [inside(middle.x, width), inside(middle.y, height)];
  return { sprite, x: x0, y: y0, shift: [(x0 - middle.x) / (2 * width), (y0 - middle.y) / (2 * height)], width,
    height };
}

// Share of an ellipsoid's half sizes within which no value is written.
const CORE = 0.72;

/** Middle and half sizes of the core of an ellipsoid, a unit ball that is stretched, on the screen. */
function coreOf(ball, camera) {
  const view = camera.matrixWorldInverse.clone().multiply(ball.matrixWorld).elements;
  const [x, , , , , y] = camera.projectionMatrix.elements;
  const [width, height] = [0, 1].map((k) => (CORE * Math.hypot(view[k], view[k + 4], view[k + 8])) / -view[14]);
  const middle = ball.position.clone().setFromMatrixPosition(ball.matrixWorld).project(camera);
  return { x: middle.x, y: middle.y, width: width * x, height: height * y };
}

/** Names of the nodes from below the mechanism's place down to an object. */
export function pathOf(object) {
  const names = [];
  for (let node = object; node; node = node.parent) {
    if (node.name === "cartstiff") return names;
    names.unshift(node.name);
  }
  return [];
}

/** Let a part be seen through what stands before it. */
function shine(mesh) {
  if (mesh.userData.twin !== undefined) return;
  if (pathOf(mesh)[0] === "wrench") { // a load is never buried
    Object.assign(mesh.material, { depthTest: false, transparent: true });
    mesh.renderOrder = OVER_ALL;
  }
  mesh.userData.twin = SHINING.test(pathOf(mesh)[0]);
  if (!mesh.userData.twin) return;
  const { Mesh, GreaterDepth } = MeshCat.THREE;
  const material = mesh.material.clone();
  Object.assign(material, { transparent: true, depthWrite: false, depthFunc: GreaterDepth,
    opacity: SHINE * mesh.material.opacity });
  const twin = new Mesh(mesh.geometry, material);
  twin.userData.twin = false;
  twin.userData.isTwin = true;
  mesh.add(twin);
}

/** Labels that are written: all but the values of an ellipsoid that are neither softest, nor cut, nor pointed at. */
function written(sprites, lit) {
  const values = new Map(); // by ellipsoid
  const found = [];
  for (const sprite of sprites) {
    const [part, look, name] = pathOf(sprite);
    if (!part?.endsWith(" ellipsoid") || lit(part.split(" ")[0]) || sprite.userData.label?.text.endsWith("(cut)")) {
      found.push(sprite);
      continue;
    }
    const key = `${part}/${look}`;
    values.set(key, [...(values.get(key) ?? []), [name, sprite]]);
  }
  for (const [key, named] of values) {
    named.sort(([a], [b]) => a.localeCompare(b)); // "value 1" is the smallest
    found.push(named.at(key.includes("/compliance") ? -1 : 0)[1]);
  }
  for (const sprite of sprites) sprite.material.visible = found.includes(sprite);
  return found;
}

/** Move the labels of a scene apart, and from boxes over it; one that stood free stays where it was. */
export function arrange(scene, camera, lit, boxes) {
  scene.updateMatrixWorld();
  camera.updateMatrixWorld();
  camera.updateProjectionMatrix(); // its angle of view may have just been set
  const sprites = [];
  const meshes = [];
  scene.traverseVisible((node) => {
    if (node.isSprite) sprites.push(node);
    else if (node.isMesh) meshes.push(node);
  });
  meshes.forEach(shine);
  const labels = written(sprites, lit).map((sprite) => onScreen(sprite, camera)).filter(Boolean);
  const placed = [...boxes];
  const M = scene.getObjectByName("M");
  const ball = M && M.position.clone().setFromMatrixPosition(M.matrixWorld).project(camera);
  const cores = meshes.filter((mesh) => !mesh.userData.isTwin && /ellipsoid.*body/.test(pathOf(mesh).join()))
    .map((mesh) => coreOf(mesh, camera));
  if (ball && labels.length) cores.push({ x: ball.x, y: ball.y, width: labels[0].height / camera.aspect,
    height: labels[0].height });
  for (const label of labels) {
    const { sprite, width, height } = label;
    const kept = /ellipsoid|wrench|callout/.test(pathOf(sprite)[0]) ? [...placed, ...cores] : placed;
    const free = (/** @type {number[]} */ [dx, dy], others = kept) => {
      const x = label.x + 2 * dx * width * GAP, y = label.y + 2 * dy * height * GAP;
      const inside = (at, half, to) => Math.abs(at) >= 1 || Math.abs(to) + half <= 1.001;
      return inside(label.x, width, x) && inside(label.y, height, y)
        && others.every((other) => Math.abs(other.x - x) >= (other.width + width) * 0.99
        || Math.abs(other.y - y) >= (other.height + height) * 0.99);
    };
    const before = sprite.userData.place;
    const place = before && free(before) ? before : PLACES.find((at) => free(at))
      ?? PLACES.find((at) => free(at, placed)) ?? PLACES[0];
    sprite.userData.place = place;
    sprite.center.set(0.5 - place[0] * GAP - label.shift[0], 0.5 - place[1] * GAP - label.shift[1]);
    placed.push({ x: label.x + 2 * place[0] * width * GAP, y: label.y + 2 * place[1] * height * GAP, width, height });
  }
}
