//! What the network of a depth reads.

use super::QNetwork;
use crate::nn::tensor;
use crate::perception::{INDEX, LOW_DIM, Proprio, VOXEL_CHANNELS, VoxelGrid, rotation_columns};
use crate::q_attention::grasp::HalfTurn;
use crate::q_attention::settings::{Places, QAttentionSettings};

use burn::tensor::{Device, Tensor};
use glamx::{Pose3, Quat, Vec3};

/// Distance from the hand that a place channel of 1 stands for, metres.
const PLACE_SCALE: f32 = 0.2;

/// Input of the network of one depth.
#[derive(Debug, Clone)]
pub struct NetworkInput {
    /// `[B, D H W, 10]` or `[B, D H W, 20]`: the channels of [`crate::perception::VoxelGrid`] for
    /// each voxel, then those of the wider grid where there is one, in the order of
    /// [`QNetwork::raster_of_row`].
    pub voxels: Tensor<3>,
    /// `[B, 11]` or `[B, 14]`: what the arm knows of itself, see [`HalfTurn`].
    pub proprio: Tensor<2>,
    /// Voxel of each sample, flat, whose rotation is asked for; none: the best.
    pub attended: Option<Vec<usize>>,
}

/// One sample of what the network of a depth reads.
#[derive(Debug, Clone)]
pub(in crate::q_attention) struct DepthInput {
    pub(in crate::q_attention) grid: VoxelGrid,
    /// [`QAttentionSettings::wide_half_width`].
    pub(in crate::q_attention) wide: Option<VoxelGrid>,
    pub(in crate::q_attention) arm: ArmInput,
}

/// A motion of the hand that networks are told of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::q_attention) struct HandMotion {
    /// Metres.
    pub(in crate::q_attention) shift: Vec3,
    /// About the vertical, radians.
    pub(in crate::q_attention) turn: f32,
}

impl HandMotion {
    fn of(self, grip: Pose3) -> Pose3 {
        let rotation = Quat::from_rotation_z(self.turn) * grip.rotation;
        Pose3::from_parts(grip.translation + self.shift, rotation)
    }
}

/// The arm as the network of a depth is told of it.
#[derive(Debug, Clone)]
pub(in crate::q_attention) struct ArmInput {
    /// [`proprio_features`].
    features: Vec<f32>,
    /// The hand from which places are told, where they are: [`Places::Held`].
    hand_from_world: Option<Pose3>,
}

impl ArmInput {
    /// The arm as it is; with `jitter`, the hand is told from elsewhere.
    pub(in crate::q_attention) fn new(
        settings: &QAttentionSettings,
        depth_idx: usize,
        proprio: &Proprio,
        jitter: Option<HandMotion>,
    ) -> Self {
        let half_turn = settings.half_turn;
        let Pose3 { translation, rotation, .. } = proprio.grip;
        // The label is of the hand as it is seen before it is told from elsewhere.
        let seen = Pose3::from_parts(translation, half_turn.seen(rotation));
        let told = Proprio { grip: jitter.map_or(seen, |jitter| jitter.of(seen)), ..*proprio };
        let tells = settings.places == Places::Held && depth_idx > 0 && proprio.holds();
        let hand_from_world = tells.then(|| told.grip.inverse());
        Self { features: proprio_features(half_turn, &told), hand_from_world }
    }
}

impl NetworkInput {
    /// Samples as one batch for `network`.
    pub(in crate::q_attention) fn new(
        network: &QNetwork,
        samples: &[DepthInput],
        device: &Device,
    ) -> Self {
        let n_proprio = samples.first().map_or(0, |sample| sample.arm.features.len());
        let n_voxels = samples.first().map_or(0, |sample| sample.grid.space.n_voxels());
        let n_grids = samples.first().map_or(0, |sample| 1 + usize::from(sample.wide.is_some()));
        let n_channels = n_grids * VOXEL_CHANNELS;
        let mut voxels = Vec::with_capacity(samples.len() * n_voxels * n_channels);
        for DepthInput { grid, wide, arm } in samples {
            let hand = arm.hand_from_world.as_ref();
            match network.raster_of_row() {
                Some(raster_of_row) => {
                    for &flat in raster_of_row {
                        voxels.extend(told_from(hand, centered(grid, flat), grid, flat));
                        voxels.extend(wide.iter().flat_map(|wide| centered(wide, flat)));
                    }
                }
                None => voxels.extend(
                    (0..n_voxels).flat_map(|flat| told_from(hand, grid.voxel(flat), grid, flat)),
                ),
            }
        }
        let features =
            samples.iter().flat_map(|sample| sample.arm.features.iter().copied()).collect();
        Self {
            voxels: tensor(voxels, [samples.len(), n_voxels, n_channels], device),
            proprio: tensor(features, [samples.len(), n_proprio], device),
            attended: None,
        }
    }

    /// The same with the rotation at `attended`, the voxel of each sample, flat.
    pub(in crate::q_attention) fn attending(self, attended: Vec<usize>) -> Self {
        Self { attended: Some(attended), ..self }
    }
}

/// The channels of a voxel with its place told from the hand, if there is one, in the stead of its
/// index over the count.
///
/// What the hand holds and how it moves is then one lesson for every place: a cube around a goal in
/// free space shows little else.
fn told_from(
    hand_from_world: Option<&Pose3>,
    mut channels: [f32; VOXEL_CHANNELS],
    grid: &VoxelGrid,
    flat: usize,
) -> [f32; VOXEL_CHANNELS] {
    if let Some(hand_from_world) = hand_from_world {
        let center = grid.space.point_from_voxel(grid.space.voxel_from_flat(flat));
        let from_hand = *hand_from_world * center / PLACE_SCALE;
        channels[INDEX..INDEX + 3].copy_from_slice(&from_hand.to_array());
    }
    channels
}

/// What a network is told of the arm: [`Proprio::low_dim`], and under the rule of
/// [`HalfTurn::Relative`] whether the gripper is open (1) and holds something (1), position (3) and
/// first two columns of the rotation (6) of the canonical hand, finger positions (2) and time (1).
///
/// A quaternion has two signs, and over the orientations that tasks use no choice between them
/// keeps neighbours together.
fn proprio_features(half_turn: HalfTurn, proprio: &Proprio) -> Vec<f32> {
    let low_dim = proprio.low_dim();
    if half_turn != HalfTurn::Relative {
        return low_dim.to_vec();
    }
    let mut features = vec![proprio.gripper_open, f32::from(u8::from(proprio.holds()))];
    features.extend_from_slice(&proprio.grip.translation.to_array());
    features.extend(rotation_columns(proprio.grip.rotation));
    features.extend_from_slice(&low_dim[LOW_DIM - 3..]);
    features
}

/// Length of [`proprio_features`].
pub(super) const fn n_proprio(half_turn: HalfTurn) -> usize {
    match half_turn {
        HalfTurn::Ignored | HalfTurn::Nearest => LOW_DIM,
        HalfTurn::Relative => 14,
    }
}

/// The channels of a voxel with its mean position as fractions from its centre, -1 to 1, instead of
/// metres in the world; zero where nothing is.
///
/// A lesson from one place then holds at every other, and a millimetre is not lost beside a
/// metre.
fn centered(grid: &VoxelGrid, flat: usize) -> [f32; VOXEL_CHANNELS] {
    let mut channels = grid.voxel(flat);
    let voxel = grid.space.voxel_from_flat(flat);
    if grid.is_occupied(voxel) {
        let half_voxel = 0.5 * grid.space.voxel_size();
        let center = grid.space.point_from_voxel(voxel);
        for axis in 0..3 {
            channels[axis] = (channels[axis] - center[axis]) / half_voxel[axis];
        }
    }
    channels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::{Backend, values};
    use crate::perception::{VoxelBounds, VoxelSpace};
    use crate::q_attention::half_turned;
    use crate::q_attention::settings::tests::{test_proprio, test_settings};
    use crate::rng::{Stream, stream};

    #[test]
    fn places_are_told_from_a_hand_that_holds_something_whichever_way_round_it_is() {
        let settings = QAttentionSettings { places: Places::Held, ..test_settings() };
        let device = Backend::Flex.device();
        let init = &mut stream(0, Stream::Init, 0);
        let network = QNetwork::new(&settings, 0, &device, init);
        let free = test_proprio();
        let hand = Proprio { gripper_open: 0.0, gripper_width: 0.03, ..free };
        let mut turned = hand;
        turned.grip.rotation = half_turned(hand.grip.rotation);
        let space = VoxelSpace::new(VoxelBounds::cube(hand.grip.translation, 0.1), [8; 3])
            .expect("a volume");
        let grid = VoxelGrid::voxelise([], space);
        let places = |depth_idx, proprio: &Proprio| {
            let arm = ArmInput::new(&settings, depth_idx, proprio, None);
            let sample = DepthInput { grid: grid.clone(), wide: None, arm };
            let input = NetworkInput::new(&network, &[sample], &device);
            let place = |voxel: &[f32]| Vec3::from_slice(&voxel[INDEX..INDEX + 3]);
            values(input.voxels).chunks(VOXEL_CHANNELS).map(place).collect::<Vec<_>>()
        };
        let told = places(1, &hand);
        let canonical = settings.half_turn.seen(hand.grip.rotation);
        for ((place, turned), &flat) in told
            .iter()
            .zip(places(1, &turned))
            .zip(network.raster_of_row().expect("a fast network"))
        {
            let center = space.point_from_voxel(space.voxel_from_flat(flat));
            let expected = canonical.inverse() * (center - hand.grip.translation) / PLACE_SCALE;
            assert!(place.distance(expected) < 1e-5 && turned.distance(expected) < 1e-5);
        }
        // Elsewhere they are those in the grid.
        let in_grid = places(0, &hand);
        assert!(in_grid.iter().all(|place| place.min_element() >= 0.0));
        assert_eq!(in_grid, places(1, &free));
    }

    #[test]
    fn the_wider_grid_follows_a_voxels_own_channels() {
        let settings = QAttentionSettings { wide_half_width: Some(0.4), ..test_settings() };
        let device = Backend::Flex.device();
        let network = QNetwork::new(&settings, 1, &device, &mut stream(0, Stream::Init, 0));
        let cube = |half_width| {
            let bounds = VoxelBounds::cube(Vec3::new(0.3, 0.1, 0.2), half_width);
            VoxelSpace::new(bounds, [8; 3]).expect("a volume")
        };
        // Outside the one, within the other.
        let point = (Vec3::new(0.6, 0.1, 0.2), [255, 0, 0]);
        let [grid, wide] = [0.15, 0.4].map(|half| VoxelGrid::voxelise([point], cube(half)));
        let arm = ArmInput::new(&settings, 1, &test_proprio(), None);
        let sample = DepthInput { grid, wide: Some(wide.clone()), arm };
        let input = NetworkInput::new(&network, &[sample], &device);
        assert_eq!(input.voxels.dims(), [1, 512, 2 * VOXEL_CHANNELS]);
        let rows = values(input.voxels);
        for (row, &flat) in
            rows.chunks(2 * VOXEL_CHANNELS).zip(network.raster_of_row().expect("a fast network"))
        {
            assert_eq!(row[VOXEL_CHANNELS..], centered(&wide, flat));
            let is_seen = wide.is_occupied(wide.space.voxel_from_flat(flat));
            assert_eq!(row[VOXEL_CHANNELS..VOXEL_CHANNELS + 6].iter().any(|&v| v != 0.0), is_seen);
            assert!(row[..6].iter().all(|&v| v == 0.0), "it is not in the voxel's own cube");
        }
    }

    #[test]
    fn a_hand_told_from_elsewhere_is_the_same_whichever_way_round_it_is() {
        let settings = test_settings();
        let jitter = HandMotion { shift: Vec3::new(0.02, -0.01, 0.0), turn: 0.3 };
        for step in 0..60 {
            let mut hand = test_proprio();
            hand.grip.rotation = Quat::from_rotation_z(0.1 * step as f32) * hand.grip.rotation;
            let told = |proprio: &Proprio| ArmInput::new(&settings, 1, proprio, Some(jitter));
            let here = told(&hand).features;
            let mut plain = hand;
            plain.grip.rotation = settings.half_turn.seen(hand.grip.rotation);
            plain.grip = jitter.of(plain.grip);
            assert_eq!(here, proprio_features(settings.half_turn, &plain));
            hand.grip.rotation = half_turned(hand.grip.rotation);
            let turned = told(&hand).features;
            assert!(here.iter().zip(turned).all(|(a, b)| (a - b).abs() < 1e-5), "yaw step {step}");
        }
    }
}
