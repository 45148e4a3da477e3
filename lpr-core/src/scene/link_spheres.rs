//! The spheres of a link, in clusters.

use super::frames::Frame;
use super::primitive::length;
use crate::robot::{Link, Sphere};
use glamx::Vec3;

/// Most links with spheres.
pub const MAX_LINKS: usize = 64;

/// A bit for each link.
pub(super) type LinkBits = u64;

/// Most spheres of a cluster.
pub(super) const CLUSTER: usize = 4;

/// Deepest contact that may lie between two looks, metres.
pub(super) const DEEPEST: f32 = 1e-3;

/// The spheres of one link and a sphere around all of them.
#[derive(Debug, Clone)]
pub(super) struct LinkSpheres {
    pub(super) name: String,
    /// Index among the links of the robot; of what it holds, none of them.
    index: usize,
    /// 0: fixed to the base; i: carried by joint i, or a follower.
    pub(super) body: usize,
    /// Which cloud it is tested against.
    pub(super) part: ArmPart,
    pub(super) bound: Sphere,
    /// Largest distance of a sphere's centre from that of the bound, metres.
    pub(super) spread: f32,
    pub(super) clusters: Vec<Cluster>,
}

/// Links next to each other that are fixed to the same body, and a sphere around all of them: most
/// often it tells enough.
#[derive(Debug, Clone)]
pub(super) struct LinkGroup {
    pub(super) bits: LinkBits,
    pub(super) body: usize,
    pub(super) part: ArmPart,
    pub(super) bound: Sphere,
}

impl LinkGroup {
    /// The links of an arm in groups, in their order.
    pub(super) fn of(links: &[LinkSpheres]) -> Vec<Self> {
        let mut first = 0;
        let is_same = |a: &LinkSpheres, b: &LinkSpheres| (a.body, a.part) == (b.body, b.part);
        let group = |links: &[LinkSpheres]| {
            let bits = (LinkBits::MAX >> (MAX_LINKS - links.len())) << first;
            first += links.len();
            let spheres: Vec<Sphere> =
                links.iter().flat_map(LinkSpheres::spheres).copied().collect();
            let bound = if links.len() == 1 { links[0].bound } else { bound(&spheres) };
            Self { bits, body: links[0].body, part: links[0].part, bound }
        };
        links.chunk_by(is_same).map(group).collect()
    }

    /// True of one link.
    #[inline(always)]
    pub(super) const fn is_single(&self) -> bool {
        self.bits.is_power_of_two()
    }

    /// The links of the group that are in `bits`.
    #[inline(always)]
    pub(super) const fn links<'a>(&self, arm: &'a [LinkSpheres], bits: LinkBits) -> Links<'a> {
        Links { arm, left: bits & self.bits }
    }
}

/// Links by their bits. A type of its own, since a closure is not inlined in code for wide vectors.
pub(super) struct Links<'a> {
    arm: &'a [LinkSpheres],
    left: LinkBits,
}

impl<'a> Iterator for Links<'a> {
    type Item = &'a LinkSpheres;

    #[inline(always)]
    fn next(&mut self) -> Option<&'a LinkSpheres> {
        if self.left == 0 {
            return None;
        }
        let idx = self.left.trailing_zeros() as usize;
        self.left &= self.left - 1;
        Some(&self.arm[idx])
    }
}

/// A few spheres of a link that are close together and a sphere around them, in the body's frame.
#[derive(Debug, Clone)]
pub(super) struct Cluster {
    pub(super) bound: Sphere,
    pub(super) spheres: Vec<Sphere>,
    /// Largest distance of a sphere's centre from that of the bound, metres.
    pub(super) spread: f32,
    /// `1/s²`, where `s` is the furthest that its smallest sphere may move straight between two looks.
    pub(super) inverse_squared_move: f32,
}

/// The contact rule tells the gripper from the rest of the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ArmPart {
    /// Links that do not move are never tested against the scene.
    Base,
    /// Links 1–7.
    Arm,
    /// The hand with its fingers.
    Hand,
}

impl LinkSpheres {
    /// The bound is centred in the box of the spheres: not the least, but near it for long links.
    pub(super) fn new(name: &str, body: usize, part: ArmPart, spheres: Vec<Sphere>) -> Self {
        let bound = bound(&spheres);
        let spread = spread(bound.center, &spheres);
        let mut clusters = Vec::new();
        split(spheres, &mut clusters);
        Self { name: name.to_owned(), index: usize::MAX, body, part, bound, spread, clusters }
    }

    pub(super) fn of(link: &Link, index: usize) -> Self {
        let part = if link.body == 0 { ArmPart::Base } else { ArmPart::Arm };
        Self { index, ..Self::new(&link.name, link.body, part, link.spheres_in_body()) }
    }

    /// Name of the link.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// True if one of its spheres touches one of another link, given with the frames of their bodies.
    pub(super) fn touches(&self, frame: &Frame, other: &Self, other_frame: &Frame) -> bool {
        let overlap = |a: &Sphere, b: &Sphere| length(a.center - b.center) < a.radius + b.radius;
        let (bound, other_bound) = (frame.sphere(&self.bound), other_frame.sphere(&other.bound));
        if !overlap(&bound, &other_bound) {
            return false;
        }
        let others: Vec<Sphere> = (other.spheres().map(|sphere| other_frame.sphere(sphere)))
            .filter(|sphere| overlap(sphere, &bound))
            .collect();
        let near = self.spheres().map(|sphere| frame.sphere(sphere));
        near.filter(|sphere| overlap(sphere, &other_bound))
            .any(|sphere| others.iter().any(|other| overlap(&sphere, other)))
    }

    /// In the body's frame.
    pub(super) fn spheres(&self) -> impl Iterator<Item = &Sphere> {
        self.clusters.iter().flat_map(|cluster| &cluster.spheres)
    }

    /// Index among the links of the robot.
    pub(super) const fn index(&self) -> usize {
        self.index
    }
}

impl Cluster {
    fn new(bound: Sphere, spheres: Vec<Sphere>) -> Self {
        let spread = spread(bound.center, &spheres);
        let inverse_squared_move = inverse_squared_move(least_radius(spheres.iter()));
        Self { bound, spheres, spread, inverse_squared_move }
    }
}

pub(super) fn least_radius<'a>(spheres: impl Iterator<Item = &'a Sphere>) -> f32 {
    spheres.map(|sphere| sphere.radius).fold(f32::INFINITY, f32::min)
}

/// `1/s²`, where `s` is the longest straight move between two looks at a sphere of that radius.
pub(super) fn inverse_squared_move(radius: f32) -> f32 {
    // What is smaller than the depth allowed cannot be deeper.
    1.0 / (4.0 * (2.0 * radius.max(DEEPEST) - DEEPEST) * DEEPEST)
}

/// Halves the spheres across the longest side of their box until few are left together.
fn split(mut spheres: Vec<Sphere>, clusters: &mut Vec<Cluster>) {
    if spheres.len() <= CLUSTER {
        if !spheres.is_empty() {
            clusters.push(Cluster::new(bound(&spheres), spheres));
        }
        return;
    }
    let low = spheres.iter().fold(Vec3::splat(f32::INFINITY), |low, sphere| low.min(sphere.center));
    let high =
        spheres.iter().fold(Vec3::splat(f32::NEG_INFINITY), |high, sphere| high.max(sphere.center));
    let axis = (high - low).max_position();
    spheres.sort_by(|a, b| a.center[axis].total_cmp(&b.center[axis]));
    let others = spheres.split_off(spheres.len() / 2);
    split(spheres, clusters);
    split(others, clusters);
}

/// Largest distance of a sphere's centre from a point.
fn spread(from: Vec3, spheres: &[Sphere]) -> f32 {
    spheres.iter().map(|sphere| length(sphere.center - from)).fold(0.0, f32::max)
}

/// A sphere around `spheres`.
fn bound(spheres: &[Sphere]) -> Sphere {
    let corner = |sign: f32, sphere: &Sphere| sphere.center + Vec3::splat(sign * sphere.radius);
    let low = spheres
        .iter()
        .fold(Vec3::splat(f32::INFINITY), |low, sphere| low.min(corner(-1.0, sphere)));
    let high = spheres
        .iter()
        .fold(Vec3::splat(f32::NEG_INFINITY), |high, sphere| high.max(corner(1.0, sphere)));
    let center = if spheres.is_empty() { Vec3::ZERO } else { 0.5 * (low + high) };
    let radius = spheres
        .iter()
        .fold(0.0, |most: f32, sphere| most.max(length(sphere.center - center) + sphere.radius));
    Sphere { center, radius }
}
