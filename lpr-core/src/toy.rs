//! A world without physics that a path can fail in: quick enough to learn in seconds.
//!
//! The grip reaches a knob and then moves it to its end. The first way is free. The second has to
//! bow to one side, as the way of a door's handle does; a straighter path presses on the knob and
//! ends the episode.

use crate::env::{EPISODE_LENGTH, Environment, InvalidAction, StepResult};
use crate::error::{Error, Result};
use crate::path::{BezierCurve, JointPath};
use crate::perception::{Camera, Observation, Proprio, View, time_feature};
use crate::q_attention::NextBestPose;
use crate::rng::{Rng, Stream, stream};
use crate::robot::{Gripper, JointConfig, Robot};
use std::sync::Arc;

use core::f32::consts::PI;
use glamx::{Pose3, Quat, Vec2, Vec3};
use rand::RngExt as _;

/// Least distance from the straight line along [`SIDE`] that the second path has to reach, metres.
const BOW: f32 = 0.03;

/// Direction in which the second path has to bow.
const SIDE: Vec3 = Vec3::Y;

/// Greatest distance from the end of a path to the pose, metres.
const TOLERANCE: f32 = 0.01;

/// Spread of the knob along x and y around the workspace's centre, metres.
const SPREAD: f32 = 0.08;

/// Height of the knob, metres.
const HEIGHT: f32 = 0.2;

/// From the knob to where it goes, metres.
const TRAVEL: Vec3 = Vec3::new(-0.12, 0.0, 0.08);

/// Points that the camera sees along each side of the knob.
const KNOB_POINTS: usize = 4;

/// The toy world.
///
/// ```
/// use lpr_core::env::Environment;
/// use lpr_core::rng::{Stream, stream};
/// use lpr_core::robot::{Gripper, PANDA};
/// use lpr_core::toy::Toy;
///
/// let mut toy = Toy::new(&PANDA)?;
/// toy.reset(3)?;
/// let rng = &mut stream(3, Stream::Demo, 0);
/// let mut step = || toy.demonstrated_path(rng).map(|path| toy.step(&path, Gripper::Close));
/// let reached = step().expect("the knob is within reach");
/// assert!(!reached.terminated && reached.reward == 0.0);
/// let moved = step().expect("so is its end");
/// assert!(moved.terminated && moved.reward == 1.0);
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Toy {
    robot: Arc<Robot>,
    max_width: f32,
    center: Vec2,
    knob: Vec3,
    joints: JointConfig,
    gripper: Gripper,
    keyframe: usize,
    n_steps: usize,
}

impl Toy {
    /// Number of keyframes.
    pub const KEYFRAMES: usize = 2;

    /// The world before its first episode.
    ///
    /// # Errors
    ///
    /// When the arm's gripper or workspace is not known: files describe none.
    pub fn new(robot: &Arc<Robot>) -> Result<Self> {
        Ok(Self {
            robot: Arc::clone(robot),
            max_width: robot.gripper()?.max_width,
            center: robot.workspace_center()?,
            knob: Vec3::ZERO,
            joints: robot.start,
            gripper: Gripper::Open,
            keyframe: 0,
            n_steps: 0,
        })
    }

    /// The demonstrator's way to the next keyframe; none where the arm cannot follow it.
    #[must_use]
    pub fn demonstrated_path(&self, rng: &mut Rng) -> Option<JointPath> {
        let (start, goal) = (self.robot.grip(&self.joints), self.goal(self.keyframe).pose);
        let bow = SIDE * rng.random_range(2.5 * BOW..4.0 * BOW);
        let curve =
            BezierCurve::new(&start, 0.5 * (start.translation + goal.translation) + bow, &goal);
        curve.to_joints(&self.robot, &self.joints).ok()
    }

    /// The report of camera and arm now; a toy never fails.
    #[must_use]
    pub fn observe(&mut self) -> Observation {
        let eye = self.center.extend(1.0);
        let camera = Camera::looking("toy", eye, -Vec3::Z, 1.0)
            .with_size(KNOB_POINTS * KNOB_POINTS, KNOB_POINTS);
        let mut view = View::empty(camera);
        let n = KNOB_POINTS;
        for idx in 0..view.points.len() {
            let cell = [idx % n, idx / n % n, idx / (n * n)]
                .map(|i| (i as f32 / (n - 1) as f32 - 0.5) * 0.03);
            let point = self.goal(self.keyframe).pose.translation + Vec3::from_array(cell);
            (view.points[idx], view.rgb[idx], view.depth[idx]) =
                (point, [200, 30, 30], eye.z - point.z);
        }
        let gripper_width = match self.gripper {
            Gripper::Open => self.max_width,
            Gripper::Close => 0.0,
        };
        let proprio = Proprio {
            joints: self.joints,
            gripper_width,
            gripper_open: Proprio::openness(gripper_width, self.max_width),
            finger_positions: [0.5 * gripper_width; 2],
            grip: self.robot.grip(&self.joints),
            time: time_feature(self.n_steps, EPISODE_LENGTH),
        };
        Observation { views: vec![view], proprio }
    }

    /// One macro action; a toy never fails.
    pub fn step(&mut self, path: &JointPath, gripper: Gripper) -> StepResult {
        self.n_steps += 1;
        let result = self.end(path, gripper);
        if !result.terminated {
            let goal = self.goal(self.keyframe);
            let arrived = self.robot.grip(path.goal()).translation.distance(goal.pose.translation)
                < TOLERANCE;
            (self.joints, self.gripper) = (*path.goal(), gripper);
            if arrived && self.keyframe == 0 && gripper == goal.gripper {
                self.keyframe = 1;
            }
        }
        result
    }

    fn goal(&self, keyframe: usize) -> NextBestPose {
        let position = if keyframe == 0 { self.knob } else { self.knob + TRAVEL };
        NextBestPose {
            pose: Pose3::from_parts(position, Quat::from_rotation_x(PI)),
            gripper: Gripper::Close,
        }
    }

    /// Distance by which the grip bows to the side of the straight line, metres.
    fn bow(&self, path: &JointPath) -> f32 {
        let positions = path.configs().iter().map(|config| self.robot.grip(config).translation);
        let (start, goal) =
            (self.robot.grip(path.start()).translation, self.robot.grip(path.goal()).translation);
        let along = goal - start;
        positions.fold(0.0_f32, |most, position| {
            let fraction = (position - start).dot(along) / along.length_squared().max(1e-6);
            most.max((position - start - fraction * along).dot(SIDE))
        })
    }

    fn end(&self, path: &JointPath, gripper: Gripper) -> StepResult {
        let truncated = self.n_steps >= EPISODE_LENGTH;
        let going_on = StepResult { reward: 0.0, terminated: false, truncated, invalid: None };
        let refused = |invalid| StepResult {
            terminated: true,
            truncated: false,
            invalid: Some(invalid),
            ..going_on
        };
        if path.start().max_joint_distance(&self.joints) > 1e-3 {
            return refused(InvalidAction::StartMismatch);
        }
        if !path.configs().iter().all(|config| self.robot.within_limits(config)) {
            return refused(InvalidAction::OutsideLimits);
        }
        let goal = self.goal(self.keyframe);
        let arrived =
            self.robot.grip(path.goal()).translation.distance(goal.pose.translation) < TOLERANCE;
        if !arrived || gripper != goal.gripper || self.keyframe == 0 {
            return going_on;
        }
        let bow = self.bow(path);
        if bow < BOW {
            return refused(InvalidAction::Force { link: "hand", newtons: 100.0 });
        }
        StepResult { reward: 1.0, terminated: true, truncated: false, invalid: None }
    }
}

impl Environment for Toy {
    fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    fn reset(&mut self, seed: u64) -> Result<()> {
        let rng = &mut stream(seed, Stream::Placement, 0);
        let center = self.center;
        let offset = [0; 2].map(|_| rng.random_range(-SPREAD..SPREAD));
        let knob = Vec3::new(center.x + offset[0], center.y + offset[1], HEIGHT);
        *self = Self { knob, ..Self::new(&self.robot)? };
        let is_reached =
            |keyframe| self.robot.ik_nearest(&self.goal(keyframe).pose, &self.joints).is_some();
        if !(0..Self::KEYFRAMES).all(is_reached) {
            return Err(Error::Environment(format!("the arm cannot reach the knob at {knob}")));
        }
        Ok(())
    }

    fn observe(&mut self) -> Result<Observation> {
        Ok(Self::observe(self))
    }

    fn step(&mut self, path: &JointPath, gripper: Gripper) -> Result<StepResult> {
        Ok(Self::step(self, path, gripper))
    }

    fn demonstrated_goal(&self) -> Option<NextBestPose> {
        Some(self.goal(self.keyframe))
    }
}

#[cfg(feature = "learn")]
mod demonstrations {
    use super::{Environment as _, Result, Stream, Toy, stream};
    use crate::demo::{DemoEpisode, DemoStep};
    use crate::error::Error;

    impl Toy {
        /// The demonstration of scene `seed`.
        ///
        /// # Errors
        ///
        /// When the arm cannot follow the demonstrator's curves.
        pub fn demonstration(&mut self, seed: u64) -> Result<DemoEpisode> {
            let rng = &mut stream(seed, Stream::Demo, 0);
            self.reset(seed)?;
            let mut steps = Vec::new();
            for keyframe in 0..Self::KEYFRAMES {
                let unreachable =
                    || Error::Environment(format!("no demonstration of the toy's scene {seed}"));
                let path = self.demonstrated_path(rng).ok_or_else(unreachable)?;
                let goal = self.goal(keyframe);
                let observation = self.observe();
                self.step(&path, goal.gripper);
                steps.push(DemoStep { observation, goal, path });
            }
            Ok(DemoEpisode { start: 0, steps })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::ROBOTS;

    #[test]
    fn bowed_paths_succeed_and_straight_ones_press_on_the_knob() {
        for robot in ROBOTS {
            let mut toy = Toy::new(robot).unwrap();
            for seed in 0..10 {
                let mut rng = stream(seed, Stream::Demo, 0);
                toy.reset(seed).expect("within reach");
                let first = toy.demonstrated_path(&mut rng).expect("a path");
                let result = toy.step(&first, Gripper::Close);
                assert_eq!(
                    (result.reward, result.terminated, result.truncated),
                    (0.0, false, false)
                );
                let mut other = toy.clone();
                let second = toy.demonstrated_path(&mut rng).expect("a path");
                assert_eq!(
                    toy.step(&second, Gripper::Close).reward,
                    1.0,
                    "{} scene {seed}",
                    robot.name
                );
                let straight = JointPath::new(vec![*second.start(), *second.goal()])
                    .expect("two configurations");
                let result = other.step(&straight.resample(20), Gripper::Close);
                assert!(
                    result.terminated
                        && matches!(result.invalid, Some(InvalidAction::Force { .. })),
                    "{result:?}"
                );
            }
        }
    }

    #[test]
    fn an_episode_is_cut_off_and_a_path_from_elsewhere_is_refused() {
        let mut toy = Toy::new(ROBOTS[0]).unwrap();
        toy.reset(3).expect("within reach");
        let still = JointPath::new(vec![toy.joints; 2]).expect("two configurations");
        for step in 1..=EPISODE_LENGTH {
            let result = toy.step(&still, Gripper::Open);
            assert_eq!((result.truncated, result.terminated), (step == EPISODE_LENGTH, false));
        }
        let elsewhere =
            JointPath::new(vec![toy.joints.map(|q| q + 0.1); 2]).expect("two configurations");
        assert_eq!(toy.step(&elsewhere, Gripper::Open).invalid, Some(InvalidAction::StartMismatch));
    }
}
