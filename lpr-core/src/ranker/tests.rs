use super::*;
use crate::nn::GradientClip;
use crate::rng::{Stream, stream};
use crate::robot::{Gripper, PANDA};

use glamx::{Pose3, Quat, Vec3};
use rand::RngExt as _;

fn settings() -> RankerSettings {
    RankerSettings {
        objective: Objective::TemporalDifference,
        sampling: Sampling::Prioritised,
        acting_weights: ActingNetwork::Online,
        input: RankerInput::Context,
        config_widths: vec![32, 64],
        head_widths: vec![32],
        critics: Critics::Single,
        target_range: TargetRange::Unbounded,
        discount: 0.99,
        target_mix: 0.05,
        adam: AdamSettings { learning_rate: 3e-3, l2: 0.0, clip: GradientClip::None },
    }
}

fn ranker(settings: &RankerSettings, seed: u64) -> Ranker {
    Ranker::new(settings, &PANDA, Backend::Flex, &mut stream(seed, Stream::Init, 0))
        .expect("valid settings")
}

fn context() -> RankerContext {
    let pose = Pose3::from_parts(Vec3::new(0.4, 0.1, 0.2), Quat::from_rotation_x(3.0));
    RankerContext {
        goal: NextBestPose { pose, gripper: Gripper::Close },
        gripper_open: 1.0,
        time: 0.5,
    }
}

/// A path of eight configurations from the start to a fixed goal, bent by `bend` radians at
/// every joint.
fn bent_path(bend: f32) -> RankedPath {
    let goal = PANDA.start.map(|q| q + 0.5);
    let configs = (0..8).map(|idx| {
        let s = idx as f32 / 7.0;
        PANDA.start.lerp(&goal, s).map(|q| q + 4.0 * s * (1.0 - s) * bend)
    });
    RankedPath {
        path: JointPath::new(configs.collect()).expect("eight configurations"),
        collides: false,
    }
}

fn random_paths(n: usize, rng: &mut Rng) -> Vec<RankedPath> {
    (0..n).map(|_| bent_path(rng.random_range(-1.0..1.0))).collect()
}

fn transition<'a>(
    taken: &'a RankedPath,
    next: Option<&'a RankedPath>,
    context: &'a RankerContext,
) -> RankerTransition<'a> {
    let sample = |path| RankerSample { context, path };
    RankerTransition {
        taken: sample(taken),
        reward: 0.7,
        next: next.map(sample),
        outcome: 0.0,
        weight: 1.0,
    }
}

#[test]
fn the_target_is_the_reward_alone_when_the_episode_terminated() {
    let (ranker, context) = (ranker(&settings(), 1), context());
    let (taken, next) = (bent_path(0.1), bent_path(-0.3));
    let batch = [transition(&taken, None, &context), transition(&taken, Some(&next), &context)];
    let targets = ranker.targets(&batch).expect("a valid batch");
    let value = ranker.values(&context, &[next]).expect("one path")[0];
    assert_eq!(targets[0].to_bits(), 0.7_f32.to_bits());
    assert_eq!(targets[1], 0.7 + 0.99 * value);
}

#[test]
fn the_order_of_configurations_between_the_ends_does_not_matter_and_the_context_does() {
    let (context, path) = (context(), bent_path(0.4));
    let mut configs = path.path.configs().to_vec();
    configs[1..7].reverse();
    let shuffled = RankedPath {
        path: JointPath::new(configs).expect("eight configurations"),
        collides: false,
    };
    let colliding = RankedPath { collides: true, ..path.clone() };
    let paths = [path, shuffled, colliding];
    let values = |input| {
        ranker(&RankerSettings { input, ..settings() }, 2)
            .values(&context, &paths)
            .expect("three paths")
    };
    let seen = values(RankerInput::Context);
    assert_eq!(seen[0], seen[1]);
    assert_ne!(seen[0], seen[2]);
    let unseen = values(RankerInput::Joints);
    assert_eq!(unseen[0], unseen[2]);
}

#[test]
fn twin_critics_rank_by_their_mean_and_bootstrap_from_the_smaller() {
    let settings = RankerSettings { critics: Critics::Twin, ..settings() };
    let (ranker, context) = (ranker(&settings, 3), context());
    let path = bent_path(0.2);
    let sample = RankerSample { context: &context, path: &path };
    let per_critic = ranker
        .target
        .forward(&ranker.encoding.encode(&[sample], &ranker.device).expect("one path"));
    let (a, b) = (per_critic[0][0], per_critic[1][0]);
    assert_ne!(a, b);
    let target =
        ranker.targets(&[transition(&path, Some(&path), &context)]).expect("a valid batch")[0];
    assert_eq!(target, 0.7 + 0.99 * a.min(b));
    assert_eq!(ranker.values(&context, &[path]).expect("one path"), [(a + b) / 2.0]);
}

#[test]
fn an_ensemble_has_as_many_critics_as_it_says_and_cannot_be_empty() {
    let with = |critics| RankerSettings { critics: Critics::Ensemble(critics), ..settings() };
    let (ranker, context) = (ranker(&with(4), 3), context());
    let by_critic = ranker.values_by_critic(&context, &[bent_path(0.2)]).expect("one path");
    assert_eq!(by_critic.len(), 4);
    assert!((1..4).all(|idx| by_critic[idx] != by_critic[0]));
    for count in [0, 17, usize::MAX] {
        let refused =
            Ranker::new(&with(count), &PANDA, Backend::Flex, &mut stream(0, Stream::Init, 0));
        let message = refused.expect_err("too few or too many").to_string();
        assert!(message.contains("ranker.critics") && message.contains(&count.to_string()));
    }
}

#[test]
fn cross_entropy_is_its_formula_and_finite_however_sure_the_network_is() {
    let device = Backend::Flex.device();
    let logits = [-200.0_f32, -3.0, 0.0, 0.5, 4.0, 200.0];
    for outcome in [0.0_f32, 1.0] {
        let n = logits.len();
        let found = values(cross_entropy(
            tensor(logits.to_vec(), [n], &device),
            tensor(vec![outcome; n], [n], &device),
        ));
        for (&logit, found) in logits.iter().zip(found) {
            let p = 1.0 / (1.0 + (-f64::from(logit)).exp());
            let (p, outcome) = (p.clamp(1e-87, 1.0 - 1e-16), f64::from(outcome));
            let expected = -outcome * p.ln() - (1.0 - outcome) * (1.0 - p).ln();
            let is_near = (f64::from(found) - expected).abs() < 1e-4 * (1.0 + expected);
            assert!(is_near || logit.abs() > 30.0 && found.is_finite(), "{logit}: {found}");
        }
    }
}

#[test]
fn outcomes_are_probabilities_that_rewards_and_next_paths_do_not_change() {
    let settings = RankerSettings { objective: Objective::Outcome, ..settings() };
    let context = context();
    let [good, bad, other] = [0.6, -0.6, 0.1].map(bent_path);
    let mut ranker = ranker(&settings, 8);
    for _ in 0..200 {
        let batch = [
            RankerTransition { outcome: 1.0, ..transition(&good, Some(&other), &context) },
            RankerTransition { reward: 9.0, ..transition(&bad, None, &context) },
        ];
        ranker.update(&batch).expect("a valid batch");
    }
    let values = ranker.values(&context, &[good, bad]).expect("two paths");
    assert!(values[0] > 0.95 && values[0] <= 1.0, "{values:?}");
    assert!(values[1] < 0.05 && values[1] >= 0.0, "{values:?}");
}

#[test]
fn a_running_mean_ranks_where_it_is_asked_to() {
    let settings = RankerSettings { acting_weights: ActingNetwork::Target, ..settings() };
    let (mut ranker, context, path) = (ranker(&settings, 8), context(), bent_path(0.3));
    let value = |ranker: &Ranker| {
        ranker.values(&context, core::slice::from_ref(&path)).expect("one path")[0]
    };
    let before = value(&ranker);
    let online = ranker.online.clone();
    ranker.update(&[transition(&path, None, &context)]).expect("a valid batch");
    let after = value(&ranker);
    // The same update read from the weights that gradients change moves the value farther.
    ranker.settings.acting_weights = ActingNetwork::Online;
    let moved = value(&ranker);
    assert!((after - before).abs() < 0.2 * (moved - before).abs(), "{before} {after} {moved}");
    ranker.online = online;
    assert_eq!(value(&ranker), before);
}

#[test]
fn the_same_motion_elsewhere_is_the_same_input_where_motion_is() {
    // The first joint of the Panda turns it about the vertical.
    const YAW: f32 = 0.4;
    let context = context();
    let path = bent_path(0.3);
    let turn = Pose3::from_rotation(Quat::from_rotation_z(YAW));
    let goal = NextBestPose { pose: turn * context.goal.pose, ..context.goal };
    let turned_context = RankerContext { goal, ..context };
    let configs = path.path.configs().iter().map(|config| {
        let mut turned = *config;
        turned[0] += YAW;
        turned
    });
    let turned = JointPath::new(configs.collect()).expect("eight configurations");
    let turned = RankedPath { path: turned, collides: false };
    let change = |input| {
        let ranker = ranker(&RankerSettings { input, ..settings() }, 4);
        let value = |context, path| ranker.values(context, &[path]).expect("one path")[0];
        (value(&context, path.clone()) - value(&turned_context, turned.clone())).abs()
    };
    assert!(change(RankerInput::Motion) < 1e-4, "{}", change(RankerInput::Motion));
    for input in [RankerInput::Joints, RankerInput::Context, RankerInput::Grip, RankerInput::Chord]
    {
        assert!(change(input) > 1e-3, "{input:?}: {}", change(input));
    }
}

#[test]
fn it_learns_which_kind_of_path_is_rewarded() {
    // Three kinds of path lead to the goal, and only the one bent upwards opens the drawer.
    let kinds = [0.0, 0.6, -0.6];
    let context = context();
    for seed in 0..3 {
        let mut ranker = ranker(&settings(), seed);
        let mut rng = stream(seed, Stream::Replay, 0);
        let mut around = |bend: f32| bent_path(bend + rng.random_range(-0.15..0.15));
        for update in 0..150 {
            let paths: Vec<_> = (0..24).map(|idx| around(kinds[(idx + update) % 3])).collect();
            let taken = |(idx, path)| {
                let reward = if (idx + update) % 3 == 1 { 1.0 } else { 0.0 };
                RankerTransition { reward, ..transition(path, None, &context) }
            };
            let batch: Vec<_> = paths.iter().enumerate().map(taken).collect();
            ranker.update(&batch).expect("a valid batch");
        }
        let candidates: Vec<_> = (0..30).map(|idx| around(kinds[idx % 3])).collect();
        let values = ranker.values(&context, &candidates).expect("paths of one length");
        let best = (0..30).max_by(|&a, &b| values[a].total_cmp(&values[b])).expect("thirty paths");
        assert_eq!(best % 3, 1, "seed {seed}: {values:?}");
        let worst_good = (1..30).step_by(3).map(|idx| values[idx]).fold(f32::INFINITY, f32::min);
        let best_bad = (0..30)
            .filter(|idx| idx % 3 != 1)
            .map(|idx| values[idx])
            .fold(f32::NEG_INFINITY, f32::max);
        assert!(worst_good > best_bad, "seed {seed}: {values:?}");
    }
}

/// Losses of `n` updates on random batches.
fn losses(ranker: &mut Ranker, n: u64) -> Vec<u32> {
    let context = context();
    (0..n)
        .map(|idx| {
            let mut rng = stream(9, Stream::Replay, idx);
            let (taken, next) = (random_paths(16, &mut rng), random_paths(16, &mut rng));
            let batch: Vec<_> = taken
                .iter()
                .zip(&next)
                .map(|(taken, next)| transition(taken, Some(next), &context))
                .collect();
            ranker.update(&batch).expect("a valid batch").loss.to_bits()
        })
        .collect()
}

#[cfg(feature = "parallel")]
#[test]
fn the_same_seed_gives_the_same_losses_for_any_thread_count() {
    // Wide enough for every matrix product to be split.
    let settings =
        RankerSettings { config_widths: vec![64, 256], head_widths: vec![256], ..settings() };
    let run = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool");
        pool.install(|| losses(&mut ranker(&settings, 4), 20))
    };
    let alone = run(1);
    assert_eq!(alone, run(1));
    assert_eq!(alone, run(2));
    assert_eq!(alone, run(5));
    assert!(f32::from_bits(alone[19]) < f32::from_bits(alone[0]));
}

#[test]
fn a_restored_ranker_goes_on_bit_by_bit() {
    let mut straight = ranker(&settings(), 5);
    losses(&mut straight, 3);
    let mut resumed = ranker(&settings(), 6);
    resumed.restore(&straight.state()).expect("the same settings");
    assert_eq!(losses(&mut straight, 5), losses(&mut resumed, 5));
    assert_eq!(straight.state(), resumed.state());
    let other = ranker(&RankerSettings { head_widths: vec![31], ..settings() }, 5);
    assert!(resumed.restore(&other.state()).is_err());
}

#[test]
fn broken_input_is_an_error() {
    let (mut ranker, context) = (ranker(&settings(), 1), context());
    let short = RankedPath { path: bent_path(0.0).path.resample(3), collides: false };
    let paths = [bent_path(0.0), short];
    assert!(ranker.values(&context, &paths).is_err());
    assert!(
        ranker
            .update(&[transition(&paths[0], None, &context), transition(&paths[1], None, &context)])
            .is_err()
    );
    assert!(ranker.update(&[]).is_err());
    assert_eq!(ranker.values(&context, &[]), Ok(vec![]));
    let build = |settings: RankerSettings| {
        Ranker::new(&settings, &PANDA, Backend::Flex, &mut stream(0, Stream::Init, 0))
    };
    assert!(build(RankerSettings { config_widths: vec![], ..settings() }).is_err());
    assert!(build(RankerSettings { discount: 1.5, ..settings() }).is_err());
}
