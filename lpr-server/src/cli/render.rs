//! `lpr render`: a picture of a scene or a demonstration as an animation, with the candidate paths of its keyframes.

use super::{Failure, Result, RobotArgument, TaskArgument, default_preset, paths};
use crate::images;
use core::fmt;
use lpr_core::env::Environment as _;
use lpr_core::glamx::{Pose3, Vec3};
use lpr_core::path::{CandidateStreams, JointPath, Source};
use lpr_core::perception::{CAMERA_NAMES, Camera};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::Robot;
use lpr_core::sim::feasibility::{KeyframeSnapshot, keyframe_snapshots};
use lpr_core::sim::render::{Picture, Renderer, Stroke};
use lpr_core::sim::{SimEnvironment, SimParams, World, demonstrate};
use serde::Serialize;
use std::path::PathBuf;

/// Time between the pictures of an animation, milliseconds.
const GIF_PERIOD_MS: u32 = 100;
/// Samples per pixel along each side.
const SAMPLES: usize = 3;
/// The camera that stands where a visitor would, and is no camera of an agent.
const BEAUTY: &str = "beauty";

const PLANNER_RGB: [u8; 3] = [30, 110, 220];
const BEZIER_RGB: [u8; 3] = [240, 140, 20];
const SUCCESS_RGB: [u8; 3] = [20, 150, 70];
const FAILURE_RGB: [u8; 3] = [215, 95, 95];
/// Rows of a picture for each pixel of a line's width, and of a letter's dots.
const ROWS_PER_DOT: f32 = 240.0;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    task: TaskArgument,
    #[command(flatten)]
    robot: RobotArgument,
    /// Seed of the scene
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[arg(long, value_name = "NAME", default_value = "front", value_parser = parse_camera, help = camera_help())]
    camera: String,
    /// Width and height, pixels [default: 640x480, of an animation 320x240]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Draw the whole scripted demonstration as an animated GIF
    #[arg(long)]
    demo: bool,
    /// Draw the grip's way along every candidate path, coloured by generator or by what its execution gave
    #[arg(long, value_name = "COLOURS", num_args = 0..=1, default_missing_value = "source")]
    candidates: Option<Colours>,
    /// Draw the scene before this keyframe of the demonstration, counted from 0
    #[arg(long, value_name = "K", default_value_t = 0, conflicts_with = "demo")]
    keyframe: usize,
    /// The file to write: .png, or .gif with --demo
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// What the colour of a candidate's line says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Colours {
    /// Which generator made it.
    Source,
    /// Whether it does what the demonstrator did, executed from a snapshot.
    Outcome,
}

#[derive(Debug, Clone, Copy)]
struct Size {
    width: u16,
    height: u16,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    file: PathBuf,
    width: u16,
    height: u16,
    /// Pictures of an animation.
    #[serde(skip_serializing_if = "Option::is_none")]
    frames: Option<usize>,
}

fn camera_help() -> String {
    format!("Camera: {} or {BEAUTY}", CAMERA_NAMES.join(", "))
}

fn parse_camera(name: &str) -> Result<String, String> {
    if name == BEAUTY || CAMERA_NAMES.contains(&name) {
        return Ok(name.to_owned());
    }
    Err(format!("unknown camera '{name}', known: {}, {BEAUTY}", CAMERA_NAMES.join(", ")))
}

fn parse_size(text: &str) -> Result<Size, String> {
    let side = |text: &str| text.parse().ok().filter(|side| (16..=4096).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| side(width).zip(side(height)));
    sides.map(|(width, height)| Size { width, height }).ok_or_else(|| "expected WIDTHxHEIGHT, 16 to 4096 each".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let Arguments { task: TaskArgument { task }, robot: RobotArgument { robot }, .. } = arguments;
    paths::check_keyframe(task, arguments.keyframe)?;
    let extension = if arguments.demo { "gif" } else { "png" };
    if arguments.out.extension().is_none_or(|found| found != extension) {
        return Err(Failure::Usage(format!("--out {}: expected a name that ends in .{extension}", arguments.out.display())));
    }
    let env = SimEnvironment::new(task, robot, arguments.seed, &["front"], &SimParams::STANDARD)?;
    if arguments.demo { render_demo(arguments, &env) } else { render_scene(arguments, &env) }
}

fn render_scene(arguments: &Arguments, env: &SimEnvironment) -> Result<Report> {
    let size = arguments.size.unwrap_or(Size { width: 640, height: 480 });
    let mut artist = Artist::new(&arguments.camera, size);
    let picture = if arguments.keyframe == 0 && arguments.candidates.is_none() {
        artist.draw(env.world(), &[])?
    } else {
        let snapshot = &snapshots(arguments, env)?[arguments.keyframe];
        artist.draw(snapshot.env.world(), &lines(arguments, snapshot, arguments.keyframe))?
    };
    images::write_png(&arguments.out, size.width.into(), size.height.into(), &picture.rgb)?;
    Ok(Report { file: arguments.out.clone(), width: size.width, height: size.height, frames: None })
}

fn render_demo(arguments: &Arguments, env: &SimEnvironment) -> Result<Report> {
    let size = arguments.size.unwrap_or(Size { width: 320, height: 240 });
    let demo = demonstrate(&mut env.clone(), &mut stream(arguments.seed, Stream::Demo, 0));
    let lines: Vec<_> = match arguments.candidates {
        Some(_) => {
            let snapshots = snapshots(arguments, env)?;
            snapshots.iter().enumerate().map(|(keyframe, snapshot)| lines(arguments, snapshot, keyframe)).collect()
        }
        None => Vec::new(),
    };
    let frames_per_picture = (GIF_PERIOD_MS as f32 / 1000.0 / env.world().params().control_dt).round().max(1.0) as usize;
    let mut artist = Artist::new(&arguments.camera, size);
    let mut pictures = Vec::new();
    for idx in (0..demo.frames.len()).step_by(frames_per_picture) {
        let keyframe = demo.waypoint_frames.partition_point(|&end| end <= idx);
        let lines = lines.get(keyframe).or(lines.last()).map_or(&[][..], Vec::as_slice);
        pictures.push(artist.draw(&demo.frames[idx], lines)?.rgb);
    }
    // The end is shown for a second.
    let last = pictures[pictures.len() - 1].clone();
    pictures.extend(core::iter::repeat_n(last, 1000 / GIF_PERIOD_MS as usize));
    images::write_gif(&arguments.out, size.width, size.height, &pictures, GIF_PERIOD_MS)?;
    Ok(Report { file: arguments.out.clone(), width: size.width, height: size.height, frames: Some(pictures.len()) })
}

fn snapshots(arguments: &Arguments, env: &SimEnvironment) -> Result<Vec<KeyframeSnapshot>> {
    keyframe_snapshots(env, arguments.seed).ok_or_else(|| {
        let message = format!("the demonstration of {} in scene {} fails: choose another seed", env.task().name, arguments.seed);
        lpr_core::Error::Environment(message).into()
    })
}

/// The grip's way along a candidate.
struct Line {
    points: Vec<Vec3>,
    class: &'static Class,
}

/// What the colour of a line says.
#[derive(PartialEq)]
struct Class {
    name: &'static str,
    rgb: [u8; 3],
    /// Relative to that of the others.
    width: f32,
}

static PLANNER: Class = Class { name: "planner", rgb: PLANNER_RGB, width: 1.0 };
static BEZIER: Class = Class { name: "bezier", rgb: BEZIER_RGB, width: 1.0 };
static FAILURE: Class = Class { name: "fail", rgb: FAILURE_RGB, width: 0.7 };
static SUCCESS: Class = Class { name: "succeed", rgb: SUCCESS_RGB, width: 1.5 };

/// The candidates of a keyframe as lines, those that succeed last, so that they lie on top.
fn lines(arguments: &Arguments, snapshot: &KeyframeSnapshot, keyframe: usize) -> Vec<Line> {
    let settings = default_preset().candidates;
    let streams = CandidateStreams { seed: arguments.seed, step: keyframe as u64 };
    let robot = snapshot.env.robot();
    let line = |path: &JointPath, class| Line { points: grip_points(robot, path), class };
    match arguments.candidates {
        None => Vec::new(),
        Some(Colours::Source) => {
            let set = snapshot.candidates(&settings, streams);
            set.candidates.iter().map(|candidate| line(&candidate.path, source_class(candidate.source))).collect()
        }
        Some(Colours::Outcome) => {
            let trials = snapshot.execute_all(&settings, streams);
            let mut outcomes: Vec<_> = trials.set.candidates.iter().zip(&trials.trials).collect();
            outcomes.sort_by_key(|(_, trial)| trial.success);
            let class = |success| if success { &SUCCESS } else { &FAILURE };
            outcomes.into_iter().map(|(candidate, trial)| line(&candidate.path, class(trial.success))).collect()
        }
    }
}

fn source_class(source: Source) -> &'static Class {
    if source == Source::Bezier { &BEZIER } else { &PLANNER }
}

/// Points of the grip along a path, close enough to look curved where the arm's joints make a curve.
fn grip_points(robot: &Robot, path: &JointPath) -> Vec<Vec3> {
    const N_POINTS: usize = 120;
    path.subdivide(N_POINTS).configs().iter().map(|config| robot.grip(config).translation).collect()
}

/// Draws worlds from one camera.
struct Artist<'a> {
    renderer: Renderer,
    camera: &'a str,
    size: Size,
}

impl<'a> Artist<'a> {
    fn new(camera: &'a str, size: Size) -> Self {
        Self { renderer: Renderer::for_pictures(), camera, size }
    }

    fn draw(&mut self, world: &World, lines: &[Line]) -> Result<Picture> {
        let items = SimEnvironment::picture_items(world, &mut self.renderer)?;
        let camera = self.camera(world)?;
        let mut picture = self.renderer.render_picture(&camera, &items, SAMPLES);
        for Line { points, class } in lines {
            let stroke = Stroke { rgb: class.rgb, width: class.width * self.dot(), hidden_opacity: 0.3 };
            picture.draw_polyline(&camera, points, &stroke);
        }
        self.draw_legend(&mut picture, lines);
        Ok(picture)
    }

    /// How many lines there are of each class.
    fn draw_legend(&self, picture: &mut Picture, lines: &[Line]) {
        let scale = self.dot() as usize;
        let margin = 6 * scale as i32;
        let mut top = margin;
        for class in [&PLANNER, &BEZIER, &SUCCESS, &FAILURE] {
            let n = lines.iter().filter(|line| line.class == class).count();
            if n > 0 {
                picture.draw_text([margin, top], &format!("{n} {}", class.name), class.rgb, scale);
                top += 10 * scale as i32;
            }
        }
    }

    /// Width of a line, pixels.
    fn dot(&self) -> f32 {
        (f32::from(self.size.height) / ROWS_PER_DOT).max(1.0)
    }

    fn camera(&self, world: &World) -> Result<Camera> {
        let robot = world.robot();
        let world_from_flange = Pose3::from(robot.flange(world.config()));
        let camera = if self.camera == BEAUTY { beauty(robot) } else { Camera::by_name(self.camera, robot, &world_from_flange)? };
        Ok(camera.with_size(self.size.width.into(), self.size.height.into()))
    }
}

/// A view over the whole arm and the workspace from the front and the side.
fn beauty(robot: &Robot) -> Camera {
    let center = robot.workspace_center.extend(0.0);
    let position = center + Vec3::new(1.03, 1.25, 0.95);
    Camera::looking_at(BEAUTY, position, center + Vec3::new(-0.17, 0.0, 0.36), 37_f32.to_radians())
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, width, height, frames } = self;
        write!(f, "{}: {width} x {height}", file.display())?;
        frames.map_or(Ok(()), |frames| write!(f, ", {frames} pictures"))
    }
}
