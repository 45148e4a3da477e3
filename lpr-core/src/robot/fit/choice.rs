//! Few of many balls that cover what must be covered.

use super::ball::{Ball, Spot};
use super::grid::Grid;

/// Spots on which candidates are compared.
const N_COMPARED: usize = 512;

/// Candidates that are compared for a spot, about.
const N_CANDIDATES: usize = 256;

/// At most `n` balls, enlarged by no more than `tolerance`, that cover the grid's spots.
///
/// Greedy: the spot furthest from the middle, where candidates are fewest, takes the ball that
/// covers most besides it.
pub(super) fn choose(grid: &Grid, tolerance: f64, n: usize) -> Option<Vec<Ball>> {
    let enlarged = |ball: Ball| Ball { radius: ball.depth + tolerance, ..ball };
    let candidates: Vec<Ball> = grid.balls().map(enlarged).collect();
    let spots = grid.spots();
    let mut uncovered = spots.to_vec();
    let mut chosen = Vec::new();
    while let Some(spot) = uncovered.first() {
        // Half as many again: some become superfluous.
        if 2 * chosen.len() >= 3 * n {
            return None;
        }
        let own = enlarged(grid.ball_at(spot.center));
        let covering: Vec<&Ball> =
            candidates.iter().chain([&own]).filter(|ball| ball.covers(spot)).collect();
        // Its own ball comes last: the steps begin there.
        let compared = covering.iter().rev().step_by(covering.len() / N_CANDIDATES + 1);
        let best = **compared.max_by_key(|ball| n_covered(ball, &uncovered))?;
        chosen.push(best);
        let near = grid.shell(&uncovered, &best);
        let left: Vec<Spot> =
            uncovered[near.clone()].iter().filter(|spot| !best.covers(spot)).copied().collect();
        uncovered.splice(near, left);
    }
    let mut covered: Vec<Covered> =
        chosen.into_iter().map(|ball| Covered { ball, spots: spots_in(grid, &ball) }).collect();
    drop_superfluous(&mut covered, spots.len());
    (covered.len() <= n).then(|| tightened(&covered, spots))
}

/// A chosen ball and the indices of the spots that it covers.
struct Covered {
    ball: Ball,
    spots: Vec<usize>,
}

/// Indices of the spots that a ball covers.
fn spots_in(grid: &Grid, ball: &Ball) -> Vec<usize> {
    let spots = grid.spots();
    grid.shell(spots, ball).filter(|&i| ball.covers(&spots[i])).collect()
}

fn n_covered(ball: &Ball, spots: &[Spot]) -> usize {
    spots.iter().step_by(spots.len() / N_COMPARED + 1).filter(|spot| ball.covers(spot)).count()
}

/// Leaves out balls without which everything is covered, the smallest first.
fn drop_superfluous(balls: &mut Vec<Covered>, n_spots: usize) {
    balls.sort_by(|a, b| a.ball.radius.total_cmp(&b.ball.radius));
    let mut n_covering = vec![0_usize; n_spots];
    balls.iter().flat_map(|it| &it.spots).for_each(|&spot| n_covering[spot] += 1);
    balls.retain(|it| {
        let is_needed = it.spots.iter().any(|&spot| n_covering[spot] == 1);
        if !is_needed {
            it.spots.iter().for_each(|&spot| n_covering[spot] -= 1);
        }
        is_needed
    });
}

/// Every ball as small as it may be, where a spot is left to the ball that has most room around it.
fn tightened(balls: &[Covered], spots: &[Spot]) -> Vec<Ball> {
    let mut roomiest = vec![(0, f64::NEG_INFINITY); spots.len()];
    for (i, it) in balls.iter().enumerate() {
        for &spot in &it.spots {
            let room = it.ball.room_around(&spots[spot]);
            if room >= roomiest[spot].1 {
                roomiest[spot] = (i, room);
            }
        }
    }
    let mut needed = vec![0.0_f64; balls.len()];
    for (i, room) in roomiest {
        needed[i] = needed[i].max(balls[i].ball.radius - room);
    }
    balls.iter().zip(needed).map(|(it, radius)| Ball { radius, ..it.ball }).collect()
}
