//! Checks of a scene from a file, so that physics and pictures can be built from it.

use super::{BodySpec, Condition, JointSpec, Latch, SceneSpec};
use crate::error::{Error, Result};
use crate::scene::{Part, Shape};
use glamx::{Pose3, Vec3};

/// Greatest difference of the length of a unit axis or quaternion from 1.
const UNIT_TOLERANCE: f32 = 1e-3;
/// Most bodies of a scene: masks hold their indices in 16 bits, and no table has room for more.
const MAX_BODIES: usize = 1000;
/// Farthest that anything may be, and its greatest size, metres: squares and cubes of it are still
/// ordinary numbers.
const FAR: f32 = 100.0;
/// Greatest mass and friction, kg and 1.
const HEAVY: f32 = 1e5;

impl SceneSpec {
    /// Checks sizes, poses and indices, so that physics and pictures can be built from the scene.
    ///
    /// # Errors
    ///
    /// Naming the body, joint or condition at fault.
    pub fn check(&self) -> Result<()> {
        self.first_fault().map_or(Ok(()), |fault| {
            Err(Error::Environment(format!("scene of task '{}': {fault}", self.task)))
        })
    }

    fn first_fault(&self) -> Option<String> {
        let n_bodies = self.bodies.len();
        if n_bodies > MAX_BODIES {
            return Some(format!("bodies: expected at most {MAX_BODIES}, found {n_bodies}"));
        }
        let of_body = |body: &BodySpec| {
            fault_of_body(body).map(|fault| format!("body '{}': {fault}", body.name))
        };
        let of_joint = |joint: &JointSpec| {
            self.fault_of_joint(joint).map(|fault| format!("joint '{}': {fault}", joint.name))
        };
        let of_success = || {
            let idx = self.success.iter().position(|condition| !self.has_subject(condition))?;
            Some(format!("success[{idx}]: names a body or joint that is not there"))
        };
        self.bodies
            .iter()
            .find_map(of_body)
            .or_else(|| self.joints.iter().find_map(of_joint))
            .or_else(of_success)
    }

    fn fault_of_joint(&self, joint: &JointSpec) -> Option<&'static str> {
        let exists = |body: usize| body < self.bodies.len();
        if joint.parent == joint.child || !exists(joint.parent) || !exists(joint.child) {
            return Some("expected two bodies of the scene");
        }
        let is_broken = |latch: Latch| latch.joint >= self.joints.len() || latch.min.is_nan();
        if joint.latch.is_some_and(is_broken) {
            return Some("its latch names a joint that is not there");
        }
        if joint.brake > 0.0 && joint.spring > 0.0 {
            return Some("expected a brake or a spring, not both");
        }
        let [lower, upper] = joint.limits;
        let is_placed = is_near(joint.anchor) && is_unit(joint.axis.length());
        let are_finite =
            [lower, upper, joint.start, joint.brake, joint.spring].into_iter().all(f32::is_finite);
        (!is_placed || !are_finite || lower > upper)
            .then_some("expected a unit axis and ascending limits")
    }

    /// Tells if the body or joint that a condition is about is there.
    fn has_subject(&self, condition: &Condition) -> bool {
        match *condition {
            Condition::JointMoved { joint, .. } => joint < self.joints.len(),
            Condition::BodyInZone { body, .. }
            | Condition::BodyOutsideZone { body, .. }
            | Condition::Grasped { body } => body < self.bodies.len(),
            Condition::GripInZone { .. } | Condition::NothingGrasped => true,
        }
    }
}

fn fault_of_body(body: &BodySpec) -> Option<String> {
    let is_sound = |part: &Part| is_pose(&part.pose) && has_volume(&part.shape);
    if !is_pose(&body.pose) || !body.parts.iter().all(is_sound) {
        return Some(format!("expected unit quaternions, sizes above 0 and lengths up to {FAR} m"));
    }
    let weights = [body.mass, body.friction];
    (!weights.iter().all(|weight| (0.0..=HEAVY).contains(weight)))
        .then(|| format!("expected mass and friction from 0 to {HEAVY}"))
}

fn is_unit(length: f32) -> bool {
    (length - 1.0).abs() < UNIT_TOLERANCE
}

fn is_near(point: Vec3) -> bool {
    // False for NaN.
    point.abs().cmple(Vec3::splat(FAR)).all()
}

fn is_pose(pose: &Pose3) -> bool {
    is_near(pose.translation) && is_unit(pose.rotation.length())
}

fn has_volume(shape: &Shape) -> bool {
    let above_zero = |lengths: &[f32]| lengths.iter().all(|length| *length > 0.0 && *length <= FAR);
    match shape {
        Shape::Sphere { radius } => above_zero(&[*radius]),
        Shape::Cuboid { half_extents } => above_zero(&half_extents.to_array()),
        Shape::Cylinder { radius, half_length } => above_zero(&[*radius, *half_length]),
        Shape::Capsule { radius, half_length } => {
            above_zero(&[*radius]) && (0.0..=FAR).contains(half_length)
        }
        Shape::Convex { points } => points.len() >= 4 && points.iter().all(|point| is_near(*point)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::XARM7;
    use crate::sim::placement::place;
    use crate::sim::tasks::{TASKS, Task};

    fn drawer() -> SceneSpec {
        let task = Task::by_name("open_drawer").expect("a task");
        place(&task, 0, &XARM7, 0).expect("a scene that can be placed").scene.spec
    }

    #[test]
    fn every_placed_scene_passes() {
        for task in TASKS.iter() {
            let scene = place(task, 0, &XARM7, 1).expect("a scene that can be placed").scene;
            assert_eq!(scene.spec.check(), Ok(()));
        }
    }

    #[test]
    fn what_physics_cannot_build_is_named() {
        let refusal = |change: &dyn Fn(&mut SceneSpec)| {
            let mut scene = drawer();
            change(&mut scene);
            scene.check().expect_err("a broken scene").to_string()
        };
        let broken_size =
            |scene: &mut SceneSpec| scene.bodies[0].parts[0].shape = Shape::Sphere { radius: -1.0 };
        assert!(refusal(&broken_size).contains(&drawer().bodies[0].name));
        assert!(refusal(&|scene| scene.bodies[0].mass = f32::NAN).contains("mass"));
        assert!(refusal(&|scene| scene.bodies[0].mass = 1e30).contains("mass"));
        assert!(
            refusal(&|scene| scene.bodies[0].pose.translation.x = 1e30).contains("up to 100 m")
        );
        assert!(
            refusal(&|scene| scene.bodies = vec![scene.bodies[0].clone(); 2000])
                .contains("at most 1000, found 2000")
        );
        assert!(refusal(&|scene| scene.joints[0].child = 99).contains("expected two bodies"));
        assert!(refusal(&|scene| scene.joints[0].axis = Vec3::ZERO).contains("unit axis"));
        let braked_spring =
            |scene: &mut SceneSpec| (scene.joints[0].brake, scene.joints[0].spring) = (1.0, 1.0);
        assert!(refusal(&braked_spring).contains("a brake or a spring"));
        assert!(
            refusal(&|scene| scene.joints[0].latch = Some(Latch { joint: 99, min: 0.1 }))
                .contains("latch")
        );
        assert!(
            refusal(&|scene| scene.success = vec![Condition::Grasped { body: 99 }])
                .contains("success[0]")
        );
    }
}
