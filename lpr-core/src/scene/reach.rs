//! How far the spheres of a link can move, whatever its joints do.

use super::frames::{MovingFrame, carrier};
use super::link_spheres::{LinkSpheres, inverse_squared_move, least_radius};
use crate::robot::{JointMotion, MAX_JOINTS};
use glamx::Vec3;

/// A slide without limits goes as far as this, metres: numbers stay finite.
const FURTHEST: f32 = 1e6;

/// How far the spheres of a link can move.
#[derive(Debug, Clone)]
pub(super) struct Reach {
    /// For each joint, metres that a sphere moves at most for each radian (or metre) of it.
    levers: [f32; MAX_JOINTS],
    /// Least radius of a sphere, metres.
    pub(super) radius: f32,
    /// `1/s²`, where `s` is the furthest that the smallest may move straight between two looks.
    pub(super) inverse_squared_move: f32,
}

impl Reach {
    /// The reach of a link of an arm with those `moves` and limits of the joints.
    pub(super) fn new(moves: &[MovingFrame], limits: &[(f32, f32)], link: &LinkSpheres) -> Self {
        let spheres = || link.clusters.iter().flat_map(|cluster| &cluster.spheres);
        let most = |size: fn(Vec3) -> f32| spheres().map(|s| size(s.center)).fold(0.0, f32::max);
        let mut levers = [0.0; MAX_JOINTS];
        let (mut from_axis, mut from_origin) = (most(off_axis), most(Vec3::length));
        let mut body = link.body;
        while let Some(step) = carrier(moves, body) {
            let (lower, upper) = limits[step.joint];
            let (lever, travel) = match step.motion {
                JointMotion::Turn => (from_axis, 0.0),
                JointMotion::Slide => {
                    (1.0, step.position(lower).abs().max(step.position(upper).abs()))
                }
            };
            levers[step.joint] += step.multiplier().abs() * lever;
            let travel = travel.min(FURTHEST);
            from_axis = off_axis(step.translation) + travel + from_origin;
            from_origin += step.translation.length() + travel;
            body = step.parent;
        }
        let radius = least_radius(spheres());
        Self { levers, radius, inverse_squared_move: inverse_squared_move(radius) }
    }

    /// Metres that a sphere moves at most when the joints from the one of index `first` on move at
    /// `rates`.
    pub(super) fn moved(&self, rates: &[f32], first: usize) -> f32 {
        let moved = rates.iter().zip(&self.levers).map(|(rate, lever)| rate.abs() * lever);
        moved.skip(first).sum()
    }

    /// Metres that a sphere moves at most in a step at `rates`, and its greatest acceleration,
    /// metres for a squared step, where joint `j` and those before it turn what it moves by
    /// `turns[j]`.
    pub(super) fn motion(&self, rates: &[f32], turns: &[f32]) -> (f32, f32) {
        let (mut moved, mut acceleration) = (0.0, 0.0);
        for ((rate, turn), lever) in rates.iter().zip(turns).zip(&self.levers) {
            let by = rate.abs() * lever;
            moved += by;
            acceleration += by * turn;
        }
        (moved, acceleration)
    }
}

/// Distance from the z axis.
fn off_axis(v: Vec3) -> f32 {
    libm::hypotf(v.x, v.y)
}
