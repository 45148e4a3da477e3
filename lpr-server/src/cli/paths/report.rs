//! The report of `lpr paths`: a row for every draw, and shares by generator and by keyframe.

use core::fmt;
use lpr_core::path::{CandidateSet, Source};
use lpr_core::robot::{JointConfig, Robot};
use lpr_core::sim::feasibility::Trial;
use lpr_core::sim::tasks::Task;
use serde::Serialize;

#[derive(Debug, Serialize)]
pub(in crate::cli) struct Report {
    task: String,
    robot: String,
    episodes: u32,
    /// Scene seeds whose demonstration failed, so that they have no keyframes.
    skipped_seeds: Vec<u64>,
    /// Every candidate, and every draw that gave none.
    candidates: Vec<CandidateRow>,
    summary: Summary,
    keyframes: Vec<KeyframeRow>,
}

#[derive(Debug, Serialize)]
struct CandidateRow {
    episode: u32,
    keyframe: usize,
    source: &'static str,
    collides: Option<bool>,
    /// Length in configuration space, radians.
    length: Option<f32>,
    /// The ranker's value: none without a checkpoint.
    value: Option<f32>,
    /// Reason why the draw gave no candidate.
    rejected: Option<&'static str>,
    executed: bool,
    success: Option<bool>,
    /// Reason why the execution did not succeed.
    reason: Option<&'static str>,
    path: Option<Vec<JointConfig>>,
}

/// Counts over everything that was drawn.
#[derive(Debug, Default, Serialize)]
struct Summary {
    planner: SourceRow,
    bezier: SourceRow,
    /// Only where it is asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    screw: Option<SourceRow>,
    /// Only with a checkpoint whose agent has a policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    policy: Option<SourceRow>,
    /// Share of the keyframes at which some candidate succeeds; none without `--execute`.
    best_of_all: Option<f64>,
}

#[derive(Debug, Clone, Copy, Default, Serialize)]
struct SourceRow {
    drawn: u32,
    admitted: u32,
    /// None without `--execute`.
    successes: Option<u32>,
}

/// Shares of successes at one keyframe, means over the episodes; none without `--execute`.
#[derive(Debug, Serialize)]
struct KeyframeRow {
    keyframe: usize,
    /// Episodes that got there.
    snapshots: usize,
    /// Candidates of a set.
    admitted: f64,
    /// The straight line of the grip.
    linear: Option<f64>,
    /// The shortest candidate that does not collide.
    shortest_free: Option<f64>,
    planner: Option<f64>,
    bezier: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    screw: Option<f64>,
    /// Any candidate.
    random: Option<f64>,
    /// Some candidate.
    best_of_all: Option<f64>,
}

/// One keyframe of one episode with its candidates.
pub(super) struct Drawn {
    pub(super) episode: u32,
    pub(super) keyframe: usize,
    pub(super) set: CandidateSet,
    /// One for each candidate; none without a ranker.
    pub(super) values: Option<Vec<f32>>,
    pub(super) executed: Option<Executed>,
}

pub(super) struct Executed {
    pub(super) trials: Vec<Trial>,
    pub(super) linear: Option<Trial>,
}

impl Report {
    /// The report of what was `drawn` in `episodes` demonstrations of `task`; those of
    /// `skipped_seeds` failed.
    pub(super) fn new(
        task: &Task,
        robot: &Robot,
        episodes: u32,
        skipped_seeds: Vec<u64>,
        drawn: &[Drawn],
    ) -> Self {
        Self {
            task: task.name.clone(),
            robot: robot.name.clone(),
            episodes,
            skipped_seeds,
            candidates: drawn.iter().flat_map(Drawn::rows).collect(),
            summary: summary(drawn),
            keyframes: (0..task.keyframes)
                .filter_map(|keyframe| keyframe_row(keyframe, drawn))
                .collect(),
        }
    }
}

impl Drawn {
    /// A row for each candidate, then one for each draw that gave none.
    fn rows(&self) -> Vec<CandidateRow> {
        let Self { episode, keyframe, set, values, executed } = self;
        let blank = |source: Source| CandidateRow {
            episode: *episode,
            keyframe: *keyframe,
            source: source.name(),
            collides: None,
            length: None,
            value: None,
            rejected: None,
            executed: false,
            success: None,
            reason: None,
            path: None,
        };
        let admitted = set.candidates.iter().enumerate().map(|(idx, candidate)| {
            let trial = executed.as_ref().map(|executed| &executed.trials[idx]);
            CandidateRow {
                collides: Some(candidate.collides),
                length: Some(candidate.path.length()),
                value: values.as_ref().map(|values| values[idx]),
                executed: trial.is_some(),
                success: trial.map(|trial| trial.success),
                reason: trial.and_then(failure),
                path: Some(candidate.path.configs().to_vec()),
                ..blank(candidate.source)
            }
        });
        let rejected = set.rejected.iter().map(|rejected| CandidateRow {
            rejected: Some(rejected.reason.name()),
            ..blank(rejected.source)
        });
        admitted.chain(rejected).collect()
    }

    /// Share of successes among the executed candidates that `chosen` picks.
    fn share(&self, chosen: impl Fn(&Trial) -> bool) -> Option<f64> {
        let trials = self.executed.as_ref()?.trials.iter().filter(|trial| chosen(trial));
        mean(trials.map(|trial| is(trial.success)))
    }

    fn best_of_all(&self) -> Option<f64> {
        self.executed.as_ref().map(|executed| is(executed.trials.iter().any(|trial| trial.success)))
    }

    /// Success of the shortest free candidate; where none is free that is a failure.
    fn shortest_free(&self) -> Option<f64> {
        let executed = self.executed.as_ref()?;
        let shortest = self.set.shortest_free();
        let trial = shortest.and_then(|shortest| {
            self.set.candidates.iter().position(|candidate| candidate == shortest)
        });
        Some(is(trial.is_some_and(|idx| executed.trials[idx].success)))
    }

    fn linear(&self) -> Option<f64> {
        self.executed
            .as_ref()
            .map(|executed| is(executed.linear.as_ref().is_some_and(|trial| trial.success)))
    }
}

/// Reason why an executed candidate did not succeed: the event that made it end, or that it did not
/// do what the demonstrator did.
fn failure(trial: &Trial) -> Option<&'static str> {
    (!trial.success).then(|| trial.result.invalid.map_or("not_done", |invalid| invalid.name()))
}

fn is(success: bool) -> f64 {
    f64::from(u8::from(success))
}

/// None of nothing.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (n, sum) = values.fold((0_u32, 0.0), |(n, sum), value| (n + 1, sum + value));
    (n > 0).then(|| sum / f64::from(n))
}

fn summary(drawn: &[Drawn]) -> Summary {
    let if_drawn = |source| Some(source_row(source, drawn)).filter(|row| row.drawn > 0);
    Summary {
        planner: source_row(Source::Planner, drawn),
        bezier: source_row(Source::Bezier, drawn),
        screw: if_drawn(Source::Screw),
        policy: if_drawn(Source::Policy),
        best_of_all: mean(drawn.iter().filter_map(Drawn::best_of_all)),
    }
}

fn source_row(source: Source, drawn: &[Drawn]) -> SourceRow {
    let mut row = SourceRow::default();
    for Drawn { set, executed, .. } in drawn {
        let admitted =
            set.candidates.iter().filter(|candidate| candidate.source == source).count() as u32;
        row.admitted += admitted;
        row.drawn += admitted
            + set.rejected.iter().filter(|rejected| rejected.source == source).count() as u32;
        if let Some(Executed { trials, .. }) = executed {
            let successes =
                trials.iter().filter(|trial| trial.source == source && trial.success).count()
                    as u32;
            *row.successes.get_or_insert(0) += successes;
        }
    }
    row
}

/// The shares at one keyframe; none when no episode has it.
fn keyframe_row(keyframe: usize, drawn: &[Drawn]) -> Option<KeyframeRow> {
    let here: Vec<_> = drawn.iter().filter(|drawn| drawn.keyframe == keyframe).collect();
    let share =
        |of: &dyn Fn(&Drawn) -> Option<f64>| mean(here.iter().filter_map(|drawn| of(drawn)));
    Some(KeyframeRow {
        keyframe,
        snapshots: here.len(),
        admitted: mean(here.iter().map(|drawn| drawn.set.candidates.len() as f64))?,
        linear: share(&Drawn::linear),
        shortest_free: share(&Drawn::shortest_free),
        planner: share(&|drawn| drawn.share(|trial| trial.source == Source::Planner)),
        bezier: share(&|drawn| drawn.share(|trial| trial.source == Source::Bezier)),
        screw: share(&|drawn| drawn.share(|trial| trial.source == Source::Screw)),
        random: share(&|drawn| drawn.share(|_| true)),
        best_of_all: share(&Drawn::best_of_all),
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { task, robot, episodes, skipped_seeds, keyframes, summary, .. } = self;
        writeln!(
            f,
            "{task}, {robot}: {} of {episodes} episodes",
            *episodes as usize - skipped_seeds.len()
        )?;
        let rows = [Some(summary.planner), Some(summary.bezier), summary.screw, summary.policy];
        let rows = ["planner", "bezier", "screw", "policy"].into_iter().zip(rows);
        for (source, row) in rows.filter_map(|(source, row)| Some((source, row?))) {
            write!(f, "  {source:<8} {:>5} drawn {:>5} admitted", row.drawn, row.admitted)?;
            row.successes.map_or(Ok(()), |successes| write!(f, " {successes:>5} successes"))?;
            writeln!(f)?;
        }
        writeln!(
            f,
            "keyframe  episodes  candidates  linear  shortest-free  planner  bezier  random  best-of-all"
        )?;
        let percent = |share: Option<f64>| {
            share.map_or("-".to_owned(), |share| format!("{:.0}%", 100.0 * share))
        };
        for row in keyframes {
            write!(f, "{:>8}  {:>8}  {:>10.1}", row.keyframe, row.snapshots, row.admitted)?;
            let shares = [
                row.linear,
                row.shortest_free,
                row.planner,
                row.bezier,
                row.random,
                row.best_of_all,
            ];
            for (share, width) in shares.into_iter().zip([8, 15, 9, 8, 8, 13]) {
                write!(f, "{:>width$}", percent(share))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
