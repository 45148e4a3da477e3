use super::*;
use crate::agent::{Eyes, Method, PoseSource};
use crate::q_attention::{ActingNetwork, NetworkSettings};
use crate::robot::{PANDA, XARM7};
use crate::toy::Toy;
use crate::train::Run;
use crate::train::tests::{config, run, trainer};

use proptest::prelude::{any, prop, prop_assert, proptest};

fn message(result: Result<Trainer<Toy>>) -> String {
    match result {
        Ok(_) => panic!("it was accepted"),
        Err(Error::Checkpoint(message)) => message,
        Err(other) => panic!("another kind of error: {other}"),
    }
}

fn resume(weights: &[u8], state: &[u8]) -> Result<Trainer<Toy>> {
    Trainer::resume(
        &Checkpoint { weights: weights.to_vec(), state: state.to_vec() },
        Toy::new(&PANDA).unwrap(),
    )
}

/// A checkpoint in the middle of an episode.
fn checkpoint() -> Checkpoint {
    let mut trainer = trainer(config(), Method::Lpr, 2);
    while trainer.episode.is_none() {
        trainer.step().expect("a toy scene");
    }
    trainer.checkpoint().expect("a small seed")
}

fn metrics(trainer: &mut Trainer<Toy>, n_steps: usize) -> Vec<(&'static str, u32)> {
    let mut step = || trainer.step().expect("a toy scene").metrics;
    (0..n_steps)
        .flat_map(|_| {
            step().iter().map(|(name, value)| (name, value.to_bits())).collect::<Vec<_>>()
        })
        .collect()
}

#[test]
fn a_resumed_run_goes_on_bit_by_bit_from_any_step() {
    for method in [Method::Lpr, Method::LprNoPolicy, Method::C2fArm] {
        let mut straight = trainer(config(), method, 4);
        let mut interrupted = trainer(config(), method, 4);
        // An even and an odd number of steps: one of them ends in the middle of an episode of two.
        for n_steps in [8, 7, 6] {
            let checkpoint = interrupted.checkpoint().expect("a small seed");
            interrupted = Trainer::resume(&checkpoint, Toy::new(&PANDA).unwrap())
                .expect("an intact checkpoint");
            assert_eq!(
                interrupted.checkpoint().as_ref(),
                Ok(&checkpoint),
                "nothing is lost or added"
            );
            assert_eq!(metrics(&mut straight, n_steps), metrics(&mut interrupted, n_steps));
        }
        assert_eq!(straight.checkpoint(), interrupted.checkpoint());
    }
}

#[test]
fn learned_poses_go_on_bit_by_bit_too() {
    let mut straight = attentive(ActingNetwork::Online);
    metrics(&mut straight, 3);
    let checkpoint = straight.checkpoint().expect("a small seed");
    let mut resumed =
        Trainer::resume(&checkpoint, Toy::new(&PANDA).unwrap()).expect("an intact checkpoint");
    assert_eq!(metrics(&mut straight, 3), metrics(&mut resumed, 3));
    assert_eq!(straight.checkpoint(), resumed.checkpoint());
    assert!(straight.updates().q_attention > 0);
}

#[test]
fn the_weights_alone_make_an_agent_that_attends_alike_whichever_network_acts() {
    for acting in [ActingNetwork::Online, ActingNetwork::Target] {
        let mut trainer = attentive(acting);
        metrics(&mut trainer, 3);
        let checkpoint = trainer.checkpoint().expect("a small seed");
        let saved = load_agent(&checkpoint.weights).expect("an intact file");
        let observation = trainer.environment().observe();
        let goal = |agent: &crate::agent::Agent| {
            agent.attend(observation.clone(), Eyes::Open).attention.map(|choice| choice.value)
        };
        assert_eq!(goal(&saved.agent), goal(trainer.agent()));
        let mut resumed =
            Trainer::resume(&checkpoint, Toy::new(&PANDA).unwrap()).expect("an intact checkpoint");
        assert_eq!(metrics(&mut trainer, 2), metrics(&mut resumed, 2));
        assert_eq!(trainer.checkpoint(), resumed.checkpoint());
    }
}

/// A trainer that learns poses, too, with a small network.
fn attentive(acting: ActingNetwork) -> Trainer<Toy> {
    let mut config = config();
    config.training.acting_weights = acting;
    config.training.q_attention_updates_per_step = 1;
    config.training.q_attention_batch = 2;
    config.q_attention.voxels_per_side = 8;
    config.q_attention.rotation_bins = 24;
    config.q_attention.network = NetworkSettings::Fast {
        cell_channels: 8,
        block_channels: 12,
        head_channels: 4,
        attended_channels: 4,
        hidden: 16,
        harmonics: 4,
    };
    let run = Run { poses: PoseSource::Learned, ..run(Method::Lpr, 4) };
    let mut trainer = Trainer::new(config, run, Toy::new(&PANDA).unwrap()).expect("valid settings");
    let demo = Toy::new(&PANDA).unwrap().demonstration(0).expect("within reach");
    trainer.add_demonstration(&demo).expect("two keyframes");
    trainer
}

#[test]
fn the_weights_alone_make_an_agent_that_ranks_alike() {
    let mut trainer = trainer(config(), Method::Lpr, 4);
    metrics(&mut trainer, 6);
    let checkpoint = trainer.checkpoint().expect("a small seed");
    let saved = load_agent(&checkpoint.weights).expect("an intact file");
    assert_eq!(saved.header.config, config());
    assert_eq!(saved.header.run, *trainer.run());
    assert_eq!(read_header(&checkpoint.weights).as_ref(), Ok(&saved.header));
    let score = |agent| {
        crate::evaluate::evaluate(agent, &mut Toy::new(&PANDA).unwrap(), 1000..1010, |_| ())
    };
    assert_eq!(score(&saved.agent), score(trainer.agent()));
    let networks = &saved.agent.networks;
    let acting = |networks: &crate::agent::Networks| {
        let state = networks.ranker.as_ref().map(|ranker| ranker.state());
        state.map(|state| {
            let [acting, _] =
                config().ranker.acting_weights.acting_first([state.online, state.target]);
            acting
        })
    };
    assert_eq!(acting(networks), acting(&trainer.agent().networks));
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let Checkpoint { weights, state } = checkpoint();
    assert!(resume(&weights, &state).is_ok());
    let other = trainer(config(), Method::Lpr, 9).checkpoint().expect("a small seed");
    assert!(message(resume(&other.weights, &state)).contains("not of one checkpoint"));
    let elsewhere = Trainer::resume(
        &Checkpoint { weights: weights.clone(), state: state.clone() },
        Toy::new(&XARM7).unwrap(),
    );
    assert!(message(elsewhere).contains("panda"));
    assert!(message(resume(&weights, b"{\"version\": 1}")).contains("expected `LPRSTATE`"));
    assert!(message(resume(b"PK\x03\x04 and so on", &state)).contains("not a safetensors file"));
    let foreign = safetensors::serialize::<&str, safetensors::tensor::TensorView<'_>, _>([], None);
    assert!(foreign.is_ok_and(|foreign| {
        message(resume(&foreign, &state)).contains("not a file of this program")
    }));
}

#[test]
fn a_newer_version_is_named() {
    let Checkpoint { weights, mut state } = checkpoint();
    state[8] = 3;
    assert!(message(resume(&weights, &state)).contains("version: expected 1 to 2, found 3"));
    let text = b"\nversion = 1\n";
    let at = weights.windows(text.len()).position(|window| window == text);
    // In the JSON of the header, line ends are escaped.
    assert_eq!(at, None);
    let text = b"\\nversion = 1\\n";
    let at = weights
        .windows(text.len())
        .position(|window| window == text)
        .expect("the header starts so");
    let mut newer = weights.clone();
    newer[at + text.len() - 3] = b'7';
    assert!(message(resume(&newer, &state)).contains("version 7"));
}

proptest! {
    #![proptest_config(proptest::test_runner::Config::with_cases(8))]

    #[test]
    fn files_cut_short_and_changed_bytes_are_refused_and_never_panic(
        cuts in prop::collection::vec(0.0..1.0_f64, 8),
        flips in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 8),
    ) {
        use std::sync::OnceLock;
        static CHECKPOINT: OnceLock<Checkpoint> = OnceLock::new();
        let Checkpoint { weights, state } = CHECKPOINT.get_or_init(checkpoint);
        let place = |bytes: &[u8], at: f64| ((bytes.len() as f64 * at) as usize).min(bytes.len() - 1);
        for at in cuts {
            prop_assert!(load_agent(&weights[..place(weights, at)]).is_err());
            prop_assert!(State::from_bytes(&state[..place(state, at)]).is_err());
        }
        for (at, flip) in flips {
            let damaged = |bytes: &[u8]| {
                let mut bytes = bytes.to_vec();
                let place = place(&bytes, at);
                bytes[place] ^= flip.max(1);
                bytes
            };
            prop_assert!(load_agent(&damaged(weights)).is_err());
            prop_assert!(State::from_bytes(&damaged(state)).is_err());
        }
    }

    #[test]
    fn any_payload_is_read_or_refused(payload in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut bytes = b"LPRSTATE\x01\0\0\0".to_vec();
        bytes.extend(digest::of(&payload).to_le_bytes());
        bytes.extend(&payload);
        // Nothing to expect of it but an answer.
        let _ = State::from_bytes(&bytes).is_ok();
    }
}
