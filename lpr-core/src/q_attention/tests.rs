//! The agent as a whole, on scenes of a few hundred points.

use super::loss::depth_loss;
use super::settings::tests::{test_proprio, test_settings};
use super::*;
use crate::nn::{Backend, NamedTensor, export, import, tensor, values};
use crate::perception::{VOXEL_CHANNELS, VoxelBounds};
use crate::rng::{Rng, Stream, stream};
use crate::robot::{Gripper, PANDA};

use burn::module::{Module as _, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor, TensorData};
use core::f32::consts::PI;
use glamx::{Pose3, Quat, Vec3};
use rand::RngExt as _;

/// A red stick on a table, and the pose above its middle that closes across it.
fn scene(index: u64) -> (QObservation, NextBestPose) {
    let rng = &mut stream(5, Stream::Placement, index);
    let place = PANDA.workspace_center().expect("a built-in arm has one").extend(0.0)
        + Vec3::new(rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2), 0.0);
    let yaw = rng.random_range(-0.9..1.2);
    let turn = Quat::from_rotation_z(yaw);
    let table = (0..400).map(|i| {
        (
            PANDA.workspace_center().expect("a built-in arm has one").extend(0.0)
                + grid_point(i, 20, 0.4),
            [120; 3],
        )
    });
    let stick = (0..80)
        .map(|i| (place + turn * Vec3::new(i as f32 / 400.0 - 0.1, 0.0, 0.05), [250, 10, 10]));
    let observation = QObservation::from_points(
        table.chain(stick),
        test_proprio(),
        VoxelBounds::scene(&PANDA).expect("a built-in arm has one"),
        0.005,
    );
    let pose = Pose3::from_parts(place + Vec3::Z * 0.05, turn * Quat::from_rotation_x(PI));
    (observation, NextBestPose { pose, gripper: Gripper::Close })
}

fn grid_point(i: usize, n: usize, half: f32) -> Vec3 {
    let along = |i: usize| half * (2.0 * i as f32 / (n - 1) as f32 - 1.0);
    Vec3::new(along(i % n), along(i / n), 0.0)
}

fn agent(settings: QAttentionSettings) -> QAttention {
    let rng = &mut stream(2, Stream::Init, 0);
    QAttention::new(
        settings,
        VoxelBounds::scene(&PANDA).expect("a built-in arm has one"),
        Backend::Flex,
        rng,
    )
    .expect("settings that fit together")
}

fn terminal(scene: &(QObservation, NextBestPose)) -> QSample<'_> {
    QSample {
        observation: &scene.0,
        action: scene.1,
        reward: 1.0,
        next: None,
        weight: 1.0,
        imitated: true,
    }
}

#[test]
fn one_keyframe_is_learned() {
    let settings = QAttentionSettings {
        learning_rate: 1e-2,
        crop_jitter: 0.0,
        yaw_range: 0.0,
        shift_range: Vec3::ZERO,
        rotation_regularisation: 0.1,
        ..test_settings()
    };
    let mut agent = agent(settings);
    let scenes = (0..1).map(scene).collect::<Vec<_>>();
    let batch = scenes.iter().map(terminal).collect::<Vec<_>>();
    let reports = (0..100)
        .map(|update| agent.update(&batch, &mut stream(1, Stream::Augment, update)))
        .collect::<Vec<_>>();
    assert!(
        reports.iter().all(|report| report.mean_target == 1.0),
        "every row is terminal and rewarded"
    );
    for (observation, goal) in &scenes {
        let chosen = agent.act(observation, ActingNetwork::Online).goal;
        let near = agent.codec().quantise(goal).expect("inside the bounds");
        let distance = chosen.pose.translation.distance(near.pose.translation);
        // 3.75 cm: the side of a voxel of the last depth.
        assert!(distance < 0.04, "{distance} m from the keyframe");
        assert!(
            chosen.pose.rotation.angle_between(goal.pose.rotation) < 0.5,
            "{chosen:?} for {goal:?}"
        );
        assert_eq!(chosen.gripper, goal.gripper);
    }
}

#[test]
fn an_interpolated_position_is_learned_within_its_voxel() {
    let settings = QAttentionSettings {
        learning_rate: 1e-2,
        crop_jitter: 0.0,
        yaw_range: 0.0,
        shift_range: Vec3::ZERO,
        translation_regularisation: vec![0.1; 2],
        imitation: Some(Imitation { weight: 1.0, temperature: 0.1 }),
        ..test_settings()
    };
    let scene = scene(0);
    let error = |position| {
        let mut agent = agent(QAttentionSettings { position, ..settings.clone() });
        for update in 0..200 {
            agent.update(&[terminal(&scene)], &mut stream(1, Stream::Augment, update));
        }
        let chosen = agent.act(&scene.0, ActingNetwork::Online).goal.pose.translation;
        chosen.distance(scene.1.pose.translation)
    };
    let [voxel, interpolated] = [Position::Voxel, Position::Interpolated].map(error);
    // Half a voxel of the last depth is 1.9 cm.
    assert!(voxel > 0.008 && interpolated < 0.004, "{voxel} m, then {interpolated} m");
}

#[test]
fn ten_updates_are_the_same_bits_twice() {
    let run = || {
        let mut agent = agent(test_settings());
        let scenes = (0..3).map(scene).collect::<Vec<_>>();
        let mut batch = scenes.iter().map(terminal).collect::<Vec<_>>();
        (batch[0].reward, batch[0].next) = (0.0, Some(&scenes[1].0));
        (0..10)
            .map(|update| agent.update(&batch, &mut stream(1, Stream::Augment, update)))
            .collect::<Vec<_>>()
    };
    let (first, second) = (run(), run());
    assert_eq!(first, second);
    assert_ne!(first[0].losses, first[9].losses);
    assert!(first[0].priorities.iter().all(|priority| (0.0..=3.0).contains(priority)));
}

#[test]
fn a_restored_agent_goes_on_bit_by_bit() {
    let mut straight = agent(test_settings());
    let scenes = (0..2).map(scene).collect::<Vec<_>>();
    let batch = scenes.iter().map(terminal).collect::<Vec<_>>();
    straight.update(&batch, &mut stream(1, Stream::Augment, 0));
    let rng = &mut stream(77, Stream::Init, 0);
    let bounds = VoxelBounds::scene(&PANDA).expect("a built-in arm has one");
    let mut resumed =
        QAttention::new(test_settings(), bounds, Backend::Flex, rng).expect("the same settings");
    assert_ne!(resumed.state(), straight.state());
    resumed.restore(&straight.state()).expect("a state of the same settings");
    for update in 1..3 {
        let rng = || stream(1, Stream::Augment, update);
        assert_eq!(straight.update(&batch, &mut rng()), resumed.update(&batch, &mut rng()));
    }
    let mut other = agent(QAttentionSettings {
        zoom_half_widths: vec![],
        translation_regularisation: vec![1.0],
        ..test_settings()
    });
    assert!(other.restore(&straight.state()).is_err());
}

#[test]
fn a_decision_is_the_best_of_its_values() {
    let agent = agent(test_settings());
    let decision = agent.act(&scene(0).0, ActingNetwork::Target);
    assert_eq!(decision.depths.len(), 2);
    for (depth, voxel) in decision.depths.iter().zip(&decision.action.voxels) {
        let best = depth.values[depth.grid.space.flat_from_voxel(*voxel)];
        assert!(depth.values.iter().all(|value| *value <= best));
    }
    for (values, bin) in decision.rotation_values.iter().zip(decision.action.rotation) {
        assert_eq!(values.len(), 24);
        assert!(values.iter().all(|value| *value <= values[bin]));
    }
    let chosen = agent.codec().decode(&decision.action);
    assert_eq!(decision.goal, agent.acted(chosen, &scene(0).0.proprio));
    assert_eq!(
        (decision.goal.pose.translation, decision.goal.gripper),
        (chosen.pose.translation, chosen.gripper)
    );
    assert_eq!(agent.act(&scene(0).0, ActingNetwork::Target).goal, decision.goal);
}

#[test]
fn a_hand_does_not_turn_to_the_other_side_of_the_same_grasp() {
    let agent = agent(test_settings());
    let (mut seen, _) = scene(0);
    let chosen = agent.act(&seen, ActingNetwork::Target).goal.pose.rotation;
    // The hand is already there, on the other side, which its networks do not see.
    seen.proprio.grip.rotation = chosen;
    let here = agent.act(&seen, ActingNetwork::Target);
    seen.proprio.grip.rotation = half_turned(chosen);
    let again = agent.act(&seen, ActingNetwork::Target);
    assert_eq!(again.action, here.action);
    let angle = |rotation: Quat| rotation.angle_between(seen.proprio.grip.rotation);
    let acted = again.goal.pose.rotation;
    assert!(angle(acted) <= angle(half_turned(acted)));
}

#[test]
fn gradients_of_the_loss_are_its_differences() {
    let settings = QAttentionSettings {
        network: NetworkSettings::Fast {
            cell_channels: 3,
            block_channels: 4,
            head_channels: 2,
            attended_channels: 4,
            hidden: 5,
            harmonics: 2,
        },
        ..test_settings()
    };
    let plain = Backend::Flex.device();
    let rng = &mut stream(3, Stream::Init, 0);
    let network = QNetwork::new(&settings, 1, &plain, rng);
    // Output layers start at zero, where nothing before them has a gradient.
    let mut tensors = export(&network);
    tensors
        .iter_mut()
        .flat_map(|tensor| &mut tensor.values)
        .for_each(|value| *value += rng.random_range(-0.1..0.1));
    let network = import(network, &tensors).expect("its own tensors");
    let leaves = network.clone().train();
    let gradients = loss_of(&leaves, &plain.clone().autodiff()).backward();
    let gradients = collect(&leaves, gradients);
    let step = 1e-3;
    let moved = |k: usize, by: f32| {
        let mut tensors: Vec<NamedTensor> = tensors.clone();
        // Along the gradient itself, where the difference is largest.
        let norm = gradients[k].iter().map(|g| g * g).sum::<f32>().sqrt().max(1e-9);
        tensors[k]
            .values
            .iter_mut()
            .zip(&gradients[k])
            .for_each(|(value, g)| *value += by * g / norm);
        let network = import(network.clone(), &tensors).expect("its own tensors");
        values(loss_of(&network, &plain))[0]
    };
    for (k, gradient) in gradients.iter().enumerate() {
        let norm = gradient.iter().map(|g| g * g).sum::<f32>().sqrt();
        let slope = (moved(k, step) - moved(k, -step)) / (2.0 * step);
        assert!(
            (slope - norm).abs() <= 0.03 * norm + 1e-3,
            "{}: slope {slope}, gradient {norm}",
            tensors[k].name
        );
    }
}

fn loss_of(network: &QNetwork, device: &burn::tensor::Device) -> Tensor<1> {
    let rng: &mut Rng = &mut stream(4, Stream::Noise, 0);
    let n_voxels = 512;
    let random =
        |n: usize, rng: &mut Rng| (0..n).map(|_| rng.random_range(-1.0..1.0)).collect::<Vec<f32>>();
    let input = NetworkInput {
        voxels: tensor(
            random(2 * VOXEL_CHANNELS * n_voxels, rng),
            [2, n_voxels, VOXEL_CHANNELS],
            device,
        ),
        proprio: tensor(random(28, rng), [2, 14], device),
        attended: Some(vec![17, 400]),
    };
    let ints = |values: Vec<i32>| TensorData::new(values, [2, 1]);
    let choices = loss::Choices {
        voxel: Tensor::from_data(ints(vec![17, 400]), device),
        pose: Some((
            Tensor::from_data(TensorData::new(vec![1_i32, 5, 23, 0, 12, 7], [2, 3, 1]), device),
            Tensor::from_data(ints(vec![0, 1]), device),
        )),
    };
    let column = |values: Vec<f32>| tensor(values, [2], device);
    let rows = loss::PerSample {
        targets: column(vec![1.0, 0.3]),
        weights: column(vec![0.5, 0.25]),
        imitated: column(vec![1.0, 0.0]),
        spread: None,
    };
    let loss_weights = loss::LossWeights {
        translation: 1.0,
        rotation: 1.0,
        imitation: Some(Imitation { weight: 0.1, temperature: 0.2 }),
    };
    depth_loss(&network.forward(input), &choices, rows, loss_weights).total
}

fn collect(leaves: &QNetwork, gradients: Gradients) -> Vec<Vec<f32>> {
    struct Collector(Gradients, Vec<Vec<f32>>);
    impl ModuleVisitor for Collector {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            self.1.push(values(
                param.val().grad(&self.0).expect("the loss depends on every parameter"),
            ));
        }
    }
    let mut collector = Collector(gradients, Vec::new());
    leaves.visit(&mut collector);
    collector.1
}
