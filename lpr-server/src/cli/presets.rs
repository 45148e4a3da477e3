//! Settings of the commands that look at scenes and candidates without an agent: those of the preset `fast`.

use lpr_core::glamx::Vec3;
use lpr_core::path::{BezierSettings, CandidateSettings, RrtSettings};
use lpr_core::q_attention::{NetworkSettings, QAttentionSettings};

/// The candidate set.
pub(super) const fn candidates() -> CandidateSettings {
    CandidateSettings {
        path_len: 30,
        planner_paths: 20,
        bezier_paths: 20,
        planner_collision_free_fraction: 0.5,
        draws_per_path: 5,
        min_goal_distance: 0.1,
        rrt: RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 500 },
        bezier: BezierSettings { sigma: 0.1 },
    }
}

/// What the action codec needs to know: two depths of 16³ voxels, the second 0.3 m wide, and bins of 5 degrees.
pub(super) fn q_attention() -> QAttentionSettings {
    QAttentionSettings {
        voxels_per_side: 16,
        zoom_half_widths: vec![0.15],
        rotation_bins: 72,
        discount: 0.99,
        learning_rate: 1e-3,
        weight_decay: 1e-6,
        gradient_clip: None,
        target_mix: 0.02,
        translation_regularisation: 1.0,
        rotation_regularisation: 1.0,
        crop_jitter: 0.33,
        yaw_range: 0.785,
        shift_range: Vec3::new(0.125, 0.125, 0.0),
        network: NetworkSettings::Fast { cell_channels: 32, block_channels: 96, head_channels: 16, hidden: 256, harmonics: 12 },
    }
}
