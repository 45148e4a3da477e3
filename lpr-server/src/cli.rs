//! The command line: one file per command.
//!
//! A command returns a report, which is printed as one JSON object (`--json`) or as a short table.
//! Exit status 0: done, 1: failed, 2: wrong usage. A failure is one line on standard error that
//! names the value at fault.

mod arguments;
mod arm;
mod bench;
mod demo;
mod diagnose;
mod eval;
mod experiment;
mod failure;
mod fk;
mod gallery;
mod ik;
mod output;
mod paths;
mod placements;
mod plan;
mod render;
mod replay;
mod robots;
mod scene;
mod serve;
mod settings;
mod simulator;
mod tasks;
mod train;
mod xarm;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};
use failure::{Failure, Result, WRONG_USAGE};
use output::{Format, print, print_line, report_error};
use std::ffi::OsString;
use std::process::ExitCode;

/// Five lines for `lpr` alone.
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
    /// List the built-in robots, or tell what a URDF file says
    Robots(Box<robots::Arguments>),
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
    /// Say what a trained agent gets wrong, and why its episodes fail
    Diagnose(diagnose::Arguments),
    /// Train and diagnose many agents whose figures belong together
    #[command(subcommand)]
    Experiment(experiment::Action),
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
            Self::Robots(arguments) => print(&robots::run(arguments)?, format),
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
            Self::Diagnose(arguments) => print(&diagnose::run(arguments)?, format),
            Self::Experiment(action) => print(&experiment::run(action)?, format),
            Self::Bench(arguments) => print(&bench::run(arguments)?, format),
            Self::Serve(arguments) => serve::run(arguments),
            Self::Xarm(action) => xarm::run(action, format),
        }
    }
}

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

/// Parses the command line `arguments` without running it; the first argument is the program's
/// name. Files that it names need not exist. Tests check the commands of the documentation with it.
///
/// # Errors
///
/// The message of wrong usage, as the program would print it after `error: `.
///
/// ```
/// use lpr_server::cli::check_command_line;
///
/// assert!(check_command_line(["lpr", "train", "reach_target", "--out", "run"]).is_ok());
/// assert!(check_command_line(["lpr", "train", "--help"]).is_ok());
/// let message = check_command_line(["lpr", "train", "juggle", "--out", "run"]).unwrap_err();
/// assert!(message.contains("juggle") && message.contains("reach_target"), "{message}");
/// ```
pub fn check_command_line<A: Into<OsString> + Clone>(
    arguments: impl IntoIterator<Item = A>,
) -> core::result::Result<(), String> {
    match Cli::try_parse_from(arguments) {
        Ok(_) => Ok(()),
        Err(error) if answers_a_question(&error) => Ok(()),
        Err(error) => Err(message_of(&error)),
    }
}

/// The exit status of a command, after saying why it failed.
fn exit_status(done: Result<()>) -> ExitCode {
    let Err(failure) = done else { return ExitCode::SUCCESS };
    if !matches!(failure, Failure::Interrupted) {
        report_error(&failure.to_string());
    }
    failure.exit_status().into()
}

/// Answers wrong usage with status 2, and `--help` and `--version`, which clap also calls errors,
/// with 0.
fn refuse(error: &clap::Error) -> ExitCode {
    if answers_a_question(error) {
        return exit_status(print_line(error.to_string().trim_end()));
    }
    report_error(&message_of(error));
    WRONG_USAGE.into()
}

/// Holds for `--help` and `--version`.
fn answers_a_question(error: &clap::Error) -> bool {
    matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion)
}

/// The message of wrong usage: clap's, without the paragraphs of usage and the pointer to --help.
fn message_of(error: &clap::Error) -> String {
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
    message.strip_prefix("error: ").unwrap_or(&message).to_owned()
}
