//! Learning curve of paths with the demonstrator's poses, for any setting of a preset.
//!
//! ```text
//! cargo run -p lpr-core --release --example path_study -- toy lpr 0 400 training.exploration.first=0.3
//! ```
//!
//! Arguments: a task or `toy`, a method, a seed, environment steps, and settings that differ from
//! `fast`. Prints, every 50 steps, the share of training episodes that succeeded since and of
//! validation scenes, and at the end what the choices cost.
#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a study that prints its table and may stop at bad arguments"
)]

use std::time::Instant;

use lpr_core::agent::{Method, PoseSource};
use lpr_core::config::Config;
use lpr_core::demo::DemoEpisode;
use lpr_core::env::Environment;
use lpr_core::evaluate::{best_of_all, evaluate, measure_regret};
use lpr_core::nn::Backend;
use lpr_core::robot::XARM7;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::recording::record_demo;
use lpr_core::sim::tasks::Task;
use lpr_core::toy::Toy;
use lpr_core::train::{Run, Trainer, default_cameras, demonstration_scene};

/// Steps between two lines of the table.
const INTERVAL: u64 = 50;

/// Scenes of a validation.
const VALIDATION: core::ops::Range<u64> = 1000..1030;

fn main() {
    let arguments = std::env::args().skip(1).collect::<Vec<_>>();
    let [task, method, seed, n_steps, settings @ ..] = arguments.as_slice() else {
        panic!("task method seed steps [settings]")
    };
    let (seed, n_steps) = (seed.parse().unwrap(), n_steps.parse().unwrap());
    let config = settings
        .iter()
        .fold(Config::preset("fast").unwrap(), |config, setting| config.with(setting).unwrap());
    let (method, backend, poses) =
        (Method::by_name(method).unwrap(), Backend::Flex, PoseSource::Oracle);
    let run = Run { task: task.clone(), method, poses, backend, seed, cameras: default_cameras() };
    let n_demos = config.training.demonstrations as u64;
    let scenes = (0..).map(|demo| demonstration_scene(seed, demo));
    if task == "toy" {
        let demos: Vec<_> = scenes
            .filter_map(|scene| Toy::new(&XARM7).unwrap().demonstration(scene).ok())
            .take(n_demos as usize)
            .collect();
        study(config, run, Toy::new(&XARM7).unwrap(), &demos, n_steps);
    } else {
        let task = Task::by_name(task).unwrap();
        let env =
            SimEnvironment::new(&task, &XARM7, VALIDATION.start, &["front"], &config.simulator)
                .unwrap();
        let recorded =
            scenes.filter_map(|scene| record_demo(&env, scene, &config.demos).ok().flatten());
        let demos: Vec<_> = recorded.take(n_demos as usize).flatten().collect();
        study(config, run, env, &demos, n_steps);
    }
}

fn study<E: Environment + Clone + Send + Sync>(
    config: Config,
    run: Run,
    environment: E,
    demos: &[DemoEpisode],
    n_steps: u64,
) {
    let started = Instant::now();
    let mut validation = environment.clone();
    let mut trainer = Trainer::new(config, run, environment).unwrap();
    demos.iter().for_each(|demo| trainer.add_demonstration(demo).unwrap());
    while trainer.demonstration_updates_left() > 0 {
        trainer.update().unwrap();
    }
    println!("{} chains of demonstrations, {:.1} s", demos.len(), started.elapsed().as_secs_f32());
    println!("steps episodes success valid. policy td_error losses/policy value/error seconds");
    let (mut episodes, mut successes) = (0, 0);
    let mut sums = [0.0_f32; 3];
    for step in 0..=n_steps {
        if step % INTERVAL == 0 {
            let found = evaluate(trainer.agent(), &mut validation, VALIDATION, |_| ()).unwrap();
            let [td_error, policy_loss, value_error] = sums.map(|sum| sum / INTERVAL as f32);
            println!(
                "{step:5} {episodes:8} {:7.2} {:6.2} {:6.2} {td_error:8.4} {policy_loss:13.5} {value_error:11.3} {:7.1}  {:?} {:?}",
                successes as f32 / episodes.max(1) as f32,
                found.success_rate(),
                found.policy_valid as f32 / found.steps as f32,
                started.elapsed().as_secs_f32(),
                found.chosen,
                found.failures,
            );
            (episodes, successes, sums) = (0, 0, [0.0; 3]);
        }
        let log = trainer.step().unwrap();
        for (sum, name) in sums.iter_mut().zip(["td_error", "losses/policy", "value/error"]) {
            *sum += log.metrics.get(name).unwrap_or_default();
        }
        if let Some(episode) = log.episode {
            episodes += 1;
            successes += u32::from(episode.success);
        }
    }
    println!("regret {:?}", measure_regret(trainer.agent(), &mut validation, VALIDATION).unwrap());
    let best = best_of_all(trainer.agent(), &mut validation, VALIDATION, |_| ()).unwrap();
    println!("best of all {:.2} {:?} {:?}", best.success_rate(), best.chosen, best.failures);
}
