//! How densely a motion has to be looked at, by how far the spheres move, so that nothing deeper
//! than [`DEEPEST`] lies between two looks.
//!
//! A sphere of radius `r`, free at two looks between which its centre moves straight by `s`, is
//! nowhere between them deeper in anything than `r - sqrt(r² - s²/4)`; and a centre that
//! accelerates by `a` in that time leaves the straight line by `a/8` at most.
//!
//! Two bounds say how far it moves. The first, of `reach.rs`, costs next to nothing: the levers that
//! the joints can have on a link, whatever the others do. A hand moves by much less than that, as
//! joints seldom add up: where the first bound is not enough, the second, of [`Pace`], measures
//! speeds at the looks.

use super::arm_spheres::ArmSpheres;
use super::frames::{Frames, MovingFrame};
use super::link_spheres::{DEEPEST, LinkBits, MAX_LINKS, inverse_squared_move};
use crate::lanes::{Floats, Vec3s, splat};
use crate::robot::{JointConfig, JointMotion, MAX_JOINTS};
use arrayvec::ArrayVec;
use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, SimdMask as _};
use glamx::Vec3;

/// `1/s²`, where `s` is the longest move of geometry that may touch in a point: half of it is its
/// depth between two looks.
const POINT: f32 = 1.0 / (4.0 * DEEPEST * DEEPEST);

/// For each joint, radians in a step by which the motion that it gives a point is turned: once by
/// itself, and in the second derivative twice by every joint before it.
fn turns(arm: &ArmSpheres, rates: &[f32; MAX_JOINTS]) -> [f32; MAX_JOINTS] {
    let mut turns = [0.0; MAX_JOINTS];
    let turn = |step: &MovingFrame| match step.motion {
        JointMotion::Turn => (step.multiplier() * rates[step.joint]).abs(),
        JointMotion::Slide => 0.0,
    };
    if arm.is_serial() {
        let mut before = 0.0;
        for step in &arm.moves {
            turns[step.joint] = turn(step) + 2.0 * before;
            before += turn(step);
        }
    } else {
        // Followers turn with their joint, wherever they are on the way.
        turns.fill(2.0 * arm.moves.iter().map(turn).sum::<f32>());
    }
    turns
}

/// A motion in equal steps, and what to measure at the looks at it.
#[derive(Debug, Clone)]
pub(super) struct Sweep {
    /// By how much each joint moves in a step.
    rates: [f32; MAX_JOINTS],
    /// Squared steps that are enough, for each step of the motion.
    enough: f32,
    links: ArrayVec<LinkSweep, MAX_LINKS>,
}

/// Bounds of a link, by its levers.
#[derive(Debug, Clone, Copy)]
struct LinkSweep {
    /// Metres that a sphere moves in a step.
    moved: f32,
    /// Metres in a step by which it may be faster somewhere than at the looks.
    faster: f32,
    /// Squared steps that its leaving the straight line needs, for each step.
    bend: f32,
    /// True if its levers do not rule out that something is missed.
    is_measured: bool,
}

/// What the looks at a motion left unseen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unseen {
    /// Links that something may have passed, as bits.
    pub(super) links: LinkBits,
    /// Steps to look at them in, for each step of the motion.
    pub(super) refinement: f32,
}

impl Sweep {
    /// The motion from `a` to `b` in `n` equal steps; none if the looks are close enough by the
    /// levers. Looks are `spacing` steps apart, and speeds are measured no further than that from
    /// anywhere.
    pub(super) fn new(
        arm: &ArmSpheres,
        (a, b): (&JointConfig, &JointConfig),
        n: usize,
        spacing: f32,
    ) -> Option<Self> {
        let mut rates = [0.0; MAX_JOINTS];
        for (rate, (a, b)) in rates.iter_mut().zip(a.iter().zip(b.iter())) {
            *rate = (b - a) / n as f32;
        }
        let enough = 1.0 / (spacing * spacing);
        let close = arm
            .close_pairs
            .iter()
            .fold(0, |bits: LinkBits, pair| bits | 1 << pair.links.0 | 1 << pair.links.1);
        let turns = turns(arm, &rates);
        let links = arm.reaches.iter().enumerate().map(|(idx, reach)| {
            let (moved, acceleration) = reach.motion(&rates[..arm.dof()], &turns);
            let bend = acceleration / (8.0 * DEEPEST);
            let is_close = close >> idx & 1 == 1;
            let least = if is_close { POINT } else { reach.inverse_squared_move };
            let needed = moved * moved * least + bend;
            let faster = spacing * acceleration;
            LinkSweep { moved, faster, bend, is_measured: needed > enough }
        });
        let links: ArrayVec<LinkSweep, MAX_LINKS> = links.collect();
        links.iter().any(|link| link.is_measured).then_some(Self { rates, enough, links })
    }
}

/// What was measured of each link, for each lane.
pub(super) struct Pace<S: Simd> {
    links: Vec<LinkPace<S>>,
}

struct LinkPace<S: Simd> {
    /// Metres in a step.
    fastest: Floats<S>,
    /// Squared steps needed for each step.
    needed: Floats<S>,
}

impl<S: Simd> Pace<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, arm: &ArmSpheres) -> Self {
        let still = |_| LinkPace { fastest: splat(simd, 0.0), needed: splat(simd, 0.0) };
        Self { links: arm.links.iter().map(still).collect() }
    }

    /// Measures at a look: the speeds of the bodies from the base outwards, and by them those of
    /// spheres.
    #[inline(always)]
    pub(super) fn measure<const B: usize, const IS_SERIAL: bool>(
        &mut self,
        simd: S,
        arm: &ArmSpheres,
        sweep: &Sweep,
        frames: &[Frames<S>; B],
    ) {
        let mut twists = [Twist::still(simd); B];
        for (j, step) in arm.moves.iter().enumerate() {
            let (parent, body) = if IS_SERIAL { (j, j + 1) } else { (step.parent, step.body) };
            let along = frames[body].axes[2].times(step.multiplier() * sweep.rates[step.joint]);
            let mut twist = twists[parent].at(frames[body].origin.sub(frames[parent].origin));
            match step.motion {
                JointMotion::Turn => twist.turning = twist.turning.add(along),
                JointMotion::Slide => twist.speed = twist.speed.add(along),
            }
            twists[body] = twist;
        }
        let enough = splat(simd, sweep.enough);
        for (idx, (link, bounds)) in arm.links.iter().zip(&sweep.links).enumerate() {
            if !bounds.is_measured {
                continue;
            }
            let (frame, pace) = (&frames[link.body], &mut self.links[idx]);
            let twist = &twists[link.body];
            let spin = twist.turning.length_squared().sqrt();
            // All of it at once, if that says enough.
            let center = twist.at(frame.vector(link.bound.center)).speed.length_squared().sqrt();
            let fastest = center + spin * link.spread + bounds.faster;
            let needed = fastest * fastest * arm.reaches[idx].inverse_squared_move + bounds.bend;
            if !needed.simd_gt(enough).any_true() {
                pace.fastest = pace.fastest.max(fastest);
                continue;
            }
            for cluster in &link.clusters {
                let center =
                    twist.at(frame.vector(cluster.bound.center)).speed.length_squared().sqrt();
                let fastest = center + spin * cluster.spread + bounds.faster;
                let needed = fastest * fastest * cluster.inverse_squared_move + bounds.bend;
                pace.fastest = pace.fastest.max(fastest);
                pace.needed = pace.needed.max(needed);
            }
        }
    }

    /// What was not seen, if something was not.
    #[inline(always)]
    pub(super) fn unseen(&self, arm: &ArmSpheres, sweep: &Sweep) -> Option<Unseen> {
        let mut unseen = Unseen { links: 0, refinement: 0.0 };
        let mut fastest = [0.0; MAX_LINKS];
        for (idx, (pace, bounds)) in self.links.iter().zip(&sweep.links).enumerate() {
            fastest[idx] = bounds.moved;
            if bounds.is_measured {
                fastest[idx] = most::<S>(&pace.fastest).min(bounds.moved);
                unseen.add(1 << idx, most::<S>(&pace.needed), sweep);
            }
        }
        for &(a, b) in &arm.self_pairs {
            let by = fastest[a] + fastest[b];
            let bend = sweep.links[a].bend + sweep.links[b].bend;
            // The larger of the two allows more, both together most.
            let least =
                arm.reaches[a].inverse_squared_move.min(arm.reaches[b].inverse_squared_move);
            if by * by * least + bend > sweep.enough {
                let by = by.min(arm.moved_against(a, b, &sweep.rates));
                let radius = arm.reaches[a].radius + arm.reaches[b].radius;
                unseen.add(1 << a | 1 << b, by * by * inverse_squared_move(radius) + bend, sweep);
            }
        }
        for pair in &arm.close_pairs {
            let (a, b) = pair.links;
            let by = (fastest[a] + fastest[b]).min(arm.moved_against(a, b, &sweep.rates));
            let bend = sweep.links[a].bend + sweep.links[b].bend;
            unseen.add(1 << a | 1 << b, by * by * POINT + bend, sweep);
        }
        (unseen.links != 0).then_some(unseen)
    }
}

/// The largest of the lanes.
#[inline(always)]
fn most<S: Simd>(lanes: &Floats<S>) -> f32 {
    lanes.as_slice().iter().copied().fold(0.0, f32::max)
}

impl Unseen {
    fn add(&mut self, links: LinkBits, squared_steps: f32, sweep: &Sweep) {
        if squared_steps > sweep.enough {
            self.links |= links;
            self.refinement = self.refinement.max(libm::sqrtf(squared_steps));
        }
    }
}

/// Rates of turning about, and of moving with, a point of a body.
#[derive(Clone, Copy)]
struct Twist<S: Simd> {
    turning: Vec3s<S>,
    speed: Vec3s<S>,
}

impl<S: Simd> Twist<S> {
    #[inline(always)]
    fn still(simd: S) -> Self {
        let zero = Vec3s::splat(simd, Vec3::ZERO);
        Self { turning: zero, speed: zero }
    }

    /// Of the point away from this one by `lever`.
    #[inline(always)]
    fn at(&self, lever: Vec3s<S>) -> Self {
        Self { turning: self.turning, speed: self.speed.add(self.turning.cross(lever)) }
    }
}

impl ArmSpheres {
    /// Metres that one link moves at most, seen from the other.
    fn moved_against(&self, a: usize, b: usize, rates: &[f32; MAX_JOINTS]) -> f32 {
        if !self.is_serial() {
            return f32::INFINITY;
        }
        let (inner, outer) = if self.links[a].body < self.links[b].body { (a, b) } else { (b, a) };
        self.reaches[outer].moved(&rates[..self.dof()], self.links[inner].body)
    }
}

#[cfg(test)]
mod tests {
    use crate::robot::{JointConfig, Robot};
    use crate::scene::stick_arm::{is_free_by_brute_force, stick_arm};
    use crate::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
    use glamx::Vec3;
    use proptest::prelude::*;

    /// One joint about, or along, z; a ball of that radius at `at`.
    fn one_joint(kind: &str, axis: &str, at: Vec3, radius: f32) -> Robot {
        let Vec3 { x, y, z } = at;
        let urdf = format!(
            r#"<robot name="one"><link name="base"/><link name="ball"><collision>
            <origin xyz="{x} {y} {z}"/><geometry><sphere radius="{radius}"/></geometry></collision></link>
            <joint name="joint" type="{kind}"><parent link="base"/><child link="ball"/><axis xyz="{axis}"/>
            <limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"#
        );
        Robot::from_urdf(&urdf, None, None, &|_| None).expect("is sound")
    }

    fn at(q: f32) -> JointConfig {
        JointConfig::from_fn(1, |_| q)
    }

    fn post(x: f32, y: f32) -> Scene {
        let (a, b) = (Vec3::new(x, y, -1.0), Vec3::new(x, y, 1.0));
        Scene::from_primitives(vec![Primitive::Capsule { a, b, radius: 0.001 }])
    }

    #[test]
    fn a_small_ball_on_a_long_arm_does_not_swing_through_a_wire() {
        let arm =
            ArmSpheres::from_description(&one_joint("revolute", "0 0 1", Vec3::X, 0.005)).unwrap();
        let mut n_passed_by_the_search = 0;
        for i in 0..12_u8 {
            let angle = 0.52 + 0.007 * f32::from(i);
            let scene = post(angle.cos(), angle.sin());
            let checker = MotionChecker::new(&scene, &arm, 32.0);
            assert!(!checker.path_is_free(&[at(-1.0), at(1.0)]), "wire at {angle}");
            n_passed_by_the_search += u32::from(checker.motion_is_free(&at(-1.0), &at(1.0)));
        }
        assert!(n_passed_by_the_search > 3, "{n_passed_by_the_search}");
    }

    #[test]
    fn a_small_ball_on_a_slide_does_not_pass_through_a_wire() {
        let arm = ArmSpheres::from_description(&one_joint("prismatic", "1 0 0", Vec3::ZERO, 0.005))
            .unwrap();
        for i in 0..12_u8 {
            let scene = post(0.52 + 0.007 * f32::from(i), 0.0);
            let checker = MotionChecker::new(&scene, &arm, 32.0);
            assert!(!checker.path_is_free(&[at(-1.0), at(1.0)]), "wire {i}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn a_ball_swings_into_a_wire_where_the_closed_form_says(
            radius in 0.003_f32..0.03,
            lever in 0.1_f32..1.2,
            post_at in (-1.2_f32..1.2, -0.04_f32..0.04),
            (from, to) in (-1.2_f32..1.2, -1.2_f32..1.2),
        ) {
            let arm = ArmSpheres::from_description(&one_joint("revolute", "0 0 1", lever * Vec3::X, radius)).unwrap();
            let away = lever + post_at.1;
            let scene = post(away * post_at.0.cos(), away * post_at.0.sin());
            let is_free = MotionChecker::new(&scene, &arm, 32.0).path_is_free(&[at(from), at(to)]);
            // A chord between circles about the joint, from where the swing is nearest to the wire.
            let nearest = post_at.0.clamp(from.min(to), from.max(to));
            let half_turn = (0.5 * (post_at.0 - nearest)).sin();
            let distance = (post_at.1 * post_at.1 + 4.0 * lever * away * half_turn * half_turn).sqrt();
            let depth = radius + 0.001 - distance;
            // Contacts up to a millimetre deep may be missed.
            prop_assert!(!is_free || depth < 0.001 + 1e-5, "{depth} deep was missed");
            prop_assert!(is_free || depth > -1e-4, "{} away was hit", -depth);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Motions of seven joints at once past balls as small as a pinhead, near the way of the hand.
        #[test]
        fn nothing_deeper_than_a_millimetre_is_between_the_looks(
            from in prop::array::uniform7(-1.0_f32..1.0),
            by in prop::array::uniform7(-0.6_f32..0.6),
            balls in prop::collection::vec((0.0_f32..1.0, prop::array::uniform3(-0.06_f32..0.06)), 1..6),
        ) {
            const N: u16 = 2000;
            let robot = stick_arm();
            let arm = ArmSpheres::new(&robot);
            let a = JointConfig::from_fn(7, |j| robot.start[j] + from[j]);
            let b = JointConfig::from_fn(7, |j| a[j] + by[j]);
            let balls = balls.iter().map(|(fraction, off)| Primitive::Sphere {
                center: robot.grip(&a.lerp(&b, *fraction)).translation + Vec3::from(*off),
                radius: 0.001,
            });
            let scene = Scene::from_primitives(balls.collect());
            if MotionChecker::new(&scene, &arm, 8.0).path_is_free(&[a, b]) {
                for i in 0..=N {
                    let config = a.lerp(&b, f32::from(i) / f32::from(N));
                    prop_assert!(is_free_by_brute_force(&robot, &scene, &config, -0.00102), "at {i} of {N}");
                }
            }
        }
    }
}
