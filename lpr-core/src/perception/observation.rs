//! One observation: what the cameras see and what the arm feels, and nothing else.
//!
//! The agent gets this type only, so no simulator state, mask or demonstrator can reach it.

use super::camera::Camera;
use crate::robot::JointConfig;
use glamx::{Pose3, Quat, Vec3};

/// Length of [`Proprio::low_dim`].
pub const LOW_DIM: usize = 11;

/// A closed gripper whose pads are farther apart than this holds something, metres.
const HELD_WIDTH: f32 = 0.002;
/// Opening above which the gripper counts as open, as a fraction of its full width (`RLBench`).
const OPEN_FRACTION: f32 = 0.9;
/// Limit to which finger positions are clipped in [`Proprio::low_dim`], metres (`RLBench`; the
/// Panda's stroke).
const MAX_FINGER_POSITION: f32 = 0.04;

/// The image of one camera, row by row from the top left; every buffer has `camera.n_pixels()`
/// elements.
///
/// A pixel that sees nothing between the near and far plane has depth [`View::NOTHING`] and the
/// point `Vec3::INFINITY`; no buffer ever holds NaN.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::perception::{Camera, View};
///
/// let mut view = View::empty(Camera::looking("down", Vec3::Z, Vec3::NEG_Z, 1.0).with_size(4, 4));
/// assert_eq!(view.colored_points().count(), 0, "what sees nothing gives no point");
/// (view.points[5], view.rgb[5]) = (Vec3::new(0.1, 0.0, 0.2), [200, 30, 30]);
/// assert!(view.colored_points().eq([(Vec3::new(0.1, 0.0, 0.2), [200, 30, 30])]));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The camera, where it stood.
    pub camera: Camera,
    /// Colour, sRGB.
    pub rgb: Vec<[u8; 3]>,
    /// Depth along the optical axis, metres.
    pub depth: Vec<f32>,
    /// The point in the world that each pixel sees, metres.
    pub points: Vec<Vec3>,
}

impl View {
    /// Depth of a pixel that sees nothing.
    pub const NOTHING: f32 = f32::INFINITY;

    /// The view of a camera that sees nothing, all black.
    #[must_use]
    pub fn empty(camera: Camera) -> Self {
        let n = camera.n_pixels();
        Self {
            camera,
            rgb: vec![[0; 3]; n],
            depth: vec![Self::NOTHING; n],
            points: vec![Vec3::INFINITY; n],
        }
    }

    /// The points that pixels see, with their colours, in the order of the pixels.
    pub fn colored_points(&self) -> impl Iterator<Item = (Vec3, [u8; 3])> + '_ {
        self.points
            .iter()
            .zip(&self.rgb)
            .filter(|(point, _)| point.is_finite())
            .map(|(&point, &rgb)| (point, rgb))
    }
}

/// The arm's measurement of itself: `z` in the paper.
///
/// ```
/// use lpr_core::env::EPISODE_LENGTH;
/// use lpr_core::perception::{LOW_DIM, Proprio, time_feature};
/// use lpr_core::robot::PANDA;
///
/// let proprio = Proprio {
///     joints: PANDA.start,
///     gripper_width: 0.06,
///     gripper_open: Proprio::openness(0.06, PANDA.gripper().unwrap().max_width),
///     finger_positions: [0.03; 2],
///     grip: PANDA.grip(&PANDA.start),
///     time: time_feature(0, EPISODE_LENGTH),
/// };
/// let features: [f32; LOW_DIM] = proprio.low_dim();
/// assert_eq!((features[0], features[10]), (0.0, 1.0), "three quarters open are not open; the episode begins");
/// assert_eq!(features[1..4], proprio.grip.translation.to_array());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proprio {
    /// Measured joint angles, radians.
    pub joints: JointConfig,
    /// Distance between the finger pads, metres.
    pub gripper_width: f32,
    /// 1 for an open gripper, as a network input: see [`Proprio::openness`].
    pub gripper_open: f32,
    /// Position of each finger from closed, metres.
    pub finger_positions: [f32; 2],
    /// Pose of `grip` in the world.
    pub grip: Pose3,
    /// Time feature: see [`time_feature`].
    pub time: f32,
}

impl Proprio {
    /// 1 when the pads are more than nine tenths of `max_width` (metres) apart, else 0.
    #[must_use]
    pub fn openness(gripper_width: f32, max_width: f32) -> f32 {
        f32::from(u8::from(gripper_width > OPEN_FRACTION * max_width))
    }

    /// True if the gripper closed on something.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.gripper_open < 0.5 && self.gripper_width > HELD_WIDTH
    }

    /// The network's input: gripper open (1), grip position (3) and quaternion xyzw (4), finger
    /// positions (2), time (1).
    ///
    /// Joint angles are not in it, as in `RLBench`. Of the two quaternions of an orientation it
    /// holds the one with x >= 0, not w >= 0: a gripper that points straight down has w = 0, where
    /// the sign would flip with the last bit.
    #[must_use]
    pub fn low_dim(&self) -> [f32; LOW_DIM] {
        let position = self.grip.translation;
        let rotation = positive_x(self.grip.rotation);
        let [left, right] =
            self.finger_positions.map(|finger| finger.clamp(0.0, MAX_FINGER_POSITION));
        [
            self.gripper_open,
            position.x,
            position.y,
            position.z,
            rotation.x,
            rotation.y,
            rotation.z,
            rotation.w,
            left,
            right,
            self.time,
        ]
    }
}

/// The time feature of macro step `step` (from 0): +1 at the first to -1 at the last step of an
/// episode.
#[must_use]
pub fn time_feature(step: usize, episode_length: usize) -> f32 {
    if episode_length < 2 {
        return 1.0;
    }
    1.0 - 2.0 * step.min(episode_length - 1) as f32 / (episode_length - 1) as f32
}

/// Everything the agent gets to see in one step: `o` in the paper.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// One view per camera.
    pub views: Vec<View>,
    /// The arm's measurement of itself.
    pub proprio: Proprio,
}

impl Observation {
    /// The points that the pixels of all views see, with their colours.
    pub fn colored_points(&self) -> impl Iterator<Item = (Vec3, [u8; 3])> + '_ {
        self.views.iter().flat_map(View::colored_points)
    }
}

/// Orientation as the first two columns of its matrix: continuous, unlike quaternions and Euler
/// angles (Zhou et al. 2019).
#[cfg(feature = "learn")]
#[must_use]
pub(crate) fn rotation_columns(rotation: Quat) -> [f32; 6] {
    let rotation = glamx::Mat3::from_quat(rotation);
    let ([a, b, c], [d, e, f]) = (rotation.x_axis.to_array(), rotation.y_axis.to_array());
    [a, b, c, d, e, f]
}

/// The same orientation with the sign that makes x positive.
fn positive_x(rotation: Quat) -> Quat {
    if rotation.x < 0.0 { -rotation } else { rotation }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{PANDA, ROBOTS};

    fn proprio() -> Proprio {
        Proprio {
            joints: PANDA.start,
            gripper_width: 0.08,
            gripper_open: 1.0,
            finger_positions: [0.0425, 0.01],
            grip: Pose3::from_parts(
                Vec3::new(0.4, -0.1, 0.3),
                Quat::from_xyzw(-1.0, 0.0, 0.0, 0.0),
            ),
            time: 0.5,
        }
    }

    #[test]
    fn low_dim_has_the_documented_order_and_clips_the_fingers() {
        assert_eq!(proprio().low_dim(), [1.0, 0.4, -0.1, 0.3, 1.0, 0.0, 0.0, 0.0, 0.04, 0.01, 0.5]);
    }

    #[test]
    fn both_quaternions_of_an_orientation_give_the_same_input() {
        let mut negated = proprio();
        negated.grip.rotation = -negated.grip.rotation;
        assert_eq!(negated.low_dim(), proprio().low_dim());
    }

    #[test]
    fn start_orientations_are_far_from_where_the_quaternion_changes_sign() {
        for robot in ROBOTS {
            let x = robot.grip(&robot.start).rotation.x.abs();
            assert!(x > 0.7, "{}: |x| = {x}", robot.name);
        }
    }

    #[test]
    fn time_runs_from_plus_one_to_minus_one() {
        assert_eq!(time_feature(0, 10), 1.0);
        assert_eq!(time_feature(9, 10), -1.0);
        assert_eq!(time_feature(12, 10), -1.0, "later steps than the last stay there");
        assert_eq!(time_feature(0, 1), 1.0);
    }

    #[test]
    fn openness_needs_nine_tenths_of_the_stroke() {
        assert_eq!(Proprio::openness(0.073, 0.08), 1.0);
        assert_eq!(Proprio::openness(0.072, 0.08), 0.0);
    }

    #[test]
    fn empty_pixels_give_no_points() {
        let mut view = View::empty(Camera::front(&PANDA).unwrap());
        view.points[77] = Vec3::new(0.1, 0.2, 0.3);
        view.rgb[77] = [9, 8, 7];
        let observation = Observation { views: vec![view.clone(), view], proprio: proprio() };
        let points: Vec<_> = observation.colored_points().collect();
        assert_eq!(points, [(Vec3::new(0.1, 0.2, 0.3), [9, 8, 7]); 2]);
    }
}
