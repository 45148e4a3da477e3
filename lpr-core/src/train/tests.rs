use super::*;
use crate::agent::Exploration;
use crate::demo::{Alternatives, PathStarts};
use crate::env::{EPISODE_LENGTH, Fault, InvalidAction};
use crate::error::Error;
use crate::evaluate::{Evaluation, best_of_all, evaluate, measure_regret};
use crate::learner::Row;
use crate::path::{JointPath, Refinement};
use crate::perception::Observation;
use crate::policy::PolicySpace;
use crate::q_attention::{ActingNetwork, NextBestPose};
use crate::ranker::{Critics, Objective, RankerInput, Sampling};
use crate::robot::{Gripper, PANDA, Robot};
use crate::toy::Toy;
use std::sync::Arc;

use glamx::Vec3;

/// Settings with which the toy is learned in seconds.
pub(crate) fn config() -> Config {
    let mut config = Config::preset("fast").expect("a preset");
    config.candidates.path_len = 8;
    config.candidates.planner_paths = 4;
    config.candidates.bezier_paths = 8;
    // The toy's way bows by 3 cm and more: middle points lie about 10 cm off the line.
    config.candidates.bezier.sigma = 0.1;
    config.ranker.config_widths = vec![32, 64];
    config.ranker.head_widths = vec![64];
    config.policy.widths = vec![32, 64];
    config.training.path_batch = 32;
    config.training.demonstration_updates = 20;
    config.training.path_updates_per_step = 2;
    config
}

pub(crate) fn run(method: Method, seed: u64) -> Run {
    Run {
        task: "toy".to_owned(),
        method,
        poses: PoseSource::Oracle,
        backend: Backend::Flex,
        seed,
        cameras: default_cameras(),
    }
}

/// A trainer on the toy with a few demonstrations.
pub(crate) fn trainer(config: Config, method: Method, seed: u64) -> Trainer<Toy> {
    let mut trainer =
        Trainer::new(config, run(method, seed), Toy::new(&PANDA).unwrap()).expect("valid settings");
    for demo in 0..3 {
        let demo = Toy::new(&PANDA)
            .unwrap()
            .demonstration(demonstration_scene(seed, demo))
            .expect("within reach");
        trainer.add_demonstration(&demo).expect("several keyframes");
    }
    trainer
}

fn train(trainer: &mut Trainer<Toy>, n_steps: u64) -> Vec<StepLog> {
    while trainer.demonstration_updates_left() > 0 {
        trainer.update().expect("finite losses");
    }
    (0..n_steps).map(|_| trainer.step().expect("a toy scene")).collect()
}

fn score(trainer: &Trainer<Toy>) -> Evaluation {
    evaluate(trainer.agent(), &mut Toy::new(&PANDA).unwrap(), 1000..1060, |_| ())
        .expect("toy scenes")
}

#[test]
fn it_learns_the_toy_and_chance_does_not_do_it() {
    let random = score(&trainer(config(), Method::Random, 0));
    assert!(random.success_rate() < 0.45, "{random:?}");
    for seed in 0..2 {
        let mut trainer = trainer(config(), Method::Lpr, seed);
        train(&mut trainer, 250);
        let learned = score(&trainer);
        assert!(learned.success_rate() >= 0.95, "seed {seed}: {learned:?}");
    }
}

#[test]
fn straight_lines_never_do_it_and_the_best_of_all_candidates_mostly_does() {
    let straight = score(&trainer(config(), Method::C2fArm, 0));
    assert_eq!(straight.successes, 0);
    assert_eq!(straight.failures, [("force", 60)].into());
    let random = trainer(config(), Method::Random, 0);
    let best = best_of_all(random.agent(), &mut Toy::new(&PANDA).unwrap(), 1000..1020, |_| ())
        .expect("toy scenes");
    let regret = measure_regret(random.agent(), &mut Toy::new(&PANDA).unwrap(), 1000..1020)
        .expect("toy scenes");
    let chosen = evaluate(random.agent(), &mut Toy::new(&PANDA).unwrap(), 1000..1020, |_| ())
        .expect("toy scenes");
    assert!(best.success_rate() >= 0.85, "{best:?}");
    // Each scene has one decisive step, in which the agent either succeeds or does not.
    assert!(regret.decisive_steps >= best.successes);
    assert_eq!(regret.decisive_steps - regret.missed, chosen.successes);
}

/// Measurements of a run, bit by bit, and its networks at the end.
fn fingerprint(seed: u64, n_steps: u64) -> (Vec<(&'static str, u32)>, Vec<u8>) {
    let mut trainer = trainer(config(), Method::Lpr, seed);
    let logs = train(&mut trainer, n_steps);
    let metrics = logs
        .iter()
        .flat_map(|log| log.metrics.iter())
        .map(|(name, value)| (name, value.to_bits()))
        .collect();
    (metrics, trainer.checkpoint().expect("a small seed").weights)
}

#[test]
fn outcomes_two_critics_and_a_second_round_of_curves_learn_the_toy_too() {
    let mut config = config();
    config.ranker.objective = Objective::Outcome;
    config.ranker.input = RankerInput::Motion;
    config.ranker.critics = Critics::Twin;
    config.ranker.acting_weights = ActingNetwork::Target;
    config.training.exploration = Exploration::Critics { first: 0.2, last: 0.02, steps: 200 };
    config.candidates.refinement = Some(Refinement { best: 2, paths: 4, sigma: 0.02 });
    let trained = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let mut trainer = trainer(config.clone(), Method::Lpr, 0);
            train(&mut trainer, 250);
            score(&trainer)
        })
    };
    let learned = trained(1);
    assert!(learned.success_rate() > 0.85, "{learned:?}");
    assert_eq!(learned.success_rate(), trained(2).success_rate());
}

/// Settings whose agents know from the demonstrations which paths work.
fn with_alternatives(alternatives: Alternatives) -> Config {
    let mut config = config();
    config.ranker.objective = Objective::Outcome;
    config.ranker.input = RankerInput::Motion;
    config.ranker.critics = Critics::Ensemble(3);
    config.policy.space = PolicySpace::Grip;
    config.demos.alternatives = alternatives;
    config.training.demonstration_updates = 200;
    config
}

#[test]
fn demonstrations_alone_teach_the_choice_where_their_alternatives_are_shown() {
    let rate = |alternatives| {
        let mut trainer = trainer(with_alternatives(alternatives), Method::Lpr, 0);
        train(&mut trainer, 0);
        score(&trainer).success_rate()
    };
    let [without, with] = [Alternatives::Never, Alternatives::First].map(rate);
    assert!(without < 0.85 && with > 0.95, "{without}, then {with}");
}

#[test]
fn a_run_cut_among_its_updates_on_alternatives_goes_on_bit_by_bit() {
    let mut whole = trainer(with_alternatives(Alternatives::First), Method::Lpr, 2);
    for _ in 0..5 {
        whole.update().unwrap();
    }
    let checkpoint = whole.checkpoint().unwrap();
    let mut resumed = Trainer::resume(&checkpoint, Toy::new(&PANDA).unwrap()).unwrap();
    for _ in 0..5 {
        assert_eq!(whole.update().unwrap(), resumed.update().unwrap());
    }
    // What is not needed any more is not kept.
    train(&mut resumed, 1);
    let rows = Trainer::resume(&resumed.checkpoint().unwrap(), Toy::new(&PANDA).unwrap()).unwrap();
    let rows = rows.learner.paths.rows();
    assert!(!rows.is_empty() && rows.iter().all(|row| row.alternative(0, 1.0).is_none()));
}

#[test]
fn the_ranker_draws_rows_of_all_errors_alike_where_it_samples_uniformly() {
    let weights = |sampling| {
        let mut config = config();
        config.ranker.sampling = sampling;
        let mut trainer = trainer(config, Method::Lpr, 3);
        train(&mut trainer, 10);
        let checkpoint = trainer.checkpoint().unwrap();
        let resumed = Trainer::resume(&checkpoint, Toy::new(&PANDA).unwrap()).unwrap();
        let rng = &mut stream(0, Stream::Replay, 0);
        let draws = resumed.learner.paths.sample(100, rng);
        draws.into_iter().map(|draw| draw.weight).collect::<Vec<_>>()
    };
    assert!(weights(Sampling::Uniform).iter().all(|weight| *weight == 1.0));
    assert!(weights(Sampling::Prioritised).iter().any(|weight| *weight < 0.9));
}

#[test]
fn later_starts_of_a_demonstration_teach_no_path_where_each_motion_counts_once() {
    let rows = |starts: PathStarts| {
        let mut config = config();
        config.demos.path_starts = starts;
        let mut trainer =
            Trainer::new(config, run(Method::Lpr, 0), Toy::new(&PANDA).unwrap()).unwrap();
        let whole = Toy::new(&PANDA).unwrap().demonstration(demonstration_scene(0, 0)).unwrap();
        let later = DemoEpisode { start: 10, ..whole.clone() };
        for demo in [&whole, &later] {
            trainer.add_demonstration(demo).unwrap();
        }
        (trainer.learner.n_transitions(), whole.steps.len() as u64)
    };
    let (every, n_steps) = rows(PathStarts::Every);
    assert_eq!(every, 2 * n_steps);
    assert_eq!(rows(PathStarts::First).0, n_steps);
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_seed_another() {
    let first = fingerprint(5, 25);
    assert_eq!(first, fingerprint(5, 25));
    assert_ne!(first.1, fingerprint(6, 25).1);
}

#[cfg(feature = "parallel")]
#[test]
fn the_number_of_threads_does_not_matter() {
    let with_threads = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a pool");
        pool.install(|| fingerprint(7, 25))
    };
    assert_eq!(with_threads(1), with_threads(2));
}

#[test]
fn scenes_of_training_demonstrations_and_evaluation_are_apart() {
    for seed in [0, 1, u64::MAX] {
        let training: Vec<_> = (0..50).map(|episode| training_scene(seed, episode)).collect();
        let demos: Vec<_> = (0..50).map(|demo| demonstration_scene(seed, demo)).collect();
        assert!(training.iter().chain(&demos).all(|&scene| scene >= 1 << 32));
        assert!(training.iter().all(|scene| !demos.contains(scene)));
        assert!(training.windows(2).all(|pair| pair[0] != pair[1]));
    }
}

/// A toy whose goal never changes and never rewards.
#[derive(Debug)]
struct Stuck {
    toy: Toy,
    goal: NextBestPose,
    /// Poses that the demonstrator still has.
    n_goals: usize,
}

impl Stuck {
    fn trainer(config: Config, goal: Vec3) -> Trainer<Self> {
        let mut toy = Toy::new(&PANDA).unwrap();
        toy.reset(0).expect("within reach");
        let goal = NextBestPose {
            gripper: Gripper::Open,
            pose: PANDA.grip(&PANDA.start).prepend_translation(goal),
        };
        Trainer::new(config, run(Method::Lpr, 1), Self { toy, goal, n_goals: 100 })
            .expect("valid settings")
    }
}

impl Environment for Stuck {
    fn robot(&self) -> &Arc<Robot> {
        self.toy.robot()
    }

    fn reset(&mut self, seed: u64) -> Result<()> {
        self.toy.reset(seed)
    }

    fn observe(&mut self) -> Result<Observation> {
        Ok(self.toy.observe())
    }

    fn step(&mut self, path: &JointPath, gripper: Gripper) -> Result<StepResult> {
        self.n_goals -= 1;
        Ok(self.toy.step(path, gripper))
    }

    fn demonstrated_goal(&self) -> Option<NextBestPose> {
        (self.n_goals > 0).then_some(self.goal)
    }
}

fn rows_of_one_episode(timeout: Timeout) -> Vec<Row> {
    let mut config = config();
    config.training.timeout = timeout;
    config.training.transitions_before_updates = 1000;
    let mut trainer = Stuck::trainer(config, Vec3::new(0.0, 0.1, 0.0));
    let logs: Vec<_> = (0..EPISODE_LENGTH).map(|_| trainer.step().expect("a scene")).collect();
    assert_eq!(
        logs[EPISODE_LENGTH - 1].episode.as_ref().and_then(|episode| episode.failure),
        Some("timeout")
    );
    trainer.learner.paths.rows().to_vec()
}

#[test]
fn a_timeout_bootstraps_when_it_cuts_off_and_not_when_it_terminates() {
    let truncated = rows_of_one_episode(Timeout::Truncated);
    assert_eq!(truncated.len(), EPISODE_LENGTH);
    assert!(truncated.iter().all(|row| !row.terminated() && !row.episode_success));
    assert_eq!(truncated.iter().filter(|row| row.truncated).count(), 1);
    let terminal = rows_of_one_episode(Timeout::Terminal);
    let n_terminated = terminal.iter().filter(|row| row.terminated()).count();
    assert_eq!((terminal.len(), n_terminated), (EPISODE_LENGTH, 1));
    assert!(terminal[EPISODE_LENGTH - 1].terminated());
}

#[test]
fn a_pose_out_of_reach_ends_the_episode_and_teaches_no_path() {
    let mut trainer = Stuck::trainer(config(), Vec3::new(3.0, 0.0, 0.0));
    let log = trainer.step().expect("a scene");
    assert_eq!(log.result.invalid, Some(InvalidAction::NoPath));
    assert_eq!(log.episode.expect("it ended").failure, Some("no_path"));
    assert!(log.action.path().is_none() && !log.action.set.rejected.is_empty());
    assert_eq!(trainer.learner.paths.added(), 0);
    // And the next episode starts.
    assert_eq!(trainer.step().expect("a scene").progress.episodes, 2);
}

#[test]
fn an_episode_ends_when_the_demonstrator_has_no_further_pose() {
    let mut trainer = Stuck::trainer(config(), Vec3::new(0.0, 0.1, 0.0));
    trainer.environment().n_goals = 2;
    assert!(trainer.step().expect("a scene").episode.is_none());
    let log = trainer.step().expect("a scene");
    assert_eq!(log.episode.expect("it ended").failure, Some("not_done"));
    assert!(trainer.learner.paths.rows()[1].terminated());
    assert!(trainer.step().is_err(), "and no episode can start");
}

#[test]
fn what_a_step_reports_fits_together() {
    let mut trainer = trainer(config(), Method::Lpr, 3);
    for log in train(&mut trainer, 12) {
        let values = log.action.values.as_ref().expect("paths were ranked");
        assert_eq!(values.len(), log.action.set.candidates.len());
        assert_eq!(log.metrics.get("value/chosen"), log.action.chosen_value());
        assert!(
            log.metrics.get("td_error").is_some() && log.metrics.get("losses/policy").is_some()
        );
        assert_eq!(log.episode.is_some(), log.metrics.get("episode/success").is_some());
        if let Some(episode) = &log.episode {
            let last = episode.values.last().expect("its steps were ranked");
            assert_eq!(last.realised, log.result.reward);
        }
    }
}

/// A toy whose camera is gone after a number of looks.
#[derive(Debug, Clone)]
struct Failing {
    toy: Toy,
    looks_left: usize,
}

impl Environment for Failing {
    fn robot(&self) -> &Arc<Robot> {
        self.toy.robot()
    }

    fn reset(&mut self, seed: u64) -> Result<()> {
        self.toy.reset(seed)
    }

    fn observe(&mut self) -> Result<Observation> {
        let gone = || Fault::Camera { camera: "toy".to_owned(), reason: "unplugged".to_owned() };
        self.looks_left = self.looks_left.checked_sub(1).ok_or_else(gone)?;
        Ok(self.toy.observe())
    }

    fn step(&mut self, path: &JointPath, gripper: Gripper) -> Result<StepResult> {
        Ok(self.toy.step(path, gripper))
    }

    fn demonstrated_goal(&self) -> Option<NextBestPose> {
        self.toy.demonstrated_goal()
    }
}

#[test]
fn an_episode_whose_camera_is_gone_is_dropped_and_the_run_goes_on_with_the_next() {
    let failing = |looks_left| Failing { toy: Toy::new(&PANDA).unwrap(), looks_left };
    let mut trainer =
        Trainer::new(config(), run(Method::Lpr, 1), failing(1)).expect("valid settings");
    assert!(trainer.step().expect("the first look").episode.is_none(), "an episode has two steps");
    assert!(matches!(trainer.step(), Err(Error::Fault(Fault::Camera { .. }))));
    assert_eq!((trainer.learner.paths.added(), trainer.progress.episodes), (0, 0));
    trainer.environment().looks_left = 100;
    while trainer.step().expect("the camera is back").episode.is_none() {}
    assert_eq!(trainer.progress.episodes, 1);
    assert!(trainer.learner.paths.added() > 0);

    let scenes = 1000..1003;
    let whole = evaluate(trainer.agent(), &mut failing(100), scenes.clone(), |_| ());
    assert!(whole.is_ok_and(|evaluation| evaluation.episodes == 3));
    let cut = evaluate(trainer.agent(), &mut failing(3), scenes, |_| ());
    assert!(matches!(cut, Err(Error::Fault(_))), "neither a success nor a failure of the agent");
}
