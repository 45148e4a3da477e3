//! What people see of a run: a progress bar, lines on standard error, and how fast it is.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lpr_core::agent::Agent;
use lpr_core::train::Metrics;
use std::io::{self, Write as _};
use std::time::Instant;

/// Metrics that the bar shows, with their short names.
const SHOWN_METRICS: [(&str, &str); 3] = [
    ("losses/q_attention", "pose loss"),
    ("losses/ranker", "ranker loss"),
    ("losses/policy", "policy loss"),
];

/// The bar of a run; nothing where standard error is no terminal.
#[derive(Debug)]
pub(super) struct Bar {
    bar: ProgressBar,
    /// Environment steps at which the run ends, if it was asked for.
    env_steps: Option<u64>,
    /// Seconds after which the run ends.
    seconds: f64,
    success: Option<String>,
    losses: String,
}

impl Bar {
    pub(super) fn new(env_steps: Option<u64>, seconds: f64) -> Self {
        let length = env_steps.unwrap_or(seconds as u64);
        // Hidden where standard error is no terminal.
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{bar:24} {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style);
        Self { bar, env_steps, seconds, success: None, losses: String::new() }
    }

    /// Shows how far the run is after `env_steps` and `elapsed` seconds.
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
        self.bar.set_position(if self.env_steps.is_some() { env_steps } else { elapsed as u64 });
        let left = self.seconds_left(env_steps, elapsed);
        let success = self.success.as_deref().unwrap_or("-");
        self.bar.set_message(format!(
            "step {env_steps}, success {success}, {}, at most {left:.0} s left",
            self.losses
        ));
    }

    /// What is left until the number of steps or the minutes end the run.
    fn seconds_left(&self, env_steps: u64, elapsed: f64) -> f64 {
        let of_cap = (self.seconds - elapsed).max(0.0);
        let of_steps = self
            .env_steps
            .filter(|_| env_steps > 0)
            .map(|most| elapsed * (most.saturating_sub(env_steps)) as f64 / env_steps as f64);
        of_steps.map_or(of_cap, |seconds| seconds.min(of_cap))
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

/// A line for people, on standard error; nobody may be listening.
fn say(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// How many updates a run makes in a second, from its first ones.
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

/// What an update of Q-attention will take where that is long: `forward_seconds` for a forward pass
/// of one scene here.
pub(super) fn slowness(batch: usize, forward_seconds: f64, minutes: f64) -> Option<String> {
    /// Passes of the batch in an update: online and target network on what came next, one pass with
    /// gradients, which costs three.
    const PASSES: f64 = 5.0;
    /// An update that takes less is not worth a warning, seconds.
    const SLOW: f64 = 1.0;
    let update = PASSES * batch as f64 * forward_seconds;
    (update > SLOW).then(|| {
        format!(
            "slow: an update of Q-attention will take about {update:.0} s here ({batch} scenes, estimated from a forward pass of \
             {forward_seconds:.3} s), so that {minutes:.0} minutes hold about {:.0} updates",
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
        assert_eq!(slowness(16, 0.001, 15.0), None);
        let text = slowness(128, 0.1, 15.0).unwrap();
        assert!(text.contains("about 64 s") && text.contains("about 14 updates"), "{text}");
    }

    #[test]
    fn time_left_is_the_sooner_of_steps_and_minutes() {
        let bar = Bar::new(Some(100), 60.0);
        assert_eq!(bar.seconds_left(0, 10.0), 50.0);
        assert_eq!(bar.seconds_left(50, 10.0), 10.0);
        assert_eq!(bar.seconds_left(1, 10.0), 50.0);
        assert_eq!(Bar::new(None, 60.0).seconds_left(50, 70.0), 0.0);
    }
}
