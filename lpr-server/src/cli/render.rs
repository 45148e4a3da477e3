//! `lpr render`: a picture of a scene, or what the camera of an agent sees of it; a demonstration
//! or an episode as an animation, with its candidate paths.

mod seen;

use super::arguments::RobotArgument;
use super::failure::{Failure, Result};
use super::paths;
use super::settings::default_preset;
use crate::animation;
use crate::artist::{Artist, BEAUTY, Line, Size};
use crate::episode::EpisodeFile;
use crate::images::{self, Shown};
use crate::moments::{self, Moment};
use crate::scene_file::SceneFile;
use core::fmt;
use lpr_core::env::Environment as _;
use lpr_core::path::{CandidateStreams, JointPath, Source};
use lpr_core::perception::{CAMERA_NAMES, DepthNoise, IMAGE_SIZE};
use lpr_core::rng::{Stream, stream};
use lpr_core::sim::feasibility::{KeyframeSnapshot, keyframe_snapshots};
use lpr_core::sim::render::Picture;
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{Randomization, Sensing, SimEnvironment, SimParams, World, demonstrate};
use seen::{Legend, Show};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;

/// Time between the pictures of an animation, milliseconds.
const GIF_PERIOD_MS: u32 = 100;
/// Time that the end of an animation is shown, milliseconds.
const END_MS: u32 = 1000;
const ANIMATION_SIZE: Size = Size { width: 320, height: 240 };
const PLANNER_RGB: [u8; 3] = [30, 110, 220];
const BEZIER_RGB: [u8; 3] = [240, 140, 20];
const SUCCESS_RGB: [u8; 3] = [20, 150, 70];
const FAILURE_RGB: [u8; 3] = [215, 95, 95];

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The task, one of `lpr tasks`
    #[arg(value_name = "TASK", value_parser = Task::by_name, required_unless_present_any = ["episode", "scene"])]
    task: Option<Arc<Task>>,
    /// Draw a recorded episode as an animated GIF: the candidates of each step coloured by value,
    /// then what ran
    #[arg(long, value_name = "FILE", conflicts_with_all = ["task", "robot", "seed", "demo", "candidates", "keyframe"])]
    episode: Option<PathBuf>,
    /// Draw the scene of a file that `lpr scene` wrote
    #[arg(long, value_name = "FILE", conflicts_with_all = ["task", "episode", "robot", "seed", "demo", "candidates", "keyframe"])]
    scene: Option<PathBuf>,
    #[command(flatten)]
    robot: RobotArgument,
    /// Seed of the scene
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[arg(long, value_name = "NAME", value_parser = parse_camera, help = camera_help())]
    camera: Option<String>,
    /// Draw what an agent's camera sees instead of a picture for people
    #[arg(long, value_name = "CHANNEL", conflicts_with_all = ["episode", "demo", "candidates"])]
    show: Option<Show>,
    /// With --show: the noise, holes and mixed pixels of a depth camera
    #[arg(long, requires = "show")]
    noise: bool,
    /// With --show: other colours, another light, and a camera that stands a little elsewhere
    #[arg(long, requires = "show")]
    randomize: bool,
    /// Width and height, pixels [default: 640x480, of an animation 320x240, with --show 128x128]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Draw the whole scripted demonstration as an animated GIF
    #[arg(long)]
    demo: bool,
    /// Draw the grip's way along every candidate path, coloured by generator or by what its
    /// execution gave
    #[arg(long, value_name = "COLOURS", num_args = 0..=1, default_missing_value = "source")]
    candidates: Option<Colours>,
    /// Draw the scene before this keyframe of the demonstration, counted from 0
    #[arg(long, value_name = "K", default_value_t = 0, conflicts_with = "demo")]
    keyframe: usize,
    /// The file to write: .png, or .gif with --demo and --episode
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// The meaning of the colour of a candidate's line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Colours {
    /// Which generator made it.
    Source,
    /// It does the same as the demonstrator, executed from a snapshot.
    Outcome,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    file: PathBuf,
    width: u16,
    height: u16,
    /// Pictures of an animation.
    #[serde(skip_serializing_if = "Option::is_none")]
    frames: Option<usize>,
    /// With --show.
    #[serde(flatten)]
    legend: Option<Legend>,
}

fn camera_help() -> String {
    format!(
        "Camera: {} or {BEAUTY} [default: front, of an episode {BEAUTY}]",
        CAMERA_NAMES.join(", ")
    )
}

fn parse_camera(name: &str) -> Result<String, String> {
    if name == BEAUTY || CAMERA_NAMES.contains(&name) {
        return Ok(name.to_owned());
    }
    Err(format!("camera: expected one of {}, {BEAUTY}, found '{name}'", CAMERA_NAMES.join(", ")))
}

fn parse_size(text: &str) -> Result<Size, String> {
    let side = |text: &str| text.parse().ok().filter(|side| (16..=4096).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| side(width).zip(side(height)));
    sides
        .map(|(width, height)| Size { width, height })
        .ok_or_else(|| "expected WIDTHxHEIGHT, 16 to 4096 each".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<Report> {
    let is_animation = arguments.demo || arguments.episode.is_some();
    let extension = if is_animation { "gif" } else { "png" };
    if arguments.out.extension().is_none_or(|found| found != extension) {
        return Err(Failure::Usage(format!(
            "--out {}: expected a name that ends in .{extension}",
            arguments.out.display()
        )));
    }
    if let Some(episode) = &arguments.episode {
        return render_episode(arguments, &EpisodeFile::read(episode)?);
    }
    let mut env = start(arguments)?;
    match arguments.show {
        Some(show) => render_seen(arguments, &mut env, show),
        None if arguments.demo => render_demo(arguments, &env),
        None => render_scene(arguments, &env),
    }
}

/// The scene that is asked for, at its start.
fn start(arguments: &Arguments) -> Result<SimEnvironment> {
    if let Some(scene) = &arguments.scene {
        return Ok(SceneFile::read(scene)?.start()?);
    }
    let Some(task) = &arguments.task else {
        return Err(Failure::Usage("expected a task, --scene FILE or --episode FILE".to_owned()));
    };
    paths::check_keyframe(task, arguments.keyframe)?;
    Ok(SimEnvironment::new(
        task,
        &arguments.robot.robot,
        arguments.seed,
        &["front"],
        &SimParams::STANDARD,
    )?)
}

fn render_episode(arguments: &Arguments, episode: &EpisodeFile) -> Result<Report> {
    let size = arguments.size.unwrap_or(ANIMATION_SIZE);
    let mut artist = Artist::new(arguments.camera.as_deref().unwrap_or(BEAUTY), size);
    let pictures = animation::episode(episode, &mut artist)?;
    written_gif(arguments, size, &pictures)
}

fn written_gif(arguments: &Arguments, size: Size, pictures: &[Shown]) -> Result<Report> {
    images::write_gif(&arguments.out, size.width, size.height, pictures)?;
    Ok(Report {
        file: arguments.out.clone(),
        width: size.width,
        height: size.height,
        frames: Some(pictures.len()),
        legend: None,
    })
}

fn render_scene(arguments: &Arguments, env: &SimEnvironment) -> Result<Report> {
    let size = arguments.size.unwrap_or(Size { width: 640, height: 480 });
    let mut artist = Artist::new(arguments.camera.as_deref().unwrap_or(CAMERA_NAMES[0]), size);
    let picture = if arguments.keyframe == 0 && arguments.candidates.is_none() {
        artist.draw(env.world(), &[])?
    } else {
        let snapshot = &snapshots(arguments, env)?[arguments.keyframe];
        draw(&mut artist, snapshot.env.world(), &lines(arguments, snapshot, arguments.keyframe))?
    };
    written_png(arguments, size, &picture.rgb, None)
}

fn render_seen(arguments: &Arguments, env: &mut SimEnvironment, show: Show) -> Result<Report> {
    let side = IMAGE_SIZE as u16;
    let size = arguments.size.unwrap_or(Size { width: side, height: side });
    let camera = arguments.camera.as_deref().unwrap_or(CAMERA_NAMES[0]);
    if camera == BEAUTY {
        return Err(Failure::Usage(format!(
            "--camera {BEAUTY}: is no camera of an agent, expected one of {}",
            CAMERA_NAMES.join(", ")
        )));
    }
    if arguments.keyframe > 0 {
        *env = snapshots(arguments, env)?.remove(arguments.keyframe).env;
    }
    let noise = if arguments.noise { DepthNoise::STRUCTURED_LIGHT } else { DepthNoise::OFF };
    let randomization =
        if arguments.randomize { Randomization::MODERATE } else { Randomization::OFF };
    env.set_sensing(Sensing { noise, randomization }, arguments.seed);
    let (pixels, legend) = seen::draw(env, show, camera, [size.width.into(), size.height.into()])?;
    written_png(arguments, size, &pixels, legend)
}

fn written_png(
    arguments: &Arguments,
    size: Size,
    pixels: &[[u8; 3]],
    legend: Option<Legend>,
) -> Result<Report> {
    images::write_png(&arguments.out, size.width.into(), size.height.into(), pixels)?;
    Ok(Report {
        file: arguments.out.clone(),
        width: size.width,
        height: size.height,
        frames: None,
        legend,
    })
}

fn render_demo(arguments: &Arguments, env: &SimEnvironment) -> Result<Report> {
    let size = arguments.size.unwrap_or(ANIMATION_SIZE);
    let demo = demonstrate(&mut env.clone(), &mut stream(arguments.seed, Stream::Demo, 0));
    let lines: Vec<_> = match arguments.candidates {
        Some(_) => {
            let snapshots = snapshots(arguments, env)?;
            snapshots
                .iter()
                .enumerate()
                .map(|(keyframe, snapshot)| lines(arguments, snapshot, keyframe))
                .collect()
        }
        None => Vec::new(),
    };
    let frames_per_picture =
        (GIF_PERIOD_MS as f32 / 1000.0 / env.world().params().control_dt).round().max(1.0) as usize;
    let mut artist = Artist::new(arguments.camera.as_deref().unwrap_or(CAMERA_NAMES[0]), size);
    let mut pictures = Vec::new();
    for Moment { frame, world } in moments::of(&demo, frames_per_picture) {
        let keyframe = demo.waypoint_frames.partition_point(|&end| end <= frame);
        let lines = lines.get(keyframe).or(lines.last()).map_or(&[][..], Vec::as_slice);
        pictures
            .push(Shown { pixels: draw(&mut artist, &world, lines)?.rgb, millis: GIF_PERIOD_MS });
    }
    if let Some(last) = pictures.last_mut() {
        last.millis = END_MS;
    }
    written_gif(arguments, size, &pictures)
}

/// The scene with its lines, and how many there are of each class.
fn draw(
    artist: &mut Artist<'_>,
    world: &World,
    lines: &[(Line, &'static Class)],
) -> Result<Picture> {
    let drawn: Vec<_> = lines.iter().map(|(line, _)| line.clone()).collect();
    let mut picture = artist.draw(world, &drawn)?;
    let counted = [&PLANNER, &BEZIER, &SUCCESS, &FAILURE].into_iter().filter_map(|class| {
        let n = lines.iter().filter(|(_, other)| *other == class).count();
        (n > 0).then(|| (format!("{n} {}", class.name), class.rgb))
    });
    artist.write(&mut picture, &counted.collect::<Vec<_>>());
    Ok(picture)
}

fn snapshots(arguments: &Arguments, env: &SimEnvironment) -> Result<Vec<KeyframeSnapshot>> {
    keyframe_snapshots(env, arguments.seed).ok_or_else(|| {
        let message = format!(
            "the demonstration of {} in scene {} fails: choose another seed",
            env.task().name,
            arguments.seed
        );
        lpr_core::Error::Environment(message).into()
    })
}

/// The meaning of the colour of a line.
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
fn lines(
    arguments: &Arguments,
    snapshot: &KeyframeSnapshot,
    keyframe: usize,
) -> Vec<(Line, &'static Class)> {
    let settings = default_preset().candidates;
    let streams = CandidateStreams { seed: arguments.seed, step: keyframe as u64 };
    let robot = snapshot.env.robot();
    let line = |path: &JointPath, class: &'static Class| {
        (Line::of(robot, path, class.rgb, class.width), class)
    };
    match arguments.candidates {
        None => Vec::new(),
        Some(Colours::Source) => {
            let set = snapshot.candidates(&settings, streams);
            set.candidates
                .iter()
                .map(|candidate| line(&candidate.path, source_class(candidate.source)))
                .collect()
        }
        Some(Colours::Outcome) => {
            let trials = snapshot.execute_all(&settings, streams);
            let mut outcomes: Vec<_> = trials.set.candidates.iter().zip(&trials.trials).collect();
            outcomes.sort_by_key(|(_, trial)| trial.success);
            let class = |success| if success { &SUCCESS } else { &FAILURE };
            outcomes
                .into_iter()
                .map(|(candidate, trial)| line(&candidate.path, class(trial.success)))
                .collect()
        }
    }
}

fn source_class(source: Source) -> &'static Class {
    if source == Source::Bezier { &BEZIER } else { &PLANNER }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, width, height, frames, legend } = self;
        write!(f, "{}: {width} x {height}", file.display())?;
        frames.map_or(Ok(()), |frames| write!(f, ", {frames} pictures"))?;
        legend.as_ref().map_or(Ok(()), |legend| write!(f, "{legend}"))
    }
}
