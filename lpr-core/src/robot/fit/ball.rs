//! Balls: those that may cover, and those that must be covered.

use glamx::DVec3;

/// A ball that may be enlarged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ball {
    pub(super) center: DVec3,
    /// Distance of the centre from the surface, at least; negative outside.
    pub(super) depth: f64,
    pub(super) radius: f64,
}

/// A ball that must be covered.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) center: DVec3,
    pub(super) radius: f64,
}

impl Ball {
    pub(super) fn covers(&self, spot: &Spot) -> bool {
        let room = self.radius - spot.radius;
        room >= 0.0 && self.center.distance_squared(spot.center) <= room * room
    }

    /// Distance of the spot from leaving the ball, metres.
    pub(super) fn room_around(&self, spot: &Spot) -> f64 {
        self.radius - spot.radius - self.center.distance(spot.center)
    }
}
