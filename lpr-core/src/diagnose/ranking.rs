//! What the ranker knows: its choice against the best candidate, its order within a set, and its
//! values against what came.

use super::reference::Reference;
use crate::agent::{Agent, Draws, Goal};
use crate::error::Result;
use crate::in_order::map_in_order;
use crate::path::CandidateStreams;
use crate::ranker::{RankedPath, Ranker, RankerContext};

use serde::Serialize;

/// Bins of the reliability diagram.
const BINS: usize = 10;

/// The candidates of a keyframe, each executed from the state that the demonstrator leaves.
#[derive(Debug, Clone)]
pub(super) struct RankedSet {
    is_last: bool,
    context: RankerContext,
    paths: Vec<RankedPath>,
    /// True for those that did what the demonstrator did.
    done: Vec<bool>,
}

/// The sets of all keyframes of `references`, with the demonstrator's poses.
pub(super) fn ranked_sets(agent: &Agent, references: &[Reference]) -> Result<Vec<RankedSet>> {
    let mut sets = Vec::new();
    for reference in references {
        for (step, snapshot) in (0_u64..).zip(&reference.keyframes) {
            let streams = CandidateStreams { seed: reference.scene_seed, step };
            let goal = Goal::given(snapshot.env.clone().observe(), snapshot.goal);
            let action = agent.act(goal, Draws::greedy(streams))?;
            let done = snapshot.trials(&action.set).iter().map(|trial| trial.success).collect();
            let candidates = action.set.candidates.into_iter();
            let ranked =
                candidates.map(|one| RankedPath { path: one.path, collides: one.collides });
            let (context, is_last) = (action.context, snapshot.is_last);
            sets.push(RankedSet { is_last, context, paths: ranked.collect(), done });
        }
    }
    Ok(sets)
}

/// What a ranker makes of sets whose outcomes are known.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ranking {
    /// Environment steps of the run when this ranker was saved.
    pub env_steps: u64,
    /// Sets with a candidate that does what the demonstrator does.
    pub sets: usize,
    /// Share of these sets in which the chosen candidate does not.
    pub regret: Option<f64>,
    /// Share of the pairs of a candidate that does and one that does not in which the former has
    /// the higher value; ties count half.
    pub accuracy: Option<f64>,
    /// Mean squared difference of value and outcome over the candidates of the last keyframes,
    /// whose outcome is the reward.
    pub brier: Option<f64>,
    /// The same for a value that is always the share of successes: what a ranker that knows
    /// nothing can reach.
    pub brier_of_mean: Option<f64>,
    /// Value against outcome over the candidates of the last keyframes.
    pub reliability: Vec<ReliabilityBin>,
}

/// Candidates with similar values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ReliabilityBin {
    /// Candidates in the bin.
    pub candidates: usize,
    /// Mean of their values.
    pub value: f64,
    /// Share of them that succeed.
    pub successes: f64,
}

/// What `ranker`, saved after `env_steps`, makes of `sets`.
pub(super) fn ranking(ranker: &Ranker, env_steps: u64, sets: &[RankedSet]) -> Result<Ranking> {
    let values =
        map_in_order(sets.len(), |idx| ranker.values(&sets[idx].context, &sets[idx].paths));
    let values = values.into_iter().collect::<Result<Vec<_>>>()?;
    let (mut decisive, mut missed) = (0, 0);
    let (mut pairs, mut ordered) = (0.0, 0.0);
    let mut at_the_end = Vec::new();
    for (set, values) in sets.iter().zip(&values) {
        if set.is_last {
            at_the_end.extend(values.iter().copied().zip(set.done.iter().copied()));
        }
        if !set.done.contains(&true) {
            continue;
        }
        decisive += 1;
        // The first of the highest, as the agent chooses.
        let chosen = (0..values.len()).rev().max_by(|&a, &b| values[a].total_cmp(&values[b]));
        missed += usize::from(!chosen.is_some_and(|idx| set.done[idx]));
        for (good, _) in values.iter().zip(&set.done).filter(|(_, done)| **done) {
            for (bad, _) in values.iter().zip(&set.done).filter(|(_, done)| !**done) {
                pairs += 1.0;
                ordered += if good > bad { 1.0 } else { 0.5 * f64::from(u8::from(good == bad)) };
            }
        }
    }
    let n = at_the_end.len() as f64;
    let outcome = |done: bool| f64::from(u8::from(done));
    let mean = at_the_end.iter().map(|(_, done)| outcome(*done)).sum::<f64>() / n;
    let square = |x: f64| x * x;
    let brier = at_the_end
        .iter()
        .map(|(value, done)| square(f64::from(*value) - outcome(*done)))
        .sum::<f64>()
        / n;
    Ok(Ranking {
        env_steps,
        sets: decisive,
        regret: (decisive > 0).then(|| f64::from(missed as u32) / f64::from(decisive as u32)),
        accuracy: (pairs > 0.0).then(|| ordered / pairs),
        brier: (n > 0.0).then_some(brier),
        brier_of_mean: (n > 0.0).then_some(mean * (1.0 - mean)),
        reliability: reliability(&at_the_end),
    })
}

/// The bins that hold something.
fn reliability(candidates: &[(f32, bool)]) -> Vec<ReliabilityBin> {
    let bin_of = |value: f32| ((value.clamp(0.0, 1.0) * BINS as f32) as usize).min(BINS - 1);
    let bin = |bin: usize| {
        let here: Vec<_> = candidates.iter().filter(|(value, _)| bin_of(*value) == bin).collect();
        let n = here.len() as f64;
        (!here.is_empty()).then(|| ReliabilityBin {
            candidates: here.len(),
            value: here.iter().map(|(value, _)| f64::from(*value)).sum::<f64>() / n,
            successes: here.iter().filter(|(_, done)| *done).count() as f64 / n,
        })
    };
    (0..BINS).filter_map(bin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_in_bins_beside_what_came() {
        let bins = reliability(&[(0.05, false), (0.02, true), (0.95, true), (1.7, true)]);
        let counts: Vec<_> = bins.iter().map(|bin| (bin.candidates, bin.successes)).collect();
        assert_eq!(counts, [(2, 0.5), (2, 1.0)]);
        assert!((bins[0].value - 0.035).abs() < 1e-6);
    }
}
