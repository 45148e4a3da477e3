//! An episode as an animation: what each step chose among, then what it did.

use crate::artist::{Artist, Line};
use crate::episode::{EpisodeFile, EpisodeStep};
use crate::images::Shown;
use lpr_core::Result;
use lpr_core::env::Environment as _;
use lpr_core::robot::Robot;
use lpr_core::sim::World;
use lpr_core::sim::render::{Picture, value_color};
use std::sync::Arc;

/// Time that the candidates of a step are shown, milliseconds.
const CANDIDATES_MS: u32 = 2000;
/// Time that the end is shown, milliseconds.
const END_MS: u32 = 1500;
/// Time between two pictures of an execution, milliseconds.
const PERIOD_MS: u32 = 100;
/// Control steps from one picture of an execution to the next: 50 ms each, so that it runs at twice
/// its speed.
const CONTROL_STEPS: usize = 4;

const INK: [u8; 3] = [38, 42, 50];
const DONE_RGB: [u8; 3] = [15, 120, 60];
const FAILED_RGB: [u8; 3] = [190, 50, 45];
/// Around the chosen path.
const HALO_RGB: [u8; 3] = [250, 250, 250];
/// Of paths that nothing values.
const UNVALUED_RGB: [u8; 3] = [70, 110, 170];

/// Meaning of the colours of a step's candidates: its lowest value is dark, its highest bright.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ValueScale {
    low: f32,
    high: f32,
}

impl ValueScale {
    /// None when nothing was valued.
    fn of(step: &EpisodeStep) -> Option<Self> {
        let values = step.candidates.iter().filter_map(|candidate| candidate.value);
        values.fold(None, |scale: Option<Self>, value| {
            let Self { low, high } = scale.unwrap_or(Self { low: value, high: value });
            Some(Self { low: low.min(value), high: high.max(value) })
        })
    }

    fn color(self, value: f32) -> [u8; 3] {
        let range = self.high - self.low;
        value_color(if range > 0.0 { (value - self.low) / range } else { 0.5 })
    }
}

/// The episode as `artist` draws it.
///
/// # Errors
///
/// When the scene cannot be built or drawn.
pub fn episode(episode: &EpisodeFile, artist: &mut Artist<'_>) -> Result<Vec<Shown>> {
    let mut environment = episode.start()?;
    let robot = &Arc::clone(environment.robot());
    let mut shown = Vec::new();
    for (idx, step) in episode.steps.iter().enumerate() {
        let title = format!("step {} of {}", idx + 1, episode.steps.len());
        let candidates = draw_candidates(artist, environment.world(), robot, step, &title)?;
        shown.push(Shown { pixels: candidates.rgb, millis: CANDIDATES_MS });
        let Some(path) = step.chosen_path()? else { continue };
        let mut worlds = Vec::new();
        environment.step_recorded(&path, step.gripper, |world| worlds.push(world.clone()));
        let chosen = chosen_line(robot, step)?;
        let caption = [(title, INK), (chosen_text(step), INK)];
        // The last world is always among them.
        let first = worlds.len().saturating_sub(1) % CONTROL_STEPS;
        for world in worlds.iter().skip(first).step_by(CONTROL_STEPS) {
            let mut picture = artist.draw(world, chosen.as_slice())?;
            artist.write(&mut picture, &caption);
            shown.push(Shown { pixels: picture.rgb, millis: PERIOD_MS });
        }
    }
    let mut picture = artist.draw(environment.world(), &[])?;
    artist.write(&mut picture, &[outcome(episode)]);
    shown.push(Shown { pixels: picture.rgb, millis: END_MS });
    Ok(shown)
}

/// The candidates in the colours of their values, best last, and the chosen one over them.
fn draw_candidates(
    artist: &mut Artist<'_>,
    world: &World,
    robot: &Robot,
    step: &EpisodeStep,
    title: &str,
) -> Result<Picture> {
    let scale = ValueScale::of(step);
    let mut others: Vec<_> =
        step.candidates.iter().filter(|candidate| candidate.q.is_some()).collect();
    others.sort_by(|a, b| a.value.partial_cmp(&b.value).unwrap_or(core::cmp::Ordering::Equal));
    let mut lines = Vec::new();
    for candidate in &others {
        let Some(path) = candidate.path()? else { continue };
        lines.push(Line::of(robot, &path, color(scale, candidate.value), 0.8));
    }
    if let Some(chosen) = chosen_line(robot, step)? {
        lines.extend([chosen.restyled(INK, 5.0), chosen.restyled(HALO_RGB, 3.6), chosen]);
    }
    let mut picture = artist.draw(world, &lines)?;
    let mut caption = vec![
        (title.to_owned(), INK),
        (format!("{} candidates", others.len()), INK),
        (chosen_text(step), INK),
    ];
    if let Some(ValueScale { low, high }) = scale {
        caption.push((format!("values {low:.2} to {high:.2}"), INK));
        let top = artist.write(&mut picture, &caption);
        artist.draw_bar(&mut picture, top, value_color);
    } else {
        artist.write(&mut picture, &caption);
    }
    Ok(picture)
}

fn color(scale: Option<ValueScale>, value: Option<f32>) -> [u8; 3] {
    scale.zip(value).map_or(UNVALUED_RGB, |(scale, value)| scale.color(value))
}

fn chosen_line(robot: &Robot, step: &EpisodeStep) -> Result<Option<Line>> {
    let Some(path) = step.chosen_path()? else { return Ok(None) };
    let value = step.chosen.and_then(|chosen| step.candidates[chosen].value);
    Ok(Some(Line::of(robot, &path, color(ValueScale::of(step), value), 2.2)))
}

fn chosen_text(step: &EpisodeStep) -> String {
    let Some(chosen) = step.chosen.and_then(|chosen| step.candidates.get(chosen)) else {
        return "no path reaches the pose".to_owned();
    };
    chosen.value.map_or_else(
        || chosen.source.clone(),
        |value| format!("{}, value {value:.2}", chosen.source),
    )
}

fn outcome(episode: &EpisodeFile) -> (String, [u8; 3]) {
    match episode.steps.last() {
        Some(last) if last.reward > 0.0 => ("done".to_owned(), DONE_RGB),
        Some(EpisodeStep { invalid: Some(invalid), .. }) => {
            (format!("failed: {}", invalid.replace('_', " ")), FAILED_RGB)
        }
        _ => ("not done".to_owned(), FAILED_RGB),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artist::{BEAUTY, Size};
    use crate::episode::tests::episode as recorded;

    #[test]
    fn every_step_shows_its_candidates_before_it_runs() {
        let mut file = recorded("reach_target", 3);
        let size = Size { width: 64, height: 48 };
        let n_candidates = file.steps[0].candidates.len();
        for (idx, candidate) in file.steps[0].candidates.iter_mut().enumerate() {
            candidate.value = candidate.q.as_ref().map(|_| idx as f32 / n_candidates as f32);
        }
        let shown = episode(&file, &mut Artist::quick(BEAUTY, size)).unwrap();
        let still: Vec<_> = shown
            .iter()
            .filter(|picture| picture.millis != PERIOD_MS)
            .map(|picture| picture.millis)
            .collect();
        let mut expected = vec![CANDIDATES_MS; file.steps.len()];
        expected.push(END_MS);
        assert_eq!(still, expected);
        assert!(shown.len() > 5 && shown.iter().all(|picture| picture.pixels.len() == 64 * 48));
    }

    #[test]
    fn colours_span_the_values_of_the_step() {
        let scale = ValueScale { low: 0.2, high: 0.6 };
        assert_eq!([scale.color(0.2), scale.color(0.6)], [value_color(0.0), value_color(1.0)]);
        let flat = ValueScale { low: 0.2, high: 0.2 };
        assert_eq!(flat.color(0.2), value_color(0.5));
        assert_eq!(color(None, Some(0.3)), UNVALUED_RGB);
    }
}
