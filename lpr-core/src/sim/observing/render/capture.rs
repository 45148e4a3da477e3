//! Images on demand: only the channels that are asked for are made.

use super::raster::NO_FACE;
use super::{Item, NO_ITEM, Renderer};
use crate::perception::{Camera, View};
use glamx::Vec3;

/// A channel of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Colour.
    Rgb,
    /// Depth along the optical axis.
    Depth,
    /// The point in the world that each pixel sees.
    Cloud,
    /// Which item each pixel sees.
    Mask,
}

/// Images of one camera in the channels that were asked for: each one row by row from the top left,
/// `camera.n_pixels()` long.
///
/// An agent gets a [`View`], which has no mask.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// The camera, where it stood.
    pub camera: Camera,
    /// Colour, sRGB.
    pub rgb: Option<Vec<[u8; 3]>>,
    /// Depth along the optical axis, metres; [`View::NOTHING`] where nothing is seen.
    pub depth: Option<Vec<f32>>,
    /// Points in the world, metres; `Vec3::INFINITY` where nothing is seen.
    pub points: Option<Vec<Vec3>>,
    /// [`Item::id`] of what is seen, else [`NO_ITEM`].
    pub mask: Option<Vec<u16>>,
}

impl Renderer {
    /// Captures `items`, whose meshes are this renderer's, with `camera`, after `measure` has
    /// changed its depth.
    ///
    /// Without channels nothing is drawn.
    #[must_use]
    pub fn capture(
        &mut self,
        camera: &Camera,
        items: &[Item],
        channels: &[Channel],
        measure: impl FnOnce(&mut [f32]),
    ) -> Capture {
        let asked = |channel: Channel| channels.contains(&channel);
        if !channels.is_empty() {
            self.draw(camera, items);
        }
        let depth = (asked(Channel::Depth) || asked(Channel::Cloud)).then(|| {
            let mut depth = self.depths(camera);
            measure(&mut depth);
            depth
        });
        Capture {
            camera: camera.clone(),
            rgb: asked(Channel::Rgb).then(|| self.colors(camera, items)),
            points: depth
                .as_ref()
                .filter(|_| asked(Channel::Cloud))
                .map(|depth| camera.unproject_image(depth)),
            depth: depth.filter(|_| asked(Channel::Depth)),
            mask: asked(Channel::Mask).then(|| self.ids(camera, items)),
        }
    }

    fn depths(&self, camera: &Camera) -> Vec<f32> {
        let depth = |(&inverse, &face): (&f32, &u32)| {
            if face == NO_FACE { View::NOTHING } else { 1.0 / inverse }
        };
        let row = |y: usize| {
            let (inverse_depths, face_idxs) = self.raster.row(y);
            inverse_depths.iter().zip(face_idxs).map(depth)
        };
        (0..camera.height).flat_map(row).collect()
    }

    fn colors(&mut self, camera: &Camera, items: &[Item]) -> Vec<[u8; 3]> {
        self.shade(items);
        self.of_faces(camera, |face_idx| self.shaded[face_idx].rgb)
    }

    fn ids(&self, camera: &Camera, items: &[Item]) -> Vec<u16> {
        let faces = self.raster.faces();
        // The first face stands for nothing, and its item is none of these.
        self.of_faces(camera, |face_idx| {
            items.get(faces[face_idx].item_idx as usize).map_or(NO_ITEM, |item| item.id)
        })
    }

    /// `value` of the face that each pixel sees.
    fn of_faces<T>(&self, camera: &Camera, value: impl Fn(usize) -> T) -> Vec<T> {
        (0..camera.height)
            .flat_map(|y| self.raster.row(y).1)
            .map(|&face_idx| value(face_idx as usize))
            .collect()
    }
}
