//! Reports of the controller of itself.

use super::Controller;
use crate::wire::{
    ArmReading, FastReport, Health, NormalReport, Power, RealtimeReport, Report, ReportKind,
    RichReport,
};
use lpr_core::glamx::DPose3;
use lpr_core::robot::{DOF, JointConfig, XARM7};

impl Controller {
    /// The report of this moment.
    pub(in crate::emulator) fn report(&self, kind: ReportKind) -> Report {
        let arm = ArmReading {
            state: self.state,
            mode: self.mode,
            queued: self.queue.len() as u16,
            joints: self.world.joints(),
            pose: self.tcp(),
            torques: [0.0; DOF],
        };
        match kind {
            ReportKind::Fast => Report::Fast(self.fast_report()),
            ReportKind::Realtime => Report::Realtime(RealtimeReport {
                arm,
                external_force: [0.0; 6],
                raw_force: [0.0; 6],
            }),
            ReportKind::Normal => Report::Normal(NormalReport { arm, health: self.health() }),
            ReportKind::Rich => Report::Rich(Box::new(self.rich_report(arm))),
        }
    }

    fn fast_report(&self) -> FastReport {
        let tcp = DPose3::from(self.tcp());
        let (axis, angle) = tcp.rotation.to_axis_angle();
        FastReport {
            micros: self.micros(),
            state: self.state,
            mode: self.mode,
            queued: self.queue.len() as u16,
            target: self.servo_target.unwrap_or(self.setpoint),
            joints: self.world.joints(),
            joint_speeds: self.speeds,
            position: tcp.translation.to_array(),
            axis_angle: (axis * angle).as_vec3().to_array(),
        }
    }

    fn health(&self) -> Health {
        let drives = if self.drives == Power::On { u8::MAX } else { 0 };
        Health {
            brakes: drives,
            drives,
            error: self.error,
            warning: self.warning,
            tcp_offset: self.flange_from_tcp,
            load_mass: 0.0,
            load_center: [0.0; 3],
            collision_sensitivity: self.collision_sensitivity,
            teach_sensitivity: self.teach_sensitivity,
            gravity: [0.0, 0.0, -1.0],
        }
    }

    /// Limits as the vendor's documents give them.
    fn rich_report(&self, arm: ArmReading) -> RichReport {
        RichReport {
            arm,
            health: self.health(),
            firmware: format!("v{}", self.firmware),
            tcp_limits: [100.0, 0.001, 50.0, 0.0001, 1.0],
            joint_limits: [500.0, 0.01, 20.0, 0.0001, core::f32::consts::PI],
            tcp_speed: self.tcp_speed(),
            joint_speeds: self.speeds,
        }
    }

    /// Speed of the flange, m/s.
    fn tcp_speed(&self) -> f64 {
        /// Seconds over which the velocity is a difference.
        const STEP: f64 = 1e-3;
        let joints = self.world.joints();
        let after = JointConfig::from_fn(DOF, |j| joints[j] + self.speeds[j] * STEP as f32);
        (XARM7.flange(&after).translation - XARM7.flange(&joints).translation).length() / STEP
    }
}
