//! Checks of straight joint-space motions.

use super::arm_spheres::ArmSpheres;
use super::block::{self, Checked, Looks, Sampled};
use super::contents::Scene;
use super::link_spheres::LinkBits;
use super::proximity::Proximity;
use super::sweep::Sweep;
use crate::robot::JointConfig;
use core::cell::Cell;
use core::fmt;

/// Checks motions of one arm in one scene at a fixed resolution, and counts the configurations it
/// looked at.
///
/// Both ends are free, but not the way between them:
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
///
/// let (mut left, mut right) = (XARM7.start, XARM7.start);
/// (left[0], right[0]) = (0.8, -0.8);
/// let post = Primitive::Capsule { a: Vec3::new(0.3, 0.0, 0.0), b: Vec3::new(0.3, 0.0, 0.9), radius: 0.05 };
/// let (scene, arm) = (Scene::from_primitives(vec![post]), ArmSpheres::new(&XARM7));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// assert!(checker.is_free(&left) && checker.is_free(&right));
/// assert!(!checker.motion_is_free(&left, &right));
/// assert!(!checker.path_is_free(&[left, right]) && checker.path_is_free(&[left]));
/// ```
#[derive(Clone)]
pub struct MotionChecker<'a> {
    scene: &'a Scene,
    arm: &'a ArmSpheres,
    /// Configurations per radian of joint-space distance.
    checks_per_radian: f32,
    n_checks: Cell<u64>,
    /// True if also the motions of a search are looked at as closely as a path.
    is_exact: bool,
    stop: Option<&'a dyn Fn() -> bool>,
}

impl fmt::Debug for MotionChecker<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, arm, checks_per_radian, n_checks, is_exact: _, stop: _ } = self;
        let mut debug = f.debug_struct("MotionChecker");
        debug
            .field("scene", scene)
            .field("arm", arm)
            .field("checks_per_radian", checks_per_radian)
            .field("n_checks", n_checks);
        debug.finish_non_exhaustive()
    }
}

impl<'a> MotionChecker<'a> {
    /// A checker that looks at `checks_per_radian` configurations for each radian of joint-space
    /// distance.
    #[must_use]
    pub const fn new(scene: &'a Scene, arm: &'a ArmSpheres, checks_per_radian: f32) -> Self {
        Self { scene, arm, checks_per_radian, n_checks: Cell::new(0), stop: None, is_exact: false }
    }

    /// The same, for planners that give up with
    /// [`Rejection::Stopped`](crate::path::Rejection::Stopped) once `stop` says so: they ask in
    /// every iteration. A clock makes results depend on the machine; a flag ends a search that
    /// nobody waits for.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::path::{Rejection, RrtSettings, rrt_connect};
    /// use lpr_core::rng::{Stream, stream};
    /// use lpr_core::robot::XARM7;
    /// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
    /// use std::sync::atomic::{AtomicBool, Ordering};
    ///
    /// let post = Primitive::Capsule { a: Vec3::new(0.3, 0.0, 0.0), b: Vec3::new(0.3, 0.0, 0.9), radius: 0.05 };
    /// let (scene, arm) = (Scene::from_primitives(vec![post]), ArmSpheres::new(&XARM7));
    /// let (mut start, mut goal) = (XARM7.start, XARM7.start);
    /// (start[0], goal[0]) = (0.8, -0.8);
    ///
    /// let is_cancelled = AtomicBool::new(true);
    /// let stop = || is_cancelled.load(Ordering::Relaxed);
    /// let checker = MotionChecker::new(&scene, &arm, 32.0).stopped_by(&stop);
    /// let settings = RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 5000 };
    /// let plan = rrt_connect(&checker, &start, &[goal], &settings, &mut stream(0, Stream::Planner, 0));
    /// assert_eq!(plan, Err(Rejection::Stopped));
    /// ```
    #[must_use]
    pub fn stopped_by(self, stop: &'a dyn Fn() -> bool) -> Self {
        Self { stop: Some(stop), ..self }
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.is_some_and(|stop| stop())
    }

    /// The arm.
    #[must_use]
    pub const fn arm(&self) -> &'a ArmSpheres {
        self.arm
    }

    /// The same checks at `factor` times the resolution, counted anew.
    ///
    /// ```
    /// use lpr_core::robot::{JointConfig, PANDA};
    /// use lpr_core::scene::{ArmSpheres, MotionChecker, Scene};
    ///
    /// let (scene, arm) = (Scene::empty(), ArmSpheres::new(&PANDA));
    /// let coarse = MotionChecker::new(&scene, &arm, 16.0);
    /// let fine = coarse.finer(4.0);
    /// let mut turned = PANDA.start;
    /// turned[0] += 1.0;
    /// assert!(coarse.motion_is_free(&PANDA.start, &turned) && fine.motion_is_free(&PANDA.start, &turned));
    /// assert_eq!((coarse.n_checks(), fine.n_checks()), (16, 64));
    /// ```
    #[must_use]
    pub fn finer(&self, factor: f32) -> Self {
        Self { checks_per_radian: factor * self.checks_per_radian, n_checks: Cell::new(0), ..*self }
    }

    /// The same checks at `factor` times the resolution, counted anew, each motion looked at as
    /// closely as a path.
    pub(crate) fn exact(&self, factor: f32) -> Self {
        Self { is_exact: true, ..self.finer(factor) }
    }

    /// Counts the checks of another checker as this one's.
    pub(crate) fn count(&self, other: &Self) {
        self.n_checks.set(self.n_checks.get() + other.n_checks.get());
    }

    /// Configurations looked at so far.
    #[must_use]
    pub const fn n_checks(&self) -> u64 {
        self.n_checks.get()
    }

    /// True if the arm is free at `config`.
    #[must_use]
    pub fn is_free(&self, config: &JointConfig) -> bool {
        self.n_checks.set(self.n_checks.get() + 1);
        self.scene.is_free(self.arm, config)
    }

    /// Everything that the arm at `config` is nearer to than `reach`, metres:
    /// [`Scene::proximities`].
    #[must_use]
    pub fn proximities(&self, config: &JointConfig, reach: f32) -> Vec<Proximity> {
        self.n_checks.set(self.n_checks.get() + 1);
        self.scene.proximities(self.arm, config, reach)
    }

    /// True if the straight motion from `a`, which is not looked at, to `b` is free.
    ///
    /// It is looked at in equal steps: eight, or a multiple of eight. A small sphere that moves fast
    /// may pass something between two of them: this is for edges of a search. Who returns a path
    /// asks [`Self::path_is_free`].
    #[must_use]
    pub fn motion_is_free(&self, a: &JointConfig, b: &JointConfig) -> bool {
        let n = self.n_steps(a, b);
        let sweep =
            self.is_exact.then(|| Sweep::new(self.arm, (a, b), n, Looks::Ends.spacing())).flatten();
        self.look(a, b, n, Looks::Ends, sweep.as_ref())
    }

    /// True if a motion that [`Self::motion_is_free`] found free, in whichever direction, is also free
    /// half-way between the configurations that it looked at, and wherever something deeper than
    /// 1 mm could be between these.
    pub(crate) fn is_free_between(&self, a: &JointConfig, b: &JointConfig) -> bool {
        let n = self.n_steps(a, b);
        let sweep = Sweep::new(self.arm, (a, b), n, Looks::Middles.spacing());
        self.look(a, b, n, Looks::Middles, sweep.as_ref())
    }

    fn n_steps(&self, a: &JointConfig, b: &JointConfig) -> usize {
        block::whole_blocks(libm::ceilf(a.distance(b) * self.checks_per_radian) as usize)
    }

    /// Looks at a motion in `n` steps, and closer where the `sweep` says that this leaves something
    /// unseen.
    fn look(
        &self,
        a: &JointConfig,
        b: &JointConfig,
        n: usize,
        looks: Looks,
        sweep: Option<&Sweep>,
    ) -> bool {
        let motion = Sampled { a, b, n_steps: n, looks, links: LinkBits::MAX };
        let checked = self.counted(motion, sweep);
        let Some(unseen) = checked.unseen else {
            return checked.is_free;
        };
        // Half-way between all looks so far, if that is close enough.
        let n_looks = if looks == Looks::Middles { 2 * n } else { n };
        let n_needed = libm::ceilf(unseen.refinement * n as f32) as usize;
        let (n_steps, looks) = if n_needed <= 2 * n_looks {
            (n_looks, Looks::Middles)
        } else {
            (n_needed, Looks::Ends)
        };
        self.counted(Sampled { n_steps, looks, links: unseen.links, ..motion }, None).is_free
    }

    fn counted(&self, motion: Sampled<'_>, sweep: Option<&Sweep>) -> Checked {
        let checked = block::motion_is_free(self.scene, self.arm, motion, sweep);
        self.n_checks.set(self.n_checks.get() + checked.n_checks);
        checked
    }

    /// True if the path through `configs` is free, its first configuration included: at this
    /// checker's resolution, and closer where something deeper than 1 mm could lie between two looks.
    ///
    /// A ball of 5 mm on the end of an arm of a metre swings through a wire:
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::robot::{JointConfig, Robot};
    /// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
    ///
    /// let urdf = r#"<robot name="arm"><link name="base"/><link name="ball"><collision>
    ///   <origin xyz="1 0 0"/><geometry><sphere radius="0.005"/></geometry></collision></link>
    ///   <joint name="turn" type="revolute"><parent link="base"/><child link="ball"/><axis xyz="0 0 1"/>
    ///   <limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"#;
    /// let robot = Robot::from_urdf(urdf, None, None, &|_| None)?;
    /// let (end, low) = (Vec3::new(0.52_f32.cos(), 0.52_f32.sin(), 1.0), -2.0 * Vec3::Z);
    /// let wire = Primitive::Capsule { a: end, b: end + low, radius: 0.001 };
    /// let (scene, arm) = (Scene::from_primitives(vec![wire]), ArmSpheres::from_description(&robot)?);
    /// let checker = MotionChecker::new(&scene, &arm, 32.0);
    /// let at = |q| JointConfig::from_fn(1, |_| q);
    /// assert!(!checker.path_is_free(&[at(-1.0), at(1.0)]));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    #[must_use]
    pub fn path_is_free(&self, configs: &[JointConfig]) -> bool {
        let exact = Self { is_exact: true, n_checks: Cell::new(0), ..*self };
        let is_free = configs.first().is_none_or(|start| exact.is_free(start))
            && configs.windows(2).all(|pair| exact.motion_is_free(&pair[0], &pair[1]));
        self.count(&exact);
        is_free
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Primitive;
    use crate::scene::stick_arm::stick_arm;
    use glamx::Vec3;

    #[test]
    fn a_free_motion_is_looked_at_once_at_eight_steps_or_a_multiple() {
        let (scene, arm) = (Scene::empty(), ArmSpheres::new(&stick_arm()));
        for n in 1..70_u8 {
            let checker = MotionChecker::new(&scene, &arm, 10.0);
            let mut end = stick_arm().start;
            end[0] += (f32::from(n) - 0.5) / 10.0 / 3.0;
            let checks = f32::ceil(stick_arm().start.distance(&end) * 10.0) as u64;
            assert!(checker.motion_is_free(&stick_arm().start, &end));
            assert_eq!(checker.n_checks(), checks.next_multiple_of(8));
        }
    }

    #[test]
    fn a_post_anywhere_on_the_way_of_a_turning_arm_is_found() {
        let robot = stick_arm();
        let arm = ArmSpheres::new(&robot);
        let at =
            |turn: f32| JointConfig::from_fn(7, |j| if j == 0 { turn } else { robot.start[j] });
        let reach = robot.grip(&robot.start).translation;
        for i in 0..40_u8 {
            let angle = -1.0 + 0.05 * f32::from(i);
            let base = Vec3::new(reach.x * angle.cos(), reach.x * angle.sin(), 0.0);
            let scene = Scene::from_primitives(vec![Primitive::Capsule {
                a: base,
                b: base + Vec3::Z,
                radius: 0.01,
            }]);
            let checker = MotionChecker::new(&scene, &arm, 32.0);
            assert!(!checker.motion_is_free(&at(-1.2), &at(1.2)), "post at {angle}");
            assert!(!checker.path_is_free(&[at(-1.2), at(1.2)]), "post at {angle}");
        }
    }

    /// Decides the second look: an obstacle so small that the first may
    /// step over it.
    #[test]
    fn looks_at_and_between_the_checks_see_what_an_exact_check_sees() {
        let robot = stick_arm();
        let arm = ArmSpheres::new(&robot);
        let at =
            |turn: f32| JointConfig::from_fn(7, |j| if j == 0 { turn } else { robot.start[j] });
        let grip = robot.grip(&robot.start).translation.x;
        let mut n_between_alone = 0;
        for i in 0..200_u8 {
            let angle = -1.0 + 0.01 * f32::from(i);
            let center = Vec3::new(
                grip * angle.cos(),
                grip * angle.sin(),
                robot.grip(&robot.start).translation.z,
            );
            let scene = Scene::from_primitives(vec![Primitive::Sphere { center, radius: 0.001 }]);
            // 16 and 32 steps: multiples of a block.
            let coarse = MotionChecker::new(&scene, &arm, 8.0);
            let (a, b) = (at(-1.0), at(1.0));
            let (is_free, is_free_between) =
                (coarse.motion_is_free(&a, &b), coarse.is_free_between(&a, &b));
            assert_eq!(
                is_free && is_free_between,
                coarse.exact(2.0).motion_is_free(&a, &b),
                "ball at {angle}"
            );
            assert_eq!(
                is_free_between,
                coarse.is_free_between(&b, &a),
                "ball at {angle}, backwards"
            );
            n_between_alone += u32::from(is_free && !is_free_between);
        }
        assert!(n_between_alone > 10, "{n_between_alone}");
    }

    #[test]
    fn a_path_that_starts_in_an_obstacle_is_not_free() {
        let robot = stick_arm();
        let arm = ArmSpheres::new(&robot);
        let scene = Scene::from_points(&[robot.grip(&robot.start).translation], 0.1);
        let mut away = robot.start;
        away[0] += 1.0;
        let checker = MotionChecker::new(&scene, &arm, 32.0);
        assert!(!checker.path_is_free(&[robot.start, away]));
        assert!(checker.path_is_free(&[away, away]));
    }
}
