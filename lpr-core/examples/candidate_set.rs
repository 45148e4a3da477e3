//! The set of candidate paths to one pose: who proposed each, whether it collides, and why other
//! draws gave none.
//!
//! ```text
//! cargo run -p lpr-core --no-default-features --example candidate_set
//! ```
#![expect(clippy::print_stdout, reason = "an example shows what it found")]

use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::path::{CandidateSettings, CandidateStreams, PathQuery, candidates};
use lpr_core::robot::PANDA;
use lpr_core::scene::{Primitive, Scene};
use std::collections::BTreeMap;

/// The small example set, with longer paths and more of them.
const SETTINGS: CandidateSettings = CandidateSettings {
    path_len: 30,
    planner_paths: 8,
    bezier_paths: 8,
    ..CandidateSettings::EXAMPLE
};

fn main() -> lpr_core::Result<()> {
    SETTINGS.check()?;
    let post = Primitive::Capsule {
        a: Vec3::new(0.5, 0.15, 0.0),
        b: Vec3::new(0.5, 0.15, 0.5),
        radius: 0.03,
    };
    let query = PathQuery {
        robot: &PANDA,
        start: PANDA.start,
        goal: Pose3::from_parts(
            Vec3::new(0.45, 0.3, 0.15),
            Quat::from_rotation_x(core::f32::consts::PI),
        ),
        scene: &Scene::from_primitives(vec![post]),
    };
    let set = candidates(&query, &SETTINGS, CandidateStreams { seed: 0, step: 0 });
    for (idx, candidate) in set.candidates.iter().enumerate() {
        let collides = if candidate.collides { "collides" } else { "free" };
        println!(
            "{idx:2}  {:8}{:6.2} rad  {collides}",
            candidate.source.name(),
            candidate.path.length()
        );
    }
    let mut reasons = BTreeMap::new();
    for draw in &set.rejected {
        *reasons.entry((draw.source.name(), draw.reason.name())).or_insert(0) += 1;
    }
    for ((source, reason), n_draws) in reasons {
        println!("{n_draws:2} draws of {source} gave none: {reason}");
    }
    let shortest = set.shortest_free().expect("there is room beside the post");
    println!("the shortest free one is {:.2} rad long", shortest.path.length());
    Ok(())
}
