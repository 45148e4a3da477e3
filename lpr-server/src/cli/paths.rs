//! `lpr paths`: the candidate paths of a demonstration's keyframes, and what becomes of each.

mod report;

use super::arguments::{RobotArgument, TaskArgument, scene_seeds};
use super::failure::{Failure, Result};
use super::settings::default_preset;
use crate::run_directory;
use lpr_core::agent::{Agent, Draws, Goal};
use lpr_core::checkpoint::{SavedAgent, load_agent};
use lpr_core::config::Config;
use lpr_core::path::{CandidateSet, CandidateSettings, CandidateStreams, TimingSettings};
use lpr_core::perception::Camera;
use lpr_core::robot::Robot;
use lpr_core::sim::feasibility::{KeyframeSnapshot, keyframe_snapshots};
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{SimEnvironment, SimParams};
use report::{Drawn, Executed, Report};
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    task: TaskArgument,
    #[command(flatten)]
    robot: RobotArgument,
    /// Demonstrations; number i is in scene SEED + i
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    episodes: u32,
    /// Seed of the first scene
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Keyframe, counted from 0, or "all"
    #[arg(long, value_name = "K|all", default_value = "0", value_parser = KeyframeChoice::parse)]
    keyframe: KeyframeChoice,
    /// Run directory whose agent proposes and values the paths
    #[arg(long, value_name = "DIR", conflicts_with_all = ["sigma", "collision_free_fraction", "screw"])]
    checkpoint: Option<PathBuf>,
    /// Execute every candidate, each from the same snapshot
    #[arg(long)]
    execute: bool,
    /// Standard deviation of the Bézier curves' middle points, metres [default: that of the preset
    /// fast]
    #[arg(long, value_name = "METRES")]
    sigma: Option<f32>,
    /// Share of the planner's paths that are planned with collision checking on [default: that of
    /// the preset fast]
    #[arg(long, value_name = "SHARE")]
    collision_free_fraction: Option<f32>,
    /// With the screw motion of the grip besides, which no preset has
    #[arg(long)]
    screw: bool,
    /// Contact force on the arm that ends an episode, newtons
    #[arg(long, value_name = "NEWTONS", default_value_t = SimParams::STANDARD.abort_force)]
    abort_force: f32,
    /// Friction of the finger pads and of everything else, as a multiple of what it is
    #[arg(long, value_name = "FACTOR", default_value_t = SimParams::STANDARD.friction_scale)]
    friction_scale: f32,
}

/// Which keyframes of a demonstration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KeyframeChoice {
    All,
    One(usize),
}

impl KeyframeChoice {
    fn parse(text: &str) -> Result<Self, String> {
        match text {
            "all" => Ok(Self::All),
            number => number
                .parse()
                .map(Self::One)
                .map_err(|_| "expected a number from 0 or 'all'".to_owned()),
        }
    }

    fn includes(self, keyframe: usize) -> bool {
        self == Self::All || self == Self::One(keyframe)
    }
}

/// Refuses a keyframe that the task does not have.
pub(super) fn check_keyframe(task: &Task, keyframe: usize) -> Result<()> {
    let last = task.keyframes - 1;
    if keyframe <= last {
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "--keyframe {keyframe}: the keyframes of {} are 0 to {last}",
        task.name
    )))
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let Arguments { task: TaskArgument { task }, robot: RobotArgument { robot }, episodes, .. } =
        arguments;
    if let KeyframeChoice::One(keyframe) = arguments.keyframe {
        check_keyframe(task, keyframe)?;
    }
    if arguments.abort_force.is_nan() || arguments.abort_force <= 0.0 {
        return Err(Failure::Usage(format!(
            "--abort-force {}: expected newtons above 0",
            arguments.abort_force
        )));
    }
    if !(arguments.friction_scale.is_finite() && arguments.friction_scale >= 0.0) {
        return Err(Failure::Usage(format!(
            "--friction-scale {}: expected a number from 0",
            arguments.friction_scale
        )));
    }
    let proposer = Proposer::new(arguments)?;
    let mut skipped_seeds = Vec::new();
    let mut drawn = Vec::new();
    for (episode, seed) in (0..).zip(scene_seeds(arguments.seed, *episodes)) {
        let Some(snapshots) = proposer.snapshots(task, robot, seed) else {
            skipped_seeds.push(seed);
            continue;
        };
        for (keyframe, snapshot) in snapshots
            .iter()
            .enumerate()
            .filter(|(keyframe, _)| arguments.keyframe.includes(*keyframe))
        {
            let streams = CandidateStreams { seed, step: keyframe as u64 };
            let (set, values) = proposer.propose(snapshot, streams)?;
            let executed = arguments.execute.then(|| Executed {
                trials: snapshot.trials(&set),
                linear: snapshot.linear_trial(&proposer.settings),
            });
            drawn.push(Drawn { episode, keyframe, set, values, executed });
        }
    }
    Ok(Report::new(task, robot, *episodes, skipped_seeds, &drawn))
}

/// Who proposes the paths: the generators alone, or a trained agent, which also values them.
struct Proposer {
    settings: CandidateSettings,
    agent: Option<Agent>,
    cameras: Vec<&'static str>,
    params: SimParams,
    timing: TimingSettings,
}

impl Proposer {
    fn new(arguments: &Arguments) -> Result<Self> {
        let Some(run) = &arguments.checkpoint else {
            let Config { simulator, timing, .. } = default_preset();
            let params = params(arguments, &simulator);
            return Ok(Self {
                settings: settings(arguments)?,
                agent: None,
                cameras: vec!["front"],
                params,
                timing,
            });
        };
        let SavedAgent { header, agent } = load_agent(&run_directory::latest(run)?.1.weights)?;
        let robot = &arguments.robot.robot.name;
        if header.robot != *robot {
            let reason = format!(
                "--checkpoint {}: of the robot {}, asked for {robot}",
                run.display(),
                header.robot
            );
            return Err(Failure::Usage(reason));
        }
        let cameras = header
            .run
            .cameras
            .iter()
            .map(|name| Camera::known_name(name))
            .collect::<Result<_, _>>()?;
        let Config { simulator, timing, .. } = header.config;
        let params = params(arguments, &simulator);
        Ok(Self {
            settings: agent.candidate_settings().clone(),
            agent: Some(agent),
            cameras,
            params,
            timing,
        })
    }

    /// The snapshots of the demonstration in scene `seed`; none when it fails.
    fn snapshots(
        &self,
        task: &Arc<Task>,
        robot: &Arc<Robot>,
        seed: u64,
    ) -> Option<Vec<KeyframeSnapshot>> {
        let mut env = SimEnvironment::new(task, robot, seed, &self.cameras, &self.params).ok()?;
        env.set_timing(self.timing.clone());
        keyframe_snapshots(&env, seed)
    }

    /// The candidates with their values, if there is a ranker.
    fn propose(
        &self,
        snapshot: &KeyframeSnapshot,
        streams: CandidateStreams,
    ) -> Result<(CandidateSet, Option<Vec<f32>>)> {
        let Some(agent) = &self.agent else {
            return Ok((snapshot.candidates(&self.settings, streams), None));
        };
        let observation = snapshot.env.clone().observe();
        let goal = Goal::given(observation, snapshot.goal);
        let action = agent.act(goal, Draws::greedy(streams))?;
        Ok((action.set, action.values))
    }
}

/// The simulator's settings with those of the command line.
fn params(arguments: &Arguments, simulator: &SimParams) -> SimParams {
    let Arguments { abort_force, friction_scale, .. } = *arguments;
    SimParams {
        abort_force,
        friction_scale,
        pad_friction: friction_scale * simulator.pad_friction,
        ..simulator.clone()
    }
}

fn settings(arguments: &Arguments) -> Result<CandidateSettings> {
    let mut settings = default_preset().candidates;
    if let Some(sigma) = arguments.sigma {
        settings.bezier.sigma = sigma;
    }
    if let Some(fraction) = arguments.collision_free_fraction {
        settings.planner_collision_free_fraction = fraction;
    }
    settings.screw_paths = usize::from(arguments.screw);
    settings.check()?;
    Ok(settings)
}
