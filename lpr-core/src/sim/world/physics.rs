//! rapier's sets as one value that can be cloned: a snapshot of the world.

use super::params::SimParams;
use crate::scene::{Part, Shape};
use crate::sim::scene::{BodyKind, BodySpec, JointKind, JointSpec};
use glamx::{Pose3, Quat, Vec3};
use rapier3d::prelude::{
    ActiveHooks, BroadPhaseBvh, CCDSolver, CoefficientCombineRule, ColliderBuilder, ColliderHandle,
    ColliderSet, GenericJoint, Group, ImpulseJoint, ImpulseJointHandle, ImpulseJointSet,
    IntegrationParameters, InteractionGroups, InteractionTestMode, IslandManager, JointAxis,
    MotorModel, MultibodyJointSet, NarrowPhase, PhysicsPipeline, PrismaticJointBuilder,
    RevoluteJointBuilder, RigidBodyActivation, RigidBodyBuilder, RigidBodyHandle, RigidBodySet,
    SharedShape, SoftBodySet, SpringCoefficients,
};
use serde::{Deserialize, Serialize};

/// Group of fixed and moving bodies of the scene.
pub(super) const SCENE_GROUP: Group = Group::GROUP_1;
/// Group of arm, hand and fingers.
pub(super) const ROBOT_GROUP: Group = Group::GROUP_2;

/// Damping of a brake below its limit, N·m·s/rad or N·s/m: stiff, so that it acts as dry friction.
const BRAKE_DAMPING: f32 = 100.0;
/// Damping of a spring over its stiffness, seconds: a lever that is let go returns without
/// swinging.
const SPRING_DAMPING_SECS: f32 = 0.1;
/// Keeps rapier from recycling the contacts of the robot, since a recycled contact stays in the
/// world where a kinematic body was: the fingers would leave it behind. Pairs with any hook are
/// never recycled; this one is not called, as nothing is a sensor.
const NEVER_RECYCLED: ActiveHooks = ActiveHooks::FILTER_INTERSECTION_PAIR;
/// Earth's gravity along world z, m/s².
const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, -9.81);

/// All of rapier's state.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Physics {
    pub(super) parameters: IntegrationParameters,
    pub(super) islands: IslandManager,
    pub(super) broad_phase: BroadPhaseBvh,
    pub(super) narrow_phase: NarrowPhase,
    pub(super) bodies: RigidBodySet,
    pub(super) colliders: ColliderSet,
    pub(super) impulse_joints: ImpulseJointSet,
    pub(super) multibody_joints: MultibodyJointSet,
    /// None are ever inserted.
    #[serde(skip)]
    soft_bodies: SoftBodySet,
    /// Scratch space, as the pipeline.
    #[serde(skip)]
    ccd_solver: CCDSolver,
    #[serde(skip)]
    pipeline: Pipeline,
}

/// rapier's pipeline is scratch space without state of its own: a clone starts afresh.
#[derive(Default)]
struct Pipeline(PhysicsPipeline);

impl Clone for Pipeline {
    fn clone(&self) -> Self {
        Self(PhysicsPipeline::new())
    }
}

impl Physics {
    pub(super) fn new(params: &SimParams) -> Self {
        Self {
            parameters: params.integration(),
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::default(),
            narrow_phase: NarrowPhase::new(),
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            impulse_joints: ImpulseJointSet::new(),
            multibody_joints: MultibodyJointSet::new(),
            soft_bodies: SoftBodySet::new(),
            ccd_solver: CCDSolver::new(),
            pipeline: Pipeline(PhysicsPipeline::new()),
        }
    }

    pub(super) fn step(&mut self) {
        self.pipeline.0.step(
            GRAVITY,
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibody_joints,
            &mut self.soft_bodies,
            &mut self.ccd_solver,
            &(),
            &(),
        );
    }

    /// Adds a body of the scene. Visual bodies have no colliders.
    pub(super) fn insert_body(&mut self, spec: &BodySpec, params: &SimParams) -> RigidBodyHandle {
        let builder = match spec.kind {
            BodyKind::Visual | BodyKind::Fixed => RigidBodyBuilder::fixed(),
            BodyKind::Dynamic | BodyKind::Graspable => RigidBodyBuilder::dynamic(),
        };
        let body = self.bodies.insert(builder.pose(spec.pose));
        if spec.kind == BodyKind::Visual {
            return body;
        }
        // The parts share the body's mass by their volumes; where parts overlap it counts twice.
        let volume: f32 = spec
            .parts
            .iter()
            .map(|part| shared_shape(&part.shape).mass_properties(1.0).mass())
            .sum();
        for part in &spec.parts {
            let shape = shared_shape(&part.shape);
            let density = if volume > 0.0 { spec.mass / volume } else { 0.0 };
            let collider = ColliderBuilder::new(shape)
                .position(collider_pose(part))
                .density(density)
                .friction(spec.friction * params.friction_scale)
                .collision_groups(scene_groups());
            self.colliders.insert_with_parent(collider, body, &mut self.bodies);
        }
        body
    }

    /// Adds a kinematic body of the robot.
    pub(super) fn insert_robot_body(
        &mut self,
        pose: Pose3,
        parts: &[Part],
        friction: f32,
    ) -> RigidBodyHandle {
        let body = self.bodies.insert(RigidBodyBuilder::kinematic_position_based().pose(pose));
        for part in parts {
            let collider = ColliderBuilder::new(shared_shape(&part.shape))
                .position(collider_pose(part))
                .friction(friction)
                .friction_combine_rule(CoefficientCombineRule::Max)
                .active_hooks(NEVER_RECYCLED)
                .collision_groups(InteractionGroups::new(
                    ROBOT_GROUP,
                    SCENE_GROUP,
                    InteractionTestMode::And,
                ));
            self.colliders.insert_with_parent(collider, body, &mut self.bodies);
        }
        body
    }

    /// Adds a hinge or slide between two bodies.
    ///
    /// It gives way a little, as rails and hinges do: between a rigid joint and a kinematic hand a
    /// force would be undefined (in reduced coordinates it grows without bound, with rapier's
    /// default stiffness it depends on the solver's iterations).
    pub(super) fn insert_joint(
        &mut self,
        spec: &JointSpec,
        [parent, child]: [RigidBodyHandle; 2],
        params: &SimParams,
    ) -> ImpulseJointHandle {
        // The joint's own coordinate is zero at the start poses; its x axis is the axis of motion.
        let world_from_joint =
            Pose3::from_parts(spec.anchor, Quat::from_rotation_arc(Vec3::X, spec.axis));
        let frame_in =
            |body: RigidBodyHandle| self.bodies[body].position().inv_mul(&world_from_joint);
        let limits = spec.limits.map(|limit| limit - spec.start);
        let mut joint: GenericJoint = match spec.kind {
            JointKind::Revolute => RevoluteJointBuilder::new(Vec3::X)
                .limits(limits)
                .contacts_enabled(false)
                .build()
                .into(),
            JointKind::Prismatic => PrismaticJointBuilder::new(Vec3::X)
                .limits(limits)
                .contacts_enabled(false)
                .build()
                .into(),
        };
        joint.softness =
            SpringCoefficients::new(params.joint_frequency, params.joint_damping_ratio);
        joint.local_frame1 = frame_in(parent);
        joint.local_frame2 = frame_in(child);
        let axis = motion_axis(spec.kind);
        if spec.brake > 0.0 {
            joint.set_motor_model(axis, MotorModel::ForceBased).set_motor_velocity(
                axis,
                0.0,
                BRAKE_DAMPING,
            );
            joint.set_motor_max_force(axis, spec.brake);
        } else if spec.spring > 0.0 {
            let damping = SPRING_DAMPING_SECS * spec.spring;
            joint.set_motor_model(axis, MotorModel::ForceBased).set_motor_position(
                axis,
                0.0,
                spec.spring,
                damping,
            );
            // Held still for a while and let go, it would fall asleep on its way back.
            *self.bodies[child].activation_mut() = RigidBodyActivation::cannot_sleep();
        }
        self.impulse_joints.insert(parent, child, joint, true)
    }

    /// Lets a joint move within its limits, or keeps it where it was at the start. Wakes its bodies
    /// only when that changes.
    pub(super) fn set_latched(
        &mut self,
        joint: ImpulseJointHandle,
        spec: &JointSpec,
        latched: Latched,
    ) {
        let limits = match latched {
            Latched::Yes => [0.0; 2],
            Latched::No => spec.limits.map(|limit| limit - spec.start),
        };
        let axis = motion_axis(spec.kind);
        let is_set = |joint: &ImpulseJoint| {
            joint.data.limits(axis).is_some_and(|now| [now.min, now.max] == limits)
        };
        if self.impulse_joints.get(joint).is_some_and(is_set) {
            return;
        }
        if let Some(joint) = self.impulse_joints.get_mut(joint, true) {
            joint.data.set_limits(axis, limits);
        }
    }

    /// Colliders of a body.
    pub(super) fn colliders_of(&self, body: RigidBodyHandle) -> &[ColliderHandle] {
        self.bodies[body].colliders()
    }
}

/// State of a latch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Latched {
    Yes,
    No,
}

/// The free axis of a joint, whose x is the axis of motion.
fn motion_axis(kind: JointKind) -> JointAxis {
    match kind {
        JointKind::Revolute => JointAxis::AngX,
        JointKind::Prismatic => JointAxis::LinX,
    }
}

/// Collision groups of scene bodies that the robot may touch.
pub(super) fn scene_groups() -> InteractionGroups {
    InteractionGroups::new(SCENE_GROUP, SCENE_GROUP | ROBOT_GROUP, InteractionTestMode::And)
}

/// Collision groups of a body that is attached to the hand.
pub(super) fn held_groups() -> InteractionGroups {
    InteractionGroups::new(SCENE_GROUP, SCENE_GROUP, InteractionTestMode::And)
}

/// rapier's shape.
pub(in crate::sim) fn shared_shape(shape: &Shape) -> SharedShape {
    match shape {
        Shape::Sphere { radius } => SharedShape::ball(*radius),
        Shape::Cuboid { half_extents } => {
            SharedShape::cuboid(half_extents.x, half_extents.y, half_extents.z)
        }
        Shape::Cylinder { radius, half_length } => SharedShape::cylinder(*half_length, *radius),
        Shape::Capsule { radius, half_length } => {
            SharedShape::capsule(Vec3::Z * -*half_length, Vec3::Z * *half_length, *radius)
        }
        Shape::Convex { points } => SharedShape::convex_hull(points)
            .unwrap_or_else(|| SharedShape::cuboid(1e-4, 1e-4, 1e-4)),
    }
}

/// Pose of the collider in its body: rapier's cylinder lies along y, ours along z.
pub(in crate::sim) fn collider_pose(part: &Part) -> Pose3 {
    match part.shape {
        Shape::Cylinder { .. } => {
            part.pose * Pose3::from_rotation(Quat::from_rotation_x(core::f32::consts::FRAC_PI_2))
        }
        _ => part.pose,
    }
}
