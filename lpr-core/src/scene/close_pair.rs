//! Pairs of links that pass each other closely, as the base and the upper arm of a UR5 by 7 mm: what
//! their spheres say is not enough, and where these touch the geometry is asked.

use super::frames::Frame;
use super::geometry::Geometry;
use super::link_spheres::LinkSpheres;

/// Two links that are tested by their geometry where their spheres touch.
#[derive(Debug, Clone)]
pub(super) struct ClosePair {
    /// Indices of the links that have spheres.
    pub(super) links: (usize, usize),
    geometry: (Geometry, Geometry),
}

impl ClosePair {
    pub(super) const fn new(links: (usize, usize), geometry: (Geometry, Geometry)) -> Self {
        Self { links, geometry }
    }

    /// True if the links touch, given with the frames of their bodies.
    #[cold]
    pub(super) fn meets(&self, links: &[LinkSpheres], frames: (&Frame, &Frame)) -> bool {
        let (a, b) = self.links;
        links[a].touches(frames.0, &links[b], frames.1)
            && self.geometry.0.touches(frames.0.pose(), &self.geometry.1, frames.1.pose())
    }
}

#[cfg(test)]
mod tests;
