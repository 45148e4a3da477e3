//! A picture of an arm as the planner sees it.

use super::super::failure::Result;
use crate::images;
use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::perception::Camera;
use lpr_core::robot::Robot;
use lpr_core::scene::Shape;
use lpr_core::sim::render::{Item, Renderer};
use std::path::{Path, PathBuf};

/// Size of the picture, pixels.
const SIZE: [usize; 2] = [960, 720];
/// Samples of a pixel along each side.
const SAMPLES: usize = 2;
/// Colours of links in turns, sRGB.
const COLORS: [[u8; 3]; 6] = [
    [226, 232, 240],
    [96, 165, 250],
    [251, 146, 60],
    [134, 239, 172],
    [244, 114, 182],
    [250, 204, 21],
];
const FLOOR: [u8; 3] = [214, 211, 209];

pub(super) fn parse_png(text: &str) -> Result<PathBuf, String> {
    match text.to_ascii_lowercase().ends_with(".png") {
        true => Ok(text.into()),
        false => Err("expected a name that ends in .png".to_owned()),
    }
}

/// Draws the spheres of the arm in the middle of its ranges, each link in a colour of its own.
pub(super) fn draw(path: &Path, robot: &Robot) -> Result<()> {
    let mut renderer = Renderer::for_pictures();
    let frames = robot.body_frames(&robot.start);
    let mut items = Vec::new();
    let (mut low, mut high) = (Vec3::splat(-0.1), Vec3::splat(0.1));
    let solid = robot.links.iter().filter(|link| !link.spheres.is_empty());
    for (idx, link) in solid.enumerate() {
        for sphere in link.spheres_in_body() {
            let center = (frames[link.body] * sphere.center.as_dvec3()).as_vec3();
            low = low.min(center - sphere.radius);
            high = high.max(center + sphere.radius);
            items.push(Item {
                mesh: renderer.mesh(&Shape::Sphere { radius: sphere.radius })?,
                world_from_mesh: Pose3::from_parts(center, Quat::IDENTITY),
                rgb: COLORS[idx % COLORS.len()],
                id: idx as u16,
            });
        }
    }
    let (middle, size) = (0.5 * (low + high), (high - low).length().max(0.2));
    let floor = Shape::Cuboid { half_extents: Vec3::new(2.0 * size, 2.0 * size, 0.005) };
    items.push(Item {
        mesh: renderer.mesh(&floor)?,
        world_from_mesh: Pose3::from_parts(
            Vec3::new(middle.x, middle.y, low.z.min(0.0) - 0.005),
            Quat::IDENTITY,
        ),
        rgb: FLOOR,
        id: u16::MAX - 1,
    });
    let from = middle + size * Vec3::new(1.0, -0.9, 0.6);
    let camera = Camera::looking_at("portrait", from, middle, 40_f32.to_radians())
        .with_size(SIZE[0], SIZE[1]);
    let picture = renderer.render_picture(&camera, &items, SAMPLES);
    Ok(images::write_png(path, SIZE[0] as u32, SIZE[1] as u32, &picture.rgb)?)
}
