//! Shorthand for building scenes: lengths in metres, angles of waypoints in degrees as the
//! published tables give them.

use super::{Approach, TaskScene, Waypoint};
use crate::q_attention::NextBestPose;
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::{Part, Shape};
use crate::sim::scene::{BodyKind, BodySpec, Condition, JointSpec, SceneSpec};
use core::f32::consts::{FRAC_PI_2, PI, TAU};
use glamx::{Pose3, Quat, Vec2, Vec3};
use rand::RngExt as _;

/// Friction coefficient of everything but the finger pads.
const FRICTION: f32 = 0.5;

/// A scene being built in its task frame.
pub(super) struct SceneBuilder {
    spec: SceneSpec,
    waypoints: Vec<Waypoint>,
}

impl SceneBuilder {
    /// An empty scene, whose task is named where its source is known: [`super::Task::scene`].
    pub(super) const fn new() -> Self {
        let spec = SceneSpec {
            task: String::new(),
            bodies: Vec::new(),
            joints: Vec::new(),
            success: Vec::new(),
        };
        Self { spec, waypoints: Vec::new() }
    }

    /// Adds a body whose frame is the task frame moved to `origin`; returns its index.
    pub(super) fn body(
        &mut self,
        name: &str,
        kind: BodyKind,
        origin: Vec3,
        mass: f32,
        parts: Vec<Part>,
    ) -> usize {
        let pose = Pose3::from_translation(origin);
        self.spec.bodies.push(BodySpec {
            name: name.to_owned(),
            kind,
            pose,
            parts,
            mass,
            friction: FRICTION,
        });
        self.spec.bodies.len() - 1
    }

    /// Adds a body that moves, with its frame at `pose` of the task frame; returns its index.
    pub(super) fn turned_body(
        &mut self,
        name: &str,
        pose: Pose3,
        mass: f32,
        parts: Vec<Part>,
    ) -> usize {
        let body = self.body(name, BodyKind::Dynamic, pose.translation, mass, parts);
        self.spec.bodies[body].pose = pose;
        body
    }

    /// Adds a body that a closing hand attaches, with its frame at `pose` of the task frame;
    /// returns its index.
    pub(super) fn graspable_body(
        &mut self,
        name: &str,
        pose: Pose3,
        mass: f32,
        parts: Vec<Part>,
    ) -> usize {
        let body = self.body(name, BodyKind::Graspable, pose.translation, mass, parts);
        self.spec.bodies[body].pose = pose;
        body
    }

    pub(super) fn joint(&mut self, joint: JointSpec) -> usize {
        self.spec.joints.push(joint);
        self.spec.joints.len() - 1
    }

    pub(super) fn waypoint(&mut self, pose: Pose3, gripper: Gripper, approach: Approach) {
        self.waypoints.push(Waypoint { goal: NextBestPose { pose, gripper }, approach });
    }

    pub(super) fn finish(mut self, success: Vec<Condition>) -> TaskScene {
        self.spec.success = success;
        TaskScene { spec: self.spec, waypoints: self.waypoints }
    }
}

/// Names of variations.
pub(super) fn words<const N: usize>(words: [&str; N]) -> Vec<String> {
    words.map(str::to_owned).into()
}

/// Places on the table that keep their distance from each other.
pub(super) struct Spots {
    region: Vec2,
    min_distance: f32,
    taken: Vec<Vec2>,
}

impl Spots {
    /// In a rectangle of sides `region` around the origin, at least `min_distance` apart, metres.
    pub(super) const fn new(region: Vec2, min_distance: f32) -> Self {
        Self { region, min_distance, taken: Vec::new() }
    }

    /// One more place. The region has to have room for it.
    pub(super) fn draw(&mut self, rng: &mut Rng) -> Vec2 {
        loop {
            let spot =
                self.region * Vec2::new(rng.random::<f32>() - 0.5, rng.random::<f32>() - 0.5);
            if self.taken.iter().all(|other| other.distance(spot) >= self.min_distance) {
                self.taken.push(spot);
                return spot;
            }
        }
    }
}

/// The colour of `variation` and two different others of `colors`.
pub(super) fn target_and_distractors(
    colors: &[[u8; 3]],
    variation: usize,
    rng: &mut Rng,
) -> [[u8; 3]; 3] {
    let target = colors[variation];
    let others: Vec<_> = colors.iter().copied().filter(|other| *other != target).collect();
    let first = rng.random_range(0..others.len());
    let second = (first + rng.random_range(1..others.len())) % others.len();
    [target, others[first], others[second]]
}

/// A grip pose at a position with roll, pitch, yaw in degrees: `Rz(yaw) Ry(pitch) Rx(roll)`.
pub(super) fn grip_pose(position: [f32; 3], roll_pitch_yaw: [f32; 3]) -> Pose3 {
    let [roll, pitch, yaw] = roll_pitch_yaw.map(f32::to_radians);
    let rotation =
        Quat::from_rotation_z(yaw) * Quat::from_rotation_y(pitch) * Quat::from_rotation_x(roll);
    Pose3::from_parts(Vec3::from(position), rotation)
}

/// The motion by `angle` radians about the `axis` (of unit length) through `point`.
pub(super) fn turn_about(point: Vec3, axis: Vec3, angle: f32) -> Pose3 {
    let turn = Pose3::from_rotation(Quat::from_axis_angle(axis, angle));
    Pose3::from_translation(point) * turn * Pose3::from_translation(-point)
}

/// The end of the way of `grasp` under a motion given by its share from 0 to 1, and the poses
/// before it: so many that between two of them, where the hand goes straight, a heavy lid's hinge
/// feels a tenth of a millimetre.
pub(super) fn arc_about(grasp: Pose3, motion: impl Fn(f32) -> Pose3) -> (Pose3, Vec<Pose3>) {
    /// At most two degrees apart in every task.
    const POSES: usize = 57;
    let pose = |idx: usize| motion(idx as f32 / POSES as f32) * grasp;
    (pose(POSES), (1..POSES).map(pose).collect())
}

/// A box from its centre and side lengths.
pub(super) fn cuboid(center: [f32; 3], size: [f32; 3], rgb: [u8; 3]) -> Part {
    Part::new(
        Shape::Cuboid { half_extents: 0.5 * Vec3::from(size) },
        Pose3::from_translation(Vec3::from(center)),
        rgb,
    )
}

/// An upright cylinder from its centre, radius and length.
pub(super) fn cylinder_z(center: [f32; 3], radius: f32, length: f32, rgb: [u8; 3]) -> Part {
    let shape = Shape::Cylinder { radius, half_length: 0.5 * length };
    Part::new(shape, Pose3::from_translation(Vec3::from(center)), rgb)
}

/// A cylinder along x from its centre, radius and length.
pub(super) fn cylinder_x(center: [f32; 3], radius: f32, length: f32, rgb: [u8; 3]) -> Part {
    let shape = Shape::Cylinder { radius, half_length: 0.5 * length };
    Part::new(shape, Pose3::from_parts(Vec3::from(center), Quat::from_rotation_y(FRAC_PI_2)), rgb)
}

/// A cylinder along y from its centre, radius and length.
pub(super) fn cylinder_y(center: [f32; 3], radius: f32, length: f32, rgb: [u8; 3]) -> Part {
    let shape = Shape::Cylinder { radius, half_length: 0.5 * length };
    Part::new(shape, Pose3::from_parts(Vec3::from(center), Quat::from_rotation_x(FRAC_PI_2)), rgb)
}

/// A ball from its centre and radius.
pub(super) fn ball(center: [f32; 3], radius: f32, rgb: [u8; 3]) -> Part {
    Part::new(Shape::Sphere { radius }, Pose3::from_translation(Vec3::from(center)), rgb)
}

/// An upright tube on the table from its outer radius, wall and height: boxes around it.
pub(super) fn tube(radius: f32, wall: f32, height: f32, rgb: [u8; 3]) -> Vec<Part> {
    /// Boxes of a tube.
    const SIDES: usize = 12;
    // A side of the regular polygon around the circle in the middle of the wall: the sides meet
    // there without a gap.
    let middle = radius - 0.5 * wall;
    let length = 2.0 * radius * libm::tanf(PI / SIDES as f32);
    let side = |idx: usize| {
        let turn = Pose3::from_rotation(Quat::from_rotation_z(TAU * idx as f32 / SIDES as f32));
        let part = cuboid([middle, 0.0, 0.5 * height], [wall, length, height], rgb);
        Part { pose: turn * part.pose, ..part }
    };
    (0..SIDES).map(side).collect()
}
