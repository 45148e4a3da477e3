//! The command line: one file per command.
//!
//! A command returns a report, which is printed as one JSON object (`--json`) or as a short table.
//! Exit status 0: done, 1: failed, 2: wrong usage. A failure is one line on standard error that
//! names the value at fault.

mod arm;
mod bench;
mod demo;
mod eval;
mod fk;
mod gallery;
mod ik;
mod paths;
mod placements;
mod plan;
mod render;
mod replay;
mod robots;
mod scene;
mod serve;
mod tasks;
mod train;
mod xarm;

use crate::files::FileError;
use crate::gallery::GalleryError;
use crate::xarm::client::ClientError;
use crate::xarm::emulator::EmulatorError;
use crate::xarm::executor::ExecutionError;
use crate::xarm::safety::SafetyError;
use clap::{Args, Parser, Subcommand};
use core::fmt::Display;
use lpr_core::config::Config;
use lpr_core::robot::{ROBOTS, Robot};
use lpr_core::sim::tasks::Task;
use serde::Serialize;
use std::ffi::OsString;
use std::io::{self, Write as _};
use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use thiserror::Error;

/// Exit status of arguments that are unknown, out of range or do not go together.
const WRONG_USAGE: u8 = 2;

/// What `lpr` alone prints.
const INTRODUCTION: &str = "\
lpr: robot arms that learn manipulation from a few demonstrations on a CPU (C2F-ARM with Learned Path Ranking).
  lpr tasks                                   the tasks; lpr robots: the arms
  lpr train reach_target --out run            trains an agent and evaluates it; lpr serve: many, over HTTP
  lpr render open_drawer --demo --out a.gif   a scripted demonstration as an animation
  lpr help [COMMAND]                          every command and option; --json prints one JSON object instead of a table";

#[derive(Debug, Parser)]
#[command(
    name = "lpr",
    version,
    about = "Robot arms that learn manipulation from a few demonstrations on a CPU"
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Print exactly one JSON object on standard output
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// List the built-in robots
    Robots,
    /// List the tasks
    Tasks,
    /// Place a task many times: how often that fails, and what of its range is covered
    Placements(placements::Arguments),
    /// Demonstrate a task by script
    Demo(demo::Arguments),
    /// List the candidate paths of a demonstration's keyframes, and execute each
    Paths(paths::Arguments),
    /// Draw a scene, a demonstration or a recorded episode
    Render(render::Arguments),
    /// Write the scene of a task to a file
    Scene(scene::Arguments),
    /// Draw every task and its demonstration
    Gallery(gallery::Arguments),
    /// Run a recorded episode again
    Replay(replay::Arguments),
    /// Forward kinematics of the flange
    Fk(fk::Arguments),
    /// Inverse kinematics of the flange
    Ik(ik::Arguments),
    /// Plan the motions of a file of problems, and measure the time
    Plan(plan::Arguments),
    /// Train an agent on a task
    Train(Box<train::Arguments>),
    /// Evaluate a trained agent, or a method with the demonstrator's poses
    Eval(eval::Arguments),
    /// Measure how long networks, simulation, planning and candidates take
    Bench(bench::Arguments),
    /// Serve training jobs over HTTP, and the page that shows them
    Serve(serve::Arguments),
    /// Run an agent on a UFACTORY xArm7, or emulate its controller
    #[command(subcommand)]
    Xarm(xarm::Action),
}

impl Command {
    fn run(&self, format: Format) -> Result<()> {
        match self {
            Self::Robots => print(&robots::run(), format),
            Self::Tasks => print(&tasks::run(), format),
            Self::Placements(arguments) => print(&placements::run(arguments), format),
            Self::Demo(arguments) => print(&demo::run(arguments)?, format),
            Self::Paths(arguments) => print(&paths::run(arguments)?, format),
            Self::Render(arguments) => print(&render::run(arguments)?, format),
            Self::Scene(arguments) => print(&scene::run(arguments)?, format),
            Self::Gallery(arguments) => print(&gallery::run(arguments)?, format),
            Self::Replay(arguments) => print(&replay::run(arguments)?, format),
            Self::Fk(arguments) => print(&fk::run(arguments)?, format),
            Self::Ik(arguments) => print(&ik::run(arguments)?, format),
            Self::Plan(arguments) => print(&plan::run(arguments)?, format),
            Self::Train(arguments) => print(&train::run(arguments)?, format),
            Self::Eval(arguments) => print(&eval::run(arguments)?, format),
            Self::Bench(arguments) => print(&bench::run(arguments)?, format),
            Self::Serve(arguments) => serve::run(arguments),
            Self::Xarm(action) => xarm::run(action, format),
        }
    }
}

/// The option that chooses the arm.
#[derive(Debug, Clone, Args)]
struct RobotArgument {
    /// The arm: xarm7 or panda
    #[arg(long, value_name = "NAME", value_parser = Robot::by_name, default_value = &*ROBOTS[0].name)]
    robot: Arc<Robot>,
}

/// The argument that chooses the task.
#[derive(Debug, Clone, Copy, Args)]
struct TaskArgument {
    /// The task, one of `lpr tasks`
    #[arg(value_name = "TASK", value_parser = Task::by_name)]
    task: &'static Task,
}

/// The default preset, for commands that look at scenes and candidates without a run.
fn default_preset() -> Config {
    Config::preset("fast").expect("the preset is built in and parses")
}

/// The scenes of `episodes` episodes from `seed` on.
fn scene_seeds(seed: u64, episodes: u32) -> impl Iterator<Item = u64> {
    (0..u64::from(episodes)).map(move |episode| seed.wrapping_add(episode))
}

/// How a report is printed.
#[derive(Debug, Clone, Copy)]
enum Format {
    Json,
    Table,
}

/// Why a command failed.
#[derive(Debug, Error)]
enum Failure {
    /// Input that the algorithms refuse.
    #[error(transparent)]
    Core(#[from] lpr_core::Error),
    /// A file that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A task that cannot be shown.
    #[error(transparent)]
    Gallery(#[from] GalleryError),
    /// Arguments that do not go together.
    #[error("{0}")]
    Usage(String),
    /// An address at which nothing can be served.
    #[error("--bind {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The operating system's reason.
        source: io::Error,
    },
    /// The server cannot go on.
    #[error("the server: {0}")]
    Server(io::Error),
    /// An emulator that cannot start.
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    /// A controller that cannot be reached or does not answer.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// A path that the arm must not run.
    #[error("the path is not safe: {0}")]
    Safety(#[from] SafetyError),
    /// A path that was not run to its end.
    #[error(transparent)]
    Execution(#[from] ExecutionError),
    /// The agent proposes nothing to run.
    #[error("the agent found no path: {0}")]
    NoPath(String),
    /// Standard output is closed or full.
    #[error("cannot write to standard output: {0}")]
    Output(#[from] io::Error),
}

type Result<T, E = Failure> = core::result::Result<T, E>;

/// Runs the command line `arguments`, of which the first is the program's name.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => return refuse(&error),
    };
    let format = if cli.json { Format::Json } else { Format::Table };
    let done = match &cli.command {
        Some(command) => command.run(format),
        None => print_line(INTRODUCTION),
    };
    exit_status(done)
}

/// The exit status of a command, after saying why it failed.
fn exit_status(done: Result<()>) -> ExitCode {
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            report_error(&failure.to_string());
            if matches!(failure, Failure::Usage(_)) {
                WRONG_USAGE.into()
            } else {
                ExitCode::FAILURE
            }
        }
    }
}

/// Answers wrong usage with status 2, and `--help` and `--version`, which clap also calls errors,
/// with 0.
fn refuse(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        return exit_status(print_line(error.to_string().trim_end()));
    }
    // clap's message is followed by paragraphs of tips, usage and a pointer to --help.
    let message = error.to_string();
    let said: Vec<_> = message
        .split("\n\n")
        .map(str::trim)
        .filter(|paragraph| {
            !paragraph.is_empty()
                && !paragraph.starts_with("Usage:")
                && !paragraph.starts_with("For more")
        })
        .collect();
    let message = said.join("; ");
    report_error(message.strip_prefix("error: ").unwrap_or(&message));
    WRONG_USAGE.into()
}

/// Prints the one line that a failure prints.
fn report_error(message: &str) {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    // With standard error closed there is no one left to tell.
    let _ = writeln!(io::stderr(), "error: {line}");
}

fn print<R: Serialize + Display>(report: &R, format: Format) -> Result<()> {
    match format {
        Format::Json => print_line(&serde_json::to_string(report).map_err(io::Error::from)?),
        Format::Table => print_line(report.to_string().trim_end()),
    }
}

/// Prints on standard output; a reader that has seen enough (`lpr … | head`) is no failure.
fn print_line(text: &str) -> Result<()> {
    match writeln!(io::stdout(), "{text}") {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}
