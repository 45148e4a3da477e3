//! Collision spheres that cover capsules, finger boxes, self-collision.

use super::{Capsule, GripperSpec, JointConfig, N_LINKS, Robot, Sphere};
use glamx::{Pose3, Vec3};

/// Most by which a covering sphere reaches beyond its capsule, metres.
pub const MAX_OVERSHOOT: f32 = 0.008;

/// Capsule from `a` to `b` in metres.
pub(super) const fn capsule(a: [f32; 3], b: [f32; 3], radius: f32) -> Capsule {
    Capsule { a: Vec3::from_array(a), b: Vec3::from_array(b), radius }
}

/// The spheres that cover constant capsules, as a constant slice.
macro_rules! cover {
    ($capsules:expr) => {{
        const SPHERES: [$crate::robot::Sphere; $crate::robot::geometry::n_covering($capsules)] =
            $crate::robot::geometry::covering($capsules);
        &SPHERES
    }};
}
pub(super) use cover;

/// Number of spheres of [`covering`].
pub(super) const fn n_covering(capsules: &[Capsule]) -> usize {
    let mut total = 0;
    let mut i = 0;
    while i < capsules.len() {
        total += n_intervals(&capsules[i]) + 1;
        i += 1;
    }
    total
}

/// Spheres whose union covers the capsules: equally spaced along each axis, as large as the lens
/// between neighbours needs.
pub(super) const fn covering<const N: usize>(capsules: &[Capsule]) -> [Sphere; N] {
    let mut spheres = [Sphere { center: Vec3::ZERO, radius: 0.0 }; N];
    let (mut i, mut written) = (0, 0);
    while i < capsules.len() {
        let Capsule { a, b, radius } = capsules[i];
        let n_intervals = n_intervals(&capsules[i]);
        let half_spacing =
            if n_intervals == 0 { 0.0 } else { length(&capsules[i]) / (2 * n_intervals) as f32 };
        let radius = square_root(radius * radius + half_spacing * half_spacing);
        let mut step = 0;
        while step <= n_intervals {
            let t = if n_intervals == 0 { 0.0 } else { step as f32 / n_intervals as f32 };
            let center =
                Vec3::new(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z));
            spheres[written] = Sphere { center, radius };
            written += 1;
            step += 1;
        }
        i += 1;
    }
    spheres
}

/// Fewest equal intervals of the axis for which spheres at their ends overshoot by no more than
/// [`MAX_OVERSHOOT`].
const fn n_intervals(capsule: &Capsule) -> usize {
    let largest = capsule.radius + MAX_OVERSHOOT;
    let spacing = 2.0 * square_root(largest * largest - capsule.radius * capsule.radius);
    let exact = length(capsule) / spacing;
    let whole = exact as usize;
    if exact > whole as f32 { whole + 1 } else { whole }
}

const fn length(capsule: &Capsule) -> f32 {
    let (x, y, z) =
        (capsule.b.x - capsule.a.x, capsule.b.y - capsule.a.y, capsule.b.z - capsule.a.z);
    square_root(x * x + y * y + z * z)
}

/// Square root at compile time, by Newton's method in f64.
const fn square_root(x: f32) -> f32 {
    let x = x as f64;
    let mut root = if x > 1.0 { x } else { 1.0 };
    let mut i = 0;
    while i < 40 {
        root = 0.5 * (root + x / root);
        i += 1;
    }
    root as f32
}

/// An axis-parallel box of the gripper in the grip frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GripperBox {
    /// Centre.
    pub center: Vec3,
    /// Half extents.
    pub half_extents: Vec3,
}

impl GripperBox {
    /// `grip_from_box`.
    #[must_use]
    pub fn pose(&self) -> Pose3 {
        Pose3::from_translation(self.center)
    }
}

/// One finger in the grip frame: the pad that touches objects and the body behind and above it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finger {
    /// The pad; its inner face is half the gripper's width from the grip's x-z plane.
    pub pad: GripperBox,
    /// The body, flush with the back of the pad.
    pub body: GripperBox,
}

impl GripperSpec {
    /// The fingers at that distance between the pads (metres, moved into 0 to `max_width`): at +y,
    /// then at -y.
    ///
    /// ```
    /// use lpr_core::robot::XARM7;
    ///
    /// let gripper = XARM7.gripper()?;
    /// let [left, right] = gripper.fingers(0.05);
    /// let gap = (left.pad.center.y - left.pad.half_extents.y) - (right.pad.center.y + right.pad.half_extents.y);
    /// assert!((gap - 0.05).abs() < 1e-6, "metres between the pads");
    /// assert_eq!(gripper.fingers(9.0), gripper.fingers(gripper.max_width));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    #[must_use]
    pub fn fingers(&self, width: f32) -> [Finger; 2] {
        let inner = 0.5 * width.clamp(0.0, self.max_width);
        [1.0, -1.0].map(|side| {
            let (pad, body) = (self.pad_half_extents, self.finger_half_extents);
            Finger {
                pad: GripperBox {
                    center: Vec3::new(0.0, side * (inner + pad.y), self.pad_offset_z),
                    half_extents: pad,
                },
                body: GripperBox {
                    center: Vec3::new(
                        0.0,
                        side * (inner + 2.0 * pad.y + body.y),
                        self.finger_offset_z,
                    ),
                    half_extents: body,
                },
            }
        })
    }
}

impl Robot {
    /// True if collision spheres of two frames overlap, but for [`Robot::allowed_self_collisions`].
    ///
    /// ```
    /// use lpr_core::robot::{JointConfig, PANDA};
    ///
    /// assert!(!PANDA.self_collides(&PANDA.start));
    /// let folded = JointConfig::new([0.0, -1.7, 0.0, -3.0, 0.0, 0.0, 0.0]);
    /// assert!(PANDA.within_limits(&folded) && PANDA.self_collides(&folded));
    /// ```
    #[must_use]
    pub fn self_collides(&self, config: &JointConfig) -> bool {
        let frames = self.link_frames(config);
        let pairs = (0..N_LINKS).flat_map(|a| (a + 1..N_LINKS).map(move |b| (a, b)));
        pairs
            .filter(|pair| !self.allowed_self_collisions.contains(pair))
            .any(|pair| self.frames_overlap(&frames, pair))
    }

    fn frames_overlap(&self, frames: &[Pose3; N_LINKS], (a, b): (usize, usize)) -> bool {
        let a_from_b = frames[a].inverse() * frames[b];
        self.links[b].spheres.iter().any(|sphere_b| {
            let center = a_from_b * sphere_b.center;
            self.links[a].spheres.iter().any(|sphere_a| {
                let reach = sphere_a.radius + sphere_b.radius;
                center.distance_squared(sphere_a.center) < reach * reach
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stream, stream};
    use crate::robot::{HAND, Link, PANDA, ROBOTS, XARM7};
    use rand::RngExt as _;

    fn random_config(robot: &Robot, rng: &mut Rng) -> JointConfig {
        JointConfig::from_fn(robot.dof(), |j| {
            rng.random_range(robot.joints[j].lower..robot.joints[j].upper)
        })
    }

    fn axis_distance(capsule: &Capsule, point: Vec3) -> f32 {
        let axis = capsule.b - capsule.a;
        let t = ((point - capsule.a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
        point.distance(capsule.a + t * axis)
    }

    #[test]
    fn spheres_cover_the_capsules_and_overshoot_within_the_bound() {
        let mut rng = stream(1, Stream::Planner, 0);
        for robot in ROBOTS {
            for Link { capsules, spheres, .. } in &robot.links {
                for capsule in capsules {
                    for _ in 0..2000 {
                        let mut within = || rng.random_range(-1.0f32..1.0);
                        let offset = Vec3::new(within(), within(), within()).normalize_or_zero()
                            * capsule.radius;
                        let point = capsule.a.lerp(capsule.b, 0.5 + 0.5 * within()) + offset;
                        let is_covered = spheres
                            .iter()
                            .any(|ball| ball.center.distance(point) <= ball.radius + 1e-6);
                        assert!(is_covered, "{}: {point} of {capsule:?}", robot.name);
                    }
                }
            }
            for link in &robot.links[..HAND] {
                for ball in &link.spheres {
                    let overshoot = (link.capsules.iter())
                        .map(|c| axis_distance(c, ball.center) + ball.radius - c.radius);
                    assert!(
                        overshoot.fold(f32::INFINITY, f32::min) <= MAX_OVERSHOOT + 1e-6,
                        "{}: {ball:?}",
                        robot.name
                    );
                }
            }
        }
    }

    #[test]
    fn an_arm_has_some_forty_to_sixty_spheres_and_few_capsules() {
        for robot in ROBOTS {
            let n_spheres: usize = robot.links.iter().map(|link| link.spheres.len()).sum();
            assert!((40..=60).contains(&n_spheres), "{}: {n_spheres}", robot.name);
            assert!(robot.links.iter().all(|link| (1..=3).contains(&link.capsules.len())));
        }
    }

    #[test]
    fn neighbouring_links_touch_in_every_configuration() {
        let mut rng = stream(2, Stream::Planner, 0);
        for robot in ROBOTS {
            for _ in 0..500 {
                let frames = robot.link_frames(&random_config(robot, &mut rng));
                assert!(
                    (1..N_LINKS).all(|link| robot.frames_overlap(&frames, (link - 1, link))),
                    "{}",
                    robot.name
                );
            }
        }
    }

    #[test]
    fn tested_pairs_are_apart_almost_always_and_skipped_pairs_have_a_reason() {
        let mut rng = stream(3, Stream::Planner, 0);
        const N: usize = 4000;
        for robot in ROBOTS {
            let samples: Vec<_> =
                (0..N).map(|_| robot.link_frames(&random_config(robot, &mut rng))).collect();
            for pair in (0..N_LINKS).flat_map(|a| (a + 1..N_LINKS).map(move |b| (a, b))) {
                let share =
                    samples.iter().filter(|frames| robot.frames_overlap(frames, pair)).count()
                        as f32
                        / N as f32;
                let is_allowed = robot.allowed_self_collisions.contains(&pair);
                // Link 5 of the xArm7 is slimmer than its capsule where link 7 passes.
                let has_reason =
                    share <= 0.005 || share == 1.0 || (robot.name == "xarm7" && pair == (5, 7));
                assert!(
                    if is_allowed { has_reason } else { share < 0.1 },
                    "{}: {pair:?} in {share}",
                    robot.name
                );
            }
        }
    }

    #[test]
    fn start_is_free_and_a_folded_arm_hits_itself() {
        for robot in ROBOTS {
            assert!(!robot.self_collides(&robot.start), "{}", robot.name);
        }
        // The hand is driven back into the column.
        assert!(XARM7.self_collides(&JointConfig::new([0.0, 0.0, 0.0, 0.0, 0.0, 1.6, 0.0])));
        assert!(PANDA.self_collides(&JointConfig::new([0.0, 0.5, 0.0, -3.0, 0.0, 0.3, 0.0])));
    }

    #[test]
    fn pads_are_the_width_apart_and_fingers_behind_them() {
        for robot in ROBOTS {
            for (asked, width) in
                [(0.03, 0.03), (-1.0, 0.0), (1.0, robot.gripper().unwrap().max_width)]
            {
                let [left, right] = robot.gripper().unwrap().fingers(asked);
                let inner = |finger: &Finger| finger.pad.center.y.abs() - finger.pad.half_extents.y;
                assert!((inner(&left) + inner(&right) - width).abs() < 1e-6);
                for finger in [left, right] {
                    let (pad, body) = (finger.pad, finger.body);
                    let pad_back = pad.center.y.abs() + pad.half_extents.y;
                    assert!((body.center.y.abs() - body.half_extents.y - pad_back).abs() < 1e-6);
                    let tips =
                        [pad, body].map(|part| part.pose().translation.z + part.half_extents.z);
                    assert!(
                        (tips[0] - tips[1]).abs() < 1e-6,
                        "pad and finger end together: {tips:?}"
                    );
                }
            }
        }
    }
}
