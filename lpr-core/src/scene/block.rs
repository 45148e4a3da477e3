//! Many configurations at once: one for each lane of the machine's vectors.
//!
//! Forward kinematics and checks run together. A link's bounding sphere is tested before its
//! spheres, the hand before the links behind it, and the first hit in any lane ends the check.

use super::arm_spheres::{ArmSpheres, MAX_FOLLOWERS};
use super::contents::Scene;
use super::frames::{Frames, MAX_WIDTH, Rotation};
use super::link_spheres::{ArmPart, CLUSTER, Cluster, LinkBits, LinkSpheres, MAX_LINKS};
use super::sweep::{Pace, Sweep, Unseen};
use crate::lanes::{Floats, Vec3s, sincos};
use crate::robot::{DOF, JointConfig, JointMotion, MAX_JOINTS};
use arrayvec::ArrayVec;
use fearless_simd::{Simd, SimdBase as _, SimdMask as _, dispatch};
use glamx::Vec3;

/// Configurations of a motion are a multiple of this, so that they do not depend on the width of
/// the vectors.
const BLOCK: usize = 8;
/// Most configurations of a motion: their fractions are exact in f32.
const MAX_STEPS: usize = 1 << 23;

/// Outcome of the check of a motion.
pub(super) struct Checked {
    pub(super) is_free: bool,
    /// Configurations looked at.
    pub(super) n_checks: u64,
    /// What was not seen of a free motion, if it was to be measured.
    pub(super) unseen: Option<Unseen>,
}

/// Place of a motion's configurations in its equal steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Looks {
    /// At the end of each.
    Ends,
    /// In the middle of each.
    Middles,
}

impl Looks {
    /// Steps between two looks at a motion once it has been looked at here, which is after the ends
    /// where it is at the middles.
    pub(super) const fn spacing(self) -> f32 {
        match self {
            Self::Ends => 1.0,
            Self::Middles => 0.5,
        }
    }
}

/// A straight motion and where to look at it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampled<'a> {
    pub(super) a: &'a JointConfig,
    pub(super) b: &'a JointConfig,
    /// Equal steps from `a` to `b`; a few more are taken, at most [`MAX_STEPS`].
    pub(super) n_steps: usize,
    pub(super) looks: Looks,
    /// Bits of the links to look at.
    pub(super) links: LinkBits,
}

impl Scene {
    /// True if the arm at `config` meets neither the scene nor itself.
    #[must_use]
    pub fn is_free(&self, arm: &ArmSpheres, config: &JointConfig) -> bool {
        motion_is_free(
            self,
            arm,
            Sampled { a: config, b: config, n_steps: 1, looks: Looks::Ends, links: LinkBits::MAX },
            None,
        )
        .is_free
    }
}

/// Checks the configurations of a motion.
pub(super) fn motion_is_free(
    scene: &Scene,
    arm: &ArmSpheres,
    motion: Sampled<'_>,
    sweep: Option<&Sweep>,
) -> Checked {
    let is_looked_at = |end: &JointConfig| end.is_finite() && arm.has_joints_of(end);
    if !(is_looked_at(motion.a) && is_looked_at(motion.b)) {
        return Checked { is_free: false, n_checks: 0, unseen: None };
    }
    let motion = Sampled { n_steps: whole_blocks(motion.n_steps), ..motion };
    // Arrays of the built-in arms' size stay as small as they can be.
    if arm.dof() <= DOF && arm.is_serial() {
        dispatch!(arm.level, simd => rake::<_, DOF, { DOF + 1 }, true>(simd, scene, arm, motion, sweep))
    } else {
        dispatch!(arm.level, simd => {
            rake::<_, MAX_JOINTS, { 1 + MAX_JOINTS + MAX_FOLLOWERS }, false>(simd, scene, arm, motion, sweep)
        })
    }
}

/// At least as many steps that the lanes of any width can share, at most [`MAX_STEPS`].
pub(super) fn whole_blocks(n_steps: usize) -> usize {
    n_steps.clamp(1, MAX_STEPS).next_multiple_of(BLOCK)
}

/// Lanes are spread evenly over the motion and step back together: a collision anywhere shows
/// early. `J` is the most joints and `B` the most bodies; `IS_SERIAL` if each joint stands on the one
/// before.
#[inline(always)]
fn rake<S: Simd, const J: usize, const B: usize, const IS_SERIAL: bool>(
    simd: S,
    scene: &Scene,
    arm: &ArmSpheres,
    motion: Sampled<'_>,
    sweep: Option<&Sweep>,
) -> Checked {
    let Sampled { a, b, n_steps: n, looks, links } = motion;
    let (a, b) = (a.to_array::<J>(), b.to_array::<J>());
    let width = Floats::<S>::LEN;
    let stride = n.div_ceil(width);
    let mut pace = sweep.map(|_| Pace::new(simd, arm));
    let mut frames = [Frames::identity(simd); B];
    for step in 0..stride {
        let fraction = fractions(simd, stride, step, n, looks);
        let mut q = [fraction; J];
        for j in 0..J {
            q[j] = fraction * (b[j] - a[j]) + a[j];
        }
        forward_kinematics::<S, J, B, IS_SERIAL>(simd, arm, &q, &mut frames);
        if !block_is_free(simd, scene, arm, links, &frames) {
            let n_checks = ((step + 1) * width).min(n) as u64;
            return Checked { is_free: false, n_checks, unseen: None };
        }
        if let (Some(pace), Some(sweep)) = (&mut pace, sweep) {
            pace.measure::<B, IS_SERIAL>(simd, arm, sweep, &frames);
        }
    }
    let unseen = pace.as_ref().zip(sweep).and_then(|(pace, sweep)| pace.unseen(arm, sweep));
    Checked { is_free: true, n_checks: n as u64, unseen }
}

/// Fractions of a motion of `n` steps at which the lanes are; lanes beyond the last repeat it.
#[inline(always)]
fn fractions<S: Simd>(simd: S, stride: usize, step: usize, n: usize, looks: Looks) -> Floats<S> {
    let before = if looks == Looks::Middles { 0.5 } else { 0.0 };
    let mut fractions = [0.0; MAX_WIDTH];
    for (lane, fraction) in fractions.iter_mut().enumerate() {
        *fraction = ((lane + 1) * stride - step).min(n) as f32 - before;
    }
    Floats::<S>::from_slice(simd, &fractions[..Floats::<S>::LEN]) / n as f32
}

#[inline(always)]
fn block_is_free<S: Simd>(
    simd: S,
    scene: &Scene,
    arm: &ArmSpheres,
    links: LinkBits,
    frames: &[Frames<S>],
) -> bool {
    let mut bounds = ArrayVec::<Vec3s<S>, MAX_LINKS>::new();
    for group in &arm.groups {
        let frame = &frames[group.body];
        let bound = frame.point(group.bound.center);
        bounds.push(bound);
        let looked_at = links & group.bits;
        if looked_at == 0 {
            continue;
        }
        let points = match group.part {
            ArmPart::Base => continue,
            ArmPart::Arm => &scene.arm_points,
            ArmPart::Hand => &scene.hand_points,
        };
        let spheres = group.links(&arm.links, looked_at);
        if points.meet(simd, spheres, frame, (bound, group.bound.radius))
            || scene.solids.meet(looked_at, group, &arm.links, frame, bound)
            || (!arm.fixed.solids.is_empty()
                && arm.fixed.solids.meet(looked_at, group, &arm.links, frame, bound))
        {
            return false;
        }
    }
    !meets_itself(simd, arm, links, frames, &bounds)
}

#[inline(always)]
fn meets_itself<S: Simd>(
    simd: S,
    arm: &ArmSpheres,
    links: LinkBits,
    frames: &[Frames<S>],
    bounds: &[Vec3s<S>],
) -> bool {
    for pair in &arm.lone_pairs {
        let ((group_a, group_b), (a, b)) = (pair.groups, pair.links);
        let (link_a, link_b) = (&arm.links[a], &arm.links[b]);
        if overlap(bounds[group_a], link_a.bound.radius, bounds[group_b], link_b.bound.radius)
            && (links >> a | links >> b) & 1 == 1
            && links_meet(
                simd,
                (link_a, &frames[link_a.body]),
                (link_b, &frames[link_b.body]),
                bounds[group_b],
            )
        {
            return true;
        }
    }
    for pair in &arm.group_pairs {
        let (group_a, group_b) = (&arm.groups[pair.groups.0], &arm.groups[pair.groups.1]);
        let (bound_a, bound_b) = (bounds[pair.groups.0], bounds[pair.groups.1]);
        if overlap(bound_a, group_a.bound.radius, bound_b, group_b.bound.radius) {
            for &pair in &pair.links {
                if pair_meets(simd, arm, links, frames, pair) {
                    return true;
                }
            }
        }
    }
    for pair in &arm.close_pairs {
        let (a, b) = pair.links;
        let (frame_a, frame_b) = (&frames[arm.links[a].body], &frames[arm.links[b].body]);
        if pair_meets(simd, arm, links, frames, pair.links)
            && (0..Floats::<S>::LEN)
                .any(|lane| pair.meets(&arm.links, (&frame_a.lane(lane), &frame_b.lane(lane))))
        {
            return true;
        }
    }
    false
}

/// The links by their own bounds.
#[inline(always)]
fn pair_meets<S: Simd>(
    simd: S,
    arm: &ArmSpheres,
    links: LinkBits,
    frames: &[Frames<S>],
    (a, b): (usize, usize),
) -> bool {
    if (links >> a | links >> b) & 1 == 0 {
        return false;
    }
    let (a, b) = (&arm.links[a], &arm.links[b]);
    let (frame_a, frame_b) = (&frames[a.body], &frames[b.body]);
    let (bound_a, bound_b) = (frame_a.point(a.bound.center), frame_b.point(b.bound.center));
    overlap(bound_a, a.bound.radius, bound_b, b.bound.radius)
        && links_meet(simd, (a, frame_a), (b, frame_b), bound_b)
}

#[inline(always)]
fn links_meet<S: Simd>(
    simd: S,
    (a, frame_a): (&LinkSpheres, &Frames<S>),
    (b, frame_b): (&LinkSpheres, &Frames<S>),
    bound_b: Vec3s<S>,
) -> bool {
    for cluster in &a.clusters {
        let center = frame_a.point(cluster.bound.center);
        if overlap(center, cluster.bound.radius, bound_b, b.bound.radius) {
            for other in &b.clusters {
                if overlap(
                    center,
                    cluster.bound.radius,
                    frame_b.point(other.bound.center),
                    other.bound.radius,
                ) && clusters_meet(simd, (cluster, frame_a), (other, frame_b))
                {
                    return true;
                }
            }
        }
    }
    false
}

#[inline(always)]
fn clusters_meet<S: Simd>(
    simd: S,
    (a, frame_a): (&Cluster, &Frames<S>),
    (b, frame_b): (&Cluster, &Frames<S>),
) -> bool {
    let mut centers = [Vec3s::splat(simd, Vec3::ZERO); CLUSTER];
    for (sphere, center) in b.spheres.iter().zip(&mut centers) {
        *center = frame_b.point(sphere.center);
    }
    for sphere in &a.spheres {
        let center = frame_a.point(sphere.center);
        for (other, at) in b.spheres.iter().zip(&centers) {
            if overlap(center, sphere.radius, *at, other.radius) {
                return true;
            }
        }
    }
    false
}

/// True if two balls overlap in any lane.
#[inline(always)]
fn overlap<S: Simd>(a: Vec3s<S>, radius_a: f32, b: Vec3s<S>, radius_b: f32) -> bool {
    let reach = radius_a + radius_b;
    a.sub(b).length_squared().simd_lt(reach * reach).any_true()
}

/// Frames of all that moves; the first, of the base, is left as it is.
#[inline(always)]
fn forward_kinematics<S: Simd, const J: usize, const B: usize, const IS_SERIAL: bool>(
    simd: S,
    arm: &ArmSpheres,
    q: &[Floats<S>; J],
    frames: &mut [Frames<S>; B],
) {
    for (j, joint) in arm.moves.iter().enumerate() {
        let (parent, body) = if IS_SERIAL { (j, j + 1) } else { (joint.parent, joint.body) };
        let at = &frames[parent];
        let q = match joint.follows {
            _ if IS_SERIAL => q[j],
            None => q[joint.joint],
            Some((multiplier, offset)) => q[joint.joint] * multiplier + offset,
        };
        let [x, y, z] = match &joint.rotation {
            Rotation::QuarterTurns(turns) => {
                [at.along(turns[0]), at.along(turns[1]), at.along(turns[2])]
            }
            Rotation::General(rotation) => {
                [at.vector(rotation.x_axis), at.vector(rotation.y_axis), at.vector(rotation.z_axis)]
            }
        };
        let origin = at.offset(joint.translation);
        frames[body] = match joint.motion {
            JointMotion::Slide => Frames { axes: [x, y, z], origin: origin.add(z.scaled(q)) },
            JointMotion::Turn => {
                let (sin, cos) = sincos(simd, q);
                Frames {
                    axes: [x.scaled(cos).add(y.scaled(sin)), y.scaled(cos).sub(x.scaled(sin)), z],
                    origin,
                }
            }
        };
    }
}
