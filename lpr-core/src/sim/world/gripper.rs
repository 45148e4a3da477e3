//! The gripper's state and geometry: one width for both fingers and a force stop.

use super::params::SimParams;
use crate::robot::{Gripper, GripperBox, GripperSpec};
use crate::scene::{Part, Shape};
use glamx::{Pose3, Vec3};
use rapier3d::prelude::ImpulseJointHandle;
use serde::{Deserialize, Serialize};

/// Colour of the pads.
const PAD_RGB: [u8; 3] = [40, 40, 45];
/// Colour of the fingers.
const FINGER_RGB: [u8; 3] = [90, 92, 98];

/// Physics steps by which contact forces lag behind the fingers.
const FORCE_LEAD_STEPS: f32 = 4.0;
/// Share of the grip force from which a handle counts as held, and within which of it the force
/// counts as calm.
pub(super) const FIRM: f32 = 0.8;
/// Share of the grip force by which the force has to swing to and fro for the regulator to become
/// slower: rapier's contacts are as much stiffer as bodies are heavier, and what holds a lid's bar
/// would drop a kilogram.
const SWING: f32 = 0.2;
/// By what the regulator's gain is multiplied when the force swings, and in every other physics
/// step.
const GAIN_CUT: f32 = 0.5;
const GAIN_GROWTH: f32 = 1.1;
/// Least share of the compliance.
const MIN_GAIN: f32 = 0.05;

/// State of the gripper's grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Grasp {
    /// Nothing.
    Nothing,
    /// Something between the pads that is not attached: a handle.
    Pinched,
    /// A free object, attached to the hand.
    Attached {
        /// Body index in the scene.
        body: usize,
    },
}

/// State of the gripper.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct GripperState {
    pub(super) width: f32,
    pub(super) command: Gripper,
    pub(super) grasp: Grasp,
    /// Distance by which both fingers have given way along the grip's y, metres.
    pub(super) offset: f32,
    /// Contact forces of the fingers at +y and -y after the last step, newtons.
    pub(super) forces: [f32; 2],
    /// The forces one step earlier.
    pub(super) last_forces: [f32; 2],
    /// Lack of grip force when the fingers last moved, newtons.
    last_error: f32,
    /// Share of the compliance that is in use: less while the force swings about what it should be.
    gain: f32,
    pub(super) attachment: Option<ImpulseJointHandle>,
    /// An object released but still between the pads, with the width at its release.
    pub(super) released: Option<(usize, f32)>,
}

impl GripperState {
    pub(super) fn open(spec: &GripperSpec) -> Self {
        Self {
            width: spec.max_width,
            command: Gripper::Open,
            grasp: Grasp::Nothing,
            offset: 0.0,
            forces: [0.0; 2],
            last_forces: [0.0; 2],
            last_error: 0.0,
            gain: 1.0,
            attachment: None,
            released: None,
        }
    }

    /// Moves both fingers by one physics step: towards the command, or in contact towards the grip
    /// force.
    pub(super) fn advance(&mut self, params: &SimParams, spec: &GripperSpec) {
        let travel = 2.0 * params.finger_speed * params.dt;
        let [left, right] = self.expected_forces();
        match self.command {
            Gripper::Open => {
                self.width = (self.width + travel).min(spec.max_width);
                self.offset -= self.offset.clamp(-0.5 * travel, 0.5 * travel);
                (self.gain, self.last_error) = (1.0, 0.0);
            }
            Gripper::Close if self.attachment.is_some() => {}
            Gripper::Close if self.forces == [0.0; 2] => {
                self.width = (self.width - travel).max(0.0);
            }
            Gripper::Close => {
                // One motor drives both fingers: it feels their mean; the difference pushes the
                // hand sideways.
                let error = params.grip_force - 0.5 * (left + right);
                self.adapt_gain(error, params);
                let closing =
                    (2.0 * params.finger_compliance * self.gain * error).clamp(-travel, travel);
                self.width = (self.width - closing).clamp(0.0, spec.max_width);
                let sideways = params.finger_compliance * (left - right);
                self.offset =
                    (self.offset + sideways).clamp(-params.finger_play, params.finger_play);
            }
        }
    }

    /// Slows the regulator when the force has passed from well below what it should be to well
    /// above, or back.
    fn adapt_gain(&mut self, error: f32, params: &SimParams) {
        let swings = error * self.last_error < 0.0
            && error.abs().min(self.last_error.abs()) > SWING * params.grip_force;
        let factor = if swings { GAIN_CUT } else { GAIN_GROWTH };
        self.gain = (factor * self.gain).clamp(MIN_GAIN, 1.0);
        self.last_error = error;
    }

    /// The forces a few steps ahead: contacts answer late, and a regulator on the last forces alone
    /// would oscillate.
    fn expected_forces(&self) -> [f32; 2] {
        core::array::from_fn(|side| {
            let trend = self.forces[side] - self.last_forces[side];
            (self.forces[side] + FORCE_LEAD_STEPS * trend).max(0.0)
        })
    }

    pub(super) fn settled(&self, params: &SimParams, spec: &GripperSpec) -> bool {
        match (self.command, self.grasp) {
            (Gripper::Open, _) => self.width >= spec.max_width,
            (Gripper::Close, Grasp::Nothing) => self.width <= 0.0,
            (Gripper::Close, Grasp::Attached { .. }) => true,
            (Gripper::Close, Grasp::Pinched) => self.is_calm(params),
        }
    }

    /// Tells if the grip force has come near what it will stay at: contacts answer late, so it
    /// first goes far beyond, and is right for a moment on the way there.
    fn is_calm(&self, params: &SimParams) -> bool {
        let tolerance = (1.0 - FIRM) * params.grip_force;
        let is_near =
            |[left, right]: [f32; 2]| (0.5 * (left + right) - params.grip_force).abs() < tolerance;
        is_near(self.forces) && is_near(self.expected_forces())
    }
}

/// Poses of the two fingers: at the inner faces of the pads, axes of the grip.
pub(super) fn finger_poses(world_from_grip: &Pose3, width: f32, offset: f32) -> [Pose3; 2] {
    [0.5, -0.5]
        .map(|side| *world_from_grip * Pose3::from_translation(Vec3::Y * (offset + side * width)))
}

/// Geometry of the two fingers in their own frames: the pad and the body that carries it.
pub(super) fn finger_parts(spec: &GripperSpec) -> [Vec<Part>; 2] {
    spec.fingers(0.0).map(|finger| {
        let part = |shape: &GripperBox, rgb| {
            Part::new(Shape::Cuboid { half_extents: shape.half_extents }, shape.pose(), rgb)
        };
        vec![part(&finger.pad, PAD_RGB), part(&finger.body, FINGER_RGB)]
    })
}
