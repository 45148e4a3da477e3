//! Obstacles near the arm: signed distances with their gradients in joint space, for planners that
//! optimise.
//!
//! Scalar: a planner looks at a few thousand configurations. The sphere decides, as in the checks:
//! a link's distance is that of its nearest sphere, and its gradient that sphere's, by the
//! geometric Jacobian of its centre.

use super::arm_spheres::ArmSpheres;
use super::close_pair::ClosePair;
use super::cloud::PointCloud;
use super::contents::Scene;
use super::frames::Frame;
use super::link_spheres::{ArmPart, LinkSpheres};
use super::primitive::{Primitive, length};
use super::signed_distance::SignedDistance;
use crate::robot::{JointConfig, JointMotion, Sphere};
use glamx::{Pose3, Vec3};

/// Distance from a link to an obstacle, or to another link, with its gradient.
///
/// The gradient says where to turn a joint to make room:
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, Primitive, Scene};
///
/// // A ball to the left of the hand: turning the base to the right leads away from it.
/// let beside = XARM7.grip(&XARM7.start).translation + Vec3::new(0.0, 0.2, 0.0);
/// let scene = Scene::from_primitives(vec![Primitive::Sphere { center: beside, radius: 0.05 }]);
/// let near = scene.proximities(&ArmSpheres::new(&XARM7), &XARM7.start, 0.1);
/// let hand = near.iter().min_by(|a, b| a.gradient[0].total_cmp(&b.gradient[0])).unwrap();
/// assert!(hand.distance > 0.0 && hand.distance < 0.1 && hand.gradient[0] < 0.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proximity {
    /// Gap between them, metres; negative when they overlap.
    pub distance: f32,
    /// Derivative of the gap by every joint: metres per radian, or per metre of a sliding joint.
    pub gradient: JointConfig,
}

/// The nearest sphere of a link.
struct Nearest {
    center: Vec3,
    /// From the sphere's surface.
    gap: SignedDistance,
}

/// A gap of a link, the nearest points of both, and how each moves that widens it.
pub(super) struct Gap<'a> {
    pub(super) link: &'a LinkSpheres,
    pub(super) near: Near<'a>,
    /// Metres; negative when they overlap.
    pub(super) distance: f32,
    center: Vec3,
    normal: Vec3,
    /// Of the other link.
    other_center: Vec3,
}

/// What a link is near to.
#[derive(Clone, Copy)]
pub(super) enum Near<'a> {
    Link(&'a LinkSpheres),
    Solid(&'a Primitive),
    Points,
}

/// The arm at a configuration.
pub(super) struct Placed<'a> {
    arm: &'a ArmSpheres,
    frames: Vec<Frame>,
}

impl Scene {
    /// Every pair of a link and a solid, a cloud or another link that are less than `reach`
    /// (metres) apart; none whose contact is allowed.
    #[must_use]
    pub fn proximities(
        &self,
        arm: &ArmSpheres,
        config: &JointConfig,
        reach: f32,
    ) -> Vec<Proximity> {
        let placed = Placed::new(arm, config);
        self.nearest(&placed, reach).map(|gap| placed.proximity(&gap)).collect()
    }

    /// The gaps below `reach`, metres.
    pub(super) fn nearest<'a>(
        &'a self,
        placed: &'a Placed<'a>,
        reach: f32,
    ) -> impl Iterator<Item = Gap<'a>> {
        let arm = placed.arm;
        let to_scene = arm.links.iter().enumerate().filter_map(move |(idx, link)| {
            let points = match link.part {
                ArmPart::Base => return None,
                ArmPart::Arm => &self.arm_points,
                ArmPart::Hand => &self.hand_points,
            };
            let from_solids = self.solids.forbidden(1 << idx).filter_map(move |(_, solid)| {
                Some((placed.nearest_to_solid(link, solid, reach)?, Near::Solid(solid)))
            });
            let from_base = arm.fixed.solids.forbidden(1 << idx).filter_map(move |(at, solid)| {
                let base = &arm.links[arm.fixed.links[at]];
                Some((placed.nearest_to_solid(link, solid, reach)?, Near::Link(base)))
            });
            let from_solids = from_solids.chain(from_base);
            let from_points = placed.nearest_to_points(link, points, reach);
            let nearest = from_solids.chain(from_points.map(|near| (near, Near::Points)));
            Some(nearest.map(move |(it, near)| Gap {
                link,
                near,
                distance: it.gap.distance,
                center: it.center,
                normal: it.gap.normal,
                other_center: Vec3::ZERO,
            }))
        });
        let to_itself = arm.self_pairs.iter();
        let to_itself = to_itself
            .filter_map(move |&(a, b)| placed.between(&arm.links[a], &arm.links[b], reach));
        let closely = arm.close_pairs.iter();
        let closely = closely.filter_map(move |pair| placed.between_closely(pair, reach));
        to_scene.flatten().chain(to_itself).chain(closely)
    }
}

impl<'a> Placed<'a> {
    pub(super) fn new(arm: &'a ArmSpheres, config: &JointConfig) -> Self {
        Self { arm, frames: arm.frames(config) }
    }

    /// A link by its index among those of the robot, and its body's frame in the world.
    pub(super) fn body(&self, link: usize) -> (usize, Pose3) {
        let link = &self.arm.links[link];
        (link.index(), self.frames[link.body].pose())
    }

    /// True if two links touch, the first by its solids where these are tested.
    pub(super) fn touch(&self, a: usize, b: usize) -> bool {
        let (fixed, link_b) = (&self.arm.fixed, &self.arm.links[b]);
        if fixed.links.contains(&a) {
            let solids = fixed.solids.primitives().zip(&fixed.links);
            return solids
                .filter(|(_, link)| **link == a)
                .any(|(solid, _)| self.nearest_to_solid(link_b, solid, 0.0).is_some());
        }
        let link_a = &self.arm.links[a];
        link_a.touches(self.frame(link_a), link_b, self.frame(link_b))
    }

    fn frame(&self, link: &LinkSpheres) -> &Frame {
        &self.frames[link.body]
    }

    fn place(&self, link: &LinkSpheres, sphere: &Sphere) -> Sphere {
        self.frame(link).sphere(sphere)
    }

    fn spheres(&self, link: &LinkSpheres) -> impl Iterator<Item = Sphere> {
        link.spheres().map(|sphere| self.place(link, sphere))
    }

    fn nearest_to_solid(
        &self,
        link: &LinkSpheres,
        solid: &Primitive,
        reach: f32,
    ) -> Option<Nearest> {
        let bound = self.place(link, &link.bound);
        if solid.distance(bound.center) >= bound.radius + reach {
            return None;
        }
        let gaps = self.spheres(link).map(|sphere| Nearest {
            center: sphere.center,
            gap: inflated(solid.signed_distance(sphere.center), sphere.radius),
        });
        gaps.filter(|near| near.gap.distance < reach)
            .min_by(|a, b| a.gap.distance.total_cmp(&b.gap.distance))
    }

    fn nearest_to_points(
        &self,
        link: &LinkSpheres,
        cloud: &PointCloud,
        reach: f32,
    ) -> Option<Nearest> {
        let bound = self.place(link, &link.bound);
        if cloud.is_surely_clear(bound.center, bound.radius + reach) {
            return None;
        }
        let gaps = self.spheres(link).filter_map(|sphere| {
            let point = cloud
                .nearest_within(sphere.center, sphere.radius + cloud.point_radius() + reach)?;
            let gap = SignedDistance::from_ball(
                sphere.center - point,
                sphere.radius + cloud.point_radius(),
            );
            Some(Nearest { center: sphere.center, gap })
        });
        gaps.min_by(|a, b| a.gap.distance.total_cmp(&b.gap.distance))
    }

    fn between(&self, a: &'a LinkSpheres, b: &'a LinkSpheres, reach: f32) -> Option<Gap<'a>> {
        let (bound_a, bound_b) = (self.place(a, &a.bound), self.place(b, &b.bound));
        if length(bound_a.center - bound_b.center) >= bound_a.radius + bound_b.radius + reach {
            return None;
        }
        let others: Vec<Sphere> = self.spheres(b).collect();
        let pairs =
            self.spheres(a).flat_map(|sphere| others.iter().map(move |other| (sphere, *other)));
        let gaps = pairs.map(|(sphere, other)| {
            let gap = SignedDistance::from_ball(
                sphere.center - other.center,
                sphere.radius + other.radius,
            );
            (gap, sphere.center, other.center)
        });
        let (gap, center, other_center) =
            gaps.min_by(|(a, ..), (b, ..)| a.distance.total_cmp(&b.distance))?;
        (gap.distance < reach).then_some(Gap {
            link: a,
            near: Near::Link(b),
            distance: gap.distance,
            center,
            normal: gap.normal,
            other_center,
        })
    }

    /// The same of a pair whose geometry may be apart where its spheres touch: by how much is not
    /// known.
    fn between_closely(&self, pair: &ClosePair, reach: f32) -> Option<Gap<'a>> {
        let (a, b) = (&self.arm.links[pair.links.0], &self.arm.links[pair.links.1]);
        let gap = self.between(a, b, reach)?;
        let are_apart =
            gap.distance >= 0.0 || !pair.meets(&self.arm.links, (self.frame(a), self.frame(b)));
        let distance = if are_apart { gap.distance.max(0.0) } else { gap.distance };
        (distance < reach).then_some(Gap { distance, ..gap })
    }

    /// The gap with its gradient.
    fn proximity(&self, gap: &Gap<'_>) -> Proximity {
        let mut gradient = JointConfig::from_fn(self.arm.dof(), |_| 0.0);
        self.add_motion(gap.link, gap.center, gap.normal, &mut gradient);
        if let Near::Link(other) = gap.near {
            self.add_motion(other, gap.other_center, -gap.normal, &mut gradient);
        }
        Proximity { distance: gap.distance, gradient }
    }

    /// Adds the motion of a point of a link along `normal`, by every joint that carries it.
    fn add_motion(
        &self,
        link: &LinkSpheres,
        point: Vec3,
        normal: Vec3,
        gradient: &mut JointConfig,
    ) {
        // From the base outwards.
        let mut bodies = vec![link.body];
        while let Some(step) = self.arm.carrier(bodies[bodies.len() - 1]) {
            bodies.push(step.parent);
        }
        for step in bodies.iter().rev().filter_map(|body| self.arm.carrier(*body)) {
            let frame = &self.frames[step.body];
            let velocity = match step.motion {
                JointMotion::Slide => frame.axis(),
                JointMotion::Turn => frame.axis().cross(point - frame.origin()),
            };
            let along = normal.dot(velocity);
            gradient[step.joint] += step.follows.map_or(along, |(factor, _)| factor * along);
        }
    }
}

/// The distance of the surface of a sphere of `radius` around a point.
fn inflated(from_center: SignedDistance, radius: f32) -> SignedDistance {
    SignedDistance { distance: from_center.distance - radius, ..from_center }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::stick_arm::stick_arm;
    use glamx::{Pose3, Quat};
    use proptest::prelude::*;

    /// Metres.
    const REACH: f32 = 0.2;

    fn config() -> impl Strategy<Value = JointConfig> {
        prop::array::uniform7(-2.5_f32..2.5).prop_map(JointConfig::new)
    }

    fn position() -> impl Strategy<Value = Vec3> {
        [-0.9_f32..0.9, -0.9..0.9, 0.0..1.2].prop_map(Vec3::from_array)
    }

    /// A box, a capsule and a few points.
    fn scene() -> impl Strategy<Value = Scene> {
        (
            prop::collection::vec(position(), 3),
            prop::array::uniform3(-3.0_f32..3.0),
            prop::collection::vec(position(), 0..20),
        )
            .prop_map(|(at, turn, points)| {
                let world_from_box =
                    Pose3::from_parts(at[0], Quat::from_scaled_axis(Vec3::from_array(turn)));
                let block =
                    Primitive::Cuboid { world_from_box, half_extents: Vec3::new(0.1, 0.02, 0.2) };
                let bar = Primitive::Capsule { a: at[1], b: at[2], radius: 0.03 };
                Scene::from_primitives(vec![block, bar]).with_points(&points, 0.01)
            })
    }

    fn least(proximities: &[Proximity]) -> f32 {
        proximities.iter().fold(REACH, |least, near| near.distance.min(least))
    }

    proptest! {
        #[test]
        fn the_arm_is_free_where_no_distance_is_negative(scene in scene(), config in config()) {
            let arm = ArmSpheres::new(&stick_arm());
            let least = least(&scene.proximities(&arm, &config, REACH));
            // Rounding decides a touch.
            prop_assume!(least.abs() > 2e-5);
            prop_assert_eq!(scene.is_free(&arm, &config), least > 0.0);
        }

        #[test]
        fn gradients_agree_with_finite_differences(scene in scene(), config in config()) {
            /// Radians: rounding gives 1e-3 of error in a slope, curvature little more.
            const STEP: f32 = 1e-3;
            let arm = ArmSpheres::new(&stick_arm());
            let here = scene.proximities(&arm, &config, REACH);
            for j in 0..7 {
                let moved = |by: f32| {
                    let mut moved = config;
                    moved[j] += by;
                    scene.proximities(&arm, &moved, REACH)
                };
                let (before, after) = (moved(-STEP), moved(STEP));
                // Pairs that come within reach change the list; a pair's nearest sphere or face may
                // change, too, and then the slopes on both sides differ.
                if before.len() != here.len() || after.len() != here.len() {
                    continue;
                }
                for ((before, near), after) in before.iter().zip(&here).zip(&after) {
                    let slopes = [near.distance - before.distance, after.distance - near.distance].map(|rise| rise / STEP);
                    if (slopes[0] - slopes[1]).abs() < 5e-3 {
                        let slope = 0.5 * (slopes[0] + slopes[1]);
                        prop_assert!((slope - near.gradient[j]).abs() < 1e-2, "joint {j}: {slope} instead of {}", near.gradient[j]);
                    }
                }
            }
        }

        #[test]
        fn a_link_is_as_far_from_a_lone_ball_as_its_nearest_sphere(config in config(), center in position(), radius in 0.01_f32..0.2) {
            let arm = ArmSpheres::new(&stick_arm());
            let scene = Scene::from_primitives(vec![Primitive::Sphere { center, radius }]);
            let alone = Scene::empty().proximities(&arm, &config, REACH).len();
            let found = scene.proximities(&arm, &config, REACH);
            let of_moving = arm.placed_spheres(&config).filter(|(link, _)| link.part != ArmPart::Base);
            let nearest = of_moving.map(|(_, s)| s.center.distance(center) - s.radius - radius).fold(REACH, f32::min);
            prop_assert!((least(&found[..found.len() - alone]) - nearest).abs() < 1e-5);
        }
    }
}
