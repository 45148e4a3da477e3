//! `lpr placements`: where scenes of a task come to stand, and how many draws that takes.

use super::arguments::{RobotArgument, TaskArgument, scene_seeds};
use core::f32::consts::TAU;
use core::fmt;
use lpr_core::glamx::Vec2;
use lpr_core::robot::Robot;
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{PlacedTask, Rejected, place};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};
use serde::Serialize;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Side of the cells that coverage is counted in, metres.
const CELL: f32 = 0.05;
/// Sectors of a turn that coverage is counted in.
const SECTORS: f32 = 36.0;
/// Scenes that say which cells are feasible at all, for each scene that should cover them.
const REFERENCE_FACTOR: u32 = 4;
/// First seed of those: no scene of a run or test has it.
const REFERENCE_SEED: u64 = 1_000_000;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    task: TaskArgument,
    #[command(flatten)]
    robot: RobotArgument,
    /// Scenes to place; number i has seed SEED + i
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    scenes: u32,
    /// Seed of the first scene
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    task: String,
    robot: String,
    scenes: u32,
    /// Scenes for which no draw was feasible.
    unplaced: usize,
    /// Share of draws with something in the arm's start posture.
    rejected_at_the_arm: f64,
    /// Share of draws that the arm cannot reach.
    rejected_out_of_reach: f64,
    /// Cells of 5 cm that scenes came to stand in, of those that any scene does.
    cells: Covered,
    /// Sectors of 10 degrees of their yaw.
    sectors: Covered,
    /// Least and greatest place, metres from the robot's base.
    range_m: [[f32; 2]; 2],
}

/// Numbers of the feasible ones and of those that were hit.
#[derive(Debug, Serialize)]
struct Covered {
    hit: usize,
    feasible: usize,
}

impl Covered {
    fn of(places: &[Place], reference: &[Place], cell: impl Fn(&Place) -> (i32, i32)) -> Self {
        let cells = |places: &[Place]| places.iter().map(&cell).collect::<BTreeSet<_>>();
        let (hit, reference) = (cells(places), cells(reference));
        Self { hit: hit.len(), feasible: hit.union(&reference).count() }
    }
}

/// Place of a scene.
#[derive(Debug, Clone, Copy)]
struct Place {
    at: Vec2,
    yaw: f32,
}

impl Place {
    /// Of the task's frame, or of the first body when the frame stays and bodies move in it.
    fn of(task: &Task, placed: &PlacedTask) -> Self {
        let stays = task.placement.half_range == Vec2::ZERO;
        let pose = if stays { placed.scene.spec.bodies[0].pose } else { placed.frame };
        let turn = pose.rotation;
        Self { at: pose.translation.truncate(), yaw: 2.0 * turn.z.atan2(turn.w) }
    }

    fn cell(&self) -> (i32, i32) {
        let cell = (self.at / CELL).floor().as_ivec2();
        (cell.x, cell.y)
    }

    fn sector(&self) -> (i32, i32) {
        ((self.yaw.rem_euclid(TAU) / TAU * SECTORS) as i32, 0)
    }
}

pub(super) fn run(arguments: &Arguments) -> Report {
    let Arguments { task: TaskArgument { task }, robot: RobotArgument { robot }, scenes, seed } =
        arguments;
    let (scenes, seed) = (*scenes, *seed);
    let placed = place_all(task, robot, seed, scenes);
    let reference = place_all(task, robot, REFERENCE_SEED, REFERENCE_FACTOR.saturating_mul(scenes));
    let (rejected, places): (Vec<_>, Vec<_>) = placed.iter().flatten().copied().unzip();
    let reference: Vec<_> = reference.iter().flatten().map(|(_, place)| *place).collect();
    let sum = |count: fn(&Rejected) -> u64| rejected.iter().map(count).sum::<u64>() as f64;
    let (at_the_arm, out_of_reach) = (sum(|r| r.at_the_arm), sum(|r| r.out_of_reach));
    let draws = (at_the_arm + out_of_reach + places.len() as f64).max(1.0);
    let least = places.iter().map(|place| place.at).reduce(Vec2::min).unwrap_or_default();
    let most = places.iter().map(|place| place.at).reduce(Vec2::max).unwrap_or_default();
    Report {
        task: task.name.clone(),
        robot: robot.name.clone(),
        scenes,
        unplaced: placed.iter().filter(|placed| placed.is_none()).count(),
        rejected_at_the_arm: at_the_arm / draws,
        rejected_out_of_reach: out_of_reach / draws,
        cells: Covered::of(&places, &reference, Place::cell),
        sectors: Covered::of(&places, &reference, Place::sector),
        range_m: [[least.x, most.x], [least.y, most.y]],
    }
}

/// For each scene, where it stands after which rejected draws; nothing when it cannot be placed.
fn place_all(
    task: &Task,
    robot: &Arc<Robot>,
    seed: u64,
    scenes: u32,
) -> Vec<Option<(Rejected, Place)>> {
    let seeds: Vec<_> = scene_seeds(seed, scenes).collect();
    let place = |seed| {
        let placed = place(task, 0, robot, seed).ok()?;
        Some((placed.rejected, Place::of(task, &placed)))
    };
    seeds.into_par_iter().map(place).collect()
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { task, robot, scenes, unplaced, cells, sectors, range_m: [x, y], .. } = self;
        let [arm, reach] =
            [self.rejected_at_the_arm, self.rejected_out_of_reach].map(|share| 100.0 * share);
        writeln!(
            f,
            "{task} with {robot}: {scenes} scenes, {unplaced} of them without a placement"
        )?;
        writeln!(
            f,
            "draws rejected: {:.1} % ({arm:.1} % at the arm, {reach:.1} % out of reach)",
            arm + reach
        )?;
        writeln!(
            f,
            "cells of 5 cm hit: {} of {}, sectors of 10 degrees: {} of {}",
            cells.hit, cells.feasible, sectors.hit, sectors.feasible
        )?;
        writeln!(f, "x from {:.3} to {:.3} m, y from {:.3} to {:.3} m", x[0], x[1], y[0], y[1])
    }
}
