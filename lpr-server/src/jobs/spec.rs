//! Settings of a job: the options of `lpr train` as JSON, checked before the job is accepted.

use crate::run_options::{DEFAULT_MINUTES, DEFAULT_PRESET, check_minutes, check_trainable};
use lpr_core::agent::Method;
use lpr_core::config::Config;
use lpr_core::robot::{ROBOTS, Robot};
use lpr_core::sim::tasks::Task;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use serde_path_to_error::{Path, Segment};
use std::ffi::OsString;
use std::path::Path as FilePath;
use thiserror::Error;
use utoipa::ToSchema;

/// Most demonstrations of a job: a thousand times the default.
const MAX_DEMOS: u32 = 10_000;

/// Settings of a job. Each field is the option of `lpr train` of that name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JobSpec {
    /// The task, one of `GET /v1/tasks`.
    #[schema(example = "reach_target")]
    pub task: String,
    /// The arm: `xarm7` or `panda`.
    #[serde(default = "default_robot")]
    #[schema(default = "xarm7")]
    pub robot: String,
    /// The choice of paths: `lpr`, `lpr-no-policy` or `c2farm`.
    #[serde(default = "default_method")]
    #[schema(default = "lpr")]
    pub method: String,
    /// A built-in preset: `fast`, `paper` or `paper-narrow`.
    #[serde(default = "default_preset")]
    #[schema(default = "fast")]
    pub preset: String,
    /// Every setting, in the place of the preset's: the tables of a preset file as objects.
    #[serde(default)]
    #[schema(value_type = Option<Object>)]
    pub settings: Option<Map<String, Value>>,
    /// Demonstrations, in place of the preset's number.
    #[serde(default)]
    #[schema(maximum = 10_000)]
    pub demos: Option<u32>,
    /// True if next-best poses are the demonstrator's, so that only paths are learned.
    #[serde(default)]
    pub oracle_poses: bool,
    /// Seed of everything drawn, below 2^63.
    #[serde(default)]
    #[schema(maximum = 9_223_372_036_854_775_807_u64)]
    pub seed: u64,
    /// Environment steps after which it ends.
    #[serde(default)]
    pub env_steps: Option<u64>,
    /// Minutes of training after which it ends, above 0.
    #[serde(default = "default_minutes")]
    #[schema(default = 15.0, exclusive_minimum = 0.0)]
    pub minutes: f64,
    /// Training episodes in a row that succeeded after which it ends.
    #[serde(default)]
    pub stop_after_successes: Option<u64>,
}

fn default_robot() -> String {
    ROBOTS[0].name.clone()
}

fn default_method() -> String {
    Method::Lpr.name().to_owned()
}

fn default_preset() -> String {
    DEFAULT_PRESET.to_owned()
}

const fn default_minutes() -> f64 {
    DEFAULT_MINUTES
}

/// A value of a job's description that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{pointer}: {detail}")]
pub struct SpecError {
    /// Its place in the JSON, as RFC 6901 writes it.
    pub pointer: String,
    /// The error in it, in words.
    pub detail: String,
}

impl JobSpec {
    /// Checks every value as `lpr train` does before it starts.
    ///
    /// # Errors
    ///
    /// The first value that cannot be used.
    pub fn check(&self) -> Result<(), SpecError> {
        let at = |name: &str| {
            let pointer = format!("/{name}");
            move |detail: String| SpecError { pointer, detail }
        };
        Task::by_name(&self.task).map_err(reason_of).map_err(at("task"))?;
        Robot::by_name(&self.robot).map_err(reason_of).map_err(at("robot"))?;
        let method = Method::by_name(&self.method).map_err(reason_of).map_err(at("method"))?;
        check_trainable(method).map_err(at("method"))?;
        Config::preset(&self.preset).map_err(reason_of).map_err(at("preset"))?;
        check_minutes(self.minutes).map_err(at("minutes"))?;
        let numbers = [
            ("seed", Some(self.seed)),
            ("env_steps", self.env_steps),
            ("stop_after_successes", self.stop_after_successes),
        ];
        for (name, number) in numbers {
            check_number(number.unwrap_or(0)).map_err(at(name))?;
        }
        match self.demos {
            Some(demos) if demos > MAX_DEMOS => {
                Err(at("demos")(format!("expected at most {MAX_DEMOS}, found {demos}")))
            }
            _ => self.config().map(drop),
        }
    }

    /// The settings of the job that has settings of its own.
    ///
    /// # Errors
    ///
    /// The setting that is misspelt, missing, of the wrong type or out of its range.
    pub fn config(&self) -> Result<Option<Config>, SpecError> {
        let Some(settings) = &self.settings else { return Ok(None) };
        let config: Config = serde_path_to_error::deserialize(Value::Object(settings.clone()))
            .map_err(|error| SpecError {
                pointer: format!("/settings{}", pointer(error.path())),
                detail: error.inner().to_string(),
            })?;
        // Ranges are checked where files are read.
        match Config::from_toml(&config.to_toml()) {
            Ok(config) => Ok(Some(config)),
            Err(error) => Err(settings_error(&reason_of(error))),
        }
    }

    /// The arguments of `lpr` that train it in the directory `out`, with its own settings in the
    /// file `settings`.
    #[must_use]
    pub fn arguments(&self, out: &FilePath, settings: &FilePath) -> Vec<OsString> {
        let preset =
            if self.settings.is_some() { settings.as_os_str() } else { self.preset.as_ref() };
        let mut arguments: Vec<OsString> = vec!["train".into(), self.task.clone().into()];
        arguments.extend(["--out".into(), out.into(), "--preset".into(), preset.to_owned()]);
        let mut option = |name: &str, value: String| arguments.extend([name.into(), value.into()]);
        option("--robot", self.robot.clone());
        option("--method", self.method.clone());
        option("--seed", self.seed.to_string());
        option("--minutes", self.minutes.to_string());
        for (name, value) in [
            ("--demos", self.demos.map(u64::from)),
            ("--env-steps", self.env_steps),
            ("--stop-after-successes", self.stop_after_successes),
        ] {
            value.into_iter().for_each(|value| option(name, value.to_string()));
        }
        arguments.extend(self.oracle_poses.then(|| "--oracle-poses".into()));
        arguments
    }
}

/// Place of a value in its JSON document, as RFC 6901 writes it.
#[must_use]
pub fn pointer(path: &Path) -> String {
    let segments = path.iter().map(|segment| match segment {
        Segment::Seq { index } => format!("/{index}"),
        Segment::Map { key } => format!("/{}", key.replace('~', "~0").replace('/', "~1")),
        Segment::Enum { variant } => format!("/{variant}"),
        // Of a key that is no text: JSON has none.
        Segment::Unknown => String::new(),
    });
    segments.collect()
}

/// Checks that files and databases can hold a number.
fn check_number(number: u64) -> Result<(), String> {
    if i64::try_from(number).is_ok() {
        Ok(())
    } else {
        Err(format!("expected at most {}, found {number}", i64::MAX))
    }
}

/// The core's reason, without the word for the place where it looked.
fn reason_of(error: lpr_core::Error) -> String {
    match error {
        lpr_core::Error::Config(reason)
        | lpr_core::Error::Robot(reason)
        | lpr_core::Error::Environment(reason) => reason,
        other => other.to_string(),
    }
}

/// The core's words on a setting, `table.setting[index]: reason`, with the setting as a pointer.
fn settings_error(words: &str) -> SpecError {
    let is_path =
        |text: &str| text.chars().all(|c| c.is_ascii_alphanumeric() || "_.[]".contains(c));
    match words.split_once(": ") {
        Some((path, detail)) if is_path(path) => {
            let pointer = format!("/settings/{}", path.replace(['.', '['], "/").replace(']', ""));
            SpecError { pointer, detail: detail.to_owned() }
        }
        _ => SpecError { pointer: "/settings".to_owned(), detail: words.to_owned() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn spec(value: Value) -> JobSpec {
        serde_json::from_value(value).unwrap()
    }

    #[track_caller]
    fn refusal(value: Value) -> SpecError {
        spec(value).check().unwrap_err()
    }

    fn fast() -> Value {
        serde_json::to_value(Config::preset("fast").unwrap()).unwrap()
    }

    #[test]
    fn a_task_alone_has_the_defaults_of_the_command_line() {
        let spec = spec(json!({"task": "reach_target"}));
        spec.check().unwrap();
        let arguments = spec.arguments(FilePath::new("run"), FilePath::new("settings.toml"));
        let expected = "train reach_target --out run --preset fast --robot xarm7 --method lpr --seed 0 --minutes 15";
        assert_eq!(arguments.join(" ".as_ref()), expected);
    }

    #[test]
    fn every_option_goes_to_the_command_line() {
        let spec = spec(json!({
            "task": "open_drawer", "robot": "panda", "method": "c2farm", "settings": fast(), "demos": 3, "oracle_poses": true,
            "seed": 7, "env_steps": 24, "minutes": 0.5, "stop_after_successes": 2,
        }));
        spec.check().unwrap();
        let arguments = spec.arguments(FilePath::new("run"), FilePath::new("settings.toml"));
        let expected = "train open_drawer --out run --preset settings.toml --robot panda --method c2farm --seed 7 --minutes 0.5 \
                        --demos 3 --env-steps 24 --stop-after-successes 2 --oracle-poses";
        assert_eq!(arguments.join(" ".as_ref()), expected);
    }

    #[test]
    fn a_value_that_cannot_be_used_is_pointed_at() {
        for (value, pointer, says) in [
            (json!({"task": "make_coffee"}), "/task", "task: expected one of reach_target"),
            (
                json!({"task": "reach_target", "robot": "ur5"}),
                "/robot",
                "expected one of xarm7, panda",
            ),
            (
                json!({"task": "reach_target", "method": "guess"}),
                "/method",
                "method: expected one of lpr",
            ),
            (
                json!({"task": "reach_target", "method": "linear"}),
                "/method",
                "has nothing to train",
            ),
            // Not the name of a file, as on the command line.
            (
                json!({"task": "reach_target", "preset": "Cargo.toml"}),
                "/preset",
                "preset: expected one of fast, paper, paper-narrow, found 'Cargo.toml'",
            ),
            (json!({"task": "reach_target", "minutes": 0}), "/minutes", "above 0"),
            (
                json!({"task": "reach_target", "seed": u64::MAX}),
                "/seed",
                "expected at most 9223372036854775807",
            ),
            (json!({"task": "reach_target", "demos": 10_001}), "/demos", "expected at most 10000"),
            (
                json!({"task": "reach_target", "env_steps": 1_u64 << 63}),
                "/env_steps",
                "found 9223372036854775808",
            ),
        ] {
            let SpecError { pointer: found, detail } = refusal(value);
            assert!(found == pointer && detail.contains(says), "{found}: {detail}");
        }
    }

    #[test]
    fn a_setting_that_cannot_be_used_is_pointed_at() {
        let changed = |pointer: &str, value: Value| {
            let mut settings = fast();
            *settings.pointer_mut(pointer).unwrap() = value;
            refusal(json!({"task": "reach_target", "settings": settings}))
        };
        let error = changed("/candidates/bezier/sigma", json!(-1));
        assert_eq!(
            error.to_string(),
            "/settings/candidates/bezier/sigma: expected a finite number from 0, found -1"
        );
        let error = changed("/ranker/config_widths/1", json!(0));
        assert!(
            error.to_string().starts_with("/settings/ranker/config_widths/1: expected 1 to 8192"),
            "{error}"
        );
        let error = changed("/candidates/planner_paths", json!("many"));
        assert!(
            error
                .to_string()
                .starts_with("/settings/candidates/planner_paths: invalid type: string"),
            "{error}"
        );
        let mut settings = fast();
        settings["candidates"]["bezeir"] = json!(1);
        let error = refusal(json!({"task": "reach_target", "settings": settings}));
        assert!(
            error.pointer.starts_with("/settings/candidates")
                && error.detail.contains("unknown field `bezeir`"),
            "{error}"
        );
        let error = refusal(json!({"task": "reach_target", "settings": {}}));
        assert!(
            error.pointer == "/settings" && error.detail.contains("missing field `candidates`"),
            "{error}"
        );
    }

    #[test]
    fn settings_in_json_are_those_of_the_file() {
        let spec = spec(json!({"task": "reach_target", "settings": fast()}));
        assert_eq!(spec.config().unwrap(), Some(Config::preset("fast").unwrap()));
    }
}
