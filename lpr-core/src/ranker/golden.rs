//! Three updates of small rankers beside `PyTorch` (`tests/peers/networks.py`).

use super::*;
use crate::features::golden::GoldenGoal;
use crate::nn::golden::{assert_close, assert_tensors_close};
use crate::rng::{Stream, stream};
use crate::robot::{JointConfig, PANDA};

const BACKENDS: &[Backend] = &[
    Backend::Flex,
    #[cfg(feature = "ndarray")]
    Backend::Ndarray,
];

const REFERENCE: &str = include_str!("../../../tests/golden/ranker.json");

#[derive(Deserialize)]
struct Case {
    settings: RankerSettings,
    batch: Vec<GoldenTransition>,
    before: Networks,
    values: Vec<f32>,
    updates: Vec<RankerUpdate>,
    after: Networks,
}

#[derive(Deserialize)]
struct GoldenTransition {
    taken: Sample,
    reward: f32,
    next: Option<Sample>,
    weight: f32,
}

#[derive(Deserialize)]
struct Sample {
    configs: Vec<JointConfig>,
    goal: GoldenGoal,
    collides: bool,
    gripper_open: f32,
    time: f32,
}

#[derive(Deserialize)]
struct Networks {
    online: Vec<NamedTensor>,
    target: Vec<NamedTensor>,
}

/// A sample that owns its parts.
struct Owned(RankerContext, RankedPath);

impl Sample {
    fn owned(&self) -> Owned {
        let context = RankerContext {
            goal: self.goal.next_best_pose(),
            gripper_open: self.gripper_open,
            time: self.time,
        };
        let path = JointPath::new(self.configs.clone()).expect("at least two configurations");
        Owned(context, RankedPath { path, collides: self.collides })
    }
}

impl Owned {
    fn sample(&self) -> RankerSample<'_> {
        RankerSample { context: &self.0, path: &self.1 }
    }
}

#[test]
fn values_updates_and_parameters_are_those_of_pytorch() {
    let cases: Vec<Case> =
        serde_json::from_str(REFERENCE).expect("written by tests/peers/networks.py");
    assert_eq!(cases.len(), 3);
    for &backend in BACKENDS {
        cases.iter().for_each(|case| check_case(case, backend));
    }
}

fn check_case(case: &Case, backend: Backend) {
    let mut ranker = Ranker::new(&case.settings, &PANDA, backend, &mut stream(0, Stream::Init, 0))
        .expect("valid settings");
    let Networks { online, target } = &case.before;
    let adam = ranker.state().adam;
    ranker
        .restore(&RankerState { online: online.clone(), target: target.clone(), adam })
        .expect("tensors of these settings");

    let taken: Vec<_> = case.batch.iter().map(|transition| transition.taken.owned()).collect();
    let next: Vec<_> =
        case.batch.iter().map(|transition| transition.next.as_ref().map(Sample::owned)).collect();
    let values: Vec<_> = taken
        .iter()
        .map(|Owned(context, path)| {
            ranker.values(context, core::slice::from_ref(path)).expect("one path")[0]
        })
        .collect();
    assert_close("values", &values, &case.values, 1e-5);

    let batch: Vec<_> = (0..case.batch.len())
        .map(|idx| RankerTransition {
            outcome: 0.0,
            taken: taken[idx].sample(),
            reward: case.batch[idx].reward,
            next: next[idx].as_ref().map(Owned::sample),
            weight: case.batch[idx].weight,
        })
        .collect();
    for expected in &case.updates {
        let update = ranker.update(&batch).expect("a valid batch");
        assert_close("loss", &[update.loss], &[expected.loss], 1e-5);
        assert_close("temporal differences", &update.td_errors, &expected.td_errors, 2e-5);
    }
    assert_tensors_close(&ranker.state().online, &case.after.online, 2e-5);
    assert_tensors_close(&ranker.state().target, &case.after.target, 2e-5);
}
