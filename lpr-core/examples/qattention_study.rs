//! Learning curve of Q-attention on the keyframes of a task from demonstrations alone, for any
//! setting of a preset.
//!
//! ```text
//! cargo run -p lpr-core --release --example qattention_study -- take_lid_off_saucepan 0 1200 q_attention.learning_rate=1e-3
//! ```
//!
//! Arguments: a task, a seed, updates, and settings that differ from `fast`. Demonstrations of
//! validation scenes are the truth: of each of their keyframes, prints the share that is chosen
//! within 2 cm, also within 15° (up to the gripper's symmetry) with the right gripper command, and
//! median errors, as training goes on.
#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a study that prints its table and may stop at bad arguments"
)]

use std::time::Instant;

use core::ops::Range;
use lpr_core::agent::{Agent, Eyes, Method, PoseSource};
use lpr_core::config::Config;
use lpr_core::demo::{DemoEpisode, DemoStep};
use lpr_core::diagnose::PoseError;
use lpr_core::nn::Backend;
use lpr_core::robot::XARM7;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::recording::record_demo;
use lpr_core::sim::tasks::Task;
use lpr_core::train::{Run, Trainer, default_cameras, demonstration_scene};

/// Validation scenes.
const SCENES: Range<u64> = 1000..1040;
/// Lines of the table.
const N_LINES: u64 = 8;

fn main() {
    let arguments = std::env::args().skip(1).collect::<Vec<_>>();
    let [task, seed, n_updates, settings @ ..] = arguments.as_slice() else {
        panic!("task seed updates [settings]")
    };
    let (seed, n_updates): (u64, u64) = (seed.parse().unwrap(), n_updates.parse().unwrap());
    let mut config = settings
        .iter()
        .fold(Config::preset("fast").unwrap(), |config, setting| config.with(setting).unwrap());
    config.training.demonstration_updates = n_updates;
    let task = Task::by_name(task).unwrap();
    let env =
        SimEnvironment::new(&task, &XARM7, SCENES.start, &["front"], &config.simulator).unwrap();
    let record = |scene| record_demo(&env, scene, &config.demos).ok().flatten();
    let truth: Vec<Vec<DemoEpisode>> =
        SCENES.filter_map(record).filter(|chains| !chains.is_empty()).collect();
    for n in 1..10 {
        let with_n = truth.iter().filter(|demo| demo[0].steps.len() == n).count();
        if with_n > 0 {
            println!("{with_n} scenes of {n} keyframes");
        }
    }
    // Ranker and policy are of no interest here, and the baseline has none.
    let run = Run {
        task: task.name.clone(),
        method: Method::C2fArm,
        poses: PoseSource::Learned,
        backend: Backend::Flex,
        seed,
        cameras: default_cameras(),
    };
    let demos = (0..).filter_map(|demo| record(demonstration_scene(seed, demo)));
    let mut trainer = Trainer::new(config.clone(), run, env.clone()).unwrap();
    for chain in demos.take(config.training.demonstrations).flatten() {
        trainer.add_demonstration(&chain).unwrap();
    }
    println!("{:?}", trainer.agent().networks.q_attention.as_ref().unwrap().costs());
    let started = Instant::now();
    let mut trained = 0.0;
    for update in 1..=n_updates {
        let start = Instant::now();
        let metrics = trainer.update().unwrap();
        trained += start.elapsed().as_secs_f64();
        if update % (n_updates / N_LINES).max(1) == 0 {
            let loss = metrics.iter().find(|(name, _)| *name == "losses/q_attention").unwrap().1;
            println!(
                "{update} updates, {trained:.0} s, {:.2}/s, loss {loss:.3}",
                update as f64 / trained
            );
            report(trainer.agent(), &truth);
        }
    }
    println!("{:.0} s in all", started.elapsed().as_secs_f64());
}

/// One line a keyframe.
fn report(agent: &Agent, truth: &[Vec<DemoEpisode>]) {
    let n_keyframes = truth.iter().map(|demo| demo[0].steps.len()).max().unwrap_or(0);
    for keyframe in 0..n_keyframes {
        let errors: Vec<_> = truth
            .iter()
            .filter_map(|demo| demo[0].steps.get(keyframe))
            .map(|step| error(agent, step))
            .collect();
        let n = errors.len();
        let share = |test: &dyn Fn(&PoseError) -> bool| {
            100 * errors.iter().filter(|error| test(error)).count() / n
        };
        let near = share(&|error| error.position < 0.02);
        let right = share(&PoseError::is_right);
        let coarse = share(&|error| error.position < 0.1);
        let gripper = share(&|error| error.gripper);
        let mut distances: Vec<_> = errors.iter().map(|error| error.position * 1e3).collect();
        let mut angles: Vec<_> = errors.iter().map(|error| error.rotation).collect();
        for column in [&mut distances, &mut angles] {
            column.sort_by(f32::total_cmp);
        }
        let at = |column: &[f32], percent: usize| column[(n * percent / 100).min(n - 1)];
        println!(
            "  keyframe {keyframe}: 10 cm {coarse:3} %, 2 cm {near:3} %, all {right:3} %, gripper {gripper:3} %; mm {:.0} (90 %: {:.0}), deg {:.0} (90 %: {:.0})",
            at(&distances, 50),
            at(&distances, 90),
            at(&angles, 50),
            at(&angles, 90)
        );
    }
}

fn error(agent: &Agent, step: &DemoStep) -> PoseError {
    let chosen = agent.attend(step.observation.clone(), Eyes::Open).pose;
    PoseError::between(&chosen, &step.goal)
}
