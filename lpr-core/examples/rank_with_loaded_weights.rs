//! A trained ranker's values of candidate paths: the shortest need not be the best.
//!
//! ```text
//! cargo run -p lpr-core --example rank_with_loaded_weights -- [runs/seat/weights.safetensors]
//! ```
//!
//! Without an argument it takes the weights that come with the demo page.
#![expect(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "an example reads a file and shows what it found"
)]

use lpr_core::checkpoint::load_agent;
use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::path::{CandidateStreams, PathQuery, candidates};
use lpr_core::q_attention::NextBestPose;
use lpr_core::ranker::{RankedPath, RankerContext};
use lpr_core::robot::Gripper;
use lpr_core::scene::Scene;

const PAGE_WEIGHTS: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../www/public/weights/toilet_seat_up.safetensors");

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let file = std::env::args().nth(1).unwrap_or_else(|| PAGE_WEIGHTS.to_owned());
    let saved = load_agent(&std::fs::read(file)?)?;
    let (robot, run) = (saved.agent.robot(), &saved.header.run);
    println!(
        "{} with the {}, {} environment steps",
        run.task, robot.name, saved.header.progress.env_steps
    );
    let ranker = saved.agent.networks.ranker.as_ref().ok_or("a method without a ranker")?;

    let pose =
        Pose3::from_parts(Vec3::new(0.45, 0.1, 0.25), Quat::from_rotation_x(core::f32::consts::PI));
    let query = PathQuery { robot, start: robot.start, goal: pose, scene: &Scene::empty() };
    let streams = CandidateStreams { seed: 0, step: 0 };
    let set = candidates(&query, saved.agent.candidate_settings(), streams);
    let paths: Vec<_> = set
        .candidates
        .iter()
        .map(|it| RankedPath { path: it.path.clone(), collides: it.collides })
        .collect();

    // The first step of an episode, with the gripper open.
    let context = RankerContext {
        goal: NextBestPose { pose, gripper: Gripper::Close },
        gripper_open: 1.0,
        time: 1.0,
    };
    let values = ranker.values(&context, &paths)?;
    let mut ranked: Vec<_> = set.candidates.iter().zip(values).collect();
    ranked.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    for (candidate, value) in ranked {
        println!("{value:7.3}  {:8}{:6.2} rad", candidate.source.name(), candidate.path.length());
    }
    Ok(())
}
