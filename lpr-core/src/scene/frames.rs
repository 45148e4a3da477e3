//! A frame for each lane.

use crate::lanes::Vec3s;
use fearless_simd::Simd;
use glamx::Vec3;

/// Lanes of the widest vectors.
pub(super) const MAX_WIDTH: usize = 16;

/// A frame in the world, for each lane.
#[derive(Clone, Copy)]
pub(super) struct Frames<S: Simd> {
    pub(super) axes: [Vec3s<S>; 3],
    pub(super) origin: Vec3s<S>,
}

impl<S: Simd> Frames<S> {
    #[inline(always)]
    pub(super) fn identity(simd: S) -> Self {
        let axes =
            [Vec3s::splat(simd, Vec3::X), Vec3s::splat(simd, Vec3::Y), Vec3s::splat(simd, Vec3::Z)];
        Self { axes, origin: Vec3s::splat(simd, Vec3::ZERO) }
    }

    /// One of the axes or its opposite.
    #[inline(always)]
    pub(super) fn along(&self, (axis, sign): (usize, f32)) -> Vec3s<S> {
        let axis = self.axes[axis];
        if sign < 0.0 { Vec3s { x: -axis.x, y: -axis.y, z: -axis.z } } else { axis }
    }

    #[inline(always)]
    pub(super) fn vector(&self, v: Vec3) -> Vec3s<S> {
        self.axes[0].times(v.x).add(self.axes[1].times(v.y)).add(self.axes[2].times(v.z))
    }

    /// A point of this frame in the world.
    #[inline(always)]
    pub(super) fn point(&self, v: Vec3) -> Vec3s<S> {
        self.vector(v).add(self.origin)
    }

    /// A point most of whose coordinates are 0.
    #[inline(always)]
    pub(super) fn offset(&self, v: Vec3) -> Vec3s<S> {
        let mut point = self.origin;
        for (axis, along) in [(0, v.x), (1, v.y), (2, v.z)] {
            if along != 0.0 {
                point = point.add(self.axes[axis].times(along));
            }
        }
        point
    }
}
