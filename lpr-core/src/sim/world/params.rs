//! Physics settings, and rapier's integration parameters made of them: each that rigid bodies need
//! is named here, since rapier's defaults change between releases. Only the settings of its soft
//! bodies, which no scene has, are left to a default.

use rapier3d::prelude::{FrictionModel, IntegrationParameters, SpringCoefficients};
use serde::{Deserialize, Serialize};

/// Settings of the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimParams {
    /// Physics step, seconds.
    pub dt: f32,
    /// Solver substeps of one physics step.
    pub solver_iterations: usize,
    /// Natural frequency of contacts, Hz. rapier's 30 Hz lets fingers sink 6 mm into what they
    /// hold.
    pub contact_frequency: f32,
    /// Damping ratio of contacts.
    pub contact_damping_ratio: f32,
    /// Natural frequency of hinges and slides, Hz: off their axis they give way, by less than 3 mm
    /// and 1.3 degrees while a demonstrator pulls (a test). At 120 Hz a hand half a voxel off its
    /// arc is stopped by the force on a door.
    pub joint_frequency: f32,
    /// Damping ratio of hinges and slides.
    pub joint_damping_ratio: f32,
    /// Control step, seconds: how often success is tested and demonstrations are recorded.
    pub control_dt: f32,
    /// Force at which a closing finger stops, newtons.
    pub grip_force: f32,
    /// Speed of one finger while it closes or opens, m/s.
    pub finger_speed: f32,
    /// Distance by which a finger in contact gives way in one physics step per newton of force
    /// error, metres: it sets the grip force, and lets both fingers follow a handle sideways as a
    /// compliant arm does. The closing of heavy bodies is slower, see `GripperState::gain`.
    pub finger_compliance: f32,
    /// Greatest distance that the fingers follow sideways before they are rigid, metres: a third of
    /// a voxel of the last depth (0.30 m / 16 in the presets).
    pub finger_play: f32,
    /// Friction coefficient of the pads (combined by maximum with what they touch).
    pub pad_friction: f32,
    /// Contact force on a link, hand or finger that ends the episode, newtons.
    pub abort_force: f32,
    /// Penetration of the arm into a fixed body that ends the episode, metres.
    pub abort_penetration: f32,
    /// Friction coefficient of a body in a friction sweep is multiplied by this (1 in every
    /// preset).
    pub friction_scale: f32,
}

impl SimParams {
    /// The settings measured to hold small and heavy objects without slip.
    pub const STANDARD: Self = Self {
        dt: 0.01,
        solver_iterations: 4,
        contact_frequency: 120.0,
        contact_damping_ratio: 5.0,
        joint_frequency: 80.0,
        joint_damping_ratio: 2.0,
        control_dt: 0.05,
        grip_force: 30.0,
        finger_speed: 0.05,
        finger_compliance: 2.4e-6,
        finger_play: 0.006,
        pad_friction: 1.0,
        abort_force: 80.0,
        abort_penetration: 0.005,
        friction_scale: 1.0,
    };

    /// Physics steps per control step.
    #[must_use]
    pub fn steps_per_control(&self) -> usize {
        libm::roundf(self.control_dt / self.dt).max(1.0) as usize
    }

    /// rapier's parameters.
    pub(super) fn integration(&self) -> IntegrationParameters {
        IntegrationParameters {
            dt: self.dt,
            min_ccd_dt: self.dt / 100.0,
            contact_softness: SpringCoefficients::new(
                self.contact_frequency,
                self.contact_damping_ratio,
            ),
            static_contact_softness: SpringCoefficients::new(
                self.contact_frequency,
                self.contact_damping_ratio,
            ),
            warmstart_coefficient: 1.0,
            length_unit: 1.0,
            normalized_allowed_linear_error: 0.005,
            normalized_max_corrective_velocity: 3.0,
            // 5 mm: hollow and thin objects would be felt from 2 cm away.
            normalized_prediction_distance: 0.005,
            normalized_max_linear_velocity: 400.0,
            num_solver_iterations: self.solver_iterations,
            num_internal_pgs_iterations: 1,
            num_internal_stabilization_iterations: 1,
            max_ccd_substeps: 1,
            contact_clustering: true,
            // A pair is not looked at again until it has moved: at rapier's 5 cm objects sink into
            // each other, at a hundredth of a millimetre this spares what lies still. Not for the
            // robot's pairs, see `physics::NEVER_RECYCLED`.
            contact_recycling: true,
            normalized_contact_recycle_distance: 1e-5,
            // Off, objects of 2 cm are dropped and drawers coast.
            friction_in_bias_pass: true,
            warmstart_joints: false,
            friction_model: FrictionModel::Coulomb,
            ..IntegrationParameters::default()
        }
    }
}
