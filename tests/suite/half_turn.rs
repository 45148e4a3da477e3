//! The rule for the half turn of a grasp, on every task with both arms: a perfect label, acted, is
//! what the demonstrator did to what it held, whichever way round the hand grasped it.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use lpr_core::env::Environment as _;
use lpr_core::glamx::{Pose3, Quat};
use lpr_core::perception::Proprio;
use lpr_core::q_attention::{HalfTurn, Hand, half_turned};
use lpr_core::robot::{PANDA, Robot, XARM7};
use lpr_core::sim::feasibility::keyframe_snapshots;
use lpr_core::sim::tasks::{TASKS, Task};
use lpr_core::sim::{SimEnvironment, SimParams};
use std::sync::Arc;

/// Angle below which two orientations are one, radians: a keyframe is reached within a fraction of
/// a degree.
const SAME: f32 = 0.02;
const SCENES: u64 = 4;

/// Follows the labels of the demonstration in a scene, with the hand as the demonstrator's at the
/// start or half turned.
fn follow(task: &Arc<Task>, robot: &Arc<Robot>, seed: u64, turned: bool) {
    let mut environment =
        SimEnvironment::new(task, robot, seed, &["front"], &SimParams::STANDARD).unwrap();
    environment.reset(seed).unwrap();
    let Some(keyframes) = keyframe_snapshots(&environment, seed) else { return };
    let rule = HalfTurn::Relative;
    let start = keyframes[0].env.proprio().grip.rotation;
    let mut hand = if turned { half_turned(start) } else { start };
    for (idx, keyframe) in keyframes.iter().enumerate() {
        let demonstrated = keyframe.env.proprio();
        let goal = keyframe.goal.pose.rotation;
        let label = rule.label(goal, Hand::of(&demonstrated));
        let grip = Pose3::from_parts(demonstrated.grip.translation, hand);
        let acting = Hand::of(&Proprio { grip, ..demonstrated });
        let acted = rule.acted(label, acting);
        let at = format!("{} with {}, scene {seed}, keyframe {idx}", task.name, robot.name);
        if acting.holds {
            let motion = |goal: Quat, hand: Quat| goal * hand.inverse();
            let off = motion(goal, demonstrated.grip.rotation).angle_between(motion(acted, hand));
            assert!(off < SAME, "{at}: what is held is turned {off} rad away");
        } else {
            let off = acted.angle_between(goal).min(acted.angle_between(half_turned(goal)));
            assert!(off < SAME, "{at}: the grasp is turned {off} rad away");
        }
        hand = acted;
    }
}

#[test]
fn a_perfect_label_acted_is_what_the_demonstrator_did_to_what_it_held() {
    for task in TASKS.iter() {
        for robot in [&XARM7, &PANDA] {
            for seed in 0..SCENES {
                follow(task, robot, seed, false);
                follow(task, robot, seed, true);
            }
        }
    }
}

#[test]
fn the_rule_of_before_lays_the_bottle_the_other_way_round() {
    let wine = Task::by_name("stack_wine").unwrap();
    let laid_wrongly = (0..20).filter(|&seed| {
        let mut environment =
            SimEnvironment::new(&wine, &XARM7, seed, &["front"], &SimParams::STANDARD).unwrap();
        environment.reset(seed).unwrap();
        let Some(keyframes) = keyframe_snapshots(&environment, seed) else { return false };
        keyframes.iter().any(|keyframe| {
            let hand = Hand::of(&keyframe.env.proprio());
            let goal = keyframe.goal.pose.rotation;
            let rule = HalfTurn::Nearest;
            hand.holds && rule.acted(rule.label(goal, hand), hand).angle_between(goal) > 1.0
        })
    });
    assert!(laid_wrongly.count() > 2);
}
