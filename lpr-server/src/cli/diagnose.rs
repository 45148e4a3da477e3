//! `lpr diagnose`: what a trained agent gets wrong, and why its episodes fail.

mod page;
mod report;
mod subject;

use super::arguments::{VALIDATION_SEEDS, seed_range};
use super::failure::Result;
use super::simulator::simulator;
use crate::files;
use clap::Args;
use core::ops::Range;
use lpr_core::diagnose::{DiagnosisSettings, Reference, Subject, diagnose, references};
pub(super) use report::{Report, Scope};
use std::path::PathBuf;
use subject::Run;

/// Options of `lpr diagnose`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A run directory, as `lpr train` leaves it
    #[arg(value_name = "DIR")]
    run: PathBuf,
    /// Scenes
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    scenes: u64,
    /// Seed of the first scene [default: the first of the validations]
    #[arg(long, default_value_t = VALIDATION_SEEDS, hide_default_value = true)]
    seed: u64,
    /// Scenes in which every candidate is executed; each takes as long as forty others
    #[arg(long, value_name = "N", default_value_t = 10)]
    best_of_all: usize,
    /// Augmentations of each keyframe whose labels are audited
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    augmentations: u32,
    /// Write diagnosis.json, diagnosis.txt and index.html with its pictures into this new directory
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let seeds = seed_range(arguments.seed, arguments.scenes)?;
    if let Some(out) = &arguments.out {
        files::refuse_non_empty(out)?;
    }
    let run = Run::open(&arguments.run)?;
    let environment = simulator(&run.task, run.agent().robot(), &run.cameras, &run.config)?;
    let demonstrations = run.demonstrations(&environment)?;
    let references = references(&environment, seeds.clone())?;
    refuse_no_scene(&references, &run.task.name, &seeds)?;
    let snapshots: Vec<_> =
        run.snapshots.iter().map(|(env_steps, agent)| (*env_steps, agent)).collect();
    let subject = Subject {
        agent: run.agent(),
        demonstrations: &demonstrations,
        snapshots: &snapshots,
        seed: run.seed,
    };
    let settings = DiagnosisSettings {
        best_of_all_scenes: arguments.best_of_all,
        augmentations: arguments.augmentations as usize,
        whole: true,
    };
    let diagnosis = diagnose(&subject, &references, settings)?;
    let scope = Scope {
        task: run.task.name.clone(),
        robot: run.agent().robot().name.clone(),
        method: run.agent().method().name(),
        seed: run.seed,
        env_steps: run.env_steps(),
        scene_seeds: [seeds.start, seeds.end - 1],
    };
    let report = Report { scope, diagnosis };
    if let Some(out) = &arguments.out {
        page::write(&report, out)?;
    }
    Ok(report)
}

fn refuse_no_scene(references: &[Reference], task: &str, seeds: &Range<u64>) -> Result<()> {
    if !references.is_empty() {
        return Ok(());
    }
    let reason = format!(
        "{task}: the demonstrator succeeds in none of the scenes {} to {}, so there is no truth to compare with",
        seeds.start,
        seeds.end - 1
    );
    Err(lpr_core::Error::Environment(reason).into())
}
