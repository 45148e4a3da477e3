//! Methods side by side: success by task, the mean over tasks, and the paper's method against each
//! other one in the same scenes.

use crate::cli::experiment::row::{DEMONSTRATIONS, Key, PRESET, ROBOT, Row};
use crate::cli::experiment::statistics::{Outcomes, holm, interval, mcnemar, mean};
use core::fmt::Write as _;
use core::slice;
use lpr_core::agent::{Method, PoseSource};
use std::collections::{BTreeMap, BTreeSet};

/// Successes in test scenes by training seed.
type Seeds<'a> = BTreeMap<u64, (Vec<f64>, &'a Row)>;
/// By task.
type Column<'a> = BTreeMap<String, Seeds<'a>>;
/// By name; what is compared with the others first.
type Columns<'a> = BTreeMap<(bool, String), Column<'a>>;

/// Nothing where there is but one column to show; the rows that are there twice, if there are any.
pub(super) fn markdown(rows: &[Row]) -> Result<String, String> {
    let first = column_of(rows, Method::Lpr.name());
    let mut columns = Columns::new();
    for row in rows {
        let Some(outcomes) = row.outcomes() else { continue };
        let (name, task, seed) = (column(&row.key), task(&row.key), row.key.seed);
        let column = columns.entry((Some(&name) != first.as_ref(), name.clone())).or_default();
        if column.entry(task.clone()).or_default().insert(seed, (outcomes, row)).is_some() {
            return Err(format!("holds two rows of {task} with {name} and seed {seed}"));
        }
    }
    if columns.len() < 2 {
        return Ok(String::new());
    }
    let mut text = successes(&columns);
    if let Some((_, lpr)) = columns.first_key_value().filter(|((is_other, _), _)| !is_other) {
        let name = first.unwrap_or_default();
        for ((_, other_name), other) in columns.iter().skip(1) {
            text.push_str(&against([&name, other_name], lpr, other));
        }
    }
    Ok(text)
}

/// The task, and what of its row is not the default.
pub(super) fn task(key: &Key) -> String {
    let mut name = format!("`{}`", key.task);
    if key.robot != ROBOT {
        let _ = write!(name, " ({})", key.robot);
    }
    name
}

/// Name of the column that a row belongs to.
fn column(key: &Key) -> String {
    key.method.clone() + &variant(key)
}

/// What of a row is not the default, beside its method.
pub(super) fn variant(key: &Key) -> String {
    let mut name = String::new();
    if key.preset != PRESET && key.env_steps > 0 {
        let _ = write!(name, ", {}", key.preset);
    }
    if key.demonstrations != DEMONSTRATIONS && key.env_steps > 0 {
        let _ = write!(name, ", {} demonstrations", key.demonstrations);
    }
    if key.poses == PoseSource::Oracle { name + ", true poses" } else { name }
}

/// The column of the first row of a method: of the preset itself, if it is there.
fn column_of(rows: &[Row], method: &str) -> Option<String> {
    let of_method = rows.iter().map(|row| &row.key).filter(|key| key.method == method);
    of_method.min_by_key(|key| key.preset != PRESET).map(column)
}

fn successes(columns: &Columns<'_>) -> String {
    let mut text = String::from("| task |");
    for (_, name) in columns.keys() {
        let _ = write!(text, " {name} |");
    }
    let _ = writeln!(text, "\n| --- |{}", " --- |".repeat(columns.len()));
    let tasks: BTreeSet<_> = columns.values().flat_map(BTreeMap::keys).collect();
    for task in &tasks {
        let _ = write!(text, "| {task} |");
        for column in columns.values() {
            let cell = column.get(*task).map_or_else(String::new, cell);
            let _ = write!(text, " {cell} |");
        }
        text.push('\n');
    }
    text.push_str("| mean of tasks |");
    for column in columns.values() {
        let all: Vec<_> = column.values().map(outcomes).collect();
        let [low, high] = interval(&all).map(|bound| 100.0 * bound);
        let of = if all.len() < tasks.len() { format!(" of {}", all.len()) } else { String::new() };
        let _ = write!(text, " **{:.1}** ({low:.1} to {high:.1}){of} |", 100.0 * mean(&all));
    }
    text + "\n\n"
}

fn outcomes(seeds: &Seeds<'_>) -> Outcomes {
    seeds.values().map(|(outcomes, _)| outcomes.clone()).collect()
}

/// `94: 90, 95, 97`: the mean in percent and each seed, where there are several.
fn cell(seeds: &Seeds<'_>) -> String {
    let all = outcomes(seeds);
    let percent = |outcomes: &Vec<f64>| format!("{:.0}", 100.0 * mean(&[vec![outcomes.clone()]]));
    let total = format!("**{:.0}**", 100.0 * mean(slice::from_ref(&all)));
    if all.len() < 2 {
        return total;
    }
    format!("{total}: {}", all.iter().map(percent).collect::<Vec<_>>().join(", "))
}

/// Seeds and scenes of a task that both methods were tried in.
fn pairs(first: &Seeds<'_>, second: &Seeds<'_>) -> Vec<[Vec<f64>; 2]> {
    // What needs no training is the same for every seed.
    let untrained = second.values().next().filter(|(_, row)| row.key.env_steps == 0);
    let partner = |seed: &u64| second.get(seed).or(untrained).map(|(outcomes, _)| outcomes.clone());
    first.iter().filter_map(|(seed, (own, _))| Some([own.clone(), partner(seed)?])).collect()
}

/// A table of the differences between two columns.
fn against([first, name]: [&str; 2], lpr: &Column<'_>, other: &Column<'_>) -> String {
    let mut compared = Vec::new();
    for (task, seeds) in lpr {
        let pairs = other.get(task).map(|others| pairs(seeds, others)).unwrap_or_default();
        if pairs.is_empty() {
            continue;
        }
        let difference = |[own, others]: &[Vec<f64>; 2]| {
            own.iter().zip(others).map(|(own, other)| own - other).collect::<Vec<_>>()
        };
        let differences: Outcomes = pairs.iter().map(difference).collect();
        let count = |sign: f64| differences.iter().flatten().filter(|&&d| d == sign).count() as u64;
        let only = [count(1.0), count(-1.0)];
        compared.push((task, differences, only, mcnemar(only[0], only[1])));
    }
    if compared.is_empty() {
        return String::new();
    }
    let p: Vec<_> = compared.iter().map(|(_, _, _, p)| *p).collect();
    let mut text = format!(
        "{first} against {name}, in the same scenes:\n\n| task | seeds | difference, points | only the first | only the other | p (McNemar) | p (Holm) |\n| --- | --- | --- | --- | --- | --- | --- |\n"
    );
    for ((task, differences, [only_first, only_other], p), adjusted) in
        compared.iter().zip(holm(&p))
    {
        let _ = writeln!(
            text,
            "| {task} | {} | {:+.1} | {only_first} | {only_other} | {p:.2e} | {adjusted:.2e} |",
            differences.len(),
            100.0 * mean(slice::from_ref(differences)),
        );
    }
    let all: Vec<_> = compared.into_iter().map(|(_, differences, _, _)| differences).collect();
    let [low, high] = interval(&all).map(|bound| 100.0 * bound);
    let _ = writeln!(
        text,
        "| mean of tasks | | **{:+.1}** ({low:+.1} to {high:+.1}) | | | | |\n",
        100.0 * mean(&all)
    );
    text
}
