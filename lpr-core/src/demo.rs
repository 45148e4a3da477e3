//! Demonstrations: keyframe discovery and the transitions that one demonstration yields.
//!
//! Index logic only: where the observations of the frames are kept is the caller's business. Rules
//! of the released C2F-ARM.

use crate::path::JointPath;
use crate::perception::Observation;
use crate::q_attention::NextBestPose;
use crate::robot::{DOF, JointConfig};

use glamx::Pose3;
use serde::{Deserialize, Serialize};

/// State of the arm in one recorded frame of a demonstration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DemoFrame {
    /// Measured joint angles, radians: `q`.
    pub joints: JointConfig,
    /// Measured joint velocities, rad/s.
    pub joint_velocities: [f32; DOF],
    /// True if the gripper counts as open.
    pub gripper_open: bool,
    /// Distance between the finger pads, metres.
    pub gripper_width: f32,
    /// Pose of `grip` in the world.
    pub grip: Pose3,
}

impl DemoFrame {
    /// Checks that no joint is faster than `max_speed`, rad/s.
    fn is_still(&self, max_speed: f32) -> bool {
        self.joint_velocities.iter().all(|velocity| velocity.abs() <= max_speed)
    }
}

/// When a frame of a demonstration is a keyframe, and which transitions are made of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DemoSettings {
    /// Joint speed below which the arm counts as stopped, rad/s (released: 0.1; some robots and
    /// recorders need 0.01).
    pub stopped_speed: f32,
    /// Frames after a stop in which no other stop is looked for (released: 4).
    pub stop_cooldown: usize,
    /// Every how many frames a chain of transitions starts (released: 10).
    pub start_interval: usize,
    /// Starts from which ranker and policy learn; Q-attention learns from all.
    #[serde(default)]
    pub path_starts: PathStarts,
    /// When the ranker is shown other candidates of each demonstrated way, as failures:
    /// demonstrations hold only paths that work.
    #[serde(default)]
    pub alternatives: Alternatives,
    /// Fewest frames between a start and its first keyframe (released LPR: the length of a path,
    /// 10; C2F-ARM: 1).
    pub min_start_distance: usize,
}

/// Chains of a demonstration that ranker and policy learn from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PathStarts {
    /// All, as in the released LPR: a later motion is stored once a chain, and the first one also
    /// as ever shorter remainders of itself.
    #[default]
    Every,
    /// The whole demonstration only: each motion once.
    First,
}

/// Updates that show the ranker an alternative beside each demonstrated way that they draw.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Alternatives {
    /// None.
    #[default]
    Never,
    /// Those on demonstrations alone.
    First,
    /// All.
    Always,
}

/// A demonstration from one of its frames on, as a chain of keyframes; demo augmentation makes
/// several of one recording.
#[derive(Debug, Clone, PartialEq)]
pub struct DemoEpisode {
    /// Frame of the recording at which it starts: 0 for the whole demonstration.
    pub start: usize,
    /// The keyframes that are reached one after the other; the last ends in success.
    pub steps: Vec<DemoStep>,
}

/// The way to one keyframe of a demonstration.
#[derive(Debug, Clone, PartialEq)]
pub struct DemoStep {
    /// The observation at the start of the way, with the time feature of the step within the chain.
    pub observation: Observation,
    /// The keyframe: as the action codec can express it, if poses are learned.
    pub goal: NextBestPose,
    /// The recorded configurations up to the keyframe, in any number.
    pub path: JointPath,
}

/// One transition of a demonstration, as indices of its frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DemoTransition {
    /// Frame that is observed.
    pub observation: usize,
    /// Keyframe whose grip pose and gripper state are the action, and which is observed next.
    pub keyframe: usize,
    /// Macro step at the observation, from 0 at the start of the chain: what the time feature
    /// counts.
    pub step: usize,
    /// 1 on the last keyframe, else 0.
    pub reward: f32,
    /// True if the episode ends with this transition.
    pub terminated: bool,
}

/// The keyframes of a demonstration in ascending order: where the gripper changes, where the arm
/// stops, and the last frame.
///
/// A stop next to a change of the gripper is no keyframe of its own. A keyframe directly before the
/// last one is dropped.
///
/// ```
/// use lpr_core::demo::{Alternatives, DemoFrame, DemoSettings, PathStarts, augment_demo, discover_keyframes};
/// use lpr_core::robot::PANDA;
///
/// // Twenty frames of a moving arm, whose gripper closes in the twelfth.
/// let frame = |idx: usize| DemoFrame {
///     joints: PANDA.start,
///     joint_velocities: [0.5; 7],
///     gripper_open: idx < 12,
///     gripper_width: if idx < 12 { 0.08 } else { 0.0 },
///     grip: PANDA.grip(&PANDA.start),
/// };
/// let frames: Vec<DemoFrame> = (0..20).map(frame).collect();
/// let settings = DemoSettings { stopped_speed: 0.1, stop_cooldown: 4, start_interval: 10, path_starts: PathStarts::Every, alternatives: Alternatives::Never, min_start_distance: 1 };
/// assert_eq!(discover_keyframes(&frames, &settings), [12, 19]);
///
/// let transitions = augment_demo(&frames, &settings);
/// let ends: Vec<_> = transitions.iter().map(|it| (it.observation, it.keyframe, it.terminated)).collect();
/// assert_eq!(ends, [(0, 12, false), (12, 19, true), (10, 12, false), (12, 19, true)], "from frames 0 and 10");
/// ```
#[must_use]
pub fn discover_keyframes(frames: &[DemoFrame], settings: &DemoSettings) -> Vec<usize> {
    let mut keyframes = Vec::new();
    // Frames left in which no stop is looked for.
    let mut cooldown = 0;
    for idx in 0..frames.len() {
        let stopped = cooldown == 0 && is_stopped(frames, idx, settings.stopped_speed);
        cooldown = if stopped { settings.stop_cooldown } else { cooldown.saturating_sub(1) };
        let last = idx + 1 == frames.len();
        if idx > 0 && (last || stopped || frames[idx].gripper_open != frames[idx - 1].gripper_open)
        {
            keyframes.push(idx);
        }
    }
    if let [.., before, last] = keyframes[..]
        && before + 1 == last
    {
        keyframes.remove(keyframes.len() - 2);
    }
    keyframes
}

/// Checks that the arm stands still at `idx` and that the gripper neither changed in the two frames
/// before nor changes in the next.
fn is_stopped(frames: &[DemoFrame], idx: usize, max_speed: f32) -> bool {
    // The last two frames are no stops: the last is a keyframe anyway.
    if idx + 2 >= frames.len() || !frames[idx].is_still(max_speed) {
        return false;
    }
    let around = &frames[idx.saturating_sub(2)..=idx + 1];
    around.iter().all(|frame| frame.gripper_open == frames[idx].gripper_open)
}

/// All transitions of one demonstration: from every `start_interval`-th frame a chain through the
/// keyframes after it.
///
/// Chains follow each other in the order of their starts; each ends with the one transition that is
/// terminal and rewarded.
#[must_use]
pub fn augment_demo(frames: &[DemoFrame], settings: &DemoSettings) -> Vec<DemoTransition> {
    let keyframes = discover_keyframes(frames, settings);
    (0..frames.len())
        .step_by(settings.start_interval.max(1))
        .flat_map(|start| chain(start, &keyframes, settings.min_start_distance))
        .collect()
}

/// The transitions from `start` through all keyframes after it; none when the first of them is too
/// near.
fn chain(start: usize, keyframes: &[usize], min_start_distance: usize) -> Vec<DemoTransition> {
    let ahead = &keyframes[keyframes.partition_point(|&keyframe| keyframe <= start)..];
    if ahead.first().is_none_or(|&first| first - start < min_start_distance) {
        return Vec::new();
    }
    let observed = core::iter::once(start).chain(ahead.iter().copied());
    observed
        .zip(ahead)
        .enumerate()
        .map(|(step, (observation, &keyframe))| {
            let terminated = step + 1 == ahead.len();
            DemoTransition {
                observation,
                keyframe,
                step,
                reward: f32::from(u8::from(terminated)),
                terminated,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::PANDA;
    use proptest::prelude::{any, prop, proptest};

    const SETTINGS: DemoSettings = DemoSettings {
        stopped_speed: 0.1,
        stop_cooldown: 4,
        start_interval: 10,
        path_starts: PathStarts::Every,
        alternatives: Alternatives::Never,
        min_start_distance: 1,
    };

    fn frame(speed: f32, gripper_open: bool) -> DemoFrame {
        let gripper_width = if gripper_open { 0.08 } else { 0.0 };
        DemoFrame {
            joints: PANDA.start,
            joint_velocities: [0.0, 0.0, 0.0, -speed, 0.0, 0.0, 0.0],
            gripper_open,
            gripper_width,
            grip: Pose3::IDENTITY,
        }
    }

    /// `(frames, speed, open)` after each other.
    fn demo(parts: &[(usize, f32, bool)]) -> Vec<DemoFrame> {
        parts
            .iter()
            .flat_map(|&(n, speed, open)| core::iter::repeat_n(frame(speed, open), n))
            .collect()
    }

    #[test]
    fn a_stop_and_a_grasp_and_the_end_are_keyframes() {
        // Moves in frames 0..20, stands in 20..23, moves to 40, closes there, moves on, ends at 59.
        let frames = demo(&[(20, 0.5, true), (3, 0.05, true), (17, 0.5, true), (20, 0.5, false)]);
        assert_eq!(discover_keyframes(&frames, &SETTINGS), [20, 40, 59]);
    }

    #[test]
    fn a_stop_before_the_gripper_closes_is_merged_with_the_closing() {
        let frames = demo(&[(20, 0.5, true), (1, 0.0, true), (1, 0.0, false), (20, 0.5, false)]);
        assert_eq!(discover_keyframes(&frames, &SETTINGS), [21, 41]);
    }

    #[test]
    fn one_long_stop_yields_a_keyframe_every_cooldown() {
        let frames = demo(&[(10, 0.5, true), (7, 0.0, true), (10, 0.5, true)]);
        assert_eq!(discover_keyframes(&frames, &SETTINGS), [10, 15, 26]);
    }

    #[test]
    fn a_keyframe_directly_before_the_last_is_dropped() {
        let frames = demo(&[(10, 0.5, true), (2, 0.5, false)]);
        assert_eq!(discover_keyframes(&frames, &SETTINGS), [11]);
    }

    #[test]
    fn the_speed_below_which_the_arm_is_stopped_is_a_setting() {
        let frames = demo(&[(20, 0.5, true), (3, 0.05, true), (20, 0.5, true)]);
        let strict = DemoSettings { stopped_speed: 0.01, ..SETTINGS };
        assert_eq!(discover_keyframes(&frames, &strict), [42]);
    }

    #[test]
    fn chains_start_every_tenth_frame_and_skip_starts_near_a_keyframe() {
        let frames = demo(&[(20, 0.5, true), (3, 0.05, true), (17, 0.5, true), (20, 0.5, false)]);
        let plain = augment_demo(&frames, &SETTINGS);
        let starts = |transitions: &[DemoTransition]| -> Vec<usize> {
            transitions
                .iter()
                .filter(|transition| transition.step == 0)
                .map(|transition| transition.observation)
                .collect()
        };
        assert_eq!(starts(&plain), [0, 10, 20, 30, 40, 50]);
        let row = |observation, keyframe, step, reward| DemoTransition {
            observation,
            keyframe,
            step,
            reward,
            terminated: reward > 0.0,
        };
        assert_eq!(plain[..3], [row(0, 20, 0, 0.0), row(20, 40, 1, 0.0), row(40, 59, 2, 1.0)]);
        let lpr = DemoSettings { min_start_distance: 10, ..SETTINGS };
        assert_eq!(
            starts(&augment_demo(&frames, &lpr)),
            [0, 10, 20, 30, 40],
            "frame 50 is 9 frames before the last"
        );
    }

    #[test]
    fn an_empty_demonstration_has_no_keyframes() {
        assert_eq!(discover_keyframes(&[], &SETTINGS), [0; 0]);
        assert_eq!(discover_keyframes(&demo(&[(1, 0.0, true)]), &SETTINGS), [0; 0]);
    }

    proptest! {
        #[test]
        fn every_chain_is_connected_and_ends_at_the_last_frame(
            motion in prop::collection::vec((any::<bool>(), any::<bool>()), 2..80),
            interval in 1_usize..12,
            distance in 0_usize..12,
        ) {
            let frames: Vec<_> =
                motion.iter().map(|&(moves, open)| frame(if moves { 0.5 } else { 0.0 }, open)).collect();
            let settings = DemoSettings { start_interval: interval, min_start_distance: distance, ..SETTINGS };
            let keyframes = discover_keyframes(&frames, &settings);
            assert_eq!(keyframes.last(), Some(&(frames.len() - 1)));
            assert!(keyframes.is_sorted_by(|a, b| a < b));
            let transitions = augment_demo(&frames, &settings);
            for pair in transitions.windows(2) {
                if pair[0].terminated {
                    assert_eq!(pair[1].step, 0);
                } else {
                    assert_eq!((pair[1].observation, pair[1].step), (pair[0].keyframe, pair[0].step + 1));
                }
            }
            for transition in &transitions {
                assert!(transition.observation < transition.keyframe);
                assert_eq!(transition.terminated, transition.keyframe == frames.len() - 1);
                assert_eq!(transition.terminated, transition.reward > 0.0);
            }
        }
    }
}
