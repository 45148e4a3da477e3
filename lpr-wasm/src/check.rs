//! Comparisons between wasm and native code: the simulator's results, and its speed.

use lpr_core::agent::{Agent, Draws, Goal, Init, Method, Networks, PoseSource};
use lpr_core::config::Config;
use lpr_core::digest;
use lpr_core::env::InvalidAction;
use lpr_core::error::{Error, Result};
use lpr_core::nn::Backend;
use lpr_core::path::{CandidateStreams, JointPath, Source};
use lpr_core::perception::Observation;
use lpr_core::q_attention::{ActingNetwork, NextBestPose, QObservation, QSample};
use lpr_core::ranker::{RankedPath, RankerContext};
use lpr_core::rng::{Stream, normal, stream};
use lpr_core::robot::{Robot, XARM7};
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{ArmSweep, SimEnvironment, SimParams, World, demonstrate};

/// The hash of the world, 16 hexadecimal digits, after the whole scripted demonstration in scene
/// `seed`, done or not.
///
/// # Errors
///
/// When task or robot are unknown, or the scene cannot be placed.
pub fn demonstration_hash(task: &str, robot: &str, seed: u64) -> Result<String> {
    let (task, robot) = (Task::by_name(task)?, Robot::by_name(robot)?);
    let mut environment =
        SimEnvironment::new(&task, &robot, seed, &["front"], &SimParams::STANDARD)?;
    let _ = demonstrate(&mut environment, &mut stream(seed, Stream::Demo, 0));
    Ok(hash(environment.world()))
}

/// The scene of the benchmark `physics_arm10_10ms`.
#[derive(Debug)]
pub struct PhysicsBench(ArmSweep);

impl PhysicsBench {
    /// At its start.
    ///
    /// # Errors
    ///
    /// As [`ArmSweep::new`].
    pub fn new() -> Result<Self> {
        ArmSweep::new(&SimParams::STANDARD).map(Self)
    }

    /// Goes on by physics steps; the hash of the world after them.
    ///
    /// # Errors
    ///
    /// As [`ArmSweep::step`].
    pub fn run(&mut self, n_steps: u32) -> Result<String> {
        let broken = |reason: InvalidAction| Error::Environment(reason.to_string());
        (0..n_steps).try_for_each(|_| self.0.step()).map_err(broken)?;
        Ok(hash(self.0.world()))
    }
}

/// The scene and the agent of the benchmark `candidates_41`.
#[derive(Debug)]
pub struct CandidatesBench {
    agent: Agent,
    observation: Observation,
    goal: NextBestPose,
}

impl CandidatesBench {
    /// An untrained agent of the preset `fast`, and what it sees before it opens a toilet seat.
    ///
    /// # Errors
    ///
    /// When the scene cannot be placed.
    pub fn new() -> Result<Self> {
        let (agent, mut environment) = untrained(PoseSource::Oracle)?;
        let goal = environment.plan().goals[0];
        Ok(Self { agent, observation: environment.observe(), goal })
    }

    /// Proposes and ranks the candidates of a step: obstacles, 20 planner, 20 Bézier and one policy
    /// path. The hash, 16 hexadecimal digits, of the planner's and the curves' paths, which no
    /// network has a part in.
    ///
    /// # Errors
    ///
    /// As [`Agent::act`].
    pub fn run(&self, step: u64) -> Result<String> {
        let draws = Draws::greedy(CandidateStreams { seed: 0, step });
        let action = self.agent.act(Goal::given(self.observation.clone(), self.goal), draws)?;
        let mut hash = digest::of(&[]);
        for candidate in &action.set.candidates {
            if matches!(candidate.source, Source::Planner | Source::Bezier) {
                hash = digest::extend(hash, &[u8::from(candidate.collides)]);
                let angles = candidate.path.configs().iter().flat_map(|config| config.iter());
                hash = angles.fold(hash, |hash, q| digest::extend(hash, &q.to_le_bytes()));
            }
        }
        Ok(format!("{hash:016x}"))
    }
}

/// The networks of an untrained agent of the preset `fast`, at the widths that are shipped.
#[derive(Debug)]
pub struct NetworksBench {
    agent: Agent,
    seen: QObservation,
    goal: NextBestPose,
    context: RankerContext,
    paths: Vec<RankedPath>,
    updates: u64,
}

impl NetworksBench {
    /// Before a toilet seat, with 41 paths of 30 configurations.
    ///
    /// # Errors
    ///
    /// When the scene cannot be placed.
    pub fn new() -> Result<Self> {
        const PATHS: usize = 41;
        let (agent, mut environment) = untrained(PoseSource::Learned)?;
        let goal = environment.plan().goals[0];
        let nothing_seen = Error::Environment("an agent of learned poses sees".to_owned());
        let seen = agent.attended(&environment.observe()).ok_or(nothing_seen)?;
        let context = RankerContext { goal, gripper_open: 1.0, time: 1.0 };
        let path = |idx: usize| {
            let turn = 0.3 * (idx + 1) as f32 / PATHS as f32;
            let ends = vec![XARM7.start, XARM7.start.map(|angle| angle + turn)];
            let path = JointPath::new(ends)?.resample(agent.candidate_settings().path_len);
            Ok(RankedPath { path, collides: false })
        };
        let paths = (0..PATHS).map(path).collect::<Result<_>>()?;
        Ok(Self { agent, seen, goal, context, paths, updates: 0 })
    }

    /// Q-attention's pose, by both depths; its value.
    #[must_use]
    pub fn attend(&self) -> f32 {
        let attention = self.agent.networks.q_attention.as_ref();
        attention.map_or(f32::NAN, |it| it.act(&self.seen, ActingNetwork::Online).value)
    }

    /// The ranker's values of all paths; their sum.
    ///
    /// # Errors
    ///
    /// As the ranker's.
    pub fn rank(&self) -> Result<f32> {
        let Some(ranker) = &self.agent.networks.ranker else { return Ok(f32::NAN) };
        Ok(ranker.values(&self.context, &self.paths)?.iter().sum())
    }

    /// One update of Q-attention on 16 steps that another follows; its loss.
    pub fn update(&mut self) -> f32 {
        const SCENES: usize = 16;
        let Some(attention) = &mut self.agent.networks.q_attention else { return f32::NAN };
        let (observation, action) = (&self.seen, self.goal);
        let next = Some(observation);
        let sample =
            QSample { observation, action, reward: 0.0, next, weight: 1.0, imitated: true };
        let rng = &mut stream(0, Stream::Augment, self.updates);
        self.updates += 1;
        attention.update(&[sample; SCENES], rng).losses.iter().sum()
    }

    /// Gradients of one update of Q-attention whose layers are all away from zero, as Adam's first
    /// moments: of each tensor, first its largest absolute value, then some of its numbers.
    ///
    /// # Errors
    ///
    /// As those of [`lpr_core::q_attention::QAttention::restore`].
    pub fn gradients(&mut self) -> Result<Vec<f32>> {
        /// Numbers of a tensor that are told.
        const TOLD: usize = 32;
        let Some(attention) = &mut self.agent.networks.q_attention else { return Ok(Vec::new()) };
        let mut state = attention.state();
        let rng = &mut stream(1, Stream::Init, 0);
        let online = state.depths.iter_mut().flat_map(|depth| &mut depth.online);
        // Output layers start at zero, where nothing before them has a gradient.
        online.flat_map(|tensor| &mut tensor.values).for_each(|value| *value += 0.02 * normal(rng));
        attention.restore(&state)?;
        let _ = self.update();
        let Some(attention) = &self.agent.networks.q_attention else { return Ok(Vec::new()) };
        let depths = attention.state().depths;
        let tensors = depths.iter().flat_map(|depth| &depth.adam.first);
        Ok(tensors
            .flat_map(|tensor| {
                let largest =
                    tensor.values.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
                let stride = tensor.values.len().div_ceil(TOLD);
                core::iter::once(largest).chain(tensor.values.iter().copied().step_by(stride))
            })
            .collect())
    }
}

/// A fresh agent of the preset `fast`, and the toilet seat of the native benchmarks' scene.
fn untrained(poses: PoseSource) -> Result<(Agent, SimEnvironment)> {
    const SCENE: u64 = 1000;
    let config = Config::preset("fast")?;
    let init = Init { backend: Backend::Flex, seed: 0 };
    let networks = Networks::new(config.network_settings(), &XARM7, Method::Lpr, poses, init)?;
    let agent = Agent::new(config.agent_settings(), &XARM7, Method::Lpr, networks);
    let task = Task::by_name("toilet_seat_up")?;
    let environment = SimEnvironment::new(&task, &XARM7, SCENE, &["front"], &config.simulator)?;
    Ok((agent, environment))
}

fn hash(world: &World) -> String {
    format!("{:016x}", world.hash())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_demonstration_changes_the_world_and_is_the_same_again() {
        let [once, again] =
            [(); 2].map(|()| demonstration_hash("reach_target", "panda", 3).unwrap());
        assert_eq!(once, again);
        assert_ne!(once, demonstration_hash("reach_target", "panda", 4).unwrap());
        assert!(
            demonstration_hash("reach_taget", "panda", 3)
                .unwrap_err()
                .to_string()
                .contains("reach_taget")
        );
    }

    #[test]
    fn candidates_are_the_same_again_and_others_in_another_step() {
        let bench = CandidatesBench::new().unwrap();
        assert_eq!(bench.run(1).unwrap(), bench.run(1).unwrap());
        assert_ne!(bench.run(1).unwrap(), bench.run(2).unwrap());
    }

    #[test]
    fn networks_that_are_measured_learn() {
        let mut bench = NetworksBench::new().unwrap();
        assert!(bench.attend().is_finite() && bench.rank().unwrap().is_finite());
        let first = bench.update();
        assert!((0..3).map(|_| bench.update()).last().unwrap() < first);
    }

    #[test]
    fn steps_in_two_parts_are_steps_at_once() {
        let [mut parts, mut whole] = [(); 2].map(|()| PhysicsBench::new().unwrap());
        parts.run(7).unwrap();
        assert_eq!(parts.run(5).unwrap(), whole.run(12).unwrap());
    }
}
