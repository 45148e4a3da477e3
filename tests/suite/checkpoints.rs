//! Checkpoints that are damaged, foreign or newer than this program.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::lpr::{files_below, refusal};
use crate::runs::{self, ORACLE, Runs, newest_checkpoint};
use lpr_core::checkpoint::load_agent;
use lpr_core::rng::{Rng, Stream, stream};
use rand::RngExt as _;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A run whose newest checkpoint is changed and put back.
struct Victim {
    runs: Runs,
    run: PathBuf,
    checkpoint: PathBuf,
}

impl Victim {
    fn new() -> Self {
        let runs = Runs::new();
        let run = runs.train(ORACLE, "run");
        let checkpoint = newest_checkpoint(&run);
        Self { runs, run, checkpoint }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.checkpoint.join(name)
    }

    /// The error of `lpr train --resume` about the checkpoint, after its directory. Nothing in the
    /// run may change.
    #[track_caller]
    fn resume_refusal(&self) -> String {
        let before = files_below(&self.run);
        let error = refusal(
            &[&self.runs.arguments(ORACLE, "run")[..], &["--resume".to_owned()]].concat(),
            1,
        );
        assert!(files_below(&self.run) == before, "{error}: the run was changed");
        self.after_directory(&error)
    }

    /// The error of `lpr eval` about the checkpoint, after its directory.
    #[track_caller]
    fn eval_refusal(&self) -> String {
        self.after_directory(&refusal(&["eval", self.run.to_str().unwrap(), "--episodes", "1"], 1))
    }

    #[track_caller]
    fn after_directory(&self, error: &str) -> String {
        let directory = self.checkpoint.to_str().unwrap();
        error
            .strip_prefix(directory)
            .unwrap_or_else(|| panic!("{error}: does not name {directory}"))
            .to_owned()
    }

    /// Calls `check` while file `name` has other content.
    fn with(&self, name: &str, content: &[u8], check: impl FnOnce(&Self)) {
        let original = fs::read(self.file(name)).unwrap();
        fs::write(self.file(name), content).unwrap();
        check(self);
        fs::write(self.file(name), original).unwrap();
    }
}

/// Places of a file to damage: its start, where headers are, its end, and some between.
fn places(n_bytes: usize, rng: &mut Rng) -> Vec<usize> {
    let between = (0..12).map(|_| rng.random_range(0..n_bytes));
    let mut places: Vec<_> = (0..24).chain([n_bytes - 1, n_bytes / 2]).chain(between).collect();
    places.sort_unstable();
    places.dedup();
    places
}

#[test]
fn flipped_bits_and_cut_files_are_refused_by_name() {
    let victim = Victim::new();
    for (name, idx) in [("weights.safetensors", 0), ("state.bin", 1)] {
        let check = |victim: &Victim| {
            let error = victim.resume_refusal();
            assert!(error.starts_with(&format!("/{name}: ")), "{error}");
            if name == "weights.safetensors" {
                assert!(victim.eval_refusal().starts_with("/weights.safetensors: "));
            }
        };
        let rng = &mut stream(7, Stream::Noise, idx);
        let original = fs::read(victim.file(name)).unwrap();
        for place in places(original.len(), rng) {
            let mut damaged = original.clone();
            damaged[place] ^= 1 << rng.random_range(0..8);
            victim.with(name, &damaged, check);
            victim.with(name, &original[..place], check);
        }
        victim.with(name, &[&original[..], b"\0"].concat(), check);
        victim.with(name, b"PK\x03\x04 and so on", check);
    }
    // Put back, it is as good as before.
    load_agent(&fs::read(victim.file("weights.safetensors")).unwrap()).unwrap();
}

#[test]
fn no_flipped_bit_of_the_header_of_the_weights_goes_unnoticed() {
    let runs = Runs::new();
    let weights =
        fs::read(newest_checkpoint(&runs.train(ORACLE, "run")).join("weights.safetensors"))
            .unwrap();
    let rng = &mut stream(8, Stream::Noise, 0);
    for place in 0..header(&weights).end {
        let mut damaged = weights.clone();
        damaged[place] ^= 1 << rng.random_range(0..8);
        assert!(
            load_agent(&damaged).is_err(),
            "byte {place}: {:#x} instead of {:#x}",
            damaged[place],
            weights[place]
        );
    }
}

/// Range of the JSON in a safetensors file.
fn header(weights: &[u8]) -> Range<usize> {
    8..8 + u64::from_le_bytes(weights[..8].try_into().unwrap()) as usize
}

/// FNV-1a, with which checkpoints tell damage.
fn digest(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The file of a program whose configuration says `to` in place of `from`: intact, with the digest
/// that belongs to it.
fn rewritten(weights: &[u8], from: &str, to: &str) -> Vec<u8> {
    let place = header(weights);
    let (mut json, data): (serde_json::Value, _) =
        (serde_json::from_slice(&weights[place.clone()]).unwrap(), &weights[place.end..]);
    let metadata = json["__metadata__"]["lpr"].as_str().unwrap();
    let (old, text) = metadata.split_once('\n').unwrap();
    let digest_of = |text: &str| {
        let tensors = json.as_object().unwrap().iter().filter(|(name, _)| *name != "__metadata__");
        tensors.fold(digest(text.as_bytes()), |sum, (name, tensor)| {
            let [from, to] =
                [0, 1].map(|end| tensor["data_offsets"][end].as_u64().unwrap() as usize);
            sum.wrapping_add(digest(&[name.as_bytes(), &data[from..to]].concat()))
        })
    };
    assert_eq!(old, format!("{:016x}", digest_of(text)), "the test knows how digests are made");
    assert!(text.contains(from), "{from} is not in {text}");
    let text = text.replacen(from, to, 1);
    let metadata = format!("{:016x}\n{text}", digest_of(&text));
    json["__metadata__"]["lpr"] = metadata.into();
    let json = serde_json::to_vec(&json).unwrap();
    [&(json.len() as u64).to_le_bytes(), json.as_slice(), data].concat()
}

#[test]
fn foreign_and_newer_checkpoints_are_refused_by_what_differs() {
    let victim = Victim::new();
    let weights = fs::read(victim.file("weights.safetensors")).unwrap();
    let cases = [
        ("version = 1", "version = 2", "version 2, this program reads up to 1"),
        (
            "robot = \"xarm7\"",
            "robot = \"ur5\"",
            "robot: expected one of xarm7, panda, found 'ur5'",
        ),
        ("config_widths = [8, 16]", "config_widths = [8, 32]", "shape"),
        ("bezier_paths", "bezeir_paths", "bezeir_paths"),
        ("method = \"lpr\"", "method = \"c2farm\"", "belongs to no network"),
        ("method = \"lpr\"", "method = \"guess\"", "guess"),
    ];
    for (from, to, says) in cases {
        victim.with("weights.safetensors", &rewritten(&weights, from, to), |victim| {
            for error in [victim.eval_refusal(), victim.resume_refusal()] {
                assert!(error.contains(says), "{error}");
            }
        });
    }
    let moved = rewritten(&weights, "task = \"toilet_seat_up\"", "task = \"open_drawer\"");
    victim.with("weights.safetensors", &moved, |victim| {
        assert_eq!(
            victim.resume_refusal(),
            ": of task `open_drawer`, asked to resume `toilet_seat_up`"
        );
    });
}

#[test]
fn a_newer_state_is_refused_by_its_version() {
    let victim = Victim::new();
    let mut state = fs::read(victim.file("state.bin")).unwrap();
    // The version stands after eight bytes of magic.
    state[8] = 3;
    victim.with("state.bin", &state, |victim| {
        assert_eq!(victim.resume_refusal(), "/state.bin: version: expected 1 to 2, found 3");
    });
}

/// Replaces one file of a directory by that of another run.
fn exchange(from: &Path, to: &Path, name: &str) {
    fs::copy(from.join(name), to.join(name)).unwrap();
}

#[test]
fn a_checkpoint_of_another_run_is_not_resumed() {
    let victim = Victim::new();
    let arguments = victim.runs.arguments(ORACLE, "run");
    let refused = |from: &str, to: &[&str]| {
        let mut changed: Vec<_> = arguments.iter().map(String::as_str).collect();
        let at = changed.iter().position(|argument| *argument == from).unwrap();
        changed.splice(at..=at, to.iter().copied());
        changed.push("--resume");
        let before = files_below(&victim.run);
        let error = victim.after_directory(&refusal(&changed, 1));
        assert!(files_below(&victim.run) == before, "{error}: the run was changed");
        error
    };
    assert_eq!(
        refused("toilet_seat_up", &["reach_target"]),
        ": of task `toilet_seat_up`, asked to resume `reach_target`"
    );
    assert_eq!(refused("3", &["4"]), ": of seed `3`, asked to resume `4`");
    let with_poses = |rest: &'static [&'static str]| [&["--oracle-poses"], rest].concat();
    let error = refused("--oracle-poses", &with_poses(&["--method", "c2farm"]));
    assert_eq!(error, ": of method `lpr`, asked to resume `c2farm`");
    let error = refused("--oracle-poses", &with_poses(&["--robot", "panda"]));
    assert_eq!(error, ": of the robot `xarm7`, the world has `panda`");

    // The files of two runs: each is intact, and they do not belong together.
    let mut other = victim.runs.arguments(ORACLE, "other");
    let seed = other.iter().position(|argument| argument == "3").unwrap();
    other[seed] = "4".to_owned();
    crate::lpr::json(&other);
    exchange(
        &newest_checkpoint(&victim.runs.folder.path().join("other")),
        &victim.checkpoint,
        "state.bin",
    );
    assert_eq!(victim.resume_refusal(), ": weights and state are not of one checkpoint");
}

#[test]
fn what_is_missing_is_named() {
    let victim = Victim::new();
    for name in ["state.bin", "weights.safetensors"] {
        let away = victim.runs.folder.path().join("away");
        fs::rename(victim.file(name), &away).unwrap();
        let error = victim.resume_refusal();
        assert!(error.starts_with(&format!("/{name}: cannot read: ")), "{error}");
        fs::rename(&away, victim.file(name)).unwrap();
    }
    for checkpoint in runs::checkpoints(&victim.run) {
        fs::remove_dir_all(checkpoint).unwrap();
    }
    let arguments = [&victim.runs.arguments(ORACLE, "run")[..], &["--resume".to_owned()]].concat();
    for _ in 0..2 {
        let error = refusal(&arguments, 1);
        assert_eq!(
            error,
            format!(
                "{}: {}",
                victim.run.display(),
                "holds no checkpoint: not a run directory, or a run that had not saved yet"
            )
        );
        // Nor does a directory without `checkpoints`, or none at all.
        let _ = fs::remove_dir_all(&victim.run);
    }
    assert!(!victim.run.exists(), "resuming creates nothing");
}
