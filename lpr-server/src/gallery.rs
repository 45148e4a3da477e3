//! Every task as a picture and as a short animation of its demonstration, and a page that lists
//! them.

use crate::artist::{Artist, Size, view_of};
use crate::files::{self, FileError};
use crate::formats::{TaskList, TaskRow};
use crate::images::{self, Shown};
use crate::moments;
use lpr_core::glamx::Vec3;
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::{ROBOTS, Robot};
use lpr_core::sim::tasks::{TASKS, Task};
use lpr_core::sim::{Demonstration, SimEnvironment, SimParams, demonstrate};
use rayon::prelude::*;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

const PICTURE: Size = Size { width: 320, height: 240 };
const ANIMATION: Size = PICTURE;
/// Control steps from one picture of an animation to the next: 50 ms each, so that it runs at twice
/// its speed.
const CONTROL_STEPS: usize = 4;
/// Time between two pictures of an animation, milliseconds.
const PERIOD_MS: u32 = 100;
/// Time that the end of an animation is shown, milliseconds.
const END_MS: u32 = 2000;
/// The scene shown is the first of these seeds in which the demonstrator succeeds.
const MAX_SEEDS: u64 = 20;

/// A task of the gallery.
#[derive(Debug)]
pub struct Entry {
    /// The task.
    pub row: TaskRow,
    /// Name of the arm that does it.
    pub robot: String,
    /// Seed of the scene.
    pub seed: u64,
}

/// Reason why there is no gallery.
#[derive(Debug, thiserror::Error)]
pub enum GalleryError {
    /// A scene that cannot be placed or drawn.
    #[error(transparent)]
    Core(#[from] lpr_core::Error),
    /// A file that cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A task that the demonstrator cannot do.
    #[error("no demonstration of {0} succeeds in scenes 0 to {last}", last = MAX_SEEDS - 1)]
    NoDemonstration(String),
}

/// Draws `TASK.png` and `TASK.gif` of every task into `directory`; robots take turns.
///
/// # Errors
///
/// When a task cannot be shown or a file cannot be written.
pub fn draw(directory: &Path) -> Result<Vec<Entry>, GalleryError> {
    let rows: Vec<_> = TaskList::all().tasks;
    let robots = ROBOTS.into_iter().cycle();
    let wanted: Vec<_> = TASKS.iter().zip(rows).zip(robots).collect();
    wanted
        .into_par_iter()
        .map(|((task, row), robot)| draw_task(directory, task, row, robot))
        .collect()
}

fn draw_task(
    directory: &Path,
    task: &Arc<Task>,
    row: TaskRow,
    robot: &Arc<Robot>,
) -> Result<Entry, GalleryError> {
    let (seed, demo) = demonstration(task, robot)?;
    let camera = view_of(grasp_direction(&demo));
    let picture = Artist::new(camera, PICTURE).draw(&demo.frames[0], &[])?;
    let path = directory.join(format!("{}.png", task.name));
    images::write_png(&path, PICTURE.width.into(), PICTURE.height.into(), &picture.rgb)?;
    let path = directory.join(format!("{}.gif", task.name));
    images::write_gif_of_changes(
        &path,
        ANIMATION.width,
        ANIMATION.height,
        &animation(&demo, camera)?,
    )?;
    Ok(Entry { row, robot: robot.name.clone(), seed })
}

/// The first demonstration that succeeds, with the seed of its scene.
fn demonstration(
    task: &Arc<Task>,
    robot: &Arc<Robot>,
) -> Result<(u64, Demonstration), GalleryError> {
    for seed in 0..MAX_SEEDS {
        let mut environment =
            SimEnvironment::new(task, robot, seed, &["front"], &SimParams::STANDARD)?;
        let demo = demonstrate(&mut environment, &mut stream(seed, Stream::Demo, 0));
        if demo.success {
            return Ok((seed, demo));
        }
    }
    Err(GalleryError::NoDemonstration(task.name.clone()))
}

/// Direction of the hand when it has reached the second keyframe, which grasps or pushes, or the
/// only one.
fn grasp_direction(demo: &Demonstration) -> Vec3 {
    let frames = &demo.waypoint_frames;
    let world = &demo.frames[frames[frames.len().min(2) - 1]];
    world.robot().grip(world.config()).rotation * Vec3::Z
}

fn animation(demo: &Demonstration, camera: &str) -> lpr_core::Result<Vec<Shown>> {
    let mut artist = Artist::quick(camera, ANIMATION);
    let mut shown = Vec::new();
    for moment in moments::of(demo, CONTROL_STEPS) {
        shown.push(Shown { pixels: artist.draw(&moment.world, &[])?.rgb, millis: PERIOD_MS });
    }
    if let Some(last) = shown.last_mut() {
        last.millis = END_MS;
    }
    Ok(shown)
}

/// Writes the page beside the directory of that name in which the pictures are.
///
/// # Errors
///
/// When it cannot be written.
pub fn write_page(path: &Path, directory: &str, entries: &[Entry]) -> files::Result<()> {
    let page = page(directory, entries);
    files::write_atomically(path, |writer| writer.write_all(page.as_bytes()))
}

fn page(directory: &str, entries: &[Entry]) -> String {
    let mut page = "# Gallery\n\n\
        Every task as the scripted demonstrator does it, at twice its speed; `make gallery` draws this page.\n\
        The arms take turns.\n\n\
        | task | scene | demonstration |\n| --- | --- | --- |\n"
        .to_owned();
    for Entry { row: TaskRow { name, set, description, keyframes, variations }, robot, seed } in
        entries
    {
        let picture = |extension: &str| format!("![{name}]({directory}/{name}.{extension})");
        let plural = if *keyframes == 1 { "" } else { "s" };
        let set = if *set == "extra" { "Further task".to_owned() } else { format!("Set {set}") };
        let others = match variations.len() {
            0 => String::new(),
            n => format!(", {n} variations"),
        };
        let about = format!(
            "{description}<br>{set}, {keyframes} keyframe{plural}{others}; {robot}, scene {seed}."
        );
        writeln!(page, "| `{name}`<br>{about} | {} | {} |", picture("png"), picture("gif"))
            .expect("a string takes any text");
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_lists_every_task_with_its_pictures() {
        let rows = TaskList::all().tasks.into_iter().zip(0..);
        let entries: Vec<_> =
            rows.map(|(row, seed)| Entry { row, robot: "panda".to_owned(), seed }).collect();
        let page = page("shots", &entries);
        for task in TASKS.iter() {
            assert!(
                page.contains(&format!("](shots/{}.png)", task.name))
                    && page.contains(&task.describe(0))
            );
            assert!(page.contains(&format!("](shots/{}.gif)", task.name)));
        }
        assert!(
            page.contains("1 keyframe, 7 variations; panda, scene 0.")
                && page.contains("4 keyframes; panda, scene 3.")
        );
    }

    #[test]
    fn the_same_task_is_drawn_as_the_same_bytes_with_its_end_last() {
        let drawn = || {
            let directory = tempfile::tempdir().unwrap();
            let row = TaskList::all().tasks.remove(0);
            let entry = draw_task(directory.path(), &TASKS[0], row, ROBOTS[0]).unwrap();
            assert_eq!((entry.robot, entry.seed), (ROBOTS[0].name.clone(), 0));
            ["png", "gif"].map(|extension| {
                std::fs::read(directory.path().join(format!("{}.{extension}", TASKS[0].name)))
                    .unwrap()
            })
        };
        let [picture, animation] = drawn();
        assert_eq!(drawn(), [picture.clone(), animation.clone()]);
        assert!(
            picture.len() < 150_000 && animation.len() < 300_000,
            "{} and {}",
            picture.len(),
            animation.len()
        );
    }
}
