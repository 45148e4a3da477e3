//! The three networks of an agent: `Q_θ`, `Q^R_σ` and `π_μ`.

use crate::error::Result;
use crate::method::{Method, PoseSource};
use crate::nn::Backend;
use crate::perception::VoxelBounds;
use crate::policy::{Policy, PolicySettings};
use crate::q_attention::{NetworkCost, QAttention, QAttentionSettings};
use crate::ranker::{Ranker, RankerSettings};
use crate::rng::{Stream, stream};
use crate::robot::Robot;
use std::sync::Arc;

/// The networks of an agent; those that its method does not use are not built.
#[derive(Debug)]
pub struct Networks {
    /// Next-best poses: `Q_θ` in the paper.
    pub q_attention: Option<QAttention>,
    /// Values of paths: `Q^R_σ` in the paper.
    pub ranker: Option<Ranker>,
    /// One more path: `π_μ` in the paper.
    pub policy: Option<Policy>,
}

/// Settings of all three networks.
#[derive(Debug, Clone, Copy)]
pub struct NetworksSettings<'a> {
    /// Next-best poses.
    pub q_attention: &'a QAttentionSettings,
    /// Values of paths.
    pub ranker: &'a RankerSettings,
    /// The path policy.
    pub policy: &'a PolicySettings,
}

/// Origin of fresh parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Init {
    /// Backend that computes the networks.
    pub backend: Backend,
    /// Seed of the run.
    pub seed: u64,
}

impl Networks {
    /// Fresh networks for `method`, each from its own generator (lines 1 and 2 of Algorithm 1).
    ///
    /// # Errors
    ///
    /// When settings cannot work.
    pub fn new(
        settings: NetworksSettings<'_>,
        robot: &Arc<Robot>,
        method: Method,
        poses: PoseSource,
        init: Init,
    ) -> Result<Self> {
        let NetworksSettings { q_attention, ranker, policy } = settings;
        let backend = init.backend;
        // One generator a network: a network that is not built moves the draws of no other.
        let rng = |network| stream(init.seed, Stream::Init, network);
        let bounds = VoxelBounds::scene(robot)?;
        let q_attention = (poses == PoseSource::Learned)
            .then(|| QAttention::new(q_attention.clone(), bounds, backend, &mut rng(0)));
        let policy = method.has_policy().then(|| Policy::new(policy, robot, backend, &mut rng(1)));
        let ranker = method.has_ranker().then(|| Ranker::new(ranker, robot, backend, &mut rng(2)));
        Ok(Self {
            q_attention: q_attention.transpose()?,
            ranker: ranker.transpose()?,
            policy: policy.transpose()?,
        })
    }

    /// Source of next-best poses: Q-attention where there is one.
    #[must_use]
    pub const fn poses(&self) -> PoseSource {
        if self.q_attention.is_some() { PoseSource::Learned } else { PoseSource::Oracle }
    }

    /// Name, parameters and operations of one forward pass of one sample (a scene, or a path of
    /// `path_len` configurations) for every network.
    #[must_use]
    pub fn costs(&self, path_len: usize) -> Vec<(String, NetworkCost)> {
        let depths = self.q_attention.iter().flat_map(QAttention::costs).enumerate();
        let depths = depths.map(|(depth, cost)| (format!("q_attention depth {depth}"), cost));
        let ranker = self.ranker.iter().map(|ranker| ("ranker".to_owned(), ranker.cost(path_len)));
        let policy = self.policy.iter().map(|policy| ("policy".to_owned(), policy.cost(path_len)));
        depths.chain(ranker).chain(policy).collect()
    }
}
