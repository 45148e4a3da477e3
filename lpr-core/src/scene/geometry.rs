//! The geometry of the links of an arm from a file, itself: whether two links touch where their
//! spheres do. Slow; for what is asked once of a description, and for pairs that pass closely.

use crate::robot::{Link, Robot};
use core::cell::OnceCell;
use glamx::Pose3;
use std::sync::Arc;

#[cfg(feature = "hulls")]
mod surface;

#[cfg(feature = "hulls")]
pub(super) use surface::Surface;

/// Nothing: without parry3d nothing is known of the geometry.
#[cfg(not(feature = "hulls"))]
#[derive(Debug)]
pub(super) enum Surface {}

/// The surface of a link in the frame of its body.
#[derive(Debug, Clone)]
pub(super) struct Geometry(Arc<Surface>);

impl Geometry {
    /// That of a link; none where it has none, and where nothing is known of it.
    pub(super) fn of(link: &Link) -> Option<Self> {
        Surface::of(link).map(|surface| Self(Arc::new(surface)))
    }

    /// True if it touches another, given with the places of the bodies.
    pub(super) fn touches(
        &self,
        world_from_self: Pose3,
        other: &Self,
        world_from_other: Pose3,
    ) -> bool {
        self.0.touches(&other.0, world_from_self.inverse() * world_from_other)
    }
}

/// The geometry of the links of an arm, each made ready once, where it is asked for.
pub(super) struct Geometries<'a> {
    robot: &'a Robot,
    links: Vec<OnceCell<Option<Geometry>>>,
}

impl<'a> Geometries<'a> {
    pub(super) fn of(robot: &'a Robot) -> Self {
        Self { robot, links: robot.links.iter().map(|_| OnceCell::new()).collect() }
    }

    /// That of two links by their indices; none where it is not known of one of them.
    pub(super) fn pair(&self, a: usize, b: usize) -> Option<(&Geometry, &Geometry)> {
        self.link(a).zip(self.link(b))
    }

    fn link(&self, idx: usize) -> Option<&Geometry> {
        self.links[idx].get_or_init(|| Geometry::of(&self.robot.links[idx])).as_ref()
    }
}

#[cfg(not(feature = "hulls"))]
impl Surface {
    const fn of(_: &Link) -> Option<Self> {
        None
    }

    const fn touches(&self, _: &Self, _: Pose3) -> bool {
        match *self {}
    }
}
