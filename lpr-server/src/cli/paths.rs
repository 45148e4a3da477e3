//! `lpr paths`: the candidate paths of a demonstration's keyframes, and what becomes of each.

use super::arguments::{RobotArgument, TaskArgument, scene_seeds};
use super::failure::{Failure, Result};
use super::settings::default_preset;
use crate::run_directory;
use core::fmt;
use lpr_core::agent::{Agent, Draws, Goal};
use lpr_core::checkpoint::{SavedAgent, load_agent};
use lpr_core::config::Config;

use lpr_core::path::{CandidateSet, CandidateSettings, CandidateStreams, Source, TimingSettings};
use lpr_core::perception::Camera;
use lpr_core::robot::{JointConfig, Robot};
use lpr_core::sim::feasibility::{KeyframeSnapshot, Trial, keyframe_snapshots};
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{SimEnvironment, SimParams};
use serde::Serialize;
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

#[derive(Debug, Serialize)]
pub(super) struct Report {
    task: String,
    robot: String,
    episodes: u32,
    /// Scene seeds whose demonstration failed, so that they have no keyframes.
    skipped_seeds: Vec<u64>,
    /// Every candidate, and every draw that gave none.
    candidates: Vec<CandidateRow>,
    summary: Summary,
    keyframes: Vec<KeyframeRow>,
}

#[derive(Debug, Serialize)]
struct CandidateRow {
    episode: u32,
    keyframe: usize,
    source: &'static str,
    collides: Option<bool>,
    /// Length in configuration space, radians.
    length: Option<f32>,
    /// The ranker's value: none without a checkpoint.
    value: Option<f32>,
    /// Reason why the draw gave no candidate.
    rejected: Option<&'static str>,
    executed: bool,
    success: Option<bool>,
    /// Reason why the execution did not succeed.
    reason: Option<&'static str>,
    path: Option<Vec<JointConfig>>,
}

/// Counts over everything that was drawn.
#[derive(Debug, Default, Serialize)]
struct Summary {
    planner: SourceRow,
    bezier: SourceRow,
    /// Only where it is asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    screw: Option<SourceRow>,
    /// Only with a checkpoint whose agent has a policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    policy: Option<SourceRow>,
    /// Share of the keyframes at which some candidate succeeds; none without `--execute`.
    best_of_all: Option<f64>,
}

#[derive(Debug, Clone, Copy, Default, Serialize)]
struct SourceRow {
    drawn: u32,
    admitted: u32,
    /// None without `--execute`.
    successes: Option<u32>,
}

/// Shares of successes at one keyframe, means over the episodes; none without `--execute`.
#[derive(Debug, Serialize)]
struct KeyframeRow {
    keyframe: usize,
    /// Episodes that got there.
    snapshots: usize,
    /// Candidates of a set.
    admitted: f64,
    /// The straight line of the grip.
    linear: Option<f64>,
    /// The shortest candidate that does not collide.
    shortest_free: Option<f64>,
    planner: Option<f64>,
    bezier: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    screw: Option<f64>,
    /// Any candidate.
    random: Option<f64>,
    /// Some candidate.
    best_of_all: Option<f64>,
}

/// One keyframe of one episode with its candidates.
struct Drawn {
    episode: u32,
    keyframe: usize,
    set: CandidateSet,
    /// One for each candidate; none without a ranker.
    values: Option<Vec<f32>>,
    executed: Option<Executed>,
}

struct Executed {
    trials: Vec<Trial>,
    linear: Option<Trial>,
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
    Ok(Report {
        task: task.name.clone(),
        robot: robot.name.clone(),
        episodes: *episodes,
        skipped_seeds,
        candidates: drawn.iter().flat_map(Drawn::rows).collect(),
        summary: summary(&drawn),
        keyframes: (0..task.keyframes)
            .filter_map(|keyframe| keyframe_row(keyframe, &drawn))
            .collect(),
    })
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

impl Drawn {
    /// A row for each candidate, then one for each draw that gave none.
    fn rows(&self) -> Vec<CandidateRow> {
        let Self { episode, keyframe, set, values, executed } = self;
        let blank = |source: Source| CandidateRow {
            episode: *episode,
            keyframe: *keyframe,
            source: source.name(),
            collides: None,
            length: None,
            value: None,
            rejected: None,
            executed: false,
            success: None,
            reason: None,
            path: None,
        };
        let admitted = set.candidates.iter().enumerate().map(|(idx, candidate)| {
            let trial = executed.as_ref().map(|executed| &executed.trials[idx]);
            CandidateRow {
                collides: Some(candidate.collides),
                length: Some(candidate.path.length()),
                value: values.as_ref().map(|values| values[idx]),
                executed: trial.is_some(),
                success: trial.map(|trial| trial.success),
                reason: trial.and_then(failure),
                path: Some(candidate.path.configs().to_vec()),
                ..blank(candidate.source)
            }
        });
        let rejected = set.rejected.iter().map(|rejected| CandidateRow {
            rejected: Some(rejected.reason.name()),
            ..blank(rejected.source)
        });
        admitted.chain(rejected).collect()
    }

    /// Share of successes among the executed candidates that `chosen` picks.
    fn share(&self, chosen: impl Fn(&Trial) -> bool) -> Option<f64> {
        let trials = self.executed.as_ref()?.trials.iter().filter(|trial| chosen(trial));
        mean(trials.map(|trial| is(trial.success)))
    }

    fn best_of_all(&self) -> Option<f64> {
        self.executed.as_ref().map(|executed| is(executed.trials.iter().any(|trial| trial.success)))
    }

    /// Success of the shortest free candidate; where none is free that is a failure.
    fn shortest_free(&self) -> Option<f64> {
        let executed = self.executed.as_ref()?;
        let shortest = self.set.shortest_free();
        let trial = shortest.and_then(|shortest| {
            self.set.candidates.iter().position(|candidate| candidate == shortest)
        });
        Some(is(trial.is_some_and(|idx| executed.trials[idx].success)))
    }

    fn linear(&self) -> Option<f64> {
        self.executed
            .as_ref()
            .map(|executed| is(executed.linear.as_ref().is_some_and(|trial| trial.success)))
    }
}

/// Reason why an executed candidate did not succeed: the event that made it end, or that it did not
/// do what the demonstrator did.
fn failure(trial: &Trial) -> Option<&'static str> {
    (!trial.success).then(|| trial.result.invalid.map_or("not_done", |invalid| invalid.name()))
}

fn is(success: bool) -> f64 {
    f64::from(u8::from(success))
}

/// None of nothing.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (n, sum) = values.fold((0_u32, 0.0), |(n, sum), value| (n + 1, sum + value));
    (n > 0).then(|| sum / f64::from(n))
}

fn summary(drawn: &[Drawn]) -> Summary {
    let if_drawn = |source| Some(source_row(source, drawn)).filter(|row| row.drawn > 0);
    Summary {
        planner: source_row(Source::Planner, drawn),
        bezier: source_row(Source::Bezier, drawn),
        screw: if_drawn(Source::Screw),
        policy: if_drawn(Source::Policy),
        best_of_all: mean(drawn.iter().filter_map(Drawn::best_of_all)),
    }
}

fn source_row(source: Source, drawn: &[Drawn]) -> SourceRow {
    let mut row = SourceRow::default();
    for Drawn { set, executed, .. } in drawn {
        let admitted =
            set.candidates.iter().filter(|candidate| candidate.source == source).count() as u32;
        row.admitted += admitted;
        row.drawn += admitted
            + set.rejected.iter().filter(|rejected| rejected.source == source).count() as u32;
        if let Some(Executed { trials, .. }) = executed {
            let successes =
                trials.iter().filter(|trial| trial.source == source && trial.success).count()
                    as u32;
            *row.successes.get_or_insert(0) += successes;
        }
    }
    row
}

/// The shares at one keyframe; none when no episode has it.
fn keyframe_row(keyframe: usize, drawn: &[Drawn]) -> Option<KeyframeRow> {
    let here: Vec<_> = drawn.iter().filter(|drawn| drawn.keyframe == keyframe).collect();
    let share =
        |of: &dyn Fn(&Drawn) -> Option<f64>| mean(here.iter().filter_map(|drawn| of(drawn)));
    Some(KeyframeRow {
        keyframe,
        snapshots: here.len(),
        admitted: mean(here.iter().map(|drawn| drawn.set.candidates.len() as f64))?,
        linear: share(&Drawn::linear),
        shortest_free: share(&Drawn::shortest_free),
        planner: share(&|drawn| drawn.share(|trial| trial.source == Source::Planner)),
        bezier: share(&|drawn| drawn.share(|trial| trial.source == Source::Bezier)),
        screw: share(&|drawn| drawn.share(|trial| trial.source == Source::Screw)),
        random: share(&|drawn| drawn.share(|_| true)),
        best_of_all: share(&Drawn::best_of_all),
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { task, robot, episodes, skipped_seeds, keyframes, summary, .. } = self;
        writeln!(
            f,
            "{task}, {robot}: {} of {episodes} episodes",
            *episodes as usize - skipped_seeds.len()
        )?;
        let rows = [Some(summary.planner), Some(summary.bezier), summary.screw, summary.policy];
        let rows = ["planner", "bezier", "screw", "policy"].into_iter().zip(rows);
        for (source, row) in rows.filter_map(|(source, row)| Some((source, row?))) {
            write!(f, "  {source:<8} {:>5} drawn {:>5} admitted", row.drawn, row.admitted)?;
            row.successes.map_or(Ok(()), |successes| write!(f, " {successes:>5} successes"))?;
            writeln!(f)?;
        }
        writeln!(
            f,
            "keyframe  episodes  candidates  linear  shortest-free  planner  bezier  random  best-of-all"
        )?;
        let percent = |share: Option<f64>| {
            share.map_or("-".to_owned(), |share| format!("{:.0}%", 100.0 * share))
        };
        for row in keyframes {
            write!(f, "{:>8}  {:>8}  {:>10.1}", row.keyframe, row.snapshots, row.admitted)?;
            let shares = [
                row.linear,
                row.shortest_free,
                row.planner,
                row.bezier,
                row.random,
                row.best_of_all,
            ];
            for (share, width) in shares.into_iter().zip([8, 15, 9, 8, 8, 13]) {
                write!(f, "{:>width$}", percent(share))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
