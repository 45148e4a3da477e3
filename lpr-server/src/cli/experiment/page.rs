//! The rows of an experiment as Markdown: a table, and a paragraph for each task on what fails.

mod comparison;

use super::row::Row;
use crate::cli::failure::Result;
use crate::files::{self, FileError};
use core::fmt::Write as _;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Findings of a task that are told.
const TOLD: usize = 4;

pub(super) fn markdown(rows: &[Row]) -> core::result::Result<String, String> {
    let mut text = comparison::markdown(rows)?;
    text.push_str(
        "| task | seed | steps | success in 100 test scenes | in the scenes of the diagnosis | with the demonstrator's poses | with the best of all paths | training | commit |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for row in rows.iter().filter(|row| is_diagnosed(row)) {
        let Row { key, commit, training, diagnosis, .. } = row;
        let _ = writeln!(
            text,
            "| {}{} | {} | {} | {} | {} of {} | {} | {} | {:.0} min | {commit} |",
            comparison::task(key),
            comparison::variant(key),
            key.seed,
            key.env_steps,
            success(row.eval()),
            diagnosis["successes"],
            diagnosis["scenes"],
            rung(diagnosis, "true", "ranker"),
            rung(diagnosis, "learned", "best_of_all"),
            training["wall_seconds"].as_f64().unwrap_or(f64::NAN) / 60.0,
        );
    }
    let mut told = BTreeSet::new();
    for row in rows.iter().filter(|row| is_diagnosed(row)) {
        if told.insert(&row.key.task) {
            let _ = writeln!(text, "\n{}", paragraph(row));
        }
    }
    Ok(text)
}

fn is_diagnosed(row: &Row) -> bool {
    !row.diagnosis.is_null()
}

/// `94 (88 to 97)`.
fn success(eval: &Value) -> String {
    let [low, high] = [0, 1].map(|idx| 100.0 * eval["wilson95"][idx].as_f64().unwrap_or(f64::NAN));
    format!("**{}** ({low:.0} to {high:.0})", eval["successes"])
}

fn rung(diagnosis: &Value, poses: &str, paths: &str) -> String {
    let rungs = diagnosis["ladder"].as_array().map_or(&[][..], Vec::as_slice);
    let rung = rungs.iter().find(|rung| rung["poses"] == poses && rung["paths"] == paths);
    rung.map_or("-".to_owned(), |rung| format!("{} of {}", rung["successes"], rung["episodes"]))
}

/// What fails in the first run of a task, in sentences.
fn paragraph(row: &Row) -> String {
    let Row { key, diagnosis, .. } = row;
    let mut text =
        format!("**{}**{}, seed {}.", comparison::task(key), comparison::variant(key), key.seed);
    for keyframe in items(&diagnosis["poses"]["scenes"]) {
        let _ = write!(
            text,
            " Keyframe {}: {:.0} % of the poses right, {:.0} mm and {:.0} degrees off in the median ({:.0} % right on its own demonstrations).",
            keyframe["keyframe"],
            percent(&keyframe["right"]),
            keyframe["position_mm"]["median"].as_f64().unwrap_or(f64::NAN),
            keyframe["rotation_deg"]["median"].as_f64().unwrap_or(f64::NAN),
            items(&diagnosis["poses"]["demonstrations"])
                .iter()
                .find(|other| other["keyframe"] == keyframe["keyframe"])
                .map_or(f64::NAN, |other| percent(&other["right"])),
        );
    }
    for finding in items(&diagnosis["findings"]).iter().take(TOLD) {
        let words = finding["text"].as_str().unwrap_or_default();
        let _ = write!(text, " {}.", capitalised(words));
    }
    text
}

fn items(value: &Value) -> &[Value] {
    value.as_array().map_or(&[][..], Vec::as_slice)
}

fn percent(share: &Value) -> f64 {
    100.0 * share.as_f64().unwrap_or(f64::NAN)
}

fn capitalised(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// Puts `text` into a Markdown file, between the marks of the directory of the rows.
pub(super) fn insert(page: &Path, rows: &Path, text: &str) -> Result<()> {
    let name = rows.file_name().unwrap_or_default().to_string_lossy();
    let [begin, end] = ["begin", "end"].map(|word| format!("<!-- {word} {name} -->"));
    let old = fs::read_to_string(page).map_err(FileError::io("read", page))?;
    let places = old.find(&begin).zip(old.find(&end)).filter(|(first, last)| first < last);
    let Some((first, last)) = places else {
        let reason = format!("has no lines `{begin}` and `{end}` between which the rows belong");
        return Err(FileError::content(page, reason).into());
    };
    let new = format!("{}\n\n{}\n{}", &old[..first + begin.len()], text, &old[last..]);
    Ok(files::write_atomically(page, |file| file.write_all(new.as_bytes()))?)
}
