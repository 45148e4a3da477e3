//! A run as people see it: a progress bar, lines on standard error, and its speed.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lpr_core::agent::Agent;
use lpr_core::train::Metrics;
use std::io::{self, Write as _};
use std::time::Instant;

/// Time left from which on a phase tells it without a bar, seconds.
const LONG: f64 = 10.0;
/// Metrics that the bar shows, with their short names.
const SHOWN_METRICS: [(&str, &str); 3] = [
    ("losses/q_attention", "pose loss"),
    ("losses/ranker", "ranker loss"),
    ("losses/policy", "policy loss"),
];

/// A part of a run that takes time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub(super) enum Phase {
    Demonstrations,
    #[strum(serialize = "updates on demonstrations")]
    DemonstrationUpdates,
    Training,
    Validation,
    #[strum(serialize = "final evaluation")]
    FinalEvaluation,
    Diagnosis,
}

/// The end of training, of which the sooner counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Environment steps, if they were asked for.
    pub(super) env_steps: Option<u64>,
    /// Seconds of the whole run.
    pub(super) seconds: f64,
}

/// The bar of a run's phases; where standard error is no terminal, their lines alone.
#[derive(Debug)]
pub(super) struct Bar {
    bar: ProgressBar,
    limits: Limits,
    phase: Phase,
    /// Start of the phase.
    started: Instant,
    /// Parts of the phase.
    n_parts: u64,
    /// Without a bar, the time left is told once a phase.
    told: bool,
    success: Option<String>,
    losses: String,
}

impl Bar {
    pub(super) fn new(limits: Limits) -> Self {
        // Hidden where standard error is no terminal.
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{prefix} {bar:24} {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style);
        Self {
            bar,
            limits,
            phase: Phase::Demonstrations,
            started: Instant::now(),
            n_parts: 0,
            told: false,
            success: None,
            losses: String::new(),
        }
    }

    /// Starts a phase of `n_parts` with a line of its own.
    pub(super) fn announce(&mut self, phase: Phase, n_parts: u64, text: &str) {
        self.enter(phase, n_parts);
        self.say(&format!("{phase}: {text}"));
    }

    /// Starts a phase of `n_parts`.
    pub(super) fn enter(&mut self, phase: Phase, n_parts: u64) {
        self.phase = phase;
        self.started = Instant::now();
        self.n_parts = n_parts;
        self.told = false;
        self.bar.set_prefix(phase.to_string());
        self.bar.set_length(n_parts);
        self.bar.set_position(0);
        self.bar.set_message("");
    }

    /// Starts training, or goes on with it after a validation.
    pub(super) fn enter_training(&mut self) {
        let Limits { env_steps, seconds } = self.limits;
        self.enter(Phase::Training, env_steps.unwrap_or(seconds as u64));
    }

    /// Shows that `n_done` parts of a phase other than training are done.
    pub(super) fn advance(&mut self, n_done: u64) {
        let (phase, n_parts) = (self.phase, self.n_parts);
        let left = seconds_left(self.started.elapsed().as_secs_f64(), n_done, n_parts);
        self.bar.set_position(n_done);
        self.bar.set_message(format!("{n_done} of {n_parts}, about {left:.0} s left"));
        let is_known = 10 * n_done >= n_parts;
        if self.bar.is_hidden() && !self.told && is_known {
            self.told = true;
            if left > LONG {
                self.say(&format!("{phase}: {n_done} of {n_parts}, about {left:.0} s left"));
            }
        }
    }

    /// Shows how far training is after `env_steps` and `elapsed` seconds of the run.
    pub(super) fn show(&mut self, env_steps: u64, elapsed: f64, metrics: &Metrics) {
        if self.bar.is_hidden() {
            return;
        }
        let losses = SHOWN_METRICS
            .iter()
            .filter_map(|(name, short)| Some(format!("{short} {:.4}", metrics.get(name)?)));
        let losses: Vec<_> = losses.collect();
        if !losses.is_empty() {
            self.losses = losses.join(", ");
        }
        let by_steps = self.limits.env_steps.is_some();
        self.bar.set_position(if by_steps { env_steps } else { elapsed as u64 });
        let left = self.limits.seconds_left(env_steps, elapsed);
        let success = self.success.as_deref().unwrap_or("-");
        self.bar.set_message(format!(
            "step {env_steps}, success {success}, {}, at most {left:.0} s left",
            self.losses
        ));
    }

    /// Shows a validation's success from now on.
    pub(super) fn set_success(&mut self, successes: u64, episodes: u64) {
        self.success = Some(format!("{successes} of {episodes}"));
    }

    /// A line above the bar.
    pub(super) fn say(&self, text: &str) {
        self.bar.suspend(|| say(text));
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Limits {
    /// Seconds until the number of steps or the minutes end the run.
    fn seconds_left(&self, env_steps: u64, elapsed: f64) -> f64 {
        let of_cap = (self.seconds - elapsed).max(0.0);
        let of_steps = self
            .env_steps
            .filter(|_| env_steps > 0)
            .map(|most| seconds_left(elapsed, env_steps, most));
        of_steps.map_or(of_cap, |seconds| seconds.min(of_cap))
    }
}

/// Seconds that the rest of `n_parts` will take when the first `n_done` took `elapsed`.
fn seconds_left(elapsed: f64, n_done: u64, n_parts: u64) -> f64 {
    elapsed * n_parts.saturating_sub(n_done) as f64 / n_done.max(1) as f64
}

/// A line for people, on standard error; nobody may be listening.
fn say(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Updates that a run makes in a second, from its first ones.
#[derive(Debug)]
pub(super) struct Meter {
    updates: u64,
    seconds: f64,
    reported: bool,
}

impl Meter {
    /// Updates after which the rate is known.
    const UPDATES: u64 = 20;
    /// Seconds after which it is known with fewer.
    const SECONDS: f64 = 10.0;

    pub(super) const fn new() -> Self {
        Self { updates: 0, seconds: 0.0, reported: false }
    }

    /// Counts `updates` that ended now; the rate when it has just become known.
    pub(super) fn count(&mut self, updates: u64, since: Instant) -> Option<f64> {
        if self.reported || updates == 0 {
            return None;
        }
        self.updates += updates;
        self.seconds += since.elapsed().as_secs_f64();
        self.reported = self.updates >= Self::UPDATES || self.seconds >= Self::SECONDS;
        self.reported.then(|| self.updates as f64 / self.seconds.max(1e-9))
    }
}

/// The networks with their sizes, and how fast they learn here once that is known.
pub(super) fn networks_line(agent: &Agent, updates_per_second: Option<f64>) -> String {
    let costs = agent.networks.costs(agent.candidate_settings().path_len).into_iter().map(
        |(name, cost)| {
            let (millions, giga) = (cost.parameters as f64 / 1e6, cost.flops as f64 / 1e9);
            format!("{name} {millions:.3} M parameters, {giga:.4} GFLOP a forward")
        },
    );
    let rate =
        updates_per_second.map_or(String::new(), |rate| format!("; {rate:.2} updates per second"));
    format!("networks: {}{rate}", costs.collect::<Vec<_>>().join("; "))
}

/// What Q-attention learns with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Workload {
    /// Scenes of an update.
    pub(super) batch: usize,
    pub(super) updates_per_step: usize,
    /// Environment steps, if they were asked for.
    pub(super) env_steps: Option<u64>,
    pub(super) minutes: f64,
}

/// A warning of how long an update of Q-attention and the whole run will take, where that is long: `forward_seconds` for
/// a forward pass of one scene here.
pub(super) fn slowness(workload: Workload, forward_seconds: f64) -> Option<String> {
    /// Environment steps that are told where none were asked for.
    const STEPS: u64 = 1000;
    /// Passes of the batch in an update: online and target network on what came next, one pass with
    /// gradients, which costs three.
    const PASSES: f64 = 5.0;
    /// An update that takes less is not worth a warning, seconds.
    const SLOW: f64 = 1.0;
    let Workload { batch, updates_per_step, env_steps, minutes } = workload;
    let update = PASSES * batch as f64 * forward_seconds;
    let steps = env_steps.unwrap_or(STEPS);
    let hours = update * (updates_per_step as u64 * steps) as f64 / 3600.0;
    (update > SLOW).then(|| {
        format!(
            "slow: an update of Q-attention will take about {update:.0} s here ({batch} scenes, estimated from a forward pass of \
             {forward_seconds:.3} s), so that {minutes:.0} minutes hold about {:.0} updates, and all of {steps} environment steps would take \
             about {hours:.1} hours",
            60.0 * minutes / update
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_known_once() {
        let mut meter = Meter::new();
        let since = Instant::now();
        assert_eq!(meter.count(0, since), None);
        assert_eq!(meter.count(1, since), None);
        assert!(meter.count(Meter::UPDATES, since).unwrap() > 0.0);
        assert_eq!(meter.count(Meter::UPDATES, since), None);
    }

    #[test]
    fn only_slow_networks_are_warned_of() {
        let workload =
            Workload { batch: 128, updates_per_step: 1, env_steps: Some(4500), minutes: 15.0 };
        assert_eq!(slowness(Workload { batch: 16, ..workload }, 0.001), None);
        let text = slowness(workload, 0.1).unwrap();
        for part in
            ["about 64 s", "about 14 updates", "all of 4500 environment steps", "80.0 hours"]
        {
            assert!(text.contains(part), "{text}");
        }
        let text = slowness(Workload { env_steps: None, ..workload }, 0.1).unwrap();
        assert!(
            text.contains("all of 1000 environment steps would take about 17.8 hours"),
            "{text}"
        );
    }

    #[test]
    fn time_left_is_the_sooner_of_steps_and_minutes() {
        let limits = Limits { env_steps: Some(100), seconds: 60.0 };
        assert_eq!(limits.seconds_left(0, 10.0), 50.0);
        assert_eq!(limits.seconds_left(50, 10.0), 10.0);
        assert_eq!(limits.seconds_left(1, 10.0), 50.0);
        let by_time = Limits { env_steps: None, seconds: 60.0 };
        assert_eq!(by_time.seconds_left(50, 70.0), 0.0);
    }

    #[test]
    fn the_rest_of_a_phase_takes_as_long_as_what_is_done() {
        assert_eq!(seconds_left(12.0, 3, 10), 28.0);
        assert_eq!(seconds_left(12.0, 10, 10), 0.0);
        assert!(seconds_left(12.0, 0, 10).is_finite());
    }

    #[test]
    fn phases_are_told_in_words() {
        assert_eq!(Phase::DemonstrationUpdates.to_string(), "updates on demonstrations");
        assert_eq!(Phase::Training.to_string(), "training");
    }
}
