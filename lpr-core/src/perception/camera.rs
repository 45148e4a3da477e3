//! Pinhole cameras and where they stand.
//!
//! Axes are `OpenCV`'s: z along the optical axis, x to the right of the image, y down. Image
//! coordinates are continuous: the pixel in column `c` and row `r` covers `[c, c+1) × [r, r+1)`,
//! its centre is at `(c + 0.5, r + 0.5)`.

use crate::check::one_of;
use crate::error::{Error, Result};
use crate::robot::Robot;
use glamx::{Mat3, Pose3, Quat, Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// Width and height of the images that the agent sees, pixels (as in the released code).
pub const IMAGE_SIZE: usize = 128;

/// Names that [`Camera::by_name`] knows.
pub const CAMERA_NAMES: [&str; 5] =
    ["front", "wrist", "left_shoulder", "right_shoulder", "overhead"];

/// Nearest depth that a camera sees, metres (`RLBench`'s wrist camera).
const NEAR: f32 = 0.01;
/// Farthest depth that a camera sees, metres (`RLBench`'s wrist camera).
const FAR: f32 = 10.0;

/// A pinhole camera without distortion.
///
/// ```
/// use lpr_core::glamx::{Vec2, Vec3};
/// use lpr_core::perception::Camera;
///
/// let target = Vec3::new(0.5, 0.0, 0.0);
/// let camera = Camera::looking_at("side", Vec3::new(0.5, -1.0, 0.0), target, 60_f32.to_radians());
/// let (image, depth) = camera.project(target).unwrap();
/// assert!(image.distance(Vec2::new(64.0, 64.0)) < 1e-3 && (depth - 1.0).abs() < 1e-6);
/// assert!(camera.unproject(image, depth).distance(target) < 1e-5);
/// assert_eq!(camera.project(Vec3::new(0.5, -2.0, 0.0)), None, "behind it");
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Name, as in [`CAMERA_NAMES`] for the built-in ones.
    pub name: String,
    /// Pose of the camera in the world.
    pub world_from_camera: Pose3,
    /// Focal length along the image's x, pixels.
    pub fx: f32,
    /// Focal length along the image's y, pixels.
    pub fy: f32,
    /// Column of the optical axis, pixels.
    pub cx: f32,
    /// Row of the optical axis, pixels.
    pub cy: f32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Nearest depth seen, metres.
    pub near: f32,
    /// Farthest depth seen, metres.
    pub far: f32,
}

impl Camera {
    /// A square camera of [`IMAGE_SIZE`] at `position` that looks along `direction`, with the
    /// world's z up in the image.
    ///
    /// Looking straight up or down, the top of the image points along the world's x, away from the
    /// robot.
    ///
    /// # Panics
    ///
    /// When `direction` is zero or `vertical_fov` (radians) is not between 0 and π.
    #[must_use]
    pub fn looking(name: &str, position: Vec3, direction: Vec3, vertical_fov: f32) -> Self {
        let pose = Pose3::from_parts(position, facing(direction, Vec3::Z));
        Self::at(name, pose, vertical_fov)
    }

    /// A square camera of [`IMAGE_SIZE`] at `position` with `target` in the middle of its image.
    ///
    /// # Panics
    ///
    /// When the two points coincide or `vertical_fov` (radians) is not between 0 and π.
    #[must_use]
    pub fn looking_at(name: &str, position: Vec3, target: Vec3, vertical_fov: f32) -> Self {
        Self::looking(name, position, target - position, vertical_fov)
    }

    /// A square camera of [`IMAGE_SIZE`] with the given pose.
    ///
    /// # Panics
    ///
    /// When `vertical_fov` (radians) is not between 0 and π.
    #[must_use]
    pub fn at(name: &str, world_from_camera: Pose3, vertical_fov: f32) -> Self {
        assert!(
            vertical_fov > 0.0 && vertical_fov < core::f32::consts::PI,
            "field of view: expected radians in (0, π), found {vertical_fov}"
        );
        let center = IMAGE_SIZE as f32 / 2.0;
        let focal = center / libm::tanf(0.5 * vertical_fov);
        Self {
            name: name.to_owned(),
            world_from_camera,
            fx: focal,
            fy: focal,
            cx: center,
            cy: center,
            width: IMAGE_SIZE,
            height: IMAGE_SIZE,
            near: NEAR,
            far: FAR,
        }
    }

    /// The same camera with another image size; the vertical field of view stays, the principal
    /// point is the centre.
    #[must_use]
    pub fn with_size(mut self, width: usize, height: usize) -> Self {
        let scale = height as f32 / self.height as f32;
        self.fx *= scale;
        self.fy *= scale;
        self.cx = width as f32 / 2.0;
        self.cy = height as f32 / 2.0;
        self.width = width;
        self.height = height;
        self
    }

    /// The name of a built-in camera.
    ///
    /// # Errors
    ///
    /// When there is none of that name, naming those that exist.
    pub fn known_name(name: &str) -> Result<&'static str> {
        CAMERA_NAMES.into_iter().find(|known| *known == name).ok_or_else(|| unknown_camera(name))
    }

    /// The built-in camera of that name, placed for `robot`; only `wrist` moves with the flange.
    ///
    /// ```
    /// use lpr_core::glamx::Pose3;
    /// use lpr_core::perception::Camera;
    /// use lpr_core::robot::XARM7;
    ///
    /// let world_from_flange = Pose3::from(XARM7.flange(&XARM7.start));
    /// let wrist = Camera::by_name("wrist", &XARM7, &world_from_flange)?;
    /// let (_, depth) = wrist.project(XARM7.grip(&XARM7.start).translation).unwrap();
    /// assert!(depth < 0.2, "metres from the camera to the fingertips");
    /// assert!(Camera::by_name("side", &XARM7, &world_from_flange).unwrap_err().to_string().contains("expected one of front, wrist"));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// When there is none, naming those that exist, and when the arm's workspace is not known.
    pub fn by_name(name: &str, robot: &Robot, world_from_flange: &Pose3) -> Result<Self> {
        match name {
            "front" => Self::front(robot),
            "wrist" => Ok(Self::wrist(robot, world_from_flange)),
            "left_shoulder" => Self::shoulder(name, robot, SHOULDER_SIDE),
            "right_shoulder" => Self::shoulder(name, robot, -SHOULDER_SIDE),
            "overhead" => Self::overhead(robot),
            _ => Err(unknown_camera(name)),
        }
    }

    /// `RLBench`'s front camera, the only one the paper uses: it faces the robot from 1.1 m beyond
    /// the workspace's centre.
    ///
    /// # Errors
    ///
    /// When the arm's workspace is not known: files describe none.
    pub fn front(robot: &Robot) -> Result<Self> {
        // Position (1.62, 0, 0.83) for the workspace centre (0.52, 0); 25° down; vertical field of
        // view 40°.
        let position = workspace_point(robot, Vec3::new(1.10, 0.0, 0.83))?;
        let (sin, cos) = libm::sincosf(25_f32.to_radians());
        let direction = Vec3::new(-cos, 0.0, -sin);
        Ok(Self::looking("front", position, direction, 40_f32.to_radians()))
    }

    /// A camera on the hand beside the fingers, looking at the tips; 60° as in `RLBench`, its mount
    /// is our choice.
    #[must_use]
    pub fn wrist(robot: &Robot, world_from_flange: &Pose3) -> Self {
        let flange_from_grip = Pose3::from(robot.flange_from_grip);
        let position = Vec3::new(0.075, 0.0, 0.03 - flange_from_grip.translation.z);
        let direction = Vec3::new(0.0, 0.0, 0.03) - position;
        let grip_from_camera = Pose3::from_parts(position, facing(direction, Vec3::X));
        Self::at(
            "wrist",
            world_from_flange * flange_from_grip * grip_from_camera,
            60_f32.to_radians(),
        )
    }

    /// A camera behind and beside the robot that looks over its shoulder at the workspace.
    fn shoulder(name: &str, robot: &Robot, side: f32) -> Result<Self> {
        let position = workspace_point(robot, Vec3::new(-0.55, side, 0.85))?;
        let target = workspace_point(robot, Vec3::new(0.05, 0.0, 0.10))?;
        Ok(Self::looking_at(name, position, target, 50_f32.to_radians()))
    }

    /// A camera above the workspace that looks straight down.
    fn overhead(robot: &Robot) -> Result<Self> {
        let position = workspace_point(robot, Vec3::new(0.0, 0.0, 1.45))?;
        Ok(Self::looking("overhead", position, Vec3::NEG_Z, 45_f32.to_radians()))
    }

    /// Image coordinates and depth along the optical axis (metres) of a point in the world.
    ///
    /// Coordinates may lie outside the image; `None` for a point nearer than [`Self::near`] or
    /// behind the camera.
    #[must_use]
    pub fn project(&self, point: Vec3) -> Option<(Vec2, f32)> {
        let local = self.world_from_camera.inverse_transform_point(point);
        (local.z >= self.near).then(|| {
            let image = Vec2::new(
                self.cx + self.fx * local.x / local.z,
                self.cy + self.fy * local.y / local.z,
            );
            (image, local.z)
        })
    }

    /// The point in the world at image coordinates `image` and `depth` metres along the optical
    /// axis.
    #[must_use]
    pub fn unproject(&self, image: Vec2, depth: f32) -> Vec3 {
        let ray = Vec3::new((image.x - self.cx) / self.fx, (image.y - self.cy) / self.fy, 1.0);
        self.world_from_camera.transform_point(ray * depth)
    }

    /// The points in the world that the pixels of a depth image see; `Vec3::INFINITY` where the
    /// depth is not finite.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::perception::{Camera, View};
    ///
    /// let camera = Camera::looking("down", Vec3::Z, Vec3::NEG_Z, 1.0).with_size(2, 2);
    /// let points = camera.unproject_image(&[0.9, 0.9, 0.9, View::NOTHING]);
    /// assert!(points[..3].iter().all(|point| (point.z - 0.1).abs() < 1e-6));
    /// assert_eq!(points[3], Vec3::INFINITY);
    /// ```
    #[must_use]
    pub fn unproject_image(&self, depth: &[f32]) -> Vec<Vec3> {
        let origin = self.world_from_camera.translation;
        let rotation = self.world_from_camera.rotation;
        let ray_per_column = rotation * Vec3::new(1.0 / self.fx, 0.0, 0.0);
        let mut points = Vec::with_capacity(depth.len());
        for (y, row) in depth.chunks(self.width.max(1)).enumerate() {
            let ray_left = rotation
                * Vec3::new((0.5 - self.cx) / self.fx, (y as f32 + 0.5 - self.cy) / self.fy, 1.0);
            points.extend(row.iter().enumerate().map(|(x, &z)| {
                let seen = origin + (ray_left + ray_per_column * x as f32) * z;
                if z.is_finite() { seen } else { Vec3::INFINITY }
            }));
        }
        points
    }

    /// Number of pixels.
    #[must_use]
    pub const fn n_pixels(&self) -> usize {
        self.width * self.height
    }
}

/// Distance of the shoulder cameras from the plane y = 0, metres.
const SHOULDER_SIDE: f32 = 0.75;

/// `offset` from the workspace's centre on the table.
fn workspace_point(robot: &Robot, offset: Vec3) -> Result<Vec3> {
    Ok(robot.workspace_center()?.extend(0.0) + offset)
}

/// The rotation whose z is `direction` and whose -y is as close to `up` as it can be (to x where
/// they are parallel).
fn facing(direction: Vec3, up: Vec3) -> Quat {
    let forward =
        direction.try_normalize().expect("a camera looks along a direction that is not zero");
    let right = forward.cross(up);
    let right = if right.length_squared() > 1e-6 { right } else { forward.cross(Vec3::X) };
    let right = right.try_normalize().expect("forward is parallel to at most one of the two axes");
    Quat::from_mat3(&Mat3::from_cols(right, forward.cross(right), forward))
}

fn unknown_camera(name: &str) -> Error {
    Error::Config(format!("camera: {}", one_of(CAMERA_NAMES, name)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{PANDA, ROBOTS};
    use proptest::prelude::*;

    #[test]
    fn front_camera_is_rlbenchs() {
        let camera = Camera::front(&PANDA).unwrap();
        assert!(
            (camera.fx - 175.8386).abs() < 1e-3 && camera.fx == camera.fy,
            "|f| printed by RLBench users: 175.8386"
        );
        assert!(
            (camera.world_from_camera.translation - Vec3::new(1.62, 0.0, 0.83)).length() < 1e-6
        );
        let axis = camera.world_from_camera.rotation * Vec3::Z;
        assert!((axis - Vec3::new(-0.906, 0.0, -0.423)).length() < 1e-3, "{axis}");
        let right = camera.world_from_camera.rotation * Vec3::X;
        assert!(
            (right - Vec3::Y).length() < 1e-6,
            "facing the robot, its left is on the right: {right}"
        );
    }

    #[test]
    fn every_camera_sees_the_workspace_the_right_way_up() {
        for robot in ROBOTS {
            let grip = robot.grip(&robot.start);
            let flange = Pose3::from(robot.flange(&robot.start));
            for name in CAMERA_NAMES {
                let camera = Camera::by_name(name, robot, &flange).expect("listed names are known");
                let seen = if name == "wrist" {
                    grip.translation
                } else {
                    workspace_point(robot, Vec3::new(0.0, 0.0, 0.1)).unwrap()
                };
                let (image, _) = camera.project(seen).expect("in front of the camera");
                let size = IMAGE_SIZE as f32;
                assert!(
                    image.cmpgt(Vec2::ZERO).all() && image.cmplt(Vec2::splat(size)).all(),
                    "{name}: {image}"
                );
                let down = camera.world_from_camera.rotation * Vec3::Y;
                // The hand's camera looks almost straight down: away from the robot is up.
                let down_reference =
                    if name == "wrist" { Vec3::NEG_X } else { Vec3::new(-0.1, 0.0, -1.0) };
                assert!(
                    down.dot(down_reference) > 0.09,
                    "{name} stands on its head: down is {down}"
                );
            }
        }
    }

    #[test]
    fn unknown_camera_names_the_known_ones() {
        let message = Camera::by_name("rear", &PANDA, &Pose3::IDENTITY)
            .expect_err("not built in")
            .to_string();
        assert!(message.contains("rear") && message.contains("overhead"), "{message}");
    }

    #[test]
    fn resizing_keeps_the_vertical_field_of_view() {
        let camera = Camera::front(&PANDA).unwrap();
        let wide = camera.clone().with_size(640, 360);
        let top_ray = |c: &Camera| c.cy / c.fy;
        assert!((top_ray(&camera) - top_ray(&wide)).abs() < 1e-6);
        assert_eq!(wide.fx, wide.fy);
    }

    proptest! {
        #[test]
        fn project_inverts_unproject(u in -50.0f32..200.0, v in -50.0f32..200.0, depth in 0.05f32..5.0) {
            let camera = Camera::front(&PANDA).unwrap();
            let (image, back) = camera.project(camera.unproject(Vec2::new(u, v), depth)).expect("in front of the camera");
            prop_assert!((image - Vec2::new(u, v)).length() < 2e-2 / depth.min(1.0), "{image}");
            prop_assert!((back - depth).abs() < 1e-5 * depth.max(1.0));
        }
    }
}
