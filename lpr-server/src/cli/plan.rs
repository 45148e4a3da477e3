//! `lpr plan`: motion planning on a file of problems, with the time that each takes.

mod timed;

use super::arm::{Arm, ArmArguments, Needs};
use super::failure::Result;
use crate::problems::{self, Problem};
use core::fmt;
use lpr_core::path::{
    JointPath, Plan, PlannerKind, PlannerSettings, Rejection, RrtSettings, plan_with, simplify,
};
use lpr_core::rng::{self, Stream};
use lpr_core::robot::JointConfig;
use lpr_core::scene::{ArmSpheres, MotionChecker, Scene};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;
use timed::{TimedArguments, TimedFile, file_name};

/// Samples before a planner gives up: minutes.
const MAX_ITERATIONS: u32 = 10_000_000;

const PROBLEMS_HELP: &str = r#"Problems: {"robot": NAME, "problems": [{"name", "start": [q1, …], "goals": [[q1, …], …]}, …]}; each may have "spheres", "cuboids", "capsules", "cylinders", "points" and "point_radius", and "attached": solids in the frame of the tip, and the links "touching" them"#;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    arm: ArmArguments,
    #[arg(long, value_name = "FILE", help = PROBLEMS_HELP)]
    problems: PathBuf,
    /// Planners, separated by commas: rrt-connect, sbl, kpiece, trajopt, stomp
    #[arg(long, value_name = "NAMES", value_parser = planner, value_delimiter = ',', default_value = "rrt-connect")]
    planner: Vec<PlannerKind>,
    /// Longest edge of a tree, radians
    #[arg(long, value_name = "RADIANS", default_value_t = 1.0, value_parser = range)]
    range: f32,
    /// Configurations looked at for each radian of a motion
    #[arg(long, value_name = "N", default_value_t = 32.0, value_parser = resolution)]
    checks_per_radian: f32,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Times every problem is planned; the least time counts
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    repeats: u32,
    /// Shorten and smooth every path
    #[arg(long)]
    simplify: bool,
    #[command(flatten)]
    timed: TimedArguments,
}

/// The planner of that name.
fn planner(name: &str) -> Result<PlannerKind, String> {
    PlannerKind::by_name(name).map_err(|error| error.to_string())
}

fn range(text: &str) -> Result<f32, String> {
    within(text, 0.001, 100.0)
}

fn resolution(text: &str) -> Result<f32, String> {
    within(text, 1.0, 10_000.0)
}

fn within(text: &str, low: f32, high: f32) -> Result<f32, String> {
    let value = text.parse::<f32>().ok().filter(|value| (low..=high).contains(value));
    value.ok_or_else(|| format!("expected a number from {low} to {high}"))
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    results: Vec<ProblemResult>,
    summary: Summary,
}

/// Result of one planner on one problem. Times are the least of the repeats.
#[derive(Debug, Serialize)]
struct ProblemResult {
    name: String,
    planner: PlannerKind,
    seed: u64,
    solved: bool,
    planning_micros: f64,
    /// Null without `--simplify` and without a path.
    simplify_micros: Option<f64>,
    /// To prepare the obstacles.
    world_micros: f64,
    iterations: Option<u32>,
    checks: u64,
    /// Length of the path in joint space, radians.
    cost: Option<f32>,
    path: Option<Vec<Vec<f32>>>,
    /// Only with `--timed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    timed: Option<TimedResult>,
    reason: Option<&'static str>,
    /// What touches what, and how deep, where the start or all goals touch something.
    contact: Option<String>,
}

/// The fastest motion along a path.
#[derive(Debug, Serialize)]
struct TimedResult {
    /// From start to goal; null if every smooth curve along the path touches something.
    duration_secs: Option<f64>,
    /// Name of the files, without extension.
    file: Option<String>,
}

/// Of the problems solved; times are null when there are none.
#[derive(Debug, Serialize)]
struct Summary {
    problems: usize,
    solved: usize,
    /// Problems whose start or goals are not free: no planner can solve them.
    invalid: usize,
    median_micros: Option<f64>,
    p95_micros: Option<f64>,
    p99_micros: Option<f64>,
    max_micros: Option<f64>,
    /// Planning and simplification together; as the above without `--simplify`.
    median_total_micros: Option<f64>,
    p95_total_micros: Option<f64>,
    median_cost: Option<f64>,
    checks_per_second: Option<f64>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let arm = arguments.arm.load(Needs::Collisions)?;
    let spheres = ArmSpheres::from_description(&arm.robot)?;
    let file = problems::read_problems(&arguments.problems)?;
    arm.check_name(&file.robot, &arguments.problems)?;
    let (mut results, mut timed) = (Vec::new(), Vec::new());
    for (idx, problem) in file.problems.iter().enumerate() {
        let query = Query::read(arguments, &arm, &spheres, problem, idx)?;
        for planner in &arguments.planner {
            let (result, file) = query.solve(arguments, &arm, *planner, idx)?;
            results.push(result);
            timed.extend(file);
        }
    }
    arguments.timed.write(&arm.robot, &timed)?;
    let summary = Summary::of(&results);
    Ok(Report { results, summary })
}

/// A problem, checked.
struct Query {
    name: String,
    start: JointConfig,
    goals: Vec<JointConfig>,
    scene: Scene,
    /// The arm with what it holds.
    spheres: ArmSpheres,
    world_micros: f64,
}

impl Query {
    fn read(
        arguments: &Arguments,
        arm: &Arm,
        spheres: &ArmSpheres,
        problem: &Problem,
        idx: usize,
    ) -> Result<Self> {
        let path = &arguments.problems;
        let start = arm.end(&problem.start, path, &format!("problems[{idx}].start"))?;
        let goals = problem.goals.iter().enumerate();
        let goals =
            goals.map(|(i, goal)| arm.end(goal, path, &format!("problems[{idx}].goals[{i}]")));
        let goals = goals.collect::<Result<Vec<JointConfig>>>()?;
        let (scene, world_micros) = least_micros(arguments.repeats, || problem.scene(path, idx));
        let spheres = problem.attach(spheres, path, idx)?;
        let name = problem.name.clone();
        Ok(Self { name, start, goals, scene: scene?, spheres, world_micros })
    }

    fn solve(
        &self,
        arguments: &Arguments,
        arm: &Arm,
        planner: PlannerKind,
        idx: usize,
    ) -> Result<(ProblemResult, Option<TimedFile>)> {
        let ((plan, checks), planning_micros) = least_micros(arguments.repeats, || {
            let checker = self.checker(arguments);
            (self.plan(arguments, &checker, arm, planner, idx as u64), checker.n_checks())
        });
        let mut result = ProblemResult {
            name: self.name.clone(),
            planner,
            seed: arguments.seed,
            solved: plan.is_ok(),
            planning_micros,
            simplify_micros: None,
            world_micros: self.world_micros,
            iterations: plan.as_ref().ok().map(|plan| plan.iterations),
            checks,
            cost: None,
            path: None,
            timed: None,
            reason: plan.as_ref().err().map(|reason| reason.name()),
            contact: plan.as_ref().err().and_then(|reason| self.contact(*reason)),
        };
        let Ok(Plan { path, .. }) = plan else {
            return Ok((result, None));
        };
        let path =
            if arguments.simplify { self.simplified(arguments, &path, &mut result) } else { path };
        result.cost = Some(path.length());
        result.path = Some(path.configs().iter().map(|config| arm.joints(config)).collect());
        if arguments.timed.timed.is_none() {
            return Ok((result, None));
        }
        let mut name = file_name(idx, &self.name);
        if arguments.planner.len() > 1 {
            name = format!("{name}.{}", planner.name());
        }
        let file = arguments.timed.time(name, &arm.robot, &path, &self.checker(arguments))?;
        result.timed = Some(TimedResult {
            duration_secs: file.as_ref().map(TimedFile::duration_secs),
            file: file.as_ref().map(|file| file.name.clone()),
        });
        Ok((result, file))
    }

    fn checker(&self, arguments: &Arguments) -> MotionChecker<'_> {
        MotionChecker::new(&self.scene, &self.spheres, arguments.checks_per_radian)
    }

    fn plan(
        &self,
        arguments: &Arguments,
        checker: &MotionChecker<'_>,
        arm: &Arm,
        planner: PlannerKind,
        idx: u64,
    ) -> Result<Plan, Rejection> {
        if !arm.robot.within_limits(&self.start) {
            return Err(Rejection::OutsideLimits);
        }
        let rng = &mut rng::stream(arguments.seed, Stream::Planner, idx);
        let Arguments { range, checks_per_radian, .. } = *arguments;
        let rrt = RrtSettings { range, checks_per_radian, max_iterations: MAX_ITERATIONS };
        plan_with(planner, checker, &self.start, &self.goals, &PlannerSettings::standard(rrt), rng)
    }

    /// The deepest contact of the start or of the first goal that has one.
    fn contact(&self, reason: Rejection) -> Option<String> {
        let ends = match reason {
            Rejection::StartCollides => core::slice::from_ref(&self.start),
            Rejection::GoalCollides => &self.goals,
            _ => return None,
        };
        let contact = |config| self.scene.deepest_contact(&self.spheres, config);
        ends.iter().find_map(contact).map(|contact| contact.to_string())
    }

    fn simplified(
        &self,
        arguments: &Arguments,
        path: &JointPath,
        result: &mut ProblemResult,
    ) -> JointPath {
        let ((path, checks), micros) = least_micros(arguments.repeats, || {
            let checker = self.checker(arguments);
            (simplify(path, &checker), checker.n_checks())
        });
        result.simplify_micros = Some(micros);
        result.checks += checks;
        path
    }
}

/// The result of `run`, and the least time it took, microseconds.
fn least_micros<T>(repeats: u32, mut run: impl FnMut() -> T) -> (T, f64) {
    let mut timed = || {
        let start = Instant::now();
        let value = run();
        (value, start.elapsed().as_secs_f64() * 1e6)
    };
    let (mut value, mut least) = timed();
    for _ in 1..repeats {
        let (again, micros) = timed();
        (value, least) = (again, least.min(micros));
    }
    (value, least)
}

impl Summary {
    fn of(results: &[ProblemResult]) -> Self {
        let solved: Vec<&ProblemResult> = results.iter().filter(|result| result.solved).collect();
        let invalid = [Rejection::StartCollides, Rejection::GoalCollides, Rejection::OutsideLimits]
            .map(|reason| reason.name());
        let planning = sorted(solved.iter().map(|result| result.planning_micros));
        let totals = sorted(solved.iter().map(|result| total_micros(result)));
        let costs = sorted(solved.iter().filter_map(|result| result.cost).map(f64::from));
        let seconds = totals.iter().sum::<f64>() * 1e-6;
        let checks: u64 = solved.iter().map(|result| result.checks).sum();
        Self {
            problems: results.len(),
            solved: solved.len(),
            invalid: results
                .iter()
                .filter(|result| result.reason.is_some_and(|reason| invalid.contains(&reason)))
                .count(),
            median_micros: percentile(&planning, 50),
            p95_micros: percentile(&planning, 95),
            p99_micros: percentile(&planning, 99),
            max_micros: planning.last().copied(),
            median_total_micros: percentile(&totals, 50),
            p95_total_micros: percentile(&totals, 95),
            median_cost: percentile(&costs, 50),
            checks_per_second: (seconds > 0.0).then(|| checks as f64 / seconds),
        }
    }
}

fn total_micros(result: &ProblemResult) -> f64 {
    result.planning_micros + result.simplify_micros.unwrap_or(0.0)
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The least of the sorted values that is not exceeded by `percent` of them.
fn percentile(sorted: &[f64], percent: usize) -> Option<f64> {
    let rank = (sorted.len() * percent).div_ceil(100).max(1);
    sorted.get(rank - 1).copied()
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<28}{:>10}{:>10}{:>8}{:>7}  rad",
            "problem", "µs", "simplify", "checks", "cost"
        )?;
        for result in &self.results {
            let simplify =
                result.simplify_micros.map_or_else(String::new, |micros| format!("{micros:.0}"));
            let cost = result.cost.map_or_else(String::new, |cost| format!("{cost:.2}"));
            let ProblemResult { name, planning_micros, checks, reason, contact, .. } = result;
            let reason = reason.unwrap_or_default();
            let reason = match contact {
                Some(contact) => format!("{reason}: {contact}"),
                None => reason.to_owned(),
            };
            writeln!(
                f,
                "{name:<28}{planning_micros:>10.0}{simplify:>10}{checks:>8}{cost:>7}  {reason}"
            )?;
        }
        let Summary { problems, solved, invalid, .. } = self.summary;
        write!(f, "{solved} of {problems} solved, {invalid} invalid")?;
        let Summary {
            median_micros: Some(median),
            p95_micros: Some(p95),
            max_micros: Some(max),
            ..
        } = self.summary
        else {
            return writeln!(f);
        };
        writeln!(f, "; {median:.0} µs median, {p95:.0} µs for 95 %, {max:.0} µs at most")?;
        if let Summary { median_total_micros: Some(total), median_cost: Some(cost), .. } =
            self.summary
        {
            writeln!(f, "with simplification {total:.0} µs median; cost {cost:.2} rad median")?;
        }
        let timed: Vec<&TimedResult> =
            self.results.iter().filter_map(|result| result.timed.as_ref()).collect();
        let durations = sorted(timed.iter().filter_map(|timed| timed.duration_secs));
        if let Some(median) = percentile(&durations, 50) {
            writeln!(f, "{} of {} timed; {median:.2} s median", durations.len(), timed.len())?;
        }
        Ok(())
    }
}
