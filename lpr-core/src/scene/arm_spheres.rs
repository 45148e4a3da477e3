//! The robot as spheres, compiled for collision checks.

use super::primitive::length;
use crate::robot::{DOF, HAND, JointConfig, N_LINKS, Robot, Sphere};
use glamx::{Pose3, Vec3};

/// The spheres of a robot, its kinematics in f32 and the pairs of links that may meet.
#[derive(Debug, Clone)]
pub struct ArmSpheres {
    joints: [JointRow; DOF],
    link7_from_flange: Frame,
    links: [LinkSpheres; N_LINKS],
    self_pairs: Vec<(usize, usize)>,
}

/// The spheres of one link and a sphere around all of them, in the link's frame.
#[derive(Debug, Clone)]
pub(super) struct LinkSpheres {
    pub(super) bound: Sphere,
    pub(super) spheres: Vec<Sphere>,
}

/// A modified-DH row in f32.
#[derive(Debug, Clone, Copy)]
struct JointRow {
    sin_alpha: f32,
    cos_alpha: f32,
    a: f32,
    d: f32,
}

/// A frame in the world: its axes and origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    x: Vec3,
    y: Vec3,
    z: Vec3,
    origin: Vec3,
}

impl ArmSpheres {
    /// The spheres of `robot`.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        let joints = robot.joints.map(|joint| {
            let (sin_alpha, cos_alpha) = libm::sincos(joint.alpha);
            JointRow { sin_alpha: sin_alpha as f32, cos_alpha: cos_alpha as f32, a: joint.a as f32, d: joint.d as f32 }
        });
        let links = robot.spheres.map(LinkSpheres::new);
        let self_pairs = (0..N_LINKS)
            .flat_map(|a| (a + 1..N_LINKS).map(move |b| (a, b)))
            .filter(|&(a, b)| !links[a].spheres.is_empty() && !links[b].spheres.is_empty())
            .filter(|&(a, b)| {
                !robot.allowed_self_collisions.contains(&(a, b)) && !robot.allowed_self_collisions.contains(&(b, a))
            })
            .collect();
        Self { joints, link7_from_flange: Frame::from_pose(&Pose3::from(robot.link7_from_flange)), links, self_pairs }
    }

    /// The spheres of frame `link` (base, links 1–7, hand), in its frame.
    pub(super) const fn link(&self, link: usize) -> &LinkSpheres {
        &self.links[link]
    }

    /// Frames of base, links 1–7 and hand, in f32: quicker than [`Robot::link_frames`] and within a few micrometres of it.
    pub(super) fn frames(&self, config: &JointConfig) -> [Frame; N_LINKS] {
        let mut frames = [Frame::IDENTITY; N_LINKS];
        for j in 0..DOF {
            frames[j + 1] = frames[j].after(&self.joints[j], config[j]);
        }
        frames[HAND] = frames[DOF].compose(&self.link7_from_flange);
        frames
    }

    /// Whether two links that may not meet do so.
    pub(super) fn self_collides(&self, frames: &[Frame; N_LINKS]) -> bool {
        let bounds: [Vec3; N_LINKS] = core::array::from_fn(|link| frames[link].point(self.links[link].bound.center));
        self.self_pairs.iter().any(|&(a, b)| {
            let (link_a, link_b) = (&self.links[a], &self.links[b]);
            overlap(bounds[a], link_a.bound.radius, bounds[b], link_b.bound.radius)
                && link_a.spheres.iter().any(|sphere_a| {
                    let center_a = frames[a].point(sphere_a.center);
                    overlap(center_a, sphere_a.radius, bounds[b], link_b.bound.radius)
                        && link_b
                            .spheres
                            .iter()
                            .any(|sphere_b| overlap(center_a, sphere_a.radius, frames[b].point(sphere_b.center), sphere_b.radius))
                })
        })
    }

    /// Every sphere in the world at `config`, with the link it belongs to.
    pub fn spheres_at(&self, config: &JointConfig) -> impl Iterator<Item = (usize, Sphere)> {
        let frames = self.frames(config);
        self.links.iter().enumerate().flat_map(move |(link, spheres)| {
            spheres
                .spheres
                .iter()
                .map(move |sphere| (link, Sphere { center: frames[link].point(sphere.center), radius: sphere.radius }))
        })
    }
}

fn overlap(a: Vec3, radius_a: f32, b: Vec3, radius_b: f32) -> bool {
    let reach = radius_a + radius_b;
    (a - b).length_squared() < reach * reach
}

impl LinkSpheres {
    /// The bound is centred in the box of the spheres: not the least, but near it for long links.
    fn new(spheres: &[Sphere]) -> Self {
        let corner = |sign: f32, sphere: &Sphere| sphere.center + Vec3::splat(sign * sphere.radius);
        let low = spheres.iter().fold(Vec3::splat(f32::INFINITY), |low, sphere| low.min(corner(-1.0, sphere)));
        let high = spheres.iter().fold(Vec3::splat(f32::NEG_INFINITY), |high, sphere| high.max(corner(1.0, sphere)));
        let center = if spheres.is_empty() { Vec3::ZERO } else { 0.5 * (low + high) };
        let radius = spheres.iter().fold(0.0, |most: f32, sphere| most.max(length(sphere.center - center) + sphere.radius));
        Self { bound: Sphere { center, radius }, spheres: spheres.to_vec() }
    }
}

impl Frame {
    const IDENTITY: Self = Self { x: Vec3::X, y: Vec3::Y, z: Vec3::Z, origin: Vec3::ZERO };

    fn from_pose(pose: &Pose3) -> Self {
        let axis = |v: Vec3| pose.rotation * v;
        Self { x: axis(Vec3::X), y: axis(Vec3::Y), z: axis(Vec3::Z), origin: pose.translation }
    }

    fn vector(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }

    /// A point of this frame in the world.
    pub(super) fn point(&self, point: Vec3) -> Vec3 {
        self.vector(point) + self.origin
    }

    fn compose(&self, child: &Self) -> Self {
        Self { x: self.vector(child.x), y: self.vector(child.y), z: self.vector(child.z), origin: self.point(child.origin) }
    }

    /// This frame followed by `Rx(alpha) Tx(a) Rz(q) Tz(d)`.
    fn after(&self, joint: &JointRow, q: f32) -> Self {
        let y = self.y * joint.cos_alpha + self.z * joint.sin_alpha;
        let z = self.z * joint.cos_alpha - self.y * joint.sin_alpha;
        let (sin, cos) = libm::sincosf(q);
        Self { x: self.x * cos + y * sin, y: y * cos - self.x * sin, z, origin: self.origin + self.x * joint.a + z * joint.d }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::ROBOTS;
    use crate::scene::Scene;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn spheres_and_self_collision_agree_with_the_robot_in_f64(shares in prop::array::uniform7(0.0_f32..1.0)) {
            for robot in ROBOTS {
                let arm = ArmSpheres::new(robot);
                let joints = robot.joints;
                let config = JointConfig(core::array::from_fn(|j| joints[j].lower + shares[j] * (joints[j].upper - joints[j].lower)));
                let frames = robot.link_frames(&config);
                let expected = robot.spheres.iter().enumerate().flat_map(|(link, list)| list.iter().map(move |s| (link, s)));
                for ((link, found), (wanted_link, wanted)) in arm.spheres_at(&config).zip(expected) {
                    prop_assert_eq!(link, wanted_link);
                    prop_assert!(found.center.distance(frames[link] * wanted.center) < 5e-6);
                }
                // Both compute in f32 from frames that differ by rounding: near misses aside, they agree.
                if Scene::empty().is_free(&arm, &config) == robot.self_collides(&config) {
                    let grown = |by: f32| crate::scene::stick_arm::is_free_by_brute_force(robot, &Scene::empty(), &config, by);
                    prop_assert_ne!(grown(-1e-5), grown(1e-5));
                }
            }
        }
    }

    #[test]
    fn every_arm_is_free_at_its_start() {
        for robot in ROBOTS {
            assert!(Scene::empty().is_free(&ArmSpheres::new(robot), &robot.start), "{}", robot.name);
        }
    }
}
