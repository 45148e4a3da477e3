//! A run before its first update: demonstrations, settings, and options that go together.

use super::Arguments;
use super::demonstrations::{self, Demonstrated};
use super::interruption::Interruption;
use super::progress::{Bar, Phase};
use crate::cli::failure::Result;
use core::fmt;
use lpr_core::agent::{Method, PoseSource};
use lpr_core::config::Config;
use lpr_core::sim::SimEnvironment;
use lpr_core::train::Run;
use serde::Serialize;

/// The demonstrations of a new run.
pub(super) fn demonstrate(
    arguments: &Arguments,
    environment: &SimEnvironment,
    config: &Config,
    bar: &mut Bar,
    interruption: &Interruption,
) -> Result<Vec<Demonstrated>> {
    let n_scripted = config.training.demonstrations;
    let n = match &arguments.demo_dir {
        Some(directory) => demonstrations::n_files(directory)?,
        None => n_scripted,
    };
    bar.enter(Phase::Demonstrations, n as u64);
    let mut on_demo = |n_done: usize| {
        bar.advance(n_done as u64);
        interruption.check()
    };
    let demos = match &arguments.demo_dir {
        Some(directory) => {
            demonstrations::of_directory(environment, &config.demos, directory, &mut on_demo)
        }
        None => demonstrations::scripted(
            environment,
            &config.demos,
            arguments.seed,
            n_scripted,
            &mut on_demo,
        ),
    };
    if interruption.has_come() {
        bar.finish();
        bar.say("nothing was learned yet, nothing is saved");
    }
    demos
}

/// Refuses to go on with a run of other options than those that are given. Options with their
/// default value may be left out.
pub(super) fn refuse_other_run(arguments: &Arguments, run: &Run) -> lpr_core::Result<()> {
    let differs = |option: &str, found: &dyn fmt::Display, asked: &dyn fmt::Display| {
        Err(lpr_core::Error::Checkpoint(format!(
            "of {option} `{found}`, asked to resume `{asked}`"
        )))
    };
    if run.task != arguments.task.name {
        return differs("task", &run.task, &arguments.task.name);
    }
    if arguments.method != Method::Lpr && arguments.method != run.method {
        return differs("method", &run.method.name(), &arguments.method.name());
    }
    if arguments.seed != 0 && arguments.seed != run.seed {
        return differs("seed", &run.seed, &arguments.seed);
    }
    if arguments.oracle_poses && run.poses == PoseSource::Learned {
        return differs("poses", &"learned", &"--oracle-poses");
    }
    Ok(())
}

/// `config.toml`: every setting, and what the run is of. As a preset it is read without the latter.
pub(super) fn config_toml(
    config: &Config,
    run: &Run,
    robot: &str,
    demos: &[Demonstrated],
) -> Result<String> {
    #[derive(Serialize)]
    struct Section<'a> {
        run: RunSection<'a>,
    }
    #[derive(Serialize)]
    struct RunSection<'a> {
        robot: &'a str,
        #[serde(flatten)]
        run: &'a Run,
        /// Scene seeds.
        demonstrations: Vec<u64>,
    }
    let demonstrations = demos.iter().map(|demo| demo.scene_seed).collect();
    let section = Section { run: RunSection { robot, run, demonstrations } };
    let section = toml::to_string(&section)
        .map_err(|error| lpr_core::Error::Config(format!("--seed: {error}")))?;
    Ok(format!("{}\n{section}", config.to_toml()))
}
