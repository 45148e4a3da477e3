//! Intervals and tests for successes in the same scenes.

use lpr_core::rng::{Rng, Stream, stream};
use rand::RngExt as _;

/// Resamplings of [`interval`].
const RESAMPLINGS: usize = 4000;

/// A number of each scene, for each training seed of a task: 0 or 1 of a success, or a difference of
/// two methods.
pub(super) type Outcomes = Vec<Vec<f64>>;

/// The mean over tasks, which count alike.
pub(super) fn mean(tasks: &[Outcomes]) -> f64 {
    let task = |seeds: &Outcomes| {
        let all = seeds.iter().flatten();
        all.clone().sum::<f64>() / all.count() as f64
    };
    tasks.iter().map(task).sum::<f64>() / tasks.len() as f64
}

/// The 95 % interval of [`mean`] over training seeds and scenes: a bootstrap within each task, of
/// its seeds and of the scenes that they share.
pub(super) fn interval(tasks: &[Outcomes]) -> [f64; 2] {
    let rng = &mut stream(0, Stream::Explore, 0);
    let mut means: Vec<_> = (0..RESAMPLINGS).map(|_| resampled(tasks, rng)).collect();
    means.sort_by(f64::total_cmp);
    [0.025, 0.975].map(|share| means[(share * RESAMPLINGS as f64) as usize])
}

fn resampled(tasks: &[Outcomes], rng: &mut Rng) -> f64 {
    let mut sum = 0.0;
    for seeds in tasks {
        let n_scenes = seeds.iter().map(Vec::len).min().unwrap_or(0);
        let scenes: Vec<_> = (0..n_scenes).map(|_| rng.random_range(0..n_scenes)).collect();
        let seed_mean = |outcomes: &Vec<f64>| {
            scenes.iter().map(|&scene| outcomes[scene]).sum::<f64>() / n_scenes as f64
        };
        let drawn = (0..seeds.len()).map(|_| seed_mean(&seeds[rng.random_range(0..seeds.len())]));
        sum += drawn.sum::<f64>() / seeds.len() as f64;
    }
    sum / tasks.len() as f64
}

/// The exact test of `McNemar` (1947) that two methods succeed equally often: two-sided p of the pairs
/// in which `only_first` or `only_second` did.
pub(super) fn mcnemar(only_first: u64, only_second: u64) -> f64 {
    let n = only_first + only_second;
    let mut tail = 0.0;
    // Logarithm of n over k, over 2^n: the power itself is 0 beyond a thousand pairs.
    let mut log_term = -core::f64::consts::LN_2 * n as f64;
    for k in 0..=only_first.min(only_second) {
        tail += log_term.exp();
        log_term += ((n - k) as f64 / (k + 1) as f64).ln();
    }
    (2.0 * tail).min(1.0)
}

/// The p-values of one family after Holm (1979), in their order.
pub(super) fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<_> = (0..p.len()).collect();
    order.sort_by(|&a, &b| p[a].total_cmp(&p[b]));
    let mut adjusted = vec![0.0; p.len()];
    let mut largest = 0.0_f64;
    for (rank, &idx) in order.iter().enumerate() {
        largest = largest.max(p[idx] * (p.len() - rank) as f64).min(1.0);
        adjusted[idx] = largest;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mcnemar_is_twice_the_tail_of_fair_coins() {
        // 2 (1 + 10) / 2^10, 2 (1 + 15 + 105 + 455) / 2^15, 2 / 2^40.
        for (pairs, expected) in [
            ([0, 0], 1.0),
            ([5, 5], 1.0),
            ([1, 9], 0.021_484_375),
            ([12, 3], 0.035_156_25),
            ([0, 40], 1.818_989_403_545_856_5e-12),
        ] {
            let [first, second] = pairs;
            assert!((mcnemar(first, second) - expected).abs() < 1e-12 * expected.max(1e-3));
            assert_eq!(mcnemar(first, second), mcnemar(second, first));
        }
        assert_eq!(mcnemar(600, 600), 1.0, "as many pairs as a power of 0.5 cannot count");
    }

    #[test]
    fn holm_multiplies_by_what_is_left_and_never_falls() {
        let adjusted = holm(&[0.01, 0.04, 0.03, 0.6]);
        let expected = [0.04, 0.09, 0.09, 0.6];
        assert!(adjusted.iter().zip(expected).all(|(found, p)| (found - p).abs() < 1e-12));
    }

    #[test]
    fn the_interval_has_the_width_of_scenes_and_of_seeds() {
        let share = |successes: usize| (0..100).map(|idx| f64::from(idx < successes)).collect();
        let width = |tasks: &[Outcomes]| {
            let [low, high] = interval(tasks);
            assert!(low < mean(tasks) && mean(tasks) < high);
            high - low
        };
        // One seed: that of a binomial share, 2 x 1.96 standard errors.
        let one = width(&[vec![share(50)]]);
        assert!((one - 0.196).abs() < 0.02, "{one}");
        // Seeds that differ widen it, more tasks narrow it.
        assert!(width(&[vec![share(30), share(70)]]) > 1.5 * one);
        assert!(width(&[vec![share(50)], vec![share(50)], vec![share(50)]]) < 0.7 * one);
        assert_eq!(interval(&[vec![vec![1.0; 20]; 3]]), [1.0, 1.0]);
    }
}
