//! `lpr xarm run`: a trained agent acts once on an arm.
//!
//! There is no camera yet: the agent sees the simulated scene of its task with the arm where the
//! real one is measured to be. Its gripper's command is reported and not sent. Without `--execute`
//! no frame is sent that enables or moves anything.

use super::super::{Failure, Result};
use crate::files::FileError;
use crate::run_directory;
use crate::signals::Signals;
use clap::Args;
use core::fmt;
use core::net::IpAddr;
use core::time::Duration;
use lpr_core::agent::{Action, Draws, Eyes};
use lpr_core::checkpoint::SavedAgent;
use lpr_core::env::Environment as _;
use lpr_core::path::CandidateStreams;
use lpr_core::robot::{Gripper, JointConfig, XARM7};
use lpr_core::sim::tasks::Task;
use lpr_xarm::Ports;
use lpr_xarm::executor::{Execution, Link, Watchdogs};
use lpr_xarm::safety::{CheckedPath, SafetyLimits, check_path};
use lpr_xarm::schedule::{StreamPace, schedule};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Longest wait for the controller, but for the replies to servo points.
const TIMEOUT: Duration = Duration::from_secs(2);
/// Acceleration along the path in joint space, rad/s².
const ACCELERATION: f64 = 2.0;

/// Options of `lpr xarm run`.
#[derive(Debug, Args)]
pub(in super::super) struct Arguments {
    /// A run directory of `lpr train` for the xarm7
    #[arg(value_name = "DIR")]
    run: PathBuf,
    /// The controller's address: of the loopback interface, where `lpr xarm emulate` listens
    #[arg(long, value_name = "ADDRESS")]
    host: IpAddr,
    /// Its port of commands
    #[arg(long, value_name = "PORT", default_value_t = Ports::CONTROLLER.command)]
    command_port: u16,
    /// Its second port of commands, for stopping [default: the one after --command-port]
    #[arg(long, value_name = "PORT")]
    stop_port: Option<u16>,
    /// Its port of real-time reports
    #[arg(long, value_name = "PORT", default_value_t = Ports::CONTROLLER.realtime)]
    report_port: u16,
    /// Seed of the simulated scene that the agent sees
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Enable the arm and move it
    #[arg(long)]
    execute: bool,
    /// Greatest speed along the path in joint space, rad/s
    #[arg(long, value_name = "RAD_PER_SECOND", default_value_t = 0.5)]
    speed: f64,
    /// Points a second: 50 to 250
    #[arg(long, value_name = "HERTZ", default_value_t = 100, value_parser = clap::value_parser!(u32).range(50..=250))]
    rate: u32,
    /// Longest wait for the reply to a point, seconds
    #[arg(long, value_name = "SECONDS", default_value = "0.05", value_parser = seconds)]
    reply_timeout: Duration,
    /// Oldest report, seconds
    #[arg(long, value_name = "SECONDS", default_value = "0.2", value_parser = seconds)]
    report_timeout: Duration,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let secs = text.parse::<f64>().ok().filter(|secs| *secs > 0.0 && *secs <= 10.0);
    secs.map(Duration::from_secs_f64)
        .ok_or_else(|| "expected seconds above 0, at most 10".to_owned())
}

/// Report of `lpr xarm run`.
#[derive(Debug, Serialize)]
pub(in super::super) struct Report {
    task: String,
    robot: String,
    scene_seed: u64,
    goal: GoalRow,
    source: &'static str,
    value: Option<f32>,
    collides: bool,
    n_candidates: usize,
    n_rejected: usize,
    /// Of the timed path, seconds.
    duration: f64,
    n_points: usize,
    checks: Checks,
    path: Vec<JointConfig>,
    executed: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    execution: Option<ExecutionRow>,
}

/// The next-best pose.
#[derive(Debug, Serialize)]
struct GoalRow {
    position: [f32; 3],
    rotation_xyzw: [f32; 4],
    gripper: Gripper,
}

/// Margins of the path to what is allowed; it keeps every rule.
#[derive(Debug, Serialize)]
struct Checks {
    max_joint_speed: f64,
    max_joint_acceleration: f64,
    max_tcp_speed: f64,
    min_height: f64,
    min_limit_distance: f64,
}

#[derive(Debug, Serialize)]
struct ExecutionRow {
    points_sent: usize,
    max_tracking_error: f32,
    max_lateness_ms: f64,
    max_reply_ms: f64,
    arrived_at: JointConfig,
}

pub(in super::super) fn run(arguments: &Arguments) -> Result<Report> {
    let Arguments { run, host, seed, .. } = arguments;
    refuse_real_arm(*host)?;
    let pace = pace(arguments)?;
    let SavedAgent { header, agent } = load(run)?;
    let mut link = Link::connect(*host, ports(arguments), TIMEOUT)?;
    let measured = link.measured()?;
    let task = Task::by_name(&header.run.task)
        .map_err(|error| FileError::content(run, error.to_string()))?;
    let mut env =
        crate::cli::simulator::simulator(&task, &XARM7, &header.run.cameras, &header.config)?;
    env.reset(*seed)?;
    let mut env = env.around(measured)?;
    let draws = Draws::greedy(CandidateStreams { seed: *seed, step: 0 });
    let action = agent.decide(&mut env, Eyes::Open, draws)?;
    let candidate = action.path().ok_or_else(|| no_path(&action))?;
    let points = schedule(&candidate.path, &XARM7, &pace);
    // The arm may have moved while the agent thought.
    let path = check_path(
        points,
        &link.measured()?,
        &SafetyLimits::learned_agent(&XARM7, pace.tick_secs),
    )?;
    let watchdogs = Watchdogs {
        reply_timeout: arguments.reply_timeout,
        report_timeout: arguments.report_timeout,
        ..Watchdogs::STANDARD
    };
    let mut execution = None;
    if arguments.execute {
        // Until here an interrupt ends the program, and nothing has moved.
        let interrupted = Signals::take()?.flag();
        execution = Some(link.execute(&path, &watchdogs, &interrupted)?);
    }
    Ok(report(&task, *seed, &action, &path, execution))
}

/// Only the loopback interface, until there is a way to allow an arm.
fn refuse_real_arm(host: IpAddr) -> Result<()> {
    if host.is_loopback() {
        return Ok(());
    }
    let reason = "may be a real arm, which needs --arm-real and an entry in the configuration: neither exists yet";
    Err(Failure::Usage(format!("--host {host}: {reason}")))
}

fn pace(arguments: &Arguments) -> Result<StreamPace> {
    let tick_secs = 1.0 / f64::from(arguments.rate);
    let limit = SafetyLimits::learned_agent(&XARM7, tick_secs).max_joint_speed;
    let speed = arguments.speed;
    if speed > 0.0 && speed <= limit {
        return Ok(StreamPace { max_velocity: speed, max_acceleration: ACCELERATION, tick_secs });
    }
    Err(Failure::Usage(format!("--speed {speed}: expected rad/s above 0, at most {limit:.3}")))
}

fn ports(arguments: &Arguments) -> Ports {
    let command = arguments.command_port;
    let stop = arguments.stop_port.unwrap_or(command.saturating_add(1));
    Ports { command, stop, realtime: arguments.report_port, ..Ports::CONTROLLER }
}

fn load(run: &Path) -> Result<SavedAgent> {
    let saved = run_directory::latest_agent(run)?;
    let robot = saved.agent.robot().name.clone();
    if robot == XARM7.name {
        return Ok(saved);
    }
    Err(FileError::content(
        run,
        format!("is a run of robot `{robot}`, the arm is an {}", XARM7.name),
    )
    .into())
}

/// The reasons, each once.
fn no_path(action: &Action) -> Failure {
    let mut reasons: Vec<_> =
        action.set.rejected.iter().map(|rejected| rejected.reason.name()).collect();
    reasons.sort_unstable();
    reasons.dedup();
    Failure::NoPath(reasons.join(", "))
}

fn report(
    task: &Task,
    scene_seed: u64,
    action: &Action,
    path: &CheckedPath,
    execution: Option<Execution>,
) -> Report {
    let candidate = action.path().expect("its path was checked");
    let margins = path.margins();
    Report {
        task: task.name.clone(),
        robot: XARM7.name.clone(),
        scene_seed,
        goal: GoalRow {
            position: action.goal.pose.translation.to_array(),
            rotation_xyzw: action.goal.pose.rotation.to_array(),
            gripper: action.goal.gripper,
        },
        source: candidate.source.name(),
        value: action.chosen_value(),
        collides: candidate.collides,
        n_candidates: action.set.candidates.len(),
        n_rejected: action.set.rejected.len(),
        duration: path.duration_secs(),
        n_points: path.points().len(),
        checks: Checks {
            max_joint_speed: margins.joint_speed,
            max_joint_acceleration: margins.joint_acceleration,
            max_tcp_speed: margins.tcp_speed,
            min_height: margins.height,
            min_limit_distance: margins.limit_distance,
        },
        path: candidate.path.configs().to_vec(),
        executed: execution.is_some(),
        execution: execution.map(ExecutionRow::from),
    }
}

impl From<Execution> for ExecutionRow {
    fn from(execution: Execution) -> Self {
        let ms = |duration: Duration| 1000.0 * duration.as_secs_f64();
        Self {
            points_sent: execution.points_sent,
            max_tracking_error: execution.max_tracking_error,
            max_lateness_ms: ms(execution.max_lateness),
            max_reply_ms: ms(execution.max_reply),
            arrived_at: execution.arrived_at,
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { task, scene_seed, source, n_candidates, duration, n_points, checks, .. } = self;
        let [x, y, z] = self.goal.position;
        writeln!(
            f,
            "{task}, scene {scene_seed} (simulated): goal ({x:.3}, {y:.3}, {z:.3}) m, then {:?}",
            self.goal.gripper
        )?;
        write!(f, "path: {source}, chosen from {n_candidates}")?;
        self.value.map_or(Ok(()), |value| write!(f, ", value {value:.3}"))?;
        writeln!(f, "; {duration:.2} s in {n_points} points")?;
        writeln!(
            f,
            "safe: joints at most {:.2} rad/s and {:.1} rad/s², tool at most {:.2} m/s and at least {:.3} m high",
            checks.max_joint_speed,
            checks.max_joint_acceleration,
            checks.max_tcp_speed,
            checks.min_height
        )?;
        match &self.execution {
            None => writeln!(f, "nothing was moved: --execute does that"),
            Some(row) => writeln!(
                f,
                "executed: at most {:.4} rad behind, ticks at most {:.1} ms late, replies within {:.1} ms",
                row.max_tracking_error, row.max_lateness_ms, row.max_reply_ms
            ),
        }
    }
}
