//! `lpr plan --timed`: the fastest motion along every path found, with the names that a ROS
//! `trajectory_msgs/JointTrajectory` has.

use crate::cli::failure::Result;
use crate::files;
use lpr_core::path::{
    JointPath, JointState, MotionLimits, SmoothPath, Trajectory, free_curve, time_optimal,
};
use lpr_core::robot::{MAX_JOINTS, Robot};
use lpr_core::scene::MotionChecker;
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub(super) struct TimedArguments {
    /// Write the fastest motion along every path into this folder: as a ROS `JointTrajectory` in
    /// JSON, and as CSV
    #[arg(long, value_name = "DIR")]
    pub(super) timed: Option<PathBuf>,
    /// Acceleration of the joints whose limit is not known, rad/s² or m/s²
    #[arg(long, value_name = "A", default_value_t = 5.0, requires = "timed", value_parser = acceleration)]
    acceleration: f32,
    /// Time between two points of a trajectory, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.01, requires = "timed", value_parser = period)]
    period: f32,
}

fn acceleration(text: &str) -> Result<f32, String> {
    super::within(text, 1e-3, 1e4)
}

fn period(text: &str) -> Result<f32, String> {
    super::within(text, 1e-4, 10.0)
}

/// A trajectory of a problem, and the name of its files without extension.
#[derive(Debug)]
pub(super) struct TimedFile {
    pub(super) name: String,
    trajectory: Trajectory<MAX_JOINTS>,
}

impl TimedFile {
    /// Seconds from start to goal.
    pub(super) fn duration_secs(&self) -> f64 {
        self.trajectory.duration_secs()
    }
}

impl TimedArguments {
    /// The fastest motion along `path`; none if every curve along it touches something.
    pub(super) fn time(
        &self,
        name: String,
        robot: &Robot,
        path: &JointPath,
        checker: &MotionChecker<'_>,
    ) -> Result<Option<TimedFile>> {
        let Some(curve) = free_curve::<MAX_JOINTS>(path, checker) else {
            return Ok(None);
        };
        // Joints that there are not stay where they are.
        let (mut velocity, mut acceleration) = ([1.0; MAX_JOINTS], [1.0; MAX_JOINTS]);
        for (j, joint) in robot.joints.iter().enumerate() {
            velocity[j] = f64::from(joint.max_velocity);
            let known = Some(joint.max_acceleration).filter(|limit| limit.is_finite());
            acceleration[j] = f64::from(known.unwrap_or(self.acceleration));
        }
        let limits = MotionLimits { velocity, acceleration, jerk: None };
        let trajectory = time_optimal(&curve as &SmoothPath<MAX_JOINTS>, &limits, None)?;
        Ok(Some(TimedFile { name, trajectory }))
    }

    /// Writes all files, or none.
    pub(super) fn write(&self, robot: &Robot, files: &[TimedFile]) -> Result<()> {
        let Some(folder) = &self.timed else {
            return Ok(());
        };
        files::write_directory_atomically(folder, |folder| {
            files.iter().try_for_each(|file| self.write_both(folder, robot, file))
        })
    }

    fn write_both(&self, folder: &Path, robot: &Robot, file: &TimedFile) -> Result<()> {
        let points: Vec<(f64, JointState<MAX_JOINTS>)> =
            file.trajectory.samples(f64::from(self.period))?.collect();
        let joint_names: Vec<&str> = robot.joints.iter().map(|joint| &*joint.name).collect();
        let path = |extension: &str| folder.join(format!("{}.{extension}", file.name));
        let csv = path("csv");
        files::write_atomically(&csv, |out| write_csv(out, &joint_names, &points))?;
        let points = points.iter().map(|(t, state)| Point::new(*t, state, joint_names.len()));
        let json = JointTrajectory {
            header: Header { stamp: Time { sec: 0, nanosec: 0 }, frame_id: "" },
            points: points.collect(),
            joint_names,
        };
        Ok(files::write_json(&path("json"), &json)?)
    }
}

/// Name of the files of a problem: its index, and its name as far as file systems take it.
pub(super) fn file_name(idx: usize, name: &str) -> String {
    /// Longest name, characters.
    const LONGEST: usize = 80;
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-._".contains(c) { c } else { '_' };
    format!("{idx:04}_{}", name.chars().take(LONGEST).map(plain).collect::<String>())
}

/// A `trajectory_msgs/JointTrajectory`.
#[derive(Serialize)]
struct JointTrajectory<'a> {
    header: Header,
    joint_names: Vec<&'a str>,
    points: Vec<Point>,
}

#[derive(Serialize)]
struct Header {
    stamp: Time,
    frame_id: &'static str,
}

#[derive(Serialize)]
struct Point {
    positions: Vec<f64>,
    velocities: Vec<f64>,
    accelerations: Vec<f64>,
    effort: [f64; 0],
    time_from_start: Time,
}

#[derive(Serialize)]
struct Time {
    sec: i32,
    nanosec: u32,
}

impl Point {
    fn new(t_secs: f64, state: &JointState<MAX_JOINTS>, dof: usize) -> Self {
        let [positions, velocities, accelerations] = rows(state).map(|row| row[..dof].to_vec());
        let nanos = (t_secs * 1e9).round() as u64;
        let time_from_start =
            Time { sec: (nanos / 1_000_000_000) as i32, nanosec: (nanos % 1_000_000_000) as u32 };
        Self { positions, velocities, accelerations, effort: [], time_from_start }
    }
}

const FIELDS: [&str; 3] = ["positions", "velocities", "accelerations"];

/// In the order of [`FIELDS`].
fn rows(state: &JointState<MAX_JOINTS>) -> [&[f64; MAX_JOINTS]; 3] {
    [&state.angles, &state.velocities, &state.accelerations]
}

fn write_csv(
    out: &mut dyn Write,
    joint_names: &[&str],
    points: &[(f64, JointState<MAX_JOINTS>)],
) -> io::Result<()> {
    write!(out, "time_from_start")?;
    for field in FIELDS {
        for name in joint_names {
            // A name may hold what separates fields.
            write!(out, ",\"{field}.{}\"", name.replace('"', "\"\""))?;
        }
    }
    writeln!(out)?;
    for (t, state) in points {
        write!(out, "{t:.9}")?;
        for row in rows(state) {
            row[..joint_names.len()].iter().try_for_each(|value| write!(out, ",{value}"))?;
        }
        writeln!(out)?;
    }
    Ok(())
}
