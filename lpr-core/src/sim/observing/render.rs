//! A renderer for primitive shapes on the CPU: colour, depth, organised point cloud and mask of
//! what a camera sees.
//!
//! A z-buffer over flat-shaded triangles; shading is deferred, so each pixel is coloured once.
//! Nothing here knows of physics: items are meshes with poses, and walls, floor and table are items
//! like any other.

mod annotate;
mod capture;
mod font;
mod mesh;
mod palette;
mod picture;
mod raster;

pub use annotate::Stroke;
pub use capture::{Capture, Channel};
pub use mesh::Detail;
pub use palette::value_color;
pub use picture::Picture;

use crate::error::Result;
use crate::perception::{Camera, View};
use crate::scene::Shape;
use glamx::{Pose3, Vec3};
use mesh::Mesh;
use raster::{NO_FACE, Raster};

/// Colour of pixels that see nothing.
const BACKGROUND: [u8; 3] = [188, 199, 210];

/// Light of the images of observations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Towards the light, in the world; of any length but zero.
    pub to_light: Vec3,
    /// Share of a surface's colour that is seen without the light.
    pub ambient: f32,
    /// Share of a surface's colour that the light adds where it falls straight on it.
    pub intensity: f32,
}

impl Light {
    /// The light of every observation that is not randomised.
    pub const STANDARD: Self =
        Self { to_light: Vec3::new(0.45, -0.35, 0.85), ambient: 0.45, intensity: 1.0 - 0.45 };
}

/// Mask value of pixels that see nothing.
pub const NO_ITEM: u16 = 0;

/// A mesh that a [`Renderer`] holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshId(usize);

/// A mesh placed in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Item {
    /// Its geometry.
    pub mesh: MeshId,
    /// Its pose in the world.
    pub world_from_mesh: Pose3,
    /// Its colour, sRGB.
    pub rgb: [u8; 3],
    /// Value of the mask where it is seen; [`NO_ITEM`] is taken.
    pub id: u16,
}

/// A rendered view with the item that each pixel sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The part that an agent may see.
    pub view: View,
    /// [`Item::id`] of what each pixel sees, else [`NO_ITEM`].
    pub mask: Vec<u16>,
}

impl Frame {
    /// A frame in which nothing is seen yet.
    #[must_use]
    pub fn empty(camera: Camera) -> Self {
        let mask = vec![NO_ITEM; camera.n_pixels()];
        Self { view: View::empty(camera), mask }
    }
}

/// Colour and mask value of a face.
#[derive(Debug, Clone, Copy)]
struct Shaded {
    rgb: [u8; 3],
    id: u16,
}

/// Meshes of shapes, made once, and the buffers that images are drawn in.
#[derive(Debug, Clone)]
pub struct Renderer {
    /// Light of the images from now on; pictures for people have lights of their own.
    pub light: Light,
    detail: Detail,
    shapes: Vec<Shape>,
    meshes: Vec<Mesh>,
    raster: Raster,
    shaded: Vec<Shaded>,
}

impl Renderer {
    /// A renderer without meshes.
    #[must_use]
    pub fn new(detail: Detail) -> Self {
        Self {
            light: Light::STANDARD,
            detail,
            shapes: Vec::new(),
            meshes: Vec::new(),
            raster: Raster::default(),
            shaded: Vec::new(),
        }
    }

    /// The mesh of `shape`, made at the first call and shared by equal shapes.
    ///
    /// # Errors
    ///
    /// For a convex shape whose points have no hull.
    pub fn mesh(&mut self, shape: &Shape) -> Result<MeshId> {
        if let Some(idx) = self.shapes.iter().position(|known| known == shape) {
            return Ok(MeshId(idx));
        }
        self.meshes.push(Mesh::new(shape, self.detail)?);
        self.shapes.push(shape.clone());
        Ok(MeshId(self.shapes.len() - 1))
    }

    /// Number of triangles of `items`, seen or not.
    #[must_use]
    pub fn n_triangles(&self, items: &[Item]) -> usize {
        items.iter().map(|item| self.meshes[item.mesh.0].triangles.len()).sum()
    }

    /// Renders `items` for `camera`; their meshes are this renderer's.
    #[must_use]
    pub fn render(&mut self, camera: &Camera, items: &[Item]) -> Frame {
        let mut frame = Frame::empty(camera.clone());
        self.render_into(&mut frame, items);
        frame
    }

    /// Renders `items` for the frame's camera, in place of what it saw before.
    pub fn render_into(&mut self, frame: &mut Frame, items: &[Item]) {
        self.draw(&frame.view.camera, items);
        self.shade(items);
        self.resolve(frame);
    }

    /// Fills the buffers with what `camera` sees of `items`.
    fn draw(&mut self, camera: &Camera, items: &[Item]) {
        self.raster.clear(camera);
        for (idx, item) in items.iter().enumerate() {
            self.raster.draw(camera, idx, &self.meshes[item.mesh.0], &item.world_from_mesh);
        }
    }

    /// Colours the faces that pixels may see.
    fn shade(&mut self, items: &[Item]) {
        let to_light = self.light.to_light.normalize_or_zero();
        self.shaded.clear();
        self.shaded.push(Shaded { rgb: BACKGROUND, id: NO_ITEM });
        let mut light_of = (u32::MAX, Vec3::ZERO);
        for face in &self.raster.faces()[1..] {
            let item = &items[face.item_idx as usize];
            if light_of.0 != face.item_idx {
                light_of = (face.item_idx, item.world_from_mesh.rotation.inverse() * to_light);
            }
            let normal = self.meshes[item.mesh.0].normals[face.triangle_idx as usize];
            let brightness =
                self.light.ambient + self.light.intensity * normal.dot(light_of.1).max(0.0);
            let rgb = item.rgb.map(|channel| (f32::from(channel) * brightness) as u8);
            self.shaded.push(Shaded { rgb, id: item.id });
        }
    }

    /// Turns faces and inverse depths into colours, depths, points and mask.
    fn resolve(&self, frame: &mut Frame) {
        let Frame { view: View { camera, rgb, depth, points }, mask } = frame;
        let origin = camera.world_from_camera.translation;
        let rotation = camera.world_from_camera.rotation;
        let ray_per_column = rotation * Vec3::new(1.0 / camera.fx, 0.0, 0.0);
        for y in 0..camera.height {
            let (inverse_depths, face_idxs) = self.raster.row(y);
            let left = Vec3::new(
                (0.5 - camera.cx) / camera.fx,
                (y as f32 + 0.5 - camera.cy) / camera.fy,
                1.0,
            );
            let ray_left = rotation * left;
            let row = y * camera.width..(y + 1) * camera.width;
            let outputs = rgb[row.clone()].iter_mut().zip(&mut mask[row.clone()]);
            let outputs = outputs.zip(&mut depth[row.clone()]).zip(&mut points[row]);
            for (x, (((rgb, mask), depth), point)) in outputs.enumerate() {
                let shaded = self.shaded[face_idxs[x] as usize];
                *rgb = shaded.rgb;
                *mask = shaded.id;
                let z = 1.0 / inverse_depths[x];
                let seen = origin + (ray_left + ray_per_column * x as f32) * z;
                let nothing = face_idxs[x] == NO_FACE;
                *depth = if nothing { View::NOTHING } else { z };
                *point = if nothing { Vec3::INFINITY } else { seen };
            }
        }
    }
}

#[cfg(test)]
mod tests;
