//! Pictures for people: smooth shading, shadows, several samples per pixel.

use super::mesh::{Detail, Mesh};
use super::palette::Transfer;
use super::raster::{Face, NO_FACE, Raster};
use super::{Item, Renderer};
use crate::perception::{Camera, View};
use glamx::{Pose3, Vec3};

/// Towards the key light, which casts shadows; not of unit length.
const TO_KEY: Vec3 = Vec3::new(0.55, -0.45, 1.0);
/// Towards the fill light, which casts none; not of unit length.
const TO_FILL: Vec3 = Vec3::new(0.3, 1.0, 0.35);
const KEY: Vec3 = Vec3::new(0.78, 0.75, 0.70);
const FILL: Vec3 = Vec3::new(0.12, 0.13, 0.16);
/// Light from above and from below.
const SKY: Vec3 = Vec3::new(0.36, 0.39, 0.43);
const GROUND: Vec3 = Vec3::new(0.17, 0.155, 0.14);
/// Strength of the key light's reflection, and how narrow it is.
const GLOSS: f32 = 0.06;
const GLOSS_SQUARINGS: u32 = 5;
/// Colours of the backdrop above and below the horizon's height in the picture, linear light.
const BACKDROP_TOP: Vec3 = Vec3::new(0.74, 0.79, 0.84);
const BACKDROP_BOTTOM: Vec3 = Vec3::new(0.90, 0.91, 0.92);

/// Distance of the shadow map's eye from what it covers, metres: far enough for nearly parallel
/// rays.
const LIGHT_DISTANCE: f32 = 12.0;
/// Rows and columns of the shadow map.
const SHADOW_SIZE: usize = 2048;
/// Items larger than this (floors, walls) are shadowed but do not widen the shadow map, metres.
const LARGE: f32 = 1.2;
/// Half width of the square of shadow-map texels that soften an edge.
const PENUMBRA: i32 = 2;

/// A picture and the depth behind it, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colour, sRGB.
    pub rgb: Vec<[u8; 3]>,
    /// Least depth along the optical axis within each pixel, metres; [`View::NOTHING`] where
    /// nothing is seen.
    pub depth: Vec<f32>,
}

/// Reach of the key light: depths seen from the light.
struct ShadowMap {
    camera: Camera,
    raster: Raster,
}

/// The scene as the shading of one sample needs it.
struct Scene<'a> {
    camera: &'a Camera,
    items: &'a [Item],
    meshes: &'a [Mesh],
    shadows: &'a ShadowMap,
    transfer: &'a Transfer,
    to_key: Vec3,
    to_fill: Vec3,
}

impl Renderer {
    /// A renderer whose meshes are fine enough for pictures.
    #[must_use]
    pub fn for_pictures() -> Self {
        Self::new(Detail::Picture)
    }

    /// A picture of `items` from `camera`, with `samples` × `samples` samples per pixel (1 to 8).
    #[must_use]
    pub fn render_picture(&mut self, camera: &Camera, items: &[Item], samples: usize) -> Picture {
        let samples = samples.clamp(1, 8);
        let fine = enlarged(camera, samples);
        self.raster.clear(&fine);
        for (idx, item) in items.iter().enumerate() {
            self.raster.draw(&fine, idx, &self.meshes[item.mesh.0], &item.world_from_mesh);
        }
        let scene = Scene {
            camera: &fine,
            items,
            meshes: &self.meshes,
            shadows: &ShadowMap::new(items, &self.meshes),
            transfer: &Transfer::new(),
            to_key: TO_KEY.normalize_or_zero(),
            to_fill: TO_FILL.normalize_or_zero(),
        };
        let mut picture = Picture {
            width: camera.width,
            height: camera.height,
            rgb: Vec::new(),
            depth: Vec::new(),
        };
        for y in 0..camera.height {
            resolve_row(&mut picture, &scene, &self.raster, y, samples);
        }
        picture
    }
}

/// The camera with `samples` times the rows and columns.
fn enlarged(camera: &Camera, samples: usize) -> Camera {
    let scale = samples as f32;
    Camera {
        fx: camera.fx * scale,
        fy: camera.fy * scale,
        cx: camera.cx * scale,
        cy: camera.cy * scale,
        width: camera.width * samples,
        height: camera.height * samples,
        ..camera.clone()
    }
}

/// Appends row `y` of the picture: the mean light of the samples.
fn resolve_row(
    picture: &mut Picture,
    scene: &Scene<'_>,
    raster: &Raster,
    y: usize,
    samples: usize,
) {
    let mut light = vec![Vec3::ZERO; picture.width];
    let mut nearest = vec![0.0_f32; picture.width];
    for fine_y in y * samples..(y + 1) * samples {
        let (inverse_depths, face_idxs) = raster.row(fine_y);
        for (x, (&inverse_depth, &face_idx)) in inverse_depths.iter().zip(face_idxs).enumerate() {
            if face_idx == NO_FACE {
                light[x / samples] += scene.backdrop(fine_y);
            } else {
                let point = scene.point(x, fine_y, 1.0 / inverse_depth);
                light[x / samples] += scene.shade(raster.faces()[face_idx as usize], point);
                nearest[x / samples] = nearest[x / samples].max(inverse_depth);
            }
        }
    }
    let share = 1.0 / (samples * samples) as f32;
    picture
        .rgb
        .extend(light.iter().map(|&light| scene.transfer.encode((light * share).to_array())));
    picture.depth.extend(
        nearest.iter().map(|&inverse| if inverse > 0.0 { 1.0 / inverse } else { View::NOTHING }),
    );
}

impl Scene<'_> {
    fn backdrop(&self, y: usize) -> Vec3 {
        BACKDROP_TOP.lerp(BACKDROP_BOTTOM, y as f32 / self.camera.height as f32)
    }

    /// The point in the world that a sample sees.
    fn point(&self, x: usize, y: usize, depth: f32) -> Vec3 {
        self.camera.unproject(glamx::Vec2::new(x as f32 + 0.5, y as f32 + 0.5), depth)
    }

    /// Light that the surface of `face` sends from `point` to the camera.
    fn shade(&self, face: Face, point: Vec3) -> Vec3 {
        let item = &self.items[face.item_idx as usize];
        let mesh = &self.meshes[item.mesh.0];
        let local = item.world_from_mesh.inverse_transform_point(point);
        let normal =
            item.world_from_mesh.rotation * mesh.smooth_normal(face.triangle_idx as usize, local);
        let facing_key = normal.dot(self.to_key).max(0.0);
        let lit = if facing_key > 0.0 { self.shadows.lit(point, normal) } else { 0.0 };
        let ambient = GROUND.lerp(SKY, 0.5 + 0.5 * normal.z);
        let light = ambient + FILL * normal.dot(self.to_fill).max(0.0) + KEY * (facing_key * lit);
        let to_eye = (self.camera.world_from_camera.translation - point).normalize_or_zero();
        let halfway = (to_eye + self.to_key).normalize_or_zero();
        let gloss =
            (0..GLOSS_SQUARINGS).fold(normal.dot(halfway).max(0.0), |value, _| value * value);
        Vec3::from_array(self.transfer.decode(item.rgb)) * light + Vec3::splat(GLOSS * lit * gloss)
    }
}

impl ShadowMap {
    fn new(items: &[Item], meshes: &[Mesh]) -> Self {
        let (center, radius) = focus(items, meshes);
        let to_key = TO_KEY.normalize_or_zero();
        let angle = 2.0 * libm::asinf((radius / LIGHT_DISTANCE).min(0.9));
        let mut camera =
            Camera::looking("key light", center + to_key * LIGHT_DISTANCE, -to_key, angle);
        camera = camera.with_size(SHADOW_SIZE, SHADOW_SIZE);
        camera.far = 4.0 * LIGHT_DISTANCE;
        let mut raster = Raster::default();
        raster.clear(&camera);
        for (idx, item) in items.iter().enumerate() {
            raster.draw(&camera, idx, &meshes[item.mesh.0], &item.world_from_mesh);
        }
        Self { camera, raster }
    }

    /// Share of the key light that reaches the surface with `normal` at `point`, 0 to 1.
    fn lit(&self, point: Vec3, normal: Vec3) -> f32 {
        // Off the surface, so that it does not shadow itself: a corner of the square is (PENUMBRA +
        // 1/2) √2 texels away.
        let texel = LIGHT_DISTANCE / self.camera.fx;
        let offset = 1.5 * (PENUMBRA as f32 + 0.5) * texel;
        let Some((image, depth)) = self.camera.project(point + normal * offset) else { return 1.0 };
        let (column, row) = (libm::floorf(image.x) as i32, libm::floorf(image.y) as i32);
        let inverse_depth = 1.0 / (depth - 0.5 * texel);
        // Nothing shadows what the map does not cover.
        let covered = |middle: i32| {
            let inside = |texel: i32| texel.clamp(0, SHADOW_SIZE as i32) as usize;
            inside(middle.saturating_sub(PENUMBRA))..inside(middle.saturating_add(PENUMBRA + 1))
        };
        let dark_in_row = |y: usize| {
            let depths = &self.raster.row(y).0[covered(column)];
            depths.iter().filter(|&&nearest| nearest > inverse_depth).count()
        };
        let n_dark: usize = covered(row).map(dark_in_row).sum();
        let n_texels = (2 * PENUMBRA + 1) * (2 * PENUMBRA + 1);
        1.0 - n_dark as f32 / n_texels as f32
    }
}

/// A ball around all items that are not large: centre and radius.
fn focus(items: &[Item], meshes: &[Mesh]) -> (Vec3, f32) {
    let reach = |item: &Item| meshes[item.mesh.0].radius;
    let small: Vec<_> = items.iter().filter(|item| reach(item) < LARGE).collect();
    let position = |pose: &Pose3| pose.translation;
    let center = small.iter().map(|item| position(&item.world_from_mesh)).sum::<Vec3>()
        / small.len().max(1) as f32;
    let radius = small.iter().fold(0.1_f32, |radius, item| {
        radius.max((position(&item.world_from_mesh) - center).length() + reach(item))
    });
    (center, radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;
    use glamx::Vec2;

    /// A cube floating over a floor, seen from the side.
    fn floating_cube() -> (Renderer, Vec<Item>, Camera) {
        let mut renderer = Renderer::for_pictures();
        let mut item = |half: Vec3, z: f32, rgb| Item {
            mesh: renderer.mesh(&Shape::Cuboid { half_extents: half }).expect("a proper shape"),
            world_from_mesh: Pose3::translation(0.0, 0.0, z),
            rgb,
            id: 1,
        };
        let items = vec![
            item(Vec3::new(1.5, 1.5, 0.01), -0.01, [200; 3]),
            item(Vec3::splat(0.05), 0.3, [180, 40, 40]),
        ];
        let camera =
            Camera::looking_at("p", Vec3::new(1.4, 0.0, 0.9), Vec3::new(0.0, 0.0, 0.1), 0.7)
                .with_size(160, 120);
        (renderer, items, camera)
    }

    fn red_at(picture: &Picture, camera: &Camera, point: Vec3) -> u8 {
        let (image, _): (Vec2, f32) = camera.project(point).expect("in front of the camera");
        picture.rgb[image.y as usize * picture.width + image.x as usize][0]
    }

    #[test]
    fn the_cube_shadows_the_floor_along_the_light_and_nowhere_else() {
        let (mut renderer, items, camera) = floating_cube();
        let picture = renderer.render_picture(&camera, &items, 2);
        let shadow = Vec3::new(0.0, 0.0, 0.3) - TO_KEY * 0.3;
        let in_shadow = red_at(&picture, &camera, shadow);
        let in_light = red_at(&picture, &camera, shadow + Vec3::new(0.0, 0.25, 0.0));
        assert!(in_light > in_shadow + 40, "{in_light} in the light, {in_shadow} in the shadow");
        let elsewhere = red_at(&picture, &camera, Vec3::new(0.1, 0.3, 0.0));
        assert!(in_light.abs_diff(elsewhere) < 8, "an even floor: {in_light} and {elsewhere}");
    }

    #[test]
    fn pictures_have_the_depth_of_observations() {
        let (mut renderer, items, camera) = floating_cube();
        let picture = renderer.render_picture(&camera, &items, 1);
        let frame = renderer.render(&camera, &items);
        assert_eq!(picture.depth, frame.view.depth);
        assert_eq!(picture.rgb.len(), camera.n_pixels());
    }
}
