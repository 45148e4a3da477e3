//! The pose of the tool as the controller counts it: metres here, millimetres on the wire, roll,
//! pitch and yaw in radians.

use super::bytes::{Reader, Writer, metres, millimetres};
use core::f64::consts::PI;
use lpr_core::glamx::{DPose3, DQuat, DVec3};

/// `world_from_tool`; the rotation is `Rz(yaw) Ry(pitch) Rx(roll)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TcpPose {
    /// Metres.
    pub position: [f64; 3],
    /// Roll, pitch and yaw, radians.
    pub rpy: [f64; 3],
}

impl TcpPose {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let [x, y, z, roll, pitch, yaw] = reader.f32s()?;
        Some(Self { position: [x, y, z].map(metres), rpy: [roll, pitch, yaw].map(f64::from) })
    }

    pub(super) fn write(&self, writer: &mut Writer) {
        writer.f32s(&self.position.map(millimetres)).f32s(&self.rpy.map(|angle| angle as f32));
    }
}

impl From<DPose3> for TcpPose {
    /// At a pitch of ±90° roll and yaw are one rotation: the roll is 0 there.
    fn from(pose: DPose3) -> Self {
        let (x, y, z) =
            (pose.rotation * DVec3::X, pose.rotation * DVec3::Y, pose.rotation * DVec3::Z);
        let level = x.x.hypot(x.y);
        let pitch = f64::atan2(-x.z, level);
        let (roll, yaw) = if level > 1e-9 {
            (f64::atan2(y.z, z.z), f64::atan2(x.y, x.x))
        } else {
            (0.0, f64::atan2(-y.x, y.y))
        };
        Self { position: pose.translation.to_array(), rpy: [upward(roll), pitch, upward(yaw)] }
    }
}

/// Half a turn is +π, whichever way rounding went.
fn upward(angle: f64) -> f64 {
    if angle < -PI + 1e-9 { angle + 2.0 * PI } else { angle }
}

impl From<TcpPose> for DPose3 {
    fn from(TcpPose { position, rpy: [roll, pitch, yaw] }: TcpPose) -> Self {
        let rotation = DQuat::from_rotation_z(yaw)
            * DQuat::from_rotation_y(pitch)
            * DQuat::from_rotation_x(roll);
        Self::from_parts(DVec3::from_array(position), rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lpr_core::robot::{DOF, JointConfig, XARM7};

    #[test]
    fn the_arm_stretched_out_is_where_the_vendor_says() {
        let pose = TcpPose::from(XARM7.flange(&JointConfig::new([0.0; DOF])));
        for (found, expected) in pose.position.into_iter().zip([0.206, 0.0, 0.1205]) {
            assert!((found - expected).abs() < 1e-9, "{pose:?}");
        }
        for (found, expected) in pose.rpy.into_iter().zip([PI, 0.0, 0.0]) {
            assert!((found - expected).abs() < 1e-9, "{pose:?}");
        }
    }

    #[test]
    fn roll_pitch_and_yaw_come_back_as_the_same_rotation() {
        for roll in [-3.0, -0.4, 0.0, 2.5] {
            for pitch in [-PI / 2.0, -1.2, 0.0, 0.7, PI / 2.0] {
                for yaw in [-2.0, 0.0, 3.1] {
                    let pose = DPose3::from(TcpPose {
                        position: [0.1, -0.2, 0.3],
                        rpy: [roll, pitch, yaw],
                    });
                    let again = DPose3::from(TcpPose::from(pose));
                    assert!(
                        pose.rotation.angle_between(again.rotation) < 1e-6,
                        "{roll} {pitch} {yaw}"
                    );
                }
            }
        }
    }
}
