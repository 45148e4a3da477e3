//! Training runs that take seconds, and what of them must not depend on time.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::events::{self, Scalar};
use crate::lpr::{self, Folder};
use lpr_tests::workspace;
use serde_json::{Map, Value};
use std::fs;
use std::path::{Path, PathBuf};

/// Environment steps of a run.
pub(crate) const STEPS: &str = "24";

/// Settings that make the preset `fast` small.
const SMALL: [(&str, &str); 25] = [
    ("candidates.path_len", "8"),
    ("candidates.planner_paths", "1"),
    ("candidates.bezier_paths", "2"),
    ("ranker.config_widths", "[8, 16]"),
    ("ranker.head_widths", "[16]"),
    ("policy.widths", "[8, 16]"),
    ("q_attention.voxels_per_side", "8"),
    ("q_attention.rotation_bins", "24"),
    ("q_attention.network.cell_channels", "8"),
    ("q_attention.network.block_channels", "12"),
    ("q_attention.network.head_channels", "4"),
    ("q_attention.network.attended_channels", "4"),
    ("q_attention.network.hidden", "16"),
    ("q_attention.network.harmonics", "4"),
    ("training.demonstrations", "2"),
    ("training.demonstration_updates", "4"),
    ("training.q_attention_updates_per_step", "1"),
    ("training.q_attention_batch", "2"),
    ("training.path_updates_per_step", "1"),
    ("training.path_batch", "8"),
    ("training.cloud_spacing", "0.03"),
    ("training.validation_interval", "4"),
    ("training.validation_episodes", "1"),
    // A quick arm: the final evaluation of 100 episodes takes most of the time.
    ("timing.max_velocity", "3.0"),
    ("timing.max_acceleration", "30.0"),
];

/// The text of a small preset in which the settings `changes` have other values.
pub(crate) fn preset(changes: &[(&str, &str)]) -> String {
    let text = fs::read_to_string(workspace().join("lpr-core/presets/fast.toml")).unwrap();
    let mut table = toml::Value::Table(text.parse().unwrap());
    for (setting, value) in SMALL.iter().chain(changes) {
        let place = setting.split('.').fold(&mut table, |value, key| {
            value.get_mut(key).unwrap_or_else(|| panic!("the preset has no {setting}"))
        });
        let values: toml::Table = format!("value = {value}").parse().unwrap();
        *place = values["value"].clone();
    }
    toml::to_string(&table).unwrap()
}

/// A kind of run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    pub(crate) task: &'static str,
    /// Options that make it differ from others.
    pub(crate) options: &'static [&'static str],
}

/// The demonstrator's poses.
pub(crate) const ORACLE: Kind = Kind { task: "toilet_seat_up", options: &["--oracle-poses"] };

/// Poses of Q-attention.
pub(crate) const LEARNED: Kind = Kind { task: "reach_target", options: &[] };

/// A folder with a small preset and room for runs.
pub(crate) struct Runs {
    pub(crate) folder: Folder,
    preset: String,
}

impl Runs {
    pub(crate) fn new() -> Self {
        Self::with(&[])
    }

    /// With other values of some settings.
    pub(crate) fn with(changes: &[(&str, &str)]) -> Self {
        let folder = Folder::new();
        let preset = folder.write("small.toml", preset(changes));
        Self { folder, preset }
    }

    /// The arguments of a run of [`STEPS`] steps in the directory `name`.
    pub(crate) fn arguments(&self, kind: Kind, name: &str) -> Vec<String> {
        let out = self.folder.at(name);
        let fixed = [
            "train",
            kind.task,
            "--preset",
            &self.preset,
            "--seed",
            "3",
            "--env-steps",
            STEPS,
            "--out",
            &out,
        ];
        fixed.iter().chain(kind.options).map(|&argument| argument.to_owned()).collect()
    }

    /// A whole run without interruption.
    pub(crate) fn train(&self, kind: Kind, name: &str) -> PathBuf {
        lpr::json(&self.arguments(kind, name));
        self.folder.path().join(name)
    }
}

/// Everything that a run leaves behind, without the parts that depend on time.
#[derive(Debug, PartialEq)]
pub(crate) struct Outcome {
    summary: Value,
    metrics: Vec<Map<String, Value>>,
    scalars: Vec<Scalar>,
    weights: Vec<u8>,
    state: Vec<u8>,
}

impl Outcome {
    pub(crate) fn of(run: &Path) -> Self {
        let mut summary =
            serde_json::from_slice(&fs::read(run.join("summary.json")).unwrap()).unwrap();
        remove_times(&mut summary);
        let mut metrics = metrics(run);
        assert_time_goes_on(&metrics);
        for point in &mut metrics {
            point.retain(|key, _| !is_time(key));
        }
        let checkpoint = newest_checkpoint(run);
        Self {
            summary,
            metrics,
            scalars: events::scalars(run),
            weights: fs::read(checkpoint.join("weights.safetensors")).unwrap(),
            state: fs::read(checkpoint.join("state.bin")).unwrap(),
        }
    }

    /// Fails with the first difference to `other`.
    #[track_caller]
    pub(crate) fn assert_same(&self, other: &Self, what: &str) {
        assert_eq!(self.summary, other.summary, "{what}: summary.json");
        assert_eq!(self.metrics, other.metrics, "{what}: metrics.jsonl");
        assert_eq!(self.scalars, other.scalars, "{what}: events");
        assert!(self.weights == other.weights, "{what}: weights.safetensors differ");
        assert!(self.state == other.state, "{what}: state.bin differ");
    }
}

/// The lines of `metrics.jsonl`.
pub(crate) fn metrics(run: &Path) -> Vec<Map<String, Value>> {
    let text = fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The directories of a run's whole checkpoints, oldest first.
pub(crate) fn checkpoints(run: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(run.join("checkpoints")) else { return Vec::new() };
    let mut found: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    found.retain(|path| path.file_name().unwrap().to_str().unwrap().parse::<u64>().is_ok());
    found.sort();
    found
}

pub(crate) fn newest_checkpoint(run: &Path) -> PathBuf {
    checkpoints(run).pop().unwrap_or_else(|| panic!("{} has no checkpoint", run.display()))
}

/// A resumed run counts the time before it, too.
fn assert_time_goes_on(metrics: &[Map<String, Value>]) {
    let times: Vec<_> =
        metrics.iter().filter_map(|point| point.get("wall_seconds")?.as_f64()).collect();
    assert!(times.len() > 1 && times.is_sorted(), "{times:?}");
}

/// True if the contract lets the value of `key` depend on time.
fn is_time(key: &str) -> bool {
    ["_seconds", "_ms", "_micros", "_per_second"].iter().any(|end| key.ends_with(end))
}

pub(crate) fn remove_times(value: &mut Value) {
    match value {
        Value::Object(object) => {
            object.retain(|key, _| !is_time(key));
            object.values_mut().for_each(remove_times);
        }
        Value::Array(values) => values.iter_mut().for_each(remove_times),
        _ => {}
    }
}
