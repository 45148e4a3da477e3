//! Random changes of a scene's look: colours, light and the places of the cameras.
//!
//! Off unless it is asked for. Every draw is a function of the seed, so that a scene looks the same
//! for a whole episode.

use super::render::Light;
use crate::perception::{Camera, DepthNoise};
use crate::rng::{Rng, Stream, normal, stream};
use glamx::{Pose3, Quat, Vec3};
use rand::RngExt as _;

/// Indices of the streams' generators begin here: those below are the tasks'.
const FIRST_INDEX: u64 = 1 << 40;
/// Index of the light's generator; those of bodies are below.
const LIGHT_INDEX: u64 = FIRST_INDEX + (1 << 32);
/// Bits of an index that hold the camera; those above hold the step.
const CAMERA_BITS: u32 = 8;

/// Cameras' errors and scenes' looks.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensing {
    /// Errors of the depth of every camera.
    pub noise: DepthNoise,
    /// Changes of the looks from scene to scene.
    pub randomization: Randomization,
}

/// Changes of the looks from scene to scene: everything is uniform within ± these, and off at zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Randomization {
    /// Of each colour channel of each body (the robot is one), as a share of its whole range.
    pub color: f32,
    /// Angle of the light from where it stands otherwise, radians: within a cone, not ±.
    pub light_angle: f32,
    /// Of the light's intensity, as a share of it.
    pub light_intensity: f32,
    /// Of the ambient light, as a share of it.
    pub ambient: f32,
    /// Of a camera's position along each of its axes, metres. The camera knows where it stands: a
    /// cloud stays true.
    pub camera_position: f32,
    /// Angle by which a camera is turned about any axis, radians: at most, not ±.
    pub camera_angle: f32,
}

impl Randomization {
    /// None at all.
    pub const OFF: Self = Self {
        color: 0.0,
        light_angle: 0.0,
        light_intensity: 0.0,
        ambient: 0.0,
        camera_position: 0.0,
        camera_angle: 0.0,
    };

    /// As much as a table in another room at another time of day would differ; our choice.
    pub const MODERATE: Self = Self {
        color: 0.12,
        light_angle: 0.5,
        light_intensity: 0.3,
        ambient: 0.2,
        camera_position: 0.015,
        camera_angle: 0.03,
    };

    /// The shift that is added to the channels of the colours of `body`.
    pub(super) fn color_shift(&self, seed: u64, body: usize) -> [f32; 3] {
        let rng = &mut stream(seed, Stream::Colour, FIRST_INDEX + body as u64);
        core::array::from_fn(|_| 255.0 * within(self.color, rng))
    }

    /// The light.
    pub(super) fn light(&self, seed: u64) -> Light {
        let rng = &mut stream(seed, Stream::Colour, LIGHT_INDEX);
        let Light { to_light, ambient, intensity } = Light::STANDARD;
        Light {
            to_light: turn(self.light_angle, rng) * to_light,
            ambient: ambient * (1.0 + within(self.ambient, rng)),
            intensity: intensity * (1.0 + within(self.light_intensity, rng)),
        }
    }

    /// The camera where it stands in this scene.
    pub(super) fn moved(&self, seed: u64, camera_idx: u64, mut camera: Camera) -> Camera {
        let rng = &mut stream(seed, Stream::Noise, FIRST_INDEX + camera_idx);
        let shift = Vec3::from_array(core::array::from_fn(|_| within(self.camera_position, rng)));
        camera.world_from_camera *= Pose3::from_parts(shift, turn(self.camera_angle, rng));
        camera
    }
}

/// The generator of a camera's noise in one step: it depends on nothing else, so that looking twice
/// gives the same image.
pub(super) fn noise_stream(seed: u64, step: usize, camera_idx: u64) -> Rng {
    stream(seed, Stream::Noise, ((step as u64) << CAMERA_BITS) | camera_idx)
}

/// Uniform within ± `most`.
fn within(most: f32, rng: &mut Rng) -> f32 {
    most * (2.0 * rng.random::<f32>() - 1.0)
}

/// A turn by at most `most` radians about an axis of any direction.
fn turn(most: f32, rng: &mut Rng) -> Quat {
    let axis = Vec3::new(normal(rng), normal(rng), normal(rng)).normalize_or(Vec3::Z);
    Quat::from_axis_angle(axis, most * rng.random::<f32>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::PANDA;

    #[test]
    fn off_changes_nothing() {
        assert_eq!(Randomization::OFF.color_shift(1, 2), [0.0; 3]);
        assert_eq!(Randomization::OFF.light(1), Light::STANDARD);
        let camera = Camera::front(&PANDA).unwrap();
        assert_eq!(Randomization::OFF.moved(1, 0, camera.clone()), camera);
    }

    #[test]
    fn draws_stay_within_what_they_are_limited_to_and_use_it() {
        let most = &Randomization::MODERATE;
        let (standard, camera) = (Light::STANDARD, Camera::front(&PANDA).unwrap());
        let (mut widest_angle, mut widest_color) = (0.0_f32, 0.0_f32);
        for seed in 0..200 {
            let light = most.light(seed);
            let angle = light.to_light.angle_between(standard.to_light);
            assert!(
                angle <= most.light_angle + 1e-3
                    && (light.intensity / standard.intensity - 1.0).abs()
                        <= most.light_intensity + 1e-5
            );
            assert!((light.ambient / standard.ambient - 1.0).abs() <= most.ambient + 1e-5);
            let moved = camera.world_from_camera.inverse()
                * most.moved(seed, 0, camera.clone()).world_from_camera;
            assert!(moved.translation.abs().max_element() <= most.camera_position + 1e-5);
            assert!(moved.rotation.angle_between(Quat::IDENTITY) <= most.camera_angle + 1e-3);
            let color = most.color_shift(seed, 1).map(f32::abs).into_iter().fold(0.0, f32::max);
            assert!(color <= 255.0 * most.color);
            (widest_angle, widest_color) = (widest_angle.max(angle), widest_color.max(color));
        }
        assert!(widest_angle > 0.8 * most.light_angle && widest_color > 0.9 * 255.0 * most.color);
    }

    #[test]
    fn bodies_cameras_and_seeds_differ() {
        let most = &Randomization::MODERATE;
        assert_ne!(most.color_shift(1, 0), most.color_shift(1, 1));
        assert_ne!(most.color_shift(1, 0), most.color_shift(2, 0));
        let camera = Camera::front(&PANDA).unwrap();
        assert_ne!(most.moved(1, 0, camera.clone()), most.moved(1, 1, camera));
    }
}
