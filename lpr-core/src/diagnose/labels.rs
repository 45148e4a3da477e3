//! Audit of the labels that demonstrations give: does one keyframe teach one answer?

use super::poses::degrees_between;
use crate::agent::Agent;
use crate::demo::DemoEpisode;
use crate::q_attention::{AugmentedLabel, RotationCodec};
use crate::rng::{Stream, stream};

use core::f32::consts::PI;
use serde::Serialize;

/// Labels of an angle that are farther apart than this are different answers, degrees.
const GAP: f32 = 30.0;
/// Share of the augmentations from which on the other of two equivalent grasps counts as a second
/// label of a keyframe.
const SECOND: f64 = 0.05;

/// The labels of one keyframe of all demonstrations, under augmentation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KeyframeLabels {
    /// The keyframe, from 0.
    pub keyframe: usize,
    /// Demonstrations that have it.
    pub demonstrations: usize,
    /// Labels that were drawn.
    pub labels: usize,
    /// Modes of roll, pitch and yaw: groups of labels more than 30° apart. The turn of the
    /// augmentation is taken off the yaw, which is counted within each demonstration (the most of
    /// them), since objects stand differently in each.
    pub modes: [usize; 3],
    /// Demonstrations whose augmentations have labels of both equivalent grasps.
    pub with_both_grasps: usize,
    /// Share of labels of the rarer of the two grasps, mean over the demonstrations.
    pub rarer_grasp: f64,
    /// Share of neighbours, by the turn of the augmentation, between which roll, pitch and yaw jump
    /// by more than 30°.
    pub jumps: [f64; 3],
    /// What makes a keyframe have two labels; none where it has one.
    pub warning: Option<String>,
}

/// The audit of `demonstrations` (each one's chain from its first frame) by `n` augmentations of
/// each keyframe.
pub(super) fn audit(
    agent: &Agent,
    demonstrations: &[DemoEpisode],
    n: usize,
    seed: u64,
) -> Vec<KeyframeLabels> {
    let Some(attention) = &agent.networks.q_attention else { return Vec::new() };
    let n_keyframes = demonstrations.iter().map(|demo| demo.steps.len()).max().unwrap_or(0);
    let codec = attention.codec().rotation;
    let of_keyframe = |keyframe: usize| {
        let labels = |(demo_idx, demo): (usize, &DemoEpisode)| {
            let step = demo.steps.get(keyframe)?;
            let seen = agent.attended(&step.observation)?;
            let rng =
                &mut stream(seed, Stream::Augment, (demo_idx * n_keyframes + keyframe) as u64);
            Some(attention.augmented_labels(&seen, step.goal, n, rng))
        };
        let per_demo: Vec<_> = demonstrations.iter().enumerate().filter_map(labels).collect();
        summary(codec, keyframe, per_demo)
    };
    (0..n_keyframes).map(of_keyframe).collect()
}

fn summary(
    codec: RotationCodec,
    keyframe: usize,
    mut per_demo: Vec<Vec<AugmentedLabel>>,
) -> KeyframeLabels {
    per_demo.retain(|labels| !labels.is_empty());
    let n = per_demo.len().max(1) as f64;
    let rarer = |labels: &Vec<AugmentedLabel>| {
        let turned = labels.iter().filter(|label| label.half_turned).count();
        turned.min(labels.len() - turned) as f64 / labels.len() as f64
    };
    let with_both_grasps = per_demo.iter().filter(|labels| rarer(labels) >= SECOND).count();
    let rarer_grasp = per_demo.iter().map(rarer).sum::<f64>() / n;
    // Of roll and pitch, all demonstrations together; of the yaw, each by itself.
    let together = |axis: usize| {
        let angles = per_demo.iter().flatten().map(|label| degrees(codec, label, axis));
        modes(angles.collect())
    };
    let alone = |labels: &Vec<AugmentedLabel>| {
        modes(labels.iter().map(|label| degrees(codec, label, 2)).collect())
    };
    let modes = [together(0), together(1), per_demo.iter().map(alone).max().unwrap_or(0)];
    let mut jumps = [0.0; 3];
    for labels in &mut per_demo {
        labels.sort_by(|a, b| a.yaw.total_cmp(&b.yaw));
        for (axis, jumps) in jumps.iter_mut().enumerate() {
            *jumps += share_of_jumps(codec, labels, axis) / n;
        }
    }
    let labels = per_demo.iter().map(Vec::len).sum();
    let warning = warning(with_both_grasps, per_demo.len(), rarer_grasp, modes);
    let demonstrations = per_demo.len();
    KeyframeLabels {
        keyframe,
        demonstrations,
        labels,
        modes,
        with_both_grasps,
        rarer_grasp,
        jumps,
        warning,
    }
}

fn warning(with_both: usize, n_demos: usize, rarer: f64, modes: [usize; 3]) -> Option<String> {
    if with_both > 0 {
        let share = 100.0 * rarer;
        return Some(format!(
            "both grasps, half a turn apart, in {with_both} of {n_demos} demonstrations ({share:.0} %)"
        ));
    }
    let names = ["roll", "pitch", "yaw"];
    let several: Vec<_> = names
        .into_iter()
        .zip(modes)
        .filter(|(_, modes)| *modes > 1)
        .map(|(name, modes)| format!("{modes} modes of {name}"))
        .collect();
    (!several.is_empty()).then(|| several.join(", "))
}

/// An angle of a label, degrees; of the yaw, without the turn of the augmentation.
fn degrees(codec: RotationCodec, label: &AugmentedLabel, axis: usize) -> f32 {
    let angle = codec.angle(label.rotation[axis]);
    let angle = if axis == 2 { angle - label.yaw } else { angle };
    let angle = angle.to_degrees();
    angle - 360.0 * libm::floorf((angle + 180.0) / 360.0)
}

/// Groups of angles around the circle, -180° to 180°, that are more than [`GAP`] apart.
fn modes(mut angles: Vec<f32>) -> usize {
    angles.sort_by(f32::total_cmp);
    let (Some(first), Some(last)) = (angles.first(), angles.last()) else { return 0 };
    let around = first + 360.0 - last;
    let gaps = angles.windows(2).map(|pair| pair[1] - pair[0]).chain([around]);
    gaps.filter(|gap| *gap > GAP).count().max(1)
}

/// Of `labels` in the order of their augmentations' turns.
fn share_of_jumps(codec: RotationCodec, labels: &[AugmentedLabel], axis: usize) -> f64 {
    let jumps = |pair: &&[AugmentedLabel]| {
        let [a, b] = [pair[0], pair[1]];
        let turned = if axis == 2 { (b.yaw - a.yaw).abs().min(PI).to_degrees() } else { 0.0 };
        degrees_between(codec, a.rotation[axis], b.rotation[axis]) - turned > GAP
    };
    let n = labels.len().saturating_sub(1).max(1);
    labels.windows(2).filter(jumps).count() as f64 / n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const CODEC: RotationCodec = RotationCodec { n_bins: 72 };

    /// A label whose grasp turns with the scene, by the other of the two grasps from `flip` on.
    fn label(yaw: f32, flip: f32) -> AugmentedLabel {
        let half_turned = yaw > flip;
        let angle = if half_turned { yaw + PI } else { yaw };
        AugmentedLabel { yaw, rotation: [0, 36, CODEC.bin(angle)], half_turned }
    }

    fn labels(flip: f32) -> Vec<AugmentedLabel> {
        (0..200).map(|i| label(-0.785 + 1.57 * i as f32 / 199.0, flip)).collect()
    }

    #[test]
    fn a_grasp_that_turns_with_the_scene_has_one_label() {
        let found = summary(CODEC, 0, vec![labels(9.0); 3]);
        assert_eq!((found.modes, found.with_both_grasps), ([1, 1, 1], 0));
        assert_eq!((found.jumps, found.warning), ([0.0; 3], None));
    }

    #[test]
    fn a_grasp_that_flips_under_augmentation_is_named() {
        let found = summary(CODEC, 1, vec![labels(9.0), labels(0.3)]);
        assert_eq!((found.modes, found.with_both_grasps), ([1, 1, 2], 1));
        assert!(found.jumps[2] > 0.0 && found.jumps[0] == 0.0);
        assert!(found.warning.expect("two labels").contains("half a turn"));
    }

    #[test]
    fn modes_are_counted_around_the_circle() {
        assert_eq!(modes(vec![179.0, -178.0, 175.0]), 1);
        assert_eq!(modes(vec![0.0, 5.0, 90.0, -175.0]), 3);
        assert_eq!(modes(vec![]), 0);
    }
}
