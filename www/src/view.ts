/** The 3D view: the scene, the candidates as lines, a ghost of the arm, and the voxels that Q-attention values most. */

import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { LineMaterial } from 'three/addons/lines/LineMaterial.js';
import { LineSegments2 } from 'three/addons/lines/LineSegments2.js';
import { LineSegmentsGeometry } from 'three/addons/lines/LineSegmentsGeometry.js';
import { scale, viridis } from './colors';
import { POSE_LEN, type Plan, type SceneView, type Source } from './protocol';
import { dispose, itemGroup } from './shapes';

const BACKGROUND = 0xeef1f4;
/** Widths in pixels and dashes in metres of the lines of each source. */
const LINES: Record<Source, { width: number; dash?: number }> = {
  planner: { width: 1.5 },
  bezier: { width: 1.5, dash: 0.012 },
  policy: { width: 4 },
  linear: { width: 2.5 },
  screw: { width: 2.5, dash: 0.03 },
};
const EMPHASIS = { winner: 5, pointed: 4 };
/** What an emphasised line has around it, so that it stands out from those of its colour. */
const CASING = { rgb: [0.09, 0.13, 0.17] as [number, number, number], pixels: 4 };
/** Fraction of the range of values below which a voxel is not drawn. */
const DRAWN_VOXELS = 0.4;
/** Seconds that the ghost takes along a path. */
const GHOST_SECONDS = 1.5;

/** Which candidates are drawn apart from the others. */
export interface Emphasis {
  winner: number | null;
  pointed: number | null;
}

export class View {
  private readonly renderer: THREE.WebGLRenderer;
  private readonly scene = new THREE.Scene();
  private readonly camera = new THREE.PerspectiveCamera(40, 1, 0.05, 20);
  private readonly controls: OrbitControls;
  private items: THREE.Group[] = [];
  private nRobotItems = 0;
  private readonly paths = new THREE.Group();
  private readonly emphasised = new THREE.Group();
  private readonly attention = new THREE.Group();
  private readonly goal = new THREE.AxesHelper(0.06);
  private ghost: THREE.Group[] = [];
  private ghostRun: { poses: Float32Array; begin: number } | undefined;
  private frameAsked = false;
  private onFrame: ((now: number) => void) | undefined;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.shadowMap.enabled = true;
    this.scene.background = new THREE.Color(BACKGROUND);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener('change', () => this.draw());
    this.scene.add(this.paths, this.emphasised, this.attention, this.goal, ...surroundings());
    this.goal.visible = false;
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    canvas.addEventListener('webglcontextrestored', () => this.draw());
    this.resize();
  }

  /** Replaces the scene. */
  setScene(scene: SceneView, poses: Float32Array): void {
    for (const item of [...this.items, ...this.ghost]) {
      this.scene.remove(item);
      dispose(item);
    }
    const solid = ({ rgb }: { rgb: number[] }) => new THREE.MeshStandardMaterial({ color: color(rgb), roughness: 0.65, metalness: 0.05 });
    // Pushed back a little: where the ghost stands in the arm, the arm is seen.
    const behind = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 4 };
    const ghostly = { color: 0x3b6ea5, transparent: true, opacity: 0.28, depthWrite: false, ...behind };
    const clear = () => new THREE.MeshStandardMaterial(ghostly);
    this.items = scene.items.map((item) => itemGroup(item.parts, solid));
    this.nRobotItems = scene.n_robot_items;
    this.ghost = scene.items.slice(-this.nRobotItems).map((item) => itemGroup(item.parts, clear));
    for (const ghost of this.ghost) ghost.visible = false;
    this.scene.add(...this.items, ...this.ghost);
    this.lookAt(scene.workspace);
    this.clearPlan();
    this.setPoses(poses);
  }

  /** Moves every item of the scene. */
  setPoses(poses: Float32Array): void {
    place(this.items, poses, 0);
    this.draw();
  }

  /** Draws the candidates of a plan in the colours of their values. */
  setPlan(plan: Plan): void {
    this.clearPlan();
    const colorOf = candidateColors(plan);
    for (const source of Object.keys(LINES) as Source[]) {
      const chosen = plan.candidates.map((candidate, idx) => ({ candidate, idx })).filter(({ candidate }) => candidate.source === source);
      if (chosen.length === 0) continue;
      const lines = chosen.map(({ candidate, idx }) => ({ points: candidate.grip, rgb: colorOf(idx) }));
      const { width, dash } = LINES[source];
      this.paths.add(segments(lines, { linewidth: width, transparent: true, opacity: 0.85, ...dashes(dash) }));
    }
    this.goal.position.fromArray(plan.goal.position);
    this.goal.quaternion.fromArray(plan.goal.rotation_xyzw);
    this.goal.visible = true;
    for (const depth of plan.depths) this.attention.add(voxels(depth));
    this.draw();
  }

  /** Draws the winner and the candidate under the pointer thicker. */
  setEmphasis(plan: Plan, emphasis: Emphasis): void {
    clear(this.emphasised);
    const colorOf = candidateColors(plan);
    for (const which of ['winner', 'pointed'] as const) {
      const idx = emphasis[which];
      const candidate = idx === null ? undefined : plan.candidates[idx];
      if (idx === null || !candidate) continue;
      const line = (rgb: [number, number, number], linewidth: number, order: number) => {
        const drawn = segments([{ points: candidate.grip, rgb }], { linewidth, depthTest: false, transparent: true });
        drawn.renderOrder = order;
        return drawn;
      };
      this.emphasised.add(line(CASING.rgb, EMPHASIS[which] + CASING.pixels, 1), line(colorOf(idx), EMPHASIS[which], 2));
    }
    this.draw();
  }

  /** Lets a ghost of the arm go along a path again and again; none stops it. Poses: configurations × robot items × POSE_LEN. */
  setGhost(poses: Float32Array | undefined): void {
    for (const ghost of this.ghost) ghost.visible = poses !== undefined;
    this.ghostRun = poses && { poses, begin: performance.now() };
    this.draw();
  }

  showAttention(visible: boolean): void {
    this.attention.visible = visible;
    this.draw();
  }

  /** Removes the paths, the goal and the voxels. */
  clearPlan(): void {
    for (const group of [this.paths, this.emphasised, this.attention]) clear(group);
    this.goal.visible = false;
    this.setGhost(undefined);
  }

  /** Shows frames of poses, `frameSeconds` apart, in real time. In a hidden page it shows the last. */
  play(poses: Float32Array, frameSeconds: number): Promise<void> {
    const frameLen = this.items.length * POSE_LEN;
    const nFrames = poses.length / frameLen;
    const begin = performance.now();
    return new Promise((resolve) => {
      const finish = () => {
        this.onFrame = undefined;
        document.removeEventListener('visibilitychange', finishIfHidden);
        this.setPoses(poses.subarray((nFrames - 1) * frameLen));
        resolve();
      };
      const finishIfHidden = () => document.hidden && finish();
      document.addEventListener('visibilitychange', finishIfHidden);
      if (document.hidden) return finish();
      this.onFrame = (now) => {
        const at = Math.max(now - begin, 0) / (1000 * frameSeconds);
        if (at >= nFrames - 1) return finish();
        place(this.items, poses, Math.floor(at) * frameLen, at % 1);
        this.draw();
      };
      this.draw();
    });
  }

  /** Draws once, before the next frame of the screen. */
  private draw(): void {
    if (this.frameAsked) return;
    this.frameAsked = true;
    requestAnimationFrame((now) => {
      this.frameAsked = false;
      this.onFrame?.(now);
      this.moveGhost(now);
      this.renderer.render(this.scene, this.camera);
    });
  }

  private moveGhost(now: number): void {
    if (!this.ghostRun) return;
    const { poses, begin } = this.ghostRun;
    const frameLen = this.nRobotItems * POSE_LEN;
    const nFrames = poses.length / frameLen;
    const at = ((Math.max(now - begin, 0) / (1000 * GHOST_SECONDS)) % 1) * (nFrames - 1);
    place(this.ghost, poses, Math.floor(at) * frameLen, at % 1);
    this.draw();
  }

  private lookAt([low, high]: SceneView['workspace']): void {
    const target = new THREE.Vector3((low[0] + high[0]) / 2 - 0.12, 0, 0.22);
    if (this.controls.target.distanceTo(target) < 1e-6) return;
    this.controls.target.copy(target);
    this.camera.position.set(target.x + 1.05, -1.05, 0.95);
    this.controls.update();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement ?? this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }
}

/** Colour of each candidate within the range of the plan's values; grey without values. */
export function candidateColors(plan: Plan): (idx: number) => [number, number, number] {
  const values = plan.candidates.map(({ value }) => value).filter((value) => value !== null);
  const fraction = scale(values);
  return (idx) => {
    const value = plan.candidates[idx]?.value ?? null;
    return value === null ? [0.45, 0.45, 0.5] : viridis(fraction(value));
  };
}

function color(rgb: number[]): THREE.Color {
  return new THREE.Color().setRGB(rgb[0]! / 255, rgb[1]! / 255, rgb[2]! / 255, THREE.SRGBColorSpace);
}

function surroundings(): THREE.Object3D[] {
  const table = new THREE.Mesh(new THREE.PlaneGeometry(4, 4), new THREE.MeshStandardMaterial({ color: 0xdfe3e8, roughness: 0.95 }));
  table.receiveShadow = true;
  table.position.z = -0.001;
  const grid = new THREE.GridHelper(4, 40, 0xb8c0c9, 0xd0d6dd);
  grid.rotateX(Math.PI / 2);
  const sun = new THREE.DirectionalLight(0xffffff, 2.2);
  sun.position.set(0.2, -1.2, 2.4);
  sun.target.position.set(0.4, 0, 0);
  sun.castShadow = true;
  sun.shadow.mapSize.set(1024, 1024);
  sun.shadow.bias = -0.0005;
  Object.assign(sun.shadow.camera, { left: -1.2, right: 1.2, top: 1.2, bottom: -1.2, near: 0.5, far: 5 });
  return [table, grid, sun, sun.target, new THREE.HemisphereLight(0xffffff, 0x9aa4ae, 1.5)];
}

const [FROM, TO] = [new THREE.Quaternion(), new THREE.Quaternion()];

/** Places groups as the poses from `start` say, `fraction` of the way to the frame after it. */
function place(groups: THREE.Group[], poses: Float32Array, start: number, fraction = 0): void {
  const frameLen = groups.length * POSE_LEN;
  groups.forEach((group, idx) => {
    const from = start + idx * POSE_LEN;
    const to = fraction > 0 ? from + frameLen : from;
    group.position.set(
      ...([0, 1, 2].map((axis) => poses[from + axis]! + fraction * (poses[to + axis]! - poses[from + axis]!)) as [number, number, number]),
    );
    group.quaternion.slerpQuaternions(FROM.fromArray(poses, from + 3), TO.fromArray(poses, to + 3), fraction);
  });
}

function clear(group: THREE.Group): void {
  dispose(group);
  group.clear();
}

function dashes(length: number | undefined): { dashed?: boolean; dashSize?: number; gapSize?: number } {
  return length === undefined ? {} : { dashed: true, dashSize: length, gapSize: length * 0.6 };
}

/** Lines in one drawing call, each with its colour. */
function segments(
  lines: { points: [number, number, number][]; rgb: [number, number, number] }[],
  look: ConstructorParameters<typeof LineMaterial>[0] & object,
): LineSegments2 {
  const [positions, colors]: [number[], number[]] = [[], []];
  for (const { points, rgb } of lines) {
    const linear = color(rgb.map((channel) => channel * 255)).toArray();
    for (let i = 0; i + 1 < points.length; i++) {
      positions.push(...points[i]!, ...points[i + 1]!);
      colors.push(...linear, ...linear);
    }
  }
  const geometry = new LineSegmentsGeometry().setPositions(positions).setColors(colors);
  const drawn = new LineSegments2(geometry, new LineMaterial({ vertexColors: true, ...look }));
  // Dashes go by the distance along a line.
  return drawn.computeLineDistances();
}

function voxels({ voxel_size, centers, values }: Plan['depths'][number]): THREE.InstancedMesh {
  const material = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.45, depthWrite: false });
  const fraction = scale(values);
  const drawn = centers.filter((_, idx) => fraction(values[idx]!) >= DRAWN_VOXELS);
  const mesh = new THREE.InstancedMesh(new THREE.BoxGeometry(...voxel_size), material, drawn.length);
  const matrix = new THREE.Matrix4();
  // The values fall, so those that are drawn come first.
  drawn.forEach((center, idx) => {
    mesh.setMatrixAt(idx, matrix.makeTranslation(...center));
    mesh.setColorAt(idx, color(viridis(fraction(values[idx]!)).map((channel) => channel * 255)));
  });
  return mesh;
}
