/** What the worker is asked and what it answers: the JSON of `lpr-wasm` and the messages around it. */

export type Vec3 = [number, number, number];
export type Quat = [number, number, number, number];

/** Numbers of a pose in an array: position, then quaternion x y z w. */
export const POSE_LEN = 7;

export type Shape =
  | { sphere: { radius: number } }
  | { cuboid: { half_extents: Vec3 } }
  | { cylinder: { radius: number; half_length: number } }
  | { capsule: { radius: number; half_length: number } }
  | { convex: { points: Vec3[] } };

export interface Part {
  shape: Shape;
  pose: { translation: Vec3; rotation: Quat };
  rgb: [number, number, number];
}

/** `lpr_wasm::scene::SceneView`. */
export interface SceneView {
  task: string;
  description: string;
  robot: string;
  method: string;
  seed: number;
  items: { name: string; parts: Part[] }[];
  n_robot_items: number;
  workspace: [Vec3, Vec3];
}

export type Source = 'planner' | 'bezier' | 'policy' | 'linear' | 'screw';

/** `lpr_wasm::plan::Candidate`. */
export interface Candidate {
  source: Source;
  value: number | null;
  collides: boolean;
  length: number;
  path: number[][];
  grip: Vec3[];
}

/** `lpr_wasm::plan::Plan`. */
export interface Plan {
  step: number;
  goal: { position: Vec3; rotation_xyzw: Quat; gripper: 'open' | 'close' };
  depths: { voxel_size: Vec3; centers: Vec3[]; values: number[] }[];
  goal_value: number | null;
  candidates: Candidate[];
  rejected: { source: Source; reason: string; count: number }[];
  chosen: number | null;
}

/** `lpr_wasm::demo::Outcome`. */
export interface Outcome {
  step: number;
  frame_seconds: number;
  reward: number;
  ended: boolean;
  invalid: string | null;
  world_hash: string;
}

export interface Picture {
  rgb: Uint8Array;
  width: number;
  height: number;
}

/** A scene as it stands, without a plan. */
export interface Start {
  scene: SceneView;
  poses: Float32Array;
}

export interface Planned {
  plan: Plan;
  picture: Picture;
  milliseconds: number;
}

export interface Executed {
  outcome: Outcome;
  /** Frames × items × POSE_LEN. */
  poses: Float32Array;
  milliseconds: number;
}

/** What the worker does, by name. */
export interface Calls {
  load: (weights: string, seed: number) => Start;
  reset: (seed: number) => Start;
  plan: () => Planned;
  ghost: (candidate: number) => Float32Array;
  execute: (candidate: number) => Executed;
}

export interface Request {
  id: number;
  call: keyof Calls;
  args: unknown[];
}

export type Reply =
  | { kind: 'result'; id: number; result: unknown }
  | { kind: 'error'; id: number; message: string }
  | { kind: 'progress'; loaded: number; total: number };
