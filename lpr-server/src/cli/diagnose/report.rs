//! A diagnosis in text, as tables.

use core::fmt;
use lpr_core::diagnose::{Diagnosis, Failure, KeyframePoses, Paths, Poses, Ranking};
use serde::Serialize;
use std::collections::BTreeMap;

/// What was looked at.
#[derive(Debug, Clone, Serialize)]
pub(in crate::cli) struct Scope {
    pub(in crate::cli) task: String,
    pub(in crate::cli) robot: String,
    pub(in crate::cli) method: &'static str,
    pub(in crate::cli) seed: u64,
    pub(in crate::cli) env_steps: u64,
    /// The first and the last; those in which the demonstrator fails are left out.
    pub(in crate::cli) scene_seeds: [u64; 2],
}

/// The report of `lpr diagnose`.
#[derive(Debug, Clone, Serialize)]
pub(in crate::cli) struct Report {
    #[serde(flatten)]
    pub(in crate::cli) scope: Scope,
    #[serde(flatten)]
    pub(in crate::cli) diagnosis: Diagnosis,
}

impl Report {
    /// The first line: who did how well.
    pub(super) fn headline(&self) -> String {
        let Scope { task, robot, method, seed, env_steps, scene_seeds: [first, last] } =
            &self.scope;
        let Diagnosis { scenes, successes, wilson95, .. } = &self.diagnosis;
        let [low, high] = wilson95.map(|bound| 100.0 * bound);
        let rate = 100.0 * *successes as f64 / *scenes as f64;
        format!(
            "{task} with {method} on {robot}, seed {seed}, after {env_steps} environment steps: {successes} of {scenes} scenes ({first} to {last}), {rate:.0} % (95 %: {low:.0} to {high:.0})"
        )
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.headline())?;
        self.diagnosis_text(f)
    }
}

impl Report {
    fn diagnosis_text(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Diagnosis { findings, poses, labels, ladder, rankings, failures, .. } = &self.diagnosis;
        writeln!(f, "\nwhat costs most")?;
        if findings.is_empty() {
            writeln!(f, "  nothing was found")?;
        }
        for finding in findings {
            let costs = finding.costs.map_or(String::new(), |costs| percent(Some(costs)));
            writeln!(f, "{costs:>6}  {}", finding.text)?;
        }
        if !poses.scenes.is_empty() {
            writeln!(
                f,
                "\nposes, chosen against demonstrated (near: 2 cm and 15 degrees; right: and the gripper)"
            )?;
            pose_rows(f, "in these scenes", &poses.scenes)?;
            pose_rows(f, "each depth led to the right place", &poses.guided)?;
            pose_rows(f, "on its own demonstrations", &poses.demonstrations)?;
        }
        if !labels.is_empty() {
            writeln!(f, "\nlabels of the demonstrations under augmentation")?;
            writeln!(f, "keyframe  modes of roll, pitch, yaw  rarer grasp  jumps")?;
            for row in labels {
                let [roll, pitch, yaw] = row.modes;
                let jumps = row.jumps.iter().copied().fold(0.0, f64::max);
                writeln!(
                    f,
                    "{:>8}  {roll:>15} {pitch:>5} {yaw:>3}  {:>11}  {:>5}  {}",
                    row.keyframe,
                    percent(Some(row.rarer_grasp)),
                    percent(Some(jumps)),
                    row.warning.as_deref().unwrap_or_default()
                )?;
            }
        }
        if !ladder.is_empty() {
            writeln!(f, "\nsuccess by source of the poses and choice among the paths")?;
            self.ladder_text(f)?;
        }
        if !rankings.is_empty() {
            writeln!(f, "\nthe ranker on the demonstrator's poses, by snapshot")?;
            writeln!(f, "   steps  sets  regret  order  Brier (of the mean)")?;
            rankings.iter().try_for_each(|ranking| ranking_row(f, ranking))?;
        }
        failure_rows(f, failures)
    }

    fn ladder_text(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<20}", "poses")?;
        Paths::ALL.into_iter().try_for_each(|paths| write!(f, "{:>15}", paths.name()))?;
        writeln!(f)?;
        for poses in Poses::ALL {
            let of = |paths| {
                let rungs = self.diagnosis.ladder.iter();
                rungs.clone().find(|rung| rung.poses == poses && rung.paths == paths)
            };
            if Paths::ALL.into_iter().all(|paths| of(paths).is_none()) {
                continue;
            }
            write!(f, "{:<20}", poses.name())?;
            for paths in Paths::ALL {
                let text = of(paths)
                    .map_or("-".to_owned(), |rung| format!("{}/{}", rung.successes, rung.episodes));
                write!(f, "{text:>15}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

fn pose_rows(f: &mut fmt::Formatter<'_>, title: &str, rows: &[KeyframePoses]) -> fmt::Result {
    if rows.is_empty() {
        return Ok(());
    }
    writeln!(f, "{title}")?;
    writeln!(
        f,
        "keyframe     n  right  near      mm (90 %)     deg (90 %)  gripper  wrong choices"
    )?;
    for row in rows {
        let wrong =
            row.wrong.iter().map(|(part, share)| format!("{part} {}", percent(Some(*share))));
        let taken = row
            .taken_for
            .iter()
            .map(|(other, share)| format!("that of keyframe {other} {}", percent(Some(*share))));
        let words: Vec<_> = wrong.chain(taken).collect();
        writeln!(
            f,
            "{:>8} {:>5}  {:>5} {:>5}  {:>5.0} ({:>5.0})  {:>5.0} ({:>5.0})  {:>7}  {}",
            row.keyframe,
            row.cases,
            percent(Some(row.right)),
            percent(Some(row.near)),
            row.position_mm.median,
            row.position_mm.p90,
            row.rotation_deg.median,
            row.rotation_deg.p90,
            percent(Some(row.gripper)),
            words.join(", ")
        )?;
    }
    Ok(())
}

fn ranking_row(f: &mut fmt::Formatter<'_>, ranking: &Ranking) -> fmt::Result {
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
    writeln!(
        f,
        "{:>8}  {:>4}  {:>6}  {:>5}  {} ({})",
        ranking.env_steps,
        ranking.sets,
        percent(ranking.regret),
        percent(ranking.accuracy),
        number(ranking.brier),
        number(ranking.brier_of_mean)
    )
}

fn failure_rows(f: &mut fmt::Formatter<'_>, failures: &[Failure]) -> fmt::Result {
    let mut by_cause: BTreeMap<_, Vec<&Failure>> = BTreeMap::new();
    for failure in failures {
        by_cause.entry(failure.cause).or_default().push(failure);
    }
    let mut by_cause: Vec<_> = by_cause.into_iter().collect();
    by_cause.sort_by_key(|(_, failures)| core::cmp::Reverse(failures.len()));
    if !by_cause.is_empty() {
        writeln!(f, "\nfailed episodes by their first cause")?;
    }
    for (cause, failures) in by_cause {
        writeln!(f, "{:>4}  {}", failures.len(), cause.text())?;
        for failure in failures.iter().take(EXAMPLES) {
            writeln!(f, "        {}", example(failure))?;
        }
    }
    Ok(())
}

/// Failed episodes of each cause that are told one by one.
pub(super) const EXAMPLES: usize = 3;

/// A failed episode in a line.
pub(super) fn example(failure: &Failure) -> String {
    let mut words = vec![format!("scene {}, keyframe {}", failure.scene_seed, failure.step)];
    if let (Some(mm), Some(deg)) = (failure.position_mm, failure.rotation_deg) {
        words.push(format!("{mm:.0} mm and {deg:.0} degrees off"));
    }
    if !failure.detail.is_empty() {
        words.push(failure.detail.clone());
    }
    words.join(": ")
}

fn percent(share: Option<f64>) -> String {
    share.map_or("-".to_owned(), |share| format!("{:.0}%", 100.0 * share))
}
