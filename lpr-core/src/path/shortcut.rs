//! Deterministic shortcuts: a free path made shorter, without random numbers.

use super::JointPath;
use crate::robot::JointConfig;
use crate::scene::MotionChecker;

/// Times the edges are halved, so that shortcuts can begin and end between vertices.
const HALVINGS: usize = 2;

/// Edges shorter than this are not halved, radians.
const SHORTEST_HALVED: f32 = 0.3;

/// A free path with the same ends as the free path `path`, no longer than it.
///
/// From every vertex on it goes straight to the furthest vertex it can; then the edges are halved and it does so again.
#[must_use]
pub fn shortcut(path: &JointPath, checker: &MotionChecker<'_>) -> JointPath {
    let mut configs = skip_vertices(path.configs(), checker);
    for _ in 0..HALVINGS {
        if configs.len() == 2 {
            break;
        }
        configs = skip_vertices(&halve_edges(&configs), checker);
    }
    JointPath(configs)
}

/// The path without the vertices that a straight free motion can leave out. Its own edges count as checked.
fn skip_vertices(configs: &[JointConfig], checker: &MotionChecker<'_>) -> Vec<JointConfig> {
    let last = configs.len() - 1;
    let mut kept = vec![configs[0]];
    let mut at = 0;
    while at < last {
        let next = (at + 2..=last).rev().find(|&to| checker.motion_is_free(&configs[at], &configs[to]));
        at = next.unwrap_or(at + 1);
        kept.push(configs[at]);
    }
    kept
}

fn halve_edges(configs: &[JointConfig]) -> Vec<JointConfig> {
    let mut halved = vec![configs[0]];
    for pair in configs.windows(2) {
        if pair[0].distance(&pair[1]) > SHORTEST_HALVED {
            halved.push(pair[0].lerp(&pair[1], 0.5));
        }
        halved.push(pair[1]);
    }
    halved
}
