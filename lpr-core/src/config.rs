//! Every number of a run in one value: the settings of all modules, and whole-file presets that
//! list each of them.
//!
//! No number may be negative or not finite, whatever its module, and some have a range here; which
//! module refuses what else stands with its settings.

mod training;

pub use training::{Timeout, TrainSettings};

use crate::agent::AgentSettings;
use crate::check::one_of;
use crate::demo::DemoSettings;
use crate::error::{Error, Result};
use crate::networks::NetworksSettings;
use crate::path::{CandidateSettings, TimingSettings};
use crate::policy::PolicySettings;
use crate::q_attention::QAttentionSettings;
use crate::ranker::RankerSettings;
use crate::replay::ReplaySettings;
#[cfg(feature = "sim")]
use crate::sim::SimParams;

use serde::{Deserialize, Serialize};

/// The built-in presets by name; the first is the default.
const PRESETS: [(&str, &str); 3] = [
    ("fast", include_str!("../presets/fast.toml")),
    ("paper", include_str!("../presets/paper.toml")),
    ("paper-narrow", include_str!("../presets/paper-narrow.toml")),
];

/// Most outputs of a layer: eight times the widest of the paper.
const MAX_WIDTH: f64 = 8192.0;

/// Least and greatest value of settings outside of which a module would run out of memory, or fail
/// without naming them.
const RANGES: [(&str, f64, f64); 22] = [
    ("candidates.path_len", 2.0, 1000.0),
    ("candidates.rrt.checks_per_radian", 0.1, 1e4),
    ("ranker.config_widths", 1.0, MAX_WIDTH),
    ("ranker.head_widths", 1.0, MAX_WIDTH),
    ("policy.widths", 1.0, MAX_WIDTH),
    ("q_attention.voxels_per_side", 4.0, 128.0),
    ("q_attention.rotation_bins", 4.0, 720.0),
    ("q_attention.network.channels", 1.0, MAX_WIDTH),
    ("q_attention.network.bottleneck", 1.0, MAX_WIDTH),
    ("q_attention.network.cell_channels", 1.0, MAX_WIDTH),
    ("q_attention.network.block_channels", 1.0, MAX_WIDTH),
    ("q_attention.network.head_channels", 1.0, MAX_WIDTH),
    ("q_attention.network.attended_channels", 0.0, MAX_WIDTH),
    ("q_attention.network.hidden", 1.0, MAX_WIDTH),
    ("q_attention.network.harmonics", 1.0, 360.0),
    ("replay.capacity", 1.0, 1e7),
    ("training.path_batch", 1.0, 65536.0),
    ("training.cloud_spacing", 1e-3, 1.0),
    ("timing.max_velocity", 1e-3, 100.0),
    ("timing.max_acceleration", 1e-3, 1e4),
    ("simulator.dt", 1e-4, 0.1),
    ("simulator.solver_iterations", 1.0, 1000.0),
];

/// Every setting of an agent, its training and its world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The candidate paths.
    pub candidates: CandidateSettings,
    /// The ranking function.
    pub ranker: RankerSettings,
    /// The path policy.
    pub policy: PolicySettings,
    /// Next-best poses.
    pub q_attention: QAttentionSettings,
    /// The replay buffers.
    pub replay: ReplaySettings,
    /// Keyframes and transitions that demonstrations yield.
    pub demos: DemoSettings,
    /// Algorithm 1.
    pub training: TrainSettings,
    /// Speed of the arm.
    pub timing: TimingSettings,
    /// The simulated world.
    #[cfg(feature = "sim")]
    pub simulator: SimParams,
    /// The simulated world, unread in a build without it.
    #[cfg(not(feature = "sim"))]
    pub simulator: toml::Table,
}

impl Config {
    /// The built-in preset of that name.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] naming those that exist.
    pub fn preset(name: &str) -> Result<Self> {
        let Some((_, text)) = PRESETS.iter().find(|(known, _)| *known == name) else {
            return Err(Error::Config(format!("preset: {}", one_of(Self::preset_names(), name))));
        };
        Self::from_toml(text)
    }

    /// Names of the built-in presets; the first is the default.
    pub fn preset_names() -> impl Iterator<Item = &'static str> {
        PRESETS.iter().map(|(name, _)| *name)
    }

    /// The configuration that a file holds; it has to list every setting.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] naming the setting that is misspelt, missing, of the wrong type or out of
    /// its range.
    pub fn from_toml(text: &str) -> Result<Self> {
        let table: toml::Table =
            text.parse().map_err(|error: toml::de::Error| Error::Config(error.to_string()))?;
        check_numbers(&toml::Value::Table(table), "")?;
        let config: Self =
            toml::from_str(text).map_err(|error| Error::Config(error.to_string()))?;
        config.check()?;
        Ok(config)
    }

    /// The same with one setting changed: `table.setting=value`, the value as in a preset.
    ///
    /// # Errors
    ///
    /// As [`Self::from_toml`]; and when there is no such table, or no value.
    pub fn with(&self, setting: &str) -> Result<Self> {
        let unusable = |why: &str| Error::Config(format!("{setting}: {why}"));
        let (path, value) =
            setting.split_once('=').ok_or_else(|| unusable("expected table.setting=value"))?;
        let value: toml::Table = format!("value = {value}")
            .parse()
            .map_err(|_| unusable("expected a value as in a preset"))?;
        let mut root: toml::Value =
            self.to_toml().parse::<toml::Table>().expect("what was written can be read").into();
        let (parents, name) =
            path.rsplit_once('.').ok_or_else(|| unusable("expected table.setting=value"))?;
        let table = parents.split('.').try_fold(&mut root, |table, key| table.get_mut(key));
        let table =
            table.and_then(toml::Value::as_table_mut).ok_or_else(|| unusable("no such table"))?;
        table.extend(value.into_iter().map(|(_, value)| (name.to_owned(), value)));
        let text = toml::to_string(&root).map_err(|error| unusable(&error.to_string()))?;
        Self::from_toml(&text)
    }

    /// The file that [`Self::from_toml`] reads.
    ///
    /// # Panics
    ///
    /// Never: every setting has a representation.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("settings are tables, lists, numbers and words")
    }

    /// The settings of the networks.
    #[must_use]
    pub const fn network_settings(&self) -> NetworksSettings<'_> {
        NetworksSettings {
            q_attention: &self.q_attention,
            ranker: &self.ranker,
            policy: &self.policy,
        }
    }

    /// The settings of acting.
    #[must_use]
    pub fn agent_settings(&self) -> AgentSettings {
        let TrainSettings { cloud_spacing, acting_weights, .. } = self.training;
        let discount = self.ranker.discount;
        AgentSettings {
            candidates: self.candidates.clone(),
            cloud_spacing,
            acting_weights,
            discount,
        }
    }

    /// Checks what no type checks. Ranker, policy and replay check their settings when they are
    /// built.
    fn check(&self) -> Result<()> {
        self.candidates.check()?;
        self.q_attention.check()?;
        self.training.check()
    }
}

/// Refuses numbers that no setting may have, naming the first by its `path`.
fn check_numbers(value: &toml::Value, path: &str) -> Result<()> {
    match value {
        toml::Value::Integer(number) => check_number(*number as f64, path),
        toml::Value::Float(number) => check_number(*number, path),
        toml::Value::Array(values) => values
            .iter()
            .enumerate()
            .try_for_each(|(idx, value)| check_numbers(value, &format!("{path}[{idx}]"))),
        toml::Value::Table(table) => table.iter().try_for_each(|(key, value)| {
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            check_numbers(value, &path)
        }),
        _ => Ok(()),
    }
}

fn check_number(number: f64, path: &str) -> Result<()> {
    if !(number.is_finite() && number >= 0.0) {
        return Err(Error::Config(format!(
            "{path}: expected a finite number from 0, found {number}"
        )));
    }
    // The numbers of a list have the range of the list.
    let setting = path.split('[').next().unwrap_or(path);
    match RANGES.iter().find(|(name, ..)| *name == setting) {
        Some((_, least, most)) if !(*least..=*most).contains(&number) => {
            Err(Error::Config(format!("{path}: expected {least} to {most}, found {number}")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::Exploration;

    fn fast() -> &'static str {
        PRESETS[0].1
    }

    /// The error about the preset `fast` with `from` replaced by `to`.
    fn refusal(from: &str, to: &str) -> String {
        assert!(fast().contains(from), "the preset has no {from}");
        Config::from_toml(&fast().replacen(from, to, 1)).expect_err(to).to_string()
    }

    #[test]
    fn presets_parse_build_and_round_trip() {
        for name in Config::preset_names() {
            let config = Config::preset(name).unwrap_or_else(|error| panic!("{name}: {error}"));
            #[cfg(feature = "sim")]
            assert_eq!(
                config.simulator,
                SimParams::STANDARD,
                "{name}: the simulator is the same in every preset"
            );
            assert_eq!(Config::from_toml(&config.to_toml()), Ok(config), "{name}");
        }
    }

    #[test]
    fn presets_differ_and_list_the_numbers_of_the_paper() {
        let [fast, paper, narrow] =
            ["fast", "paper", "paper-narrow"].map(|name| Config::preset(name).expect("a preset"));
        assert_ne!(fast, paper);
        assert_eq!((paper.candidates.planner_paths, paper.candidates.bezier_paths), (20, 20));
        assert!(
            (paper.candidates.bezier.sigma * paper.candidates.bezier.sigma - 0.2).abs() < 1e-3,
            "the paper's variance"
        );
        assert_eq!(paper.ranker.config_widths, [64, 128, 1024]);
        assert_eq!(paper.ranker.head_widths, [512, 512]);
        assert_eq!(paper.policy.widths, [64, 256, 256]);
        assert_eq!(paper.training.exploration, Exploration::Greedy);
        assert_eq!(paper.training.timeout, Timeout::Terminal);
        // Narrow networks are the only difference.
        let widened = Config {
            q_attention: paper.q_attention.clone(),
            training: paper.training.clone(),
            ..narrow.clone()
        };
        assert_eq!(widened, paper);
        assert_ne!(narrow.q_attention.network, paper.q_attention.network);
    }

    #[test]
    fn a_misspelt_or_missing_setting_is_named() {
        assert!(refusal("bezier_paths", "bezeir_paths").contains("bezeir_paths"));
        assert!(refusal("voxels_per_side = 16\n", "").contains("voxels_per_side"));
        assert!(refusal("[policy]", "[polcy]").contains("polcy"));
        assert!(refusal("kind = \"critics\"", "kind = \"greedily\"").contains("greedily"));
        assert!(Config::preset("quick").expect_err("unknown").to_string().contains("fast, paper"));
    }

    #[test]
    fn numbers_out_of_their_range_are_named() {
        for number in ["-0.1", "nan", "inf", "-inf"] {
            let message = refusal("sigma = 0.07", &format!("sigma = {number}"));
            assert!(message.contains("candidates.bezier.sigma"), "{message}");
        }
        assert!(
            refusal("planner_paths = 20", "planner_paths = -20")
                .contains("candidates.planner_paths")
        );
        assert!(refusal("planner_paths = 20", "planner_paths = 2.5").contains("planner_paths"));
        assert!(refusal("path_len = 30", "path_len = 1").contains("candidates.path_len"));
        assert!(refusal("path_batch = 64", "path_batch = 0").contains("training.path_batch"));
        assert!(refusal("first = ", "first = 4").contains("training.exploration"));
        assert!(refusal("cloud_spacing = 0.01", "cloud_spacing = 0").contains("cloud_spacing"));
        assert!(
            refusal("widths = [64, 128, 256]", "widths = [64, 0, 256]")
                .contains("ranker.config_widths[1]")
        );
        assert!(
            refusal("cell_channels = 32", "cell_channels = 0")
                .contains("expected 1 to 8192, found 0")
        );
    }

    #[test]
    fn one_setting_can_be_changed() {
        let config = Config::preset("fast").expect("a preset");
        let changed = config.with("candidates.rrt.range=0.5").expect("a setting");
        assert_eq!(changed.candidates.rrt.range, 0.5);
        assert_eq!(changed.with("candidates.rrt.range=1.0").as_ref(), Ok(&config));
        for unusable in [
            "candidates",
            "candidates.nothing.range=1",
            "candidates.rrt.range=",
            "candidates.rrt.rnge=1",
            "x=1",
        ] {
            assert!(matches!(config.with(unusable), Err(Error::Config(_))), "{unusable}");
        }
    }

    #[test]
    fn every_range_is_that_of_a_setting_and_holds_its_preset() {
        let texts = PRESETS.map(|(_, text)| text.parse::<toml::Table>().expect("a preset parses"));
        for (name, least, most) in RANGES {
            let in_preset = |table: &toml::Table| {
                let mut path = name.split('.');
                let first = table.get(path.next()?)?;
                path.try_fold(first, |value, key| value.get(key)).cloned()
            };
            assert!(texts.iter().any(|table| in_preset(table).is_some()), "no preset has {name}");
            assert!(least < most, "{name}");
        }
    }
}
