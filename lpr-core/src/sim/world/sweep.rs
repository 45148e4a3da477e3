//! The scene that physics is timed on: an arm that sweeps over ten boxes, none of which ever falls
//! asleep.

use super::{SimParams, World};
use crate::env::InvalidAction;
use crate::error::Result;
use crate::robot::{JointConfig, XARM7};
use crate::scene::{Part, Shape};
use crate::sim::scene::{BodyKind, BodySpec, SceneSpec};
use glamx::{Pose3, Vec3};
use rapier3d::prelude::RigidBodyActivation;
use std::sync::Arc;

/// Boxes that lie on the table.
const BOXES: usize = 10;
/// Half a side of a box, metres.
const HALF_SIDE: f32 = 0.02;
/// From one box to the next along x and y, metres: each lies alone.
const SPACING: f32 = 0.1;
/// Angular frequency of the sweep, rad/s.
const FREQUENCY: f32 = 2.0;
/// Amplitude of every joint, radians: the arm turns to and fro and nods, above the boxes.
const AMPLITUDES: JointConfig = JointConfig::new([0.5, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0]);

/// An xArm7 that sweeps sinusoidally over ten boxes on a table.
///
/// The arm is kinematic, as everywhere in the simulator. `tests/peers/physics_mujoco.py` has the
/// same scene for `MuJoCo`.
#[derive(Debug, Clone)]
pub struct ArmSweep {
    world: World,
    n_steps: u64,
}

impl ArmSweep {
    /// The scene at rest, all boxes awake for good.
    ///
    /// # Errors
    ///
    /// None of this scene's; those of [`World::new`].
    pub fn new(params: &SimParams) -> Result<Self> {
        let mut world = World::new(Arc::new(ten_boxes()), &XARM7, XARM7.start, params)?;
        for handle in &world.bodies {
            *world.physics.bodies[*handle].activation_mut() = RigidBodyActivation::cannot_sleep();
        }
        Ok(Self { world, n_steps: 0 })
    }

    /// One physics step.
    ///
    /// # Errors
    ///
    /// None of this scene's; those of [`World::step`].
    pub fn step(&mut self) -> Result<(), InvalidAction> {
        self.n_steps += 1;
        let phase = FREQUENCY * self.world.params().dt * self.n_steps as f32;
        let sine = libm::sinf(phase);
        self.world.step(&JointConfig::from_fn(XARM7.start.dof(), |j| {
            XARM7.start[j] + AMPLITUDES[j] * sine
        }))
    }

    /// The world now.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }
}

fn ten_boxes() -> SceneSpec {
    let body = |name: String, kind, position, half_extents, mass| BodySpec {
        name,
        kind,
        pose: Pose3::from_translation(position),
        parts: vec![Part::new(Shape::Cuboid { half_extents }, Pose3::IDENTITY, [180; 3])],
        mass,
        friction: 0.5,
    };
    let place = |idx: usize| {
        Vec3::new(0.3 + SPACING * (idx % 5) as f32, 0.15 + SPACING * (idx / 5) as f32, HALF_SIDE)
    };
    let boxes = (0..BOXES).map(|idx| {
        body(format!("box{idx}"), BodyKind::Dynamic, place(idx), Vec3::splat(HALF_SIDE), 0.1)
    });
    let table = body(
        "table".to_owned(),
        BodyKind::Fixed,
        Vec3::new(0.45, 0.0, -0.02),
        Vec3::new(0.75, 0.85, 0.02),
        0.0,
    );
    SceneSpec {
        task: "boxes".to_owned(),
        bodies: boxes.chain([table]).collect(),
        joints: Vec::new(),
        success: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_stay_awake_and_where_they_are_while_the_arm_sweeps() {
        let mut sweep = ArmSweep::new(&SimParams::STANDARD).unwrap();
        let start: Vec<_> =
            sweep.world().scene_items().map(|(_, pose, _)| pose.translation).collect();
        for step in 0..1000 {
            sweep.step().unwrap();
            let awake = sweep.world.physics.islands.active_bodies();
            let boxes = awake.filter(|handle| sweep.world.bodies[..BOXES].contains(handle)).count();
            assert_eq!(boxes, BOXES, "awake after step {step}");
        }
        for ((_, pose, _), start) in sweep.world().scene_items().zip(start) {
            assert!(pose.translation.distance(start) < 0.002, "{} from {start}", pose.translation);
        }
        assert!(
            sweep.world().config().max_joint_distance(&XARM7.start) > 0.1,
            "the arm is on its way"
        );
    }
}
