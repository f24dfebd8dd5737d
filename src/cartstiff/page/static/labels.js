// Labels of the picture: each as near to its point as it can be without covering another.

// Places around the point, in sizes of the label, nearest first.
const PLACES = [0, 1, 2, 3]
  .flatMap((ring) => [-1, -0.5, 0, 0.5, 1].flatMap((x) => [-ring, ring].map((y) => [x, y])))
  .sort((a, b) => Math.hypot(a[0], 0.7 * a[1]) - Math.hypot(b[0], 0.7 * b[1]));
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
  return { sprite, x: x0, y: y0, shift: [(x0 - middle.x) / (2 * width), (y0 - middle.y) / (2 * height)], width, height };
}

/** Move the labels of a scene apart; one that stood free stays where it was. */
export function spreadLabels(scene, camera) {
  scene.updateMatrixWorld();
  camera.updateMatrixWorld();
  const labels = [];
  scene.traverseVisible((node) => {
    const found = node.isSprite && onScreen(node, camera);
    if (found) labels.push(found);
  });
  const placed = [];
  for (const label of labels) {
    const { sprite, width, height } = label;
    const free = ([dx, dy]) => {
      const x = label.x + 2 * dx * width * GAP, y = label.y + 2 * dy * height * GAP;
      return placed.every((other) => Math.abs(other.x - x) >= (other.width + width) * 0.99
        || Math.abs(other.y - y) >= (other.height + height) * 0.99);
    };
    const before = sprite.userData.place;
    const place = before && free(before) ? before : PLACES.find(free) ?? PLACES[0];
    sprite.userData.place = place;
    sprite.center.set(0.5 - place[0] * GAP - label.shift[0], 0.5 - place[1] * GAP - label.shift[1]);
    placed.push({ x: label.x + 2 * place[0] * width * GAP, y: label.y + 2 * place[1] * height * GAP, width, height });
  }
}
