//! What costs most, in sentences: the summary that a person reads first.

use super::failures::{Cause, Failure};
use super::labels::KeyframeLabels;
use super::ladder::{Paths, Poses, Rung};
use super::poses::{KeyframePoses, PoseReport};
use super::ranking::Ranking;

use serde::Serialize;
use std::collections::BTreeMap;

/// One finding.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Share of the scenes that it costs; none where this is not known.
    pub costs: Option<f64>,
    /// What it is.
    pub text: String,
}

/// Findings by what they cost: causes of failed episodes first, then rungs of the ladder below which
/// success falls, then warnings.
pub(super) fn findings(
    scenes: usize,
    failures: &[Failure],
    poses: &PoseReport,
    ladder: &[Rung],
    rankings: &[Ranking],
    labels: &[KeyframeLabels],
) -> Vec<Finding> {
    let mut found = of_failures(scenes, failures, poses);
    found.extend(of_ladder(ladder));
    found.extend(poses.scenes.iter().filter_map(of_keyframe));
    found.extend(of_ranking(rankings.last()));
    found.extend(of_labels(labels));
    found
}

/// One for each cause at each keyframe, the most frequent first.
fn of_failures(scenes: usize, failures: &[Failure], poses: &PoseReport) -> Vec<Finding> {
    let mut groups: BTreeMap<(Cause, usize), Vec<&Failure>> = BTreeMap::new();
    for failure in failures {
        groups.entry((failure.cause, failure.step)).or_default().push(failure);
    }
    let mut groups: Vec<_> = groups.into_iter().collect();
    groups.sort_by_key(|(_, failures)| core::cmp::Reverse(failures.len()));
    let finding = |((cause, step), failures): ((Cause, usize), Vec<&Failure>)| {
        let n = failures.len();
        let costs = n as f64 / scenes.max(1) as f64;
        let (what, detail) = match cause {
            Cause::Pose => (of_pose(step, poses), most_frequent(&failures)),
            _ => (cause.text().to_owned(), most_frequent(&failures)),
        };
        let detail = if detail.is_empty() { detail } else { format!(" ({detail})") };
        let text = format!("{n} of {scenes} scenes fail at keyframe {step}: {what}{detail}");
        Finding { costs: Some(costs), text }
    };
    groups.into_iter().map(finding).collect()
}

/// A keyframe with a choice that is mostly wrong, whatever comes of it.
fn of_keyframe(keyframe: &KeyframePoses) -> Option<Finding> {
    let KeyframePoses { keyframe, wrong, .. } = keyframe;
    let mostly = wrong.iter().filter(|(_, share)| **share >= 0.5);
    let parts: Vec<_> =
        mostly.map(|(part, share)| format!("{part} {:.0} %", 100.0 * share)).collect();
    let text =
        format!("poses: choices of keyframe {keyframe} that are wrong: {}", parts.join(", "));
    (!parts.is_empty()).then_some(Finding { costs: None, text })
}

/// Where the poses of a keyframe go that are wrong.
fn of_pose(step: usize, poses: &PoseReport) -> String {
    /// Share of the poses from which on a keyframe counts as left out.
    const OFTEN: f64 = 0.25;
    let here = poses.scenes.iter().find(|keyframe| keyframe.keyframe == step);
    let other = here.and_then(|here| {
        here.taken_for
            .iter()
            .filter(|(_, share)| **share >= OFTEN)
            .max_by(|a, b| a.1.total_cmp(b.1))
    });
    match other {
        Some((other, share)) if *other > step => format!(
            "pose: keyframe {step} is left out, {:.0} % of the poses there are those of keyframe {other}",
            100.0 * share
        ),
        Some((other, share)) => {
            format!("pose: {:.0} % of the poses there are those of keyframe {other}", 100.0 * share)
        }
        None => "pose".to_owned(),
    }
}

/// The words of the failures that come most often, without numbers.
fn most_frequent(failures: &[&Failure]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for part in failures.iter().flat_map(|failure| failure.detail.split(", ")) {
        let is_counted = !part.is_empty() && !part.chars().any(|c| c.is_ascii_digit())
            || part.starts_with("voxel");
        if is_counted {
            *counts.entry(part).or_default() += 1;
        }
    }
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|(_, n)| core::cmp::Reverse(*n));
    let words: Vec<_> = counts.into_iter().map(|(part, n)| format!("{part} {n}")).collect();
    words.join(", ")
}

/// A fall of success from one rung to the next that is worth a sentence.
const FALL: f64 = 0.1;

fn of_ladder(ladder: &[Rung]) -> Vec<Finding> {
    let rate = |poses: Poses, paths: Paths| {
        let rung = ladder.iter().find(|rung| rung.poses == poses && rung.paths == paths)?;
        Some(rung.success_rate())
    };
    let fall = |from: Option<f64>, to: Option<f64>, text: &str| {
        let (from, to) = (from?, to?);
        let costs = Some(from - to).filter(|costs| *costs >= FALL)?;
        let [from, to] = [from, to].map(|rate| 100.0 * rate);
        Some(Finding { costs: Some(costs), text: format!("{text}: {from:.0} to {to:.0} %") })
    };
    let best = |poses| rate(poses, Paths::BestOfAll);
    let mut found: Vec<_> = [
        fall(Some(1.0), best(Poses::True), "paths: no candidate of the true pose does it"),
        fall(
            best(Poses::True),
            best(Poses::Quantised),
            "code of actions: its nearest pose is too coarse",
        ),
        fall(
            best(Poses::Quantised),
            best(Poses::QuantisedAsActing),
            "code of actions: acting turns the grasp by half a turn",
        ),
        fall(
            best(Poses::QuantisedAsActing),
            best(Poses::Learned),
            "poses: the learned ones are worse than their labels",
        ),
        fall(
            best(Poses::Learned),
            rate(Poses::Learned, Paths::Ranker),
            "choice: the ranker's path is not the best of all",
        ),
        fall(
            best(Poses::True),
            rate(Poses::True, Paths::Ranker),
            "choice: of the true poses' paths, the ranker's is not the best of all",
        ),
        fall(
            rate(Poses::Learned, Paths::Screw),
            rate(Poses::Learned, Paths::Ranker),
            "paths: a turn about the true axis does better than the ranker's choice",
        ),
    ]
    .into_iter()
    .flatten()
    .collect();
    found.sort_by(|a, b| b.costs.unwrap_or(0.0).total_cmp(&a.costs.unwrap_or(0.0)));
    found
}

fn of_labels(labels: &[KeyframeLabels]) -> Option<Finding> {
    let warned = labels.iter().filter_map(|row| Some((row.keyframe, row.warning.as_ref()?)));
    let texts: Vec<_> =
        warned.map(|(keyframe, warning)| format!("keyframe {keyframe}: {warning}")).collect();
    let text = format!("demonstrations: keyframes with two labels: {}", texts.join("; "));
    (!texts.is_empty()).then_some(Finding { costs: None, text })
}

fn of_ranking(ranking: Option<&Ranking>) -> Option<Finding> {
    let accuracy = ranking?.accuracy?;
    let text = format!(
        "choice: the ranker puts a path that does it above one that does not in {:.0} % of the pairs, worse than chance",
        100.0 * accuracy
    );
    (accuracy < 0.5).then_some(Finding { costs: None, text })
}
