//! Many environments that step together, over rayon's threads where there are any.

use super::environment::{ControlAction, SimEnvironment};
use super::tasks::Task;
use super::world::SimParams;
use crate::env::{Environment as _, StepResult};
use crate::error::Result;
use crate::path::JointPath;
use crate::perception::Observation;
use crate::robot::{Gripper, Robot};
use core::ops::Range;
use std::sync::Arc;

/// Action of one environment step.
#[derive(Debug, Clone, PartialEq)]
pub struct MacroAction {
    /// The path that the arm follows.
    pub path: JointPath,
    /// The gripper's command at its end.
    pub gripper: Gripper,
}

/// Environments of one task and robot, each in a scene of its own.
///
/// Every answer keeps the order of the environments and has the same bits for any number of
/// threads. Environments whose episode is over are reset when the caller says so:
/// [`Self::reset_where`].
///
/// ```
/// use lpr_core::robot::{Gripper, XARM7};
/// use lpr_core::sim::tasks::Task;
/// use lpr_core::sim::{ControlAction, SimParams, VectorEnvironment};
///
/// let task = Task::by_name("reach_target")?;
/// let params = &SimParams::STANDARD;
/// let mut envs = VectorEnvironment::new(&task, &XARM7, 100..104, &["front"], params)?;
/// for _ in 0..5 {
///     let observations = envs.observe();
///     let actions: Vec<_> = observations
///         .iter()
///         .map(|seen| {
///             let mut target = seen.proprio.joints;
///             target[0] += 0.02;
///             ControlAction { target, gripper: Gripper::Open }
///         })
///         .collect();
///     let results = envs.control_step(&actions);
///     let seeds: Vec<_> = results
///         .iter()
///         .zip(200..)
///         .map(|(result, seed)| result.terminated.then_some(seed))
///         .collect();
///     envs.reset_where(&seeds)?;
/// }
/// assert_eq!(envs.environments().len(), 4);
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct VectorEnvironment {
    environments: Vec<SimEnvironment>,
}

impl VectorEnvironment {
    /// The task in the scenes `seeds`, seen by `cameras`.
    ///
    /// # Errors
    ///
    /// As [`SimEnvironment::new`], of the first scene that fails.
    pub fn new(
        task: &Arc<Task>,
        robot: &Arc<Robot>,
        seeds: Range<u64>,
        cameras: &[&str],
        params: &SimParams,
    ) -> Result<Self> {
        let mut seeds: Vec<u64> = seeds.collect();
        let environment = |seed: &mut u64| SimEnvironment::new(task, robot, *seed, cameras, params);
        let environments: Result<_> =
            map_each(&mut seeds, |_, seed| environment(seed)).into_iter().collect();
        Ok(Self { environments: environments? })
    }

    /// The environments, in order.
    #[must_use]
    pub fn environments(&self) -> &[SimEnvironment] {
        &self.environments
    }

    /// The environments, for what is done to one of them alone.
    #[must_use]
    pub fn environments_mut(&mut self) -> &mut [SimEnvironment] {
        &mut self.environments
    }

    /// Starts new episodes: the first environment in scene `first_seed`, each further one in the
    /// next scene.
    ///
    /// # Errors
    ///
    /// When a scene cannot be placed; its environment then goes on in the old one.
    pub fn reset(&mut self, first_seed: u64) -> Result<()> {
        map_each(&mut self.environments, |idx, env| env.reset(first_seed + idx as u64))
            .into_iter()
            .collect()
    }

    /// Starts a new episode in every environment that is given a scene seed.
    ///
    /// # Errors
    ///
    /// When a scene cannot be placed; its environment then goes on in the old one.
    ///
    /// # Panics
    ///
    /// Unless there is one entry for each environment.
    pub fn reset_where(&mut self, seeds: &[Option<u64>]) -> Result<()> {
        self.assert_one_each(seeds.len());
        map_each(&mut self.environments, |idx, env| {
            seeds[idx].map_or(Ok(()), |seed| env.reset(seed))
        })
        .into_iter()
        .collect()
    }

    /// Observation of each environment now.
    #[must_use]
    pub fn observe(&mut self) -> Vec<Observation> {
        map_each(&mut self.environments, |_, env| env.observe())
    }

    /// One macro action in each environment.
    ///
    /// # Panics
    ///
    /// Unless there is one action for each environment.
    pub fn step(&mut self, actions: &[MacroAction]) -> Vec<StepResult> {
        self.assert_one_each(actions.len());
        map_each(&mut self.environments, |idx, env| {
            env.step(&actions[idx].path, actions[idx].gripper)
        })
    }

    /// One control step in each environment.
    ///
    /// # Panics
    ///
    /// Unless there is one action for each environment.
    pub fn control_step(&mut self, actions: &[ControlAction]) -> Vec<StepResult> {
        self.assert_one_each(actions.len());
        map_each(&mut self.environments, |idx, env| env.control_step(&actions[idx]))
    }

    /// One control step in each environment, and what it sees after it: one round of threads
    /// instead of two.
    ///
    /// # Panics
    ///
    /// Unless there is one action for each environment.
    pub fn control_step_and_observe(
        &mut self,
        actions: &[ControlAction],
    ) -> Vec<(StepResult, Observation)> {
        self.assert_one_each(actions.len());
        map_each(&mut self.environments, |idx, env| {
            (env.control_step(&actions[idx]), env.observe())
        })
    }

    fn assert_one_each(&self, n: usize) {
        assert!(
            n == self.environments.len(),
            "one entry for each of {} environments, got {n}",
            self.environments.len()
        );
    }
}

/// Maps every item and its index by `f`, in order, on any number of threads.
#[cfg(feature = "parallel")]
fn map_each<T: Send, R: Send>(
    items: &mut [T],
    f: impl Fn(usize, &mut T) -> R + Sync + Send,
) -> Vec<R> {
    use rayon::iter::{
        IndexedParallelIterator as _, IntoParallelRefMutIterator as _, ParallelIterator as _,
    };
    items.par_iter_mut().enumerate().map(|(idx, item)| f(idx, item)).collect()
}

/// Maps every item and its index by `f`, in order.
#[cfg(not(feature = "parallel"))]
fn map_each<T, R>(items: &mut [T], f: impl Fn(usize, &mut T) -> R) -> Vec<R> {
    items.iter_mut().enumerate().map(|(idx, item)| f(idx, item)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::XARM7;

    const SCENES: Range<u64> = 20..25;

    fn environments() -> VectorEnvironment {
        let task = Task::by_name("pick_and_lift").unwrap();
        VectorEnvironment::new(&task, &XARM7, SCENES, &["front"], &SimParams::STANDARD).unwrap()
    }

    /// Every environment turns by another angle.
    fn turns(envs: &VectorEnvironment) -> Vec<ControlAction> {
        let action = |(idx, env): (usize, &SimEnvironment)| {
            let mut target = *env.world().config();
            target[0] += 0.02 * idx as f32;
            ControlAction { target, gripper: Gripper::Close }
        };
        envs.environments().iter().enumerate().map(action).collect()
    }

    fn paths(envs: &VectorEnvironment) -> Vec<MacroAction> {
        let action = |env: &SimEnvironment| {
            let grip = env.plan().goals[0];
            let start = *env.world().config();
            let goal = XARM7.ik_nearest(&grip.pose, &start).unwrap();
            MacroAction { path: JointPath::new(vec![start, goal]).unwrap(), gripper: grip.gripper }
        };
        envs.environments().iter().map(action).collect()
    }

    /// Everything that environments do, and what they then look like.
    fn run() -> (Vec<u64>, Vec<StepResult>, Vec<Observation>) {
        let mut envs = environments();
        let mut results = Vec::new();
        for _ in 0..10 {
            results.extend(envs.control_step(&turns(&envs)));
        }
        envs.reset_where(&[None, Some(90), None, Some(91), None]).unwrap();
        results.extend(envs.step(&paths(&envs)));
        results.extend(
            envs.control_step_and_observe(&turns(&envs)).into_iter().map(|(result, _)| result),
        );
        let hashes = envs.environments().iter().map(|env| env.world().hash()).collect();
        (hashes, results, envs.observe())
    }

    #[cfg(feature = "parallel")]
    #[test]
    fn the_number_of_threads_changes_nothing() {
        let with_threads =
            |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(run);
        assert_eq!(with_threads(1), with_threads(2));
    }

    #[test]
    fn every_environment_does_what_it_would_do_alone() {
        let (hashes, ..) = run();
        let mut alone = environments();
        for _ in 0..10 {
            let actions = turns(&alone);
            for (env, action) in alone.environments_mut().iter_mut().zip(&actions) {
                env.control_step(action);
            }
        }
        for (idx, seed) in [(1, 90), (3, 91)] {
            alone.environments_mut()[idx].reset(seed).unwrap();
        }
        let (paths, mut ends) = (paths(&alone), Vec::new());
        for (env, action) in alone.environments_mut().iter_mut().zip(&paths) {
            env.step(&action.path, action.gripper);
        }
        let turns = turns(&alone);
        for (env, action) in alone.environments_mut().iter_mut().zip(&turns) {
            env.control_step(action);
            ends.push(env.world().hash());
        }
        assert_eq!(hashes, ends);
        assert!(hashes.iter().skip(1).all(|hash| *hash != hashes[0]), "the scenes differ");
    }

    #[test]
    fn a_reset_starts_scenes_one_after_the_other() {
        let mut envs = environments();
        let start: Vec<_> = envs.environments().iter().map(|env| env.world().hash()).collect();
        envs.reset(SCENES.start + 1).unwrap();
        let again: Vec<_> = envs.environments().iter().map(|env| env.world().hash()).collect();
        assert_eq!(again[..4], start[1..]);
    }

    #[test]
    #[should_panic(expected = "one entry for each of 5 environments, got 4")]
    fn an_action_too_few_is_refused() {
        let mut envs = environments();
        let actions = turns(&envs);
        envs.control_step(&actions[1..]);
    }
}
