//! A diagnosis as files: JSON, text and one page of pictures.

use super::report::{EXAMPLES, Report, example};
use crate::artist::{Artist, BEAUTY, Line, Size};
use crate::cli::failure::{Failure, Result};
use crate::files;
use crate::images;
use core::fmt::Write as _;
use lpr_core::diagnose::{Cause, Failure as FailedEpisode, Ranking};
use lpr_core::glamx::{Pose3, Vec3};
use std::collections::BTreeMap;
use std::path::Path;

/// Size of a picture of a failed episode.
const PICTURE: Size = Size { width: 400, height: 300 };
/// Colours of the pose and the path that were chosen, and of the demonstrator's pose.
const CHOSEN: [u8; 3] = [225, 60, 45];
const PATH: [u8; 3] = [240, 160, 40];
const TRUTH: [u8; 3] = [40, 165, 75];

/// Writes `diagnosis.json`, `diagnosis.txt`, `index.html` and the pictures that it shows into the
/// new directory `out`.
pub(super) fn write(report: &Report, out: &Path) -> Result<()> {
    files::write_directory_atomically::<Failure>(out, |inside| {
        files::write_json(&inside.join("diagnosis.json"), report)?;
        let text = report.to_string();
        write_text(&inside.join("diagnosis.txt"), &text)?;
        let pictures = draw_failures(report, inside)?;
        Ok(write_text(&inside.join("index.html"), &page(report, &text, &pictures))?)
    })
}

fn write_text(path: &Path, text: &str) -> Result<(), files::FileError> {
    files::write_atomically(path, |file| file.write_all(text.as_bytes()))
}

/// A picture and the words under it.
struct Drawn {
    cause: Cause,
    name: String,
    caption: String,
}

/// The first failed episodes of every cause.
fn draw_failures(report: &Report, directory: &Path) -> Result<Vec<Drawn>> {
    let mut of_cause: BTreeMap<Cause, usize> = BTreeMap::new();
    let mut drawn = Vec::new();
    let mut artist = Artist::quick(BEAUTY, PICTURE);
    for failure in &report.diagnosis.failures {
        let n = of_cause.entry(failure.cause).or_default();
        *n += 1;
        if *n > EXAMPLES {
            continue;
        }
        let name = format!("{}-{n}.png", failure.cause.name().replace('_', "-"));
        let picture = draw(&mut artist, failure)?;
        let (width, height) = (PICTURE.width.into(), PICTURE.height.into());
        images::write_png(&directory.join(&name), width, height, &picture)?;
        drawn.push(Drawn { cause: failure.cause, name, caption: example(failure) });
    }
    drawn.sort_by_key(|one| (core::cmp::Reverse(of_cause[&one.cause]), one.cause));
    Ok(drawn)
}

/// The world before the step, the path, and the poses as they were chosen and demonstrated.
fn draw(artist: &mut Artist<'_>, failure: &FailedEpisode) -> Result<Vec<[u8; 3]>> {
    let world = failure.before.world();
    let path = failure.path.iter().map(|path| Line::of(world.robot(), path, PATH, 1.5));
    let truth = failure.truth.iter().flat_map(|truth| hand(&truth.pose, TRUTH));
    let chosen = hand(&failure.chosen.pose, CHOSEN);
    let lines: Vec<_> = path.chain(truth).chain(chosen).collect();
    Ok(artist.draw(world, &lines)?.rgb)
}

/// A hand at `pose`: its approach, and the two fingers.
fn hand(pose: &Pose3, rgb: [u8; 3]) -> [Line; 2] {
    /// Length of the approach and of the fingers, and half of their distance, metres.
    const HAND: [f32; 3] = [0.14, 0.05, 0.05];
    let [approach, finger, half] = HAND;
    let at = |y: f32, z: f32| *pose * Vec3::new(0.0, y, z);
    let fingers = vec![at(-half, 0.0), at(-half, -finger), at(half, -finger), at(half, 0.0)];
    let line = |points| Line::through(points, rgb, 3.0);
    [line(vec![at(0.0, -approach), at(0.0, -finger)]), line(fingers)]
}

fn page(report: &Report, text: &str, pictures: &[Drawn]) -> String {
    let headline = escaped(&report.headline());
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{headline}</title>\n<style>{STYLE}</style>\n<h1>{headline}</h1>\n"
    );
    let last = report.diagnosis.rankings.last().filter(|ranking| !ranking.reliability.is_empty());
    let _ = writeln!(html, "<pre>{}</pre>", escaped(text.split_once('\n').map_or("", |it| it.1)));
    if let Some(ranking) = last {
        let _ = writeln!(
            html,
            "<h2>Value of a path against what came of it</h2>\n<figure>{}<figcaption>Candidates of the last keyframes, by their value. On the diagonal, a value is the chance of success. The area of a point is the number of candidates.</figcaption></figure>",
            reliability(ranking)
        );
    }
    let mut cause = None;
    for Drawn { cause: of, name, caption } in pictures {
        if cause != Some(*of) {
            let close = if cause.is_some() { "</div>\n" } else { "" };
            let _ = writeln!(html, "{close}<h2>{}</h2>\n<div class=\"row\">", of.text());
            cause = Some(*of);
        }
        let caption = escaped(caption);
        let _ = writeln!(
            html,
            "<figure><img src=\"{name}\" alt=\"{caption}\" width=\"{}\" height=\"{}\"><figcaption>{caption}</figcaption></figure>",
            PICTURE.width, PICTURE.height
        );
    }
    if cause.is_some() {
        html.push_str("</div>\n<p>The world before the first step that went wrong. <b class=\"chosen\">Red</b>: the pose that was chosen. <b class=\"truth\">Green</b>: the demonstrator's. <b class=\"path\">Orange</b>: the path that ran.</p>\n");
    }
    html
}

const STYLE: &str = "\
body{font:15px/1.45 system-ui,sans-serif;max-width:84rem;margin:2rem auto;padding:0 1rem;color:#222}\
h1{font-size:1.2rem}h2{font-size:1.05rem;margin:1.6rem 0 .4rem}\
pre{font:13px/1.4 ui-monospace,monospace;white-space:pre-wrap;background:#f6f6f4;padding:1rem}\
.row{display:flex;flex-wrap:wrap;gap:1rem}figure{margin:0;max-width:25rem}figcaption{font-size:.85rem;color:#555}\
.chosen{color:#e13c2d}.truth{color:#28a54b}.path{color:#c77a10}";

/// The reliability diagram as SVG.
fn reliability(ranking: &Ranking) -> String {
    /// Side of the diagram and its margin, pixels.
    const SIDE: f64 = 260.0;
    const MARGIN: f64 = 34.0;
    let x = |value: f64| MARGIN + SIDE * value;
    let y = |value: f64| 14.0 + SIDE * (1.0 - value);
    let most = ranking.reliability.iter().map(|bin| bin.candidates).max().unwrap_or(1) as f64;
    let mut svg = format!(
        "<svg width=\"{0}\" height=\"{1}\" viewBox=\"0 0 {0} {1}\" role=\"img\"><title>Reliability of the ranker's values</title>",
        SIDE + MARGIN + 12.0,
        SIDE + 52.0
    );
    let _ = write!(
        svg,
        "<rect x=\"{}\" y=\"{}\" width=\"{SIDE}\" height=\"{SIDE}\" fill=\"none\" stroke=\"#bbb\"/><line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"#bbb\" stroke-dasharray=\"4 4\"/>",
        x(0.0),
        y(1.0),
        x(0.0),
        y(0.0),
        x(1.0),
        y(1.0)
    );
    for tick in [0.0, 0.5, 1.0] {
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{}\" font-size=\"12\" text-anchor=\"middle\">{tick}</text><text x=\"{}\" y=\"{}\" font-size=\"12\" text-anchor=\"end\">{tick}</text>",
            x(tick),
            y(0.0) + 16.0,
            x(0.0) - 5.0,
            y(tick) + 4.0
        );
    }
    for bin in &ranking.reliability {
        let radius = 2.0 + 9.0 * (bin.candidates as f64 / most).sqrt();
        let _ = write!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\" fill=\"#2b6cb0\" fill-opacity=\"0.65\"><title>{} candidates: mean value {:.2}, {:.0} % succeed</title></circle>",
            x(bin.value.clamp(0.0, 1.0)),
            y(bin.successes),
            bin.candidates,
            bin.value,
            100.0 * bin.successes
        );
    }
    let _ = write!(
        svg,
        "<text x=\"{}\" y=\"{}\" font-size=\"12\" text-anchor=\"middle\">value</text></svg>",
        x(0.5),
        y(0.0) + 32.0
    );
    svg
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
