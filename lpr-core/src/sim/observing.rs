//! Images of a world: by the cameras of an observation, and by any camera in the channels that are
//! asked for.

mod randomization;
pub mod render;

pub use randomization::{Randomization, Sensing};

use super::world::World;
use crate::error::Result;
use crate::perception::{CAMERA_NAMES, Camera, View};
use crate::scene::Part;
use glamx::Pose3;
use randomization::noise_stream;
use render::{Capture, Channel, Detail, Item, MeshId, NO_ITEM, Renderer};

/// An image that one camera is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRequest {
    /// Name of [`Camera::by_name`].
    pub camera: String,
    /// Columns and rows, pixels; the vertical field of view is the same for every size.
    pub size: [usize; 2],
    /// Channels to be made; no other is.
    pub channels: Vec<Channel>,
}

/// The thing that a value of a mask stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskLabel<'a> {
    /// Nothing.
    Nothing,
    /// A body of the scene.
    Body {
        /// Its index in the scene.
        body: usize,
        /// Its name.
        name: &'a str,
    },
    /// A link, the hand or a finger.
    Robot {
        /// Its name.
        part: &'static str,
    },
}

impl<'a> MaskLabel<'a> {
    /// The label of `value` in masks of `world`: 0 nothing, then 1 + the index of a body, then the
    /// frames of the robot (base to link 7, hand, both fingers). `None` for a value that is in no
    /// mask.
    #[must_use]
    pub fn of(world: &'a World, value: u16) -> Option<Self> {
        let Some(idx) = usize::from(value).checked_sub(1) else { return Some(Self::Nothing) };
        let bodies = &world.spec().bodies;
        match bodies.get(idx) {
            Some(body) => Some(Self::Body { body: idx, name: &body.name }),
            None => {
                World::robot_body_names().get(idx - bodies.len()).map(|part| Self::Robot { part })
            }
        }
    }
}

/// Meshes and colours of the scene, made once an episode, and how its cameras see it.
#[derive(Debug, Clone)]
pub(super) struct Drawing {
    renderer: Renderer,
    /// Parts of each body of the scene, then of each frame of the robot.
    bodies: Vec<Vec<DrawnPart>>,
    sensing: Option<SeededSensing>,
}

#[derive(Debug, Clone)]
struct DrawnPart {
    mesh: MeshId,
    body_from_part: Pose3,
    rgb: [u8; 3],
}

#[derive(Debug, Clone)]
struct SeededSensing {
    settings: Sensing,
    seed: u64,
}

impl Drawing {
    pub(super) fn new(world: &World) -> Result<Self> {
        let mut renderer = Renderer::new(Detail::Observation);
        let bodies = meshes(world, &mut renderer)?;
        Ok(Self { renderer, bodies, sensing: None })
    }

    /// The settings of [`Self::set_sensing`], if there are any.
    pub(super) fn sensing(&self) -> Option<&Sensing> {
        self.sensing.as_ref().map(|sensing| &sensing.settings)
    }

    /// Cameras measure with noise and the scene looks otherwise from now on, as `seed` says.
    pub(super) fn set_sensing(&mut self, world: &World, settings: Sensing, seed: u64) {
        let randomization = &settings.randomization;
        self.renderer.light = randomization.light(seed);
        let n_bodies = world.spec().bodies.len();
        let built = world.scene_items().map(|(_, _, parts)| parts.to_vec());
        let built = built.chain(world.robot_items().into_iter().map(|(_, parts)| parts));
        for (idx, (drawn, built)) in self.bodies.iter_mut().zip(built).enumerate() {
            let shift = randomization.color_shift(seed, idx.min(n_bodies));
            for (drawn, part) in drawn.iter_mut().zip(built) {
                // Casts saturate.
                drawn.rgb = core::array::from_fn(|c| (f32::from(part.rgb[c]) + shift[c]) as u8);
            }
        }
        self.sensing = Some(SeededSensing { settings, seed });
    }

    /// Image of `camera` in macro action `step` (which the noise depends on), in these channels.
    pub(super) fn capture(
        &mut self,
        world: &World,
        camera: Camera,
        channels: &[Channel],
        step: usize,
    ) -> Capture {
        let items = items(world, &self.bodies);
        let Some(SeededSensing { settings: Sensing { noise, randomization }, seed }) =
            &self.sensing
        else {
            return self.renderer.capture(&camera, &items, channels, |_| {});
        };
        let known = CAMERA_NAMES.iter().position(|name| *name == camera.name);
        let camera_idx = known.unwrap_or(CAMERA_NAMES.len()) as u64;
        let camera = randomization.moved(*seed, camera_idx, camera);
        let measure = |depth: &mut [f32]| {
            noise.apply(&camera, depth, &mut noise_stream(*seed, step, camera_idx));
        };
        self.renderer.capture(&camera, &items, channels, measure)
    }

    /// As [`Self::capture`], for an observation: everything but the mask.
    pub(super) fn view(&mut self, world: &World, camera: Camera, step: usize) -> View {
        if self.sensing.is_none() {
            // Colour, depth and points in one pass over the pixels: the same numbers, sooner.
            return self.renderer.render(&camera, &items(world, &self.bodies)).view;
        }
        let channels = [Channel::Rgb, Channel::Depth, Channel::Cloud];
        let Capture { camera, rgb, depth, points, .. } =
            self.capture(world, camera, &channels, step);
        let asked = "a channel that was asked for is there";
        View {
            camera,
            rgb: rgb.expect(asked),
            depth: depth.expect(asked),
            points: points.expect(asked),
        }
    }
}

/// Items of a picture: every visible part of scene and robot, with ids as in [`MaskLabel::of`].
pub(super) fn picture_items(world: &World, renderer: &mut Renderer) -> Result<Vec<Item>> {
    Ok(items(world, &meshes(world, renderer)?))
}

/// Drawn parts of the scene's bodies, then of the robot's frames.
fn meshes(world: &World, renderer: &mut Renderer) -> Result<Vec<Vec<DrawnPart>>> {
    let scene = world.scene_items().map(|(_, _, parts)| parts.to_vec());
    let robot = world.robot_items().into_iter().map(|(_, parts)| parts);
    let mut drawn = |Part { shape, pose, rgb }: &Part| {
        Ok(DrawnPart { mesh: renderer.mesh(shape)?, body_from_part: *pose, rgb: *rgb })
    };
    scene.chain(robot).map(|parts| parts.iter().map(&mut drawn).collect()).collect()
}

/// The parts where they are now.
fn items(world: &World, bodies: &[Vec<DrawnPart>]) -> Vec<Item> {
    let poses = world.scene_items().map(|(_, pose, _)| pose).chain(world.robot_poses());
    let mut items = Vec::new();
    for (idx, (pose, parts)) in poses.zip(bodies).enumerate() {
        let id = NO_ITEM + 1 + idx as u16;
        items.extend(parts.iter().map(|DrawnPart { mesh, body_from_part, rgb }| {
            let world_from_mesh = pose * *body_from_part;
            Item { mesh: *mesh, world_from_mesh, rgb: *rgb, id }
        }));
    }
    items
}
