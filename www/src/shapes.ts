/** Meshes from the parts of a scene. */

import * as THREE from 'three';
import { ConvexGeometry } from 'three/addons/geometries/ConvexGeometry.js';
import type { Part, Shape } from './protocol';

/** Sides of what is round. */
const SIDES = 32;

function geometry(shape: Shape): THREE.BufferGeometry {
  if ('sphere' in shape) return new THREE.SphereGeometry(shape.sphere.radius, SIDES, SIDES / 2);
  if ('cuboid' in shape) {
    const [x, y, z] = shape.cuboid.half_extents;
    return new THREE.BoxGeometry(2 * x, 2 * y, 2 * z);
  }
  // The axis of these is z here and y there.
  if ('cylinder' in shape) {
    const { radius, half_length } = shape.cylinder;
    return new THREE.CylinderGeometry(radius, radius, 2 * half_length, SIDES).rotateX(Math.PI / 2);
  }
  if ('capsule' in shape) {
    const { radius, half_length } = shape.capsule;
    return new THREE.CapsuleGeometry(radius, 2 * half_length, SIDES / 4, SIDES).rotateX(Math.PI / 2);
  }
  return new ConvexGeometry(shape.convex.points.map((point) => new THREE.Vector3(...point)));
}

/** A group of meshes for the parts of one item; `look` makes the material of a part. */
export function itemGroup(parts: Part[], look: (part: Part) => THREE.Material): THREE.Group {
  const group = new THREE.Group();
  for (const part of parts) {
    const mesh = new THREE.Mesh(geometry(part.shape), look(part));
    mesh.position.fromArray(part.pose.translation);
    mesh.quaternion.fromArray(part.pose.rotation);
    mesh.castShadow = true;
    mesh.receiveShadow = true;
    group.add(mesh);
  }
  return group;
}

/** Frees what the graphics card holds of everything below `root`. */
export function dispose(root: THREE.Object3D): void {
  root.traverse((object) => {
    const { geometry, material } = object as Partial<THREE.Mesh>;
    geometry?.dispose();
    for (const each of Array.isArray(material) ? material : material ? [material] : []) each.dispose();
  });
}
