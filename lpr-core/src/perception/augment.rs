//! Augmentation of point clouds: a turn about the vertical and a shift.
//!
//! The released C2F-ARM has none; it is `PerAct`'s, which turns by up to ±45° and shifts by up to
//! ±0.125 m.

use glamx::{Pose3, Quat, Vec3};
use serde::{Deserialize, Serialize};

/// A turn about a vertical axis, then a shift; points and the poses that label them move together.
///
/// ```
/// use core::f32::consts::FRAC_PI_2;
/// use lpr_core::glamx::Vec3;
/// use lpr_core::perception::PointTransform;
///
/// let turn = PointTransform { yaw: FRAC_PI_2, shift: Vec3::new(0.0, 0.0, 0.1), about: Vec3::X };
/// let (moved, rgb) = turn.apply([(Vec3::ZERO, [9, 9, 9])]).next().unwrap();
/// assert!(moved.distance(Vec3::new(1.0, -1.0, 0.1)) < 1e-6 && rgb == [9, 9, 9]);
/// assert_eq!(turn.pose() * Vec3::ZERO, moved);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointTransform {
    /// Angle about the world's z, radians.
    pub yaw: f32,
    /// Shift after the turn, metres.
    pub shift: Vec3,
    /// A point on the axis of the turn, metres.
    pub about: Vec3,
}

impl PointTransform {
    /// The transform as a pose: `moved = pose() * point`.
    ///
    /// Apply it to points before they are voxelised and to poses in the world, such as the grip's
    /// or the next-best pose.
    #[must_use]
    pub fn pose(&self) -> Pose3 {
        let (sin, cos) = libm::sincosf(0.5 * self.yaw);
        let rotation = Quat::from_xyzw(0.0, 0.0, sin, cos);
        Pose3::from_parts(self.about + self.shift - rotation * self.about, rotation)
    }

    /// `points` moved; colours and order stay.
    pub fn apply<P>(&self, points: P) -> impl Iterator<Item = (Vec3, [u8; 3])> + use<P>
    where
        P: IntoIterator<Item = (Vec3, [u8; 3])>,
    {
        let pose = self.pose();
        points.into_iter().map(move |(point, rgb)| (pose * point, rgb))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::FRAC_PI_2;

    #[test]
    fn a_quarter_turn_about_a_point_and_a_shift() {
        let transform = PointTransform {
            yaw: FRAC_PI_2,
            shift: Vec3::new(0.0, 0.0, 0.1),
            about: Vec3::new(0.5, 0.0, 7.0),
        };
        let moved: Vec<_> = transform.apply([(Vec3::new(0.7, 0.0, 0.2), [1, 2, 3])]).collect();
        assert!((moved[0].0 - Vec3::new(0.5, 0.2, 0.3)).length() < 1e-6, "{}", moved[0].0);
        assert_eq!(moved[0].1, [1, 2, 3]);
    }

    #[test]
    fn poses_move_with_the_points_seen_from_them() {
        let transform = PointTransform {
            yaw: 0.7,
            shift: Vec3::new(0.1, -0.05, 0.02),
            about: Vec3::new(0.5, 0.1, 0.0),
        };
        let grip = Pose3::new(Vec3::new(0.4, 0.2, 0.3), Vec3::new(3.0, 0.2, 0.1));
        let point = Vec3::new(0.45, 0.25, 0.1);
        let (moved_grip, moved_point) = (transform.pose() * grip, transform.pose() * point);
        let difference =
            grip.inverse_transform_point(point) - moved_grip.inverse_transform_point(moved_point);
        assert!(difference.length() < 1e-6, "{difference}");
    }
}
