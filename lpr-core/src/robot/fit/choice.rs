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
        uncovered.retain(|spot| !best.covers(spot));
    }
    drop_superfluous(&mut chosen, spots);
    tighten(&mut chosen, spots);
    (chosen.len() <= n).then_some(chosen)
}

fn n_covered(ball: &Ball, spots: &[Spot]) -> usize {
    spots.iter().step_by(spots.len() / N_COMPARED + 1).filter(|spot| ball.covers(spot)).count()
}

/// Leaves out balls without which everything is covered, the smallest first.
fn drop_superfluous(balls: &mut Vec<Ball>, spots: &[Spot]) {
    balls.sort_by(|a, b| a.radius.total_cmp(&b.radius));
    let mut n_covering: Vec<usize> =
        spots.iter().map(|spot| balls.iter().filter(|ball| ball.covers(spot)).count()).collect();
    balls.retain(|ball| {
        let is_needed = spots.iter().zip(&n_covering).any(|(spot, n)| *n == 1 && ball.covers(spot));
        if !is_needed {
            let covered = spots.iter().zip(&mut n_covering).filter(|(spot, _)| ball.covers(spot));
            covered.for_each(|(_, n)| *n -= 1);
        }
        is_needed
    });
}

/// Makes every ball as small as it may be, where a spot is left to the ball that has most room
/// around it.
fn tighten(balls: &mut [Ball], spots: &[Spot]) {
    let mut needed = vec![0.0_f64; balls.len()];
    for spot in spots {
        let covering = balls.iter().enumerate().filter(|(_, ball)| ball.covers(spot));
        let rooms = covering.map(|(i, ball)| (i, ball.room_around(spot)));
        if let Some((i, room)) = rooms.max_by(|(_, a), (_, b)| a.total_cmp(b)) {
            needed[i] = needed[i].max(balls[i].radius - room);
        }
    }
    balls.iter_mut().zip(needed).for_each(|(ball, radius)| ball.radius = radius);
}
