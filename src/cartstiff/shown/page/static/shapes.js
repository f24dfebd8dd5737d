// Shapes that the page itself adds to a picture, besides those that it is sent.

/** A group in a picture's scene, whose places are those of the world: the viewer's scene is turned. */
export function worldOf({ viewer: { scene } }) {
  const world = new MeshCat.THREE.Group();
  world.quaternion.copy(scene.quaternion).invert();
  scene.add(world);
  return world;
}

/** A mesh in one colour, or with null in those of its corners; `through`: seen through what stands before it. */
export function shape(geometry, color, { opacity = 1, through = false, order = 0 } = {}) {
  const { Mesh, MeshBasicMaterial } = MeshCat.THREE;
  const mesh = new Mesh(geometry, new MeshBasicMaterial({ color: color ?? 0xffffff, vertexColors: color === null,
    opacity, transparent: through || opacity < 1, depthTest: !through }));
  mesh.renderOrder = order;
  mesh.userData.twin = false;
  return mesh;
}

/** The same twice: what stands before it leaves it pale. */
export const both = (geometry, color, pale, order = 0) => [shape(geometry, color, { order }),
  shape(geometry, color, { opacity: pale, through: true, order })];

/** Put an object where a point of another is in the world, its own z along an axis of that. */
export function align(object, other, point, axis) {
  const { Matrix4, Quaternion, Vector3 } = MeshCat.THREE;
  other.updateWorldMatrix(true, false);
  object.position.set(...point).applyMatrix4(other.matrixWorld);
  object.quaternion.setFromRotationMatrix(new Matrix4().extractRotation(other.matrixWorld))
    .multiply(new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), new Vector3(...axis).normalize()));
}
